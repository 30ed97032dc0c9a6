"""The paper's detection table from a campaign's results: ours, the paper's, and how sure ours is."""

import math
from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.claims import Finding, comparison
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.experiment import Measures
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import ratios

PAPER: Mapping[str, Row] = {
    "1-robot": {"tp": 6967, "fp": 176, "fn": 1889, "precision": 0.975, "recall": 0.787, "f1": 0.871},
    "5-robot": {"tp": 14953, "fp": 1047, "fn": 619, "precision": 0.935, "recall": 0.960, "f1": 0.947},
}
"""The paper's only table."""
PAPER_FRAMES = 1999
TOLERANCE = 0.05
"""how near a mean counts as the paper's"""

SCORES = ("precision", "recall", "f1")

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
    ]


def cells_of(results: Results) -> Cells:
    """The scores of each cell's finished trials, in the campaign's order, without the grid's columns."""
    scores = results.table("scores")
    if scores.empty:
        return {}
    robots = results.column(scores, "robots")
    names = [
        f"{size}-robot{', ' if others else ''}{others}"
        for size, others in zip(robots, results.others(scores, "robots"), strict=True)
    ]
    cells = scores.drop(columns=results.factors).groupby(pd.Series(names, scores.index), sort=False)
    return {str(name): cell for name, cell in cells}


def summary_table(cells: Cells) -> Table:
    """The paper's table: counts and ratios over all frames, means over seeds, and the paper's row."""
    rows: list[Mapping[str, Cell]] = []
    for row, (name, cell) in zip(scores_table(cells).rows, cells.items(), strict=True):
        rows.append({"trial": name, "source": "ours", "seeds": len(cell), **row})
        if len(cell) > 1:
            means = {score: score_over_seeds(cell, score) for score in SCORES}
            rows.append({"trial": name, "source": "mean over seeds", "seeds": len(cell), **means})
        if name in PAPER:
            rows.append({"trial": name, "source": "paper", "frames": PAPER_FRAMES, **PAPER[name]})
    both = ", ours and the paper's" if PAPER.keys() & cells.keys() else ""
    return Table("detection_summary", f"Detection scores{both} (95 % intervals over seeds)", rows)


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
        scored = ratios(matched, sum(cell["fp"]) + duplicates, missed)
        error_m = sum(cell["error_sum_m"]) / matched if matched else math.nan
        counts = {"matched": matched, "duplicates": duplicates, "missed": missed}
        rows.append({"trial": name, **counts, **scored._asdict(), "mean_error_m": error_m})
    return Table("detection_matching", "One-to-one matching: further boxes on one intruder are false", rows)


def by_seed_table(cells: Cells) -> Table:
    """A row per cell and seed."""
    rows: list[Mapping[str, Cell]] = [
        {"trial": name, **row} for name, cell in cells.items() for row in records(cell)
    ]
    return Table("scores_by_seed", "Scores by seed", rows)


def comparison_table(cells: Cells) -> Table:
    """Ours beside the paper's: means over seeds with 95 % bootstrap intervals, and the difference."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        for score in SCORES:
            ours = score_over_seeds(cell, score)
            paper = float(PAPER[name][score] or 0.0) if name in PAPER else math.nan
            difference = ours.value - paper
            rows.append(
                {"trial": name, "score": score, "ours": ours, "paper": paper, "difference": difference}
            )
    title = "Means over seeds and the paper's scores (95 % intervals)"
    return Table("detection_comparison", title, rows, bounds={"ours": ("low", "high", "seeds")})


def score_over_seeds(cell: pd.DataFrame, score: str) -> statistics.Estimate:
    """The mean of one score over a cell's trials and its interval; the bootstrap has a seed of its own."""
    return statistics.mean(cell[score].tolist(), stream(0, "bootstrap", score))


def claims(results: Results) -> list[Finding]:
    """The six means of the paper's table, and which team is ahead in each score."""
    cells = cells_of(results)
    found = []
    for name, paper in PAPER.items():
        for score in SCORES if name in cells else ():
            value = float(paper[score] or 0.0)
            ours = score_over_seeds(cells[name], score)
            statement = f"{name} {score} is {value:.3f}, within {TOLERANCE}"
            found.append(Finding(statement, ours, value - TOLERANCE, value + TOLERANCE))
    if PAPER.keys() <= cells.keys():
        for score, rises in (("recall", True), ("precision", False), ("f1", True)):
            one, five = (_by_seed(cells[name].dropna(subset=[score]), score) for name in PAPER)
            statement = f"{score} {'rises' if rises else 'falls'} from 1 to 5 robots"
            found.append(comparison(statement, one, five, rises, score))
    return found


def measures(results: Results) -> Measures:
    """Precision, recall and F1 of each cell by seed."""
    return {
        (name, score): _by_seed(cell, score) for name, cell in cells_of(results).items() for score in SCORES
    }


def _by_seed(cell: pd.DataFrame, score: str) -> dict[int, float]:
    return dict(zip(cell["seed"].tolist(), cell[score].tolist(), strict=True))
