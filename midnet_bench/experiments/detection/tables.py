"""The paper's detection table from a campaign's results: ours, the paper's, and how sure ours is."""

import math
from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.detection.error_tables import error_tables
from midnet_bench.experiments.experiment import Measures
from midnet_bench.experiments.guarded.metric_tables import metric_measures, metric_tables
from midnet_bench.scoring.frame_counts import Ratios, ratios

PAPER: Mapping[str, Row] = {
    "1-robot": {"tp": 6967, "fp": 176, "fn": 1889, "precision": 0.975, "recall": 0.787, "f1": 0.871},
    "5-robot": {"tp": 14953, "fp": 1047, "fn": 619, "precision": 0.935, "recall": 0.960, "f1": 0.947},
}
"""The paper's only table."""
PAPER_FRAMES = 1999

SCORES = ("precision", "recall", "f1")
BESIDE = ("f1_one_to_one", "gospa_per_frame_m")
"""measures that the paper does not have"""
MANY_DUPLICATES = 0.05
"""share of the true positives from which a note says so"""

Cells = Mapping[str, pd.DataFrame]
"""The rows of the table ``scores`` by cell, named in the paper's manner (``5-robot``), seeds ascending"""


def tables(results: Results) -> list[Table]:
    """The tables of a detection campaign."""
    cells = cells_of(results)
    return [
        summary_table(cells),
        scores_table(cells),
        matching_table(cells),
        comparison_table(cells),
        by_seed_table(cells),
        *metric_tables(results),
        *error_tables(results),
    ]


def cells_of(results: Results) -> Cells:
    """The scores of each cell's finished trials, in the campaign's order, without the grid's columns.

    With them stand ``f1_one_to_one``, ``gospa_per_frame_m`` (of results that have it) and ``collisions`` of
    the trial's robots.
    """
    scores = results.table("scores")
    if scores.empty:
        return {}
    names = results.teams(scores)
    place = [*results.factors, "seed"]
    scores = scores.assign(f1_one_to_one=one_to_one(scores))
    if not (fleet := results.table("robots")).empty:
        scores = scores.join(fleet.groupby(place, sort=False)["collisions"].sum(), on=place)
    if "gospa_m" in scores:  # not in results of versions up to 0.1.0
        scores = scores.assign(gospa_per_frame_m=scores["gospa_m"] / scores["frames"])
    cells = scores.drop(columns=results.factors).groupby(pd.Series(names, scores.index), sort=False)
    return {str(name): cell for name, cell in cells}


def one_to_one(scores: pd.DataFrame) -> list[float]:
    """F1 of each trial by one-to-one matching."""
    columns = (scores[name].tolist() for name in ("matched", "fp", "duplicates", "missed"))
    return [
        ratios(matched, fp + duplicates, missed).f1
        for matched, fp, duplicates, missed in zip(*columns, strict=True)
    ]


def summary_table(cells: Cells) -> Table:
    """The paper's table: counts and ratios over all frames, means over seeds, and the paper's row.

    One-to-one F1 and GOSPA stand beside them, since the paper's way of counting rewards boxes that should
    have been fused.
    """
    rows: list[Mapping[str, Cell]] = []
    notes = []
    for row, (name, cell) in zip(scores_table(cells).rows, cells.items(), strict=True):
        pooled: dict[str, Cell] = {"f1_one_to_one": matched_ratios(cell).f1}
        if "gospa_m" in cell:
            pooled["gospa_per_frame_m"] = statistics.exact_sum(cell["gospa_m"]) / sum(cell["frames"])
        if "collisions" in cell:
            pooled["collisions_per_trial"] = sum(cell["collisions"]) / len(cell)
        rows.append({"trial": name, "source": "ours", "seeds": len(cell), **row, **pooled})
        if len(cell) > 1:
            beside = [score for score in BESIDE if score in cell]
            means = {score: score_over_seeds(cell, score) for score in (*SCORES, *beside)}
            rows.append({"trial": name, "source": "mean over seeds", "seeds": len(cell), **means})
        if name in PAPER:
            rows.append({"trial": name, "source": "paper", "frames": PAPER_FRAMES, **PAPER[name]})
        notes += _note_on_duplicates(name, cell)
    both = ", ours and the paper's" if PAPER.keys() & cells.keys() else ""
    title = f"Detection scores{both} ({statistics.MEAN_METHOD}, over seeds)"
    return Table("detection_summary", title, rows, {"collisions_per_trial": 2}, notes=notes)


def _note_on_duplicates(name: str, cell: pd.DataFrame) -> list[str]:
    """A sentence if a good part of the true positives are further boxes on intruders that have one."""
    found = sum(cell["tp"])
    further = (found - sum(cell["matched"])) / found if found else 0.0
    if further <= MANY_DUPLICATES:
        return []
    return [
        f"{name}: {further:.0%} of tp are further boxes on an intruder that has one. The paper's count takes "
        "them for true, one-to-one F1 for false."
    ]


def scores_table(cells: Cells) -> Table:
    """A row per cell: counts summed over its seeds, ratios of the sums (Eqs. 8 to 10)."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        counts = {key: sum(cell[key]) for key in ("frames", "tp", "fp", "fn")}
        scored = ratios(counts["tp"], counts["fp"], counts["fn"])
        rows.append({"trial": name, **counts, **scored._asdict()})
    return Table("detection_scores", "Detection scores", rows)


def matching_table(cells: Cells) -> Table:
    """The same frames by one-to-one matching: an intruder is found once, further boxes are false."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        matched, duplicates, missed = (sum(cell[key]) for key in ("matched", "duplicates", "missed"))
        scored = matched_ratios(cell)
        error_m = statistics.exact_sum(cell["error_sum_m"]) / matched if matched else math.nan
        counts = {"matched": matched, "duplicates": duplicates, "missed": missed}
        rows.append({"trial": name, **counts, **scored._asdict(), "mean_error_m": error_m})
    return Table("detection_matching", "One-to-one matching: further boxes on one intruder are false", rows)


def matched_ratios(cell: pd.DataFrame) -> Ratios:
    """Precision, recall and F1 by one-to-one matching, of a cell's summed counts."""
    false = sum(cell["fp"]) + sum(cell["duplicates"])
    return ratios(sum(cell["matched"]), false, sum(cell["missed"]))


def by_seed_table(cells: Cells) -> Table:
    """A row per cell and seed."""
    rows: list[Mapping[str, Cell]] = [
        {"trial": name, **row} for name, cell in cells.items() for row in records(cell)
    ]
    return Table("scores_by_seed", "Scores by seed", rows)


def comparison_table(cells: Cells) -> Table:
    """Ours beside the paper's: means over seeds with 95 % intervals, and the difference."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        for score in SCORES:
            ours = score_over_seeds(cell, score)
            paper = float(PAPER[name][score] or 0.0) if name in PAPER else math.nan
            difference = ours.value - paper
            rows.append(
                {"trial": name, "score": score, "ours": ours, "paper": paper, "difference": difference}
            )
    title = f"Means over seeds and the paper's scores ({statistics.MEAN_METHOD})"
    return Table("detection_comparison", title, rows, bounds={"ours": ("low", "high", "seeds")})


def score_over_seeds(cell: pd.DataFrame, score: str, confidence: float = 0.95) -> statistics.Estimate:
    """The mean of one score over a cell's trials, and its interval; ratios stay between 0 and 1."""
    most = math.inf if score.endswith("_m") else 1.0
    return statistics.mean(cell[score].tolist(), confidence, within=(0.0, most))


def measures(results: Results) -> Measures:
    """Precision, recall and F1, one-to-one F1, GOSPA and further metrics of each cell by seed."""
    scores = {
        (name, score): by_seed(cell, score)
        for name, cell in cells_of(results).items()
        for score in (*SCORES, *BESIDE)
        if score in cell
    }
    return {**scores, **metric_measures(results)}


def by_seed(cell: pd.DataFrame, score: str) -> dict[int, float]:
    """One column of a cell's trials by seed."""
    return dict(zip(cell["seed"].tolist(), cell[score].tolist(), strict=True))
