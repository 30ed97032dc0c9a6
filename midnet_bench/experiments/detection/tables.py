"""The paper's detection table from a campaign's results: ours, the paper's, and how sure ours is.

Section V.A defines tp as the boxes that intersect an intruder, and fp as the others. It explains the fp of
five robots by one intruder taken for several, whose boxes all intersect it: both cannot hold (item 43).
Second boxes on one intruder are counted both ways.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.compare import tidy
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.statistics import distance
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.analysis.words import team_in_words
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.detection.error_tables import error_tables
from midnet_bench.experiments.guarded.metric_tables import metric_measures, metric_tables
from midnet_bench.scoring.frame_counts import Ratios, TruePositives, ratios


class Team(NamedTuple):
    """The cell of a detection campaign: the team's size, and in words what else it differs by."""

    robots: int
    others: str = ""

    def __str__(self) -> str:
        """``5-robot, oracle=window``, as tables have it."""
        return ", ".join(filter(None, (f"{self.robots}-robot", self.others)))


PAPER: Mapping[Team, Row] = {
    Team(1): {"tp": 6967, "fp": 176, "fn": 1889, "precision": 0.975, "recall": 0.787, "f1": 0.871},
    Team(5): {"tp": 14953, "fp": 1047, "fn": 619, "precision": 0.935, "recall": 0.960, "f1": 0.947},
}
"""The paper's only table."""
PAPER_FRAMES = 1999
PAPER_ARENA = "map1"

SCORES = ("precision", "recall", "f1")
COUNTS = ("tp", "fp", "fn")
TP_BOXES: TruePositives = "every"
"""of results that do not have the option"""
COUNTINGS: Mapping[TruePositives, str] = {
    "every": "each box on an intruder is a true positive, as section V.A defines it",
    "surplus_false": "one box on each intruder is a true positive and a second one false, as section V.A "
    "explains the false positives of five robots",
}
"""value of ``tp_boxes`` -> its meaning"""

Cells = Mapping[Team, pd.DataFrame]
"""The rows of the table ``scores`` by cell, seeds ascending"""
BESIDE = ("f1_one_to_one", "gospa_per_frame_m")
"""measures that the paper does not have"""
SHOWN = (*SCORES, "f1_one_to_one")
HEADS = {"trial": "", "source": "", "f1": "F1", "f1_one_to_one": "F1 one-to-one"}
"""the scores that a reader sees first, and what stands above them"""
MANY_DUPLICATES = 0.05
"""share of the true positives from which a note says so"""


def tables(results: Results) -> list[Table]:
    """The tables of a detection campaign."""
    cells, paper = cells_of(results), paper_of(results.definition)
    return [
        summary_table(cells, window_notes(results.definition), paper),
        table_to_paste(cells, paper),
        scores_table(cells),
        matching_table(cells),
        comparison_table(cells, paper),
        counting_table(cells, paper),
        *distance_tables(cells, paper),
        by_seed_table(cells),
        *metric_tables(results),
        *error_tables(results),
    ]


def cells_of(results: Results) -> Cells:
    """The scores of each cell's finished trials, in the campaign's order, without the grid's columns.

    With them stand ``boxes``, ``f1_one_to_one``, ``gospa_per_frame_m`` and
    ``collisions`` of the trial's robots.
    """
    scores = trials_of(results)
    if scores.empty:
        return {}
    robots, others = results.column(scores, "robots").tolist(), results.other_factors(scores, "robots")
    teams = [Team(*one) for one in zip(robots, others, strict=True)]
    rows = scores.drop(columns=results.factors)
    return {team: rows[[one == team for one in teams]] for team in dict.fromkeys(teams)}


def trials_of(results: Results) -> pd.DataFrame:
    """The table ``scores`` with the columns that :func:`cells_of` names; empty without a finished trial."""
    scores = results.table("scores")
    if scores.empty:
        return scores
    keys = [*results.factors, "seed"]
    scores = with_boxes(results, scores)
    if not (fleet := results.table("robots")).empty:
        scores = scores.join(fleet.groupby(keys, sort=False)["collisions"].sum(), on=keys)
    return scores.assign(gospa_per_frame_m=scores["gospa_m"] / scores["frames"])


def window_notes(definition: Definition) -> list[str]:
    """A sentence for each local costmap of the campaign that ends before the usable range does."""
    given = {**{name: [value] for name, value in definition.parameters.items()}, **definition.grid}
    oracles, sizes, ranges = (given.get(name, []) for name in ("oracle", "local_size_m", "obstacle_range_m"))
    if oracles and set(oracles) <= {"window", "sight"}:  # whose costmaps hold the whole range
        return []
    return [
        f"The {size_m:g} m local costmap ends {size_m / 2.0:g} m ahead; the usable range is {range_m:g} m: "
        "objects in between are missed."
        for size_m, range_m in itertools.product(sizes, ranges)
        if isinstance(size_m, int | float) and isinstance(range_m, int | float) and size_m / 2.0 < range_m
    ]


def summary_table(cells: Cells, notes: Sequence[str] = (), paper: Mapping[Team, Row] = PAPER) -> Table:
    """The paper's table: counts and ratios over all frames, means over seeds, and the paper's row.

    One-to-one F1 and GOSPA stand beside them, since the paper's way of counting rewards boxes that should
    have been fused.
    """
    rows: list[Mapping[str, Cell]] = []
    notes = [*notes] if cells else []
    for row, (name, cell) in zip(scores_table(cells).rows, cells.items(), strict=True):
        pooled: dict[str, Cell] = {"f1_one_to_one": matched_ratios(cell).f1}
        pooled["gospa_per_frame_m"] = statistics.exact_sum(cell["gospa_m"]) / sum(cell["frames"])
        if "collisions" in cell:
            pooled["collisions_per_trial"] = sum(cell["collisions"]) / len(cell)
        rows.append({"trial": str(name), "source": "ours", "seeds": len(cell), **row, **pooled})
        if len(cell) > 1:
            means = {score: score_over_seeds(cell, score) for score in (*SCORES, *BESIDE)}
            rows.append({"trial": str(name), "source": "mean over seeds", "seeds": len(cell), **means})
        if name in paper:
            rows.append({"trial": str(name), "source": "paper", "frames": PAPER_FRAMES, **paper[name]})
        notes += _note_on_duplicates(name, cell)
    both = ", ours and the paper's" if paper.keys() & cells.keys() else ""
    title = f"Detection scores{both} ({statistics.MEAN_METHOD}, over seeds)"
    return Table("detection_summary", title, rows, {"collisions_per_trial": 2}, notes=notes)


def table_to_paste(cells: Cells, paper: Mapping[Team, Row] = PAPER) -> Table:
    """``detection_table``: ours with intervals and the paper's row, for a paper (LaTeX) or a page."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        means = {score: score_over_seeds(cell, score) for score in SHOWN}
        rows.append({"trial": team_in_words(str(name)), "source": "ours", "seeds": len(cell), **means})
        if name in paper:
            printed = {score: paper[name][score] for score in SCORES}
            rows.append({"trial": "", "source": "paper", **printed})
    title = "Detection scores, means over seeds with 95 % t intervals"
    return Table("detection_table", title, rows, labels=HEADS)


def _note_on_duplicates(name: Team, cell: pd.DataFrame) -> list[str]:
    """A sentence if a good part of the true positives are further boxes on intruders that have one."""
    found = sum(cell["tp"])
    further = (found - sum(cell["matched"])) / found if found else 0.0
    if further <= MANY_DUPLICATES:
        return []
    return [
        f"{name}: {further:.0%} of tp are further boxes on an intruder that has one. By the paper's "
        "definition they are true, by its explanation of false positives false: see detection_counting."
    ]


def scores_table(cells: Cells) -> Table:
    """A row per cell: counts summed over its seeds, ratios of the sums (Eqs. 8 to 10)."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        counts = {key: sum(cell[key]) for key in ("frames", "tp", "fp", "fn")}
        scored = ratios(counts["tp"], counts["fp"], counts["fn"])
        rows.append({"trial": str(name), **counts, **scored._asdict()})
    return Table("detection_scores", "Detection scores", rows)


def matching_table(cells: Cells) -> Table:
    """The same frames by one-to-one matching: an intruder is found once, further boxes are false."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        matched, duplicates, missed = (sum(cell[key]) for key in ("matched", "duplicates", "missed"))
        scored = matched_ratios(cell)
        error_m = statistics.exact_sum(cell["error_sum_m"]) / matched if matched else math.nan
        counts = {"matched": matched, "duplicates": duplicates, "missed": missed}
        rows.append({"trial": str(name), **counts, **scored._asdict(), "mean_error_m": error_m})
    return Table("detection_matching", "Same trials, counting one box per intruder", rows)


def matched_ratios(cell: pd.DataFrame) -> Ratios:
    """Precision, recall and F1 by one-to-one matching, of a cell's summed counts."""
    matched = sum(cell["matched"])
    return ratios(matched, sum(cell["boxes"]) - matched, sum(cell["missed"]))


def by_seed_table(cells: Cells) -> Table:
    """A row per cell and seed."""
    rows: list[Mapping[str, Cell]] = [
        {"trial": str(name), **row} for name, cell in cells.items() for row in records(cell)
    ]
    return Table("scores_by_seed", "Scores by seed", rows)


def comparison_table(cells: Cells, paper: Mapping[Team, Row] = PAPER) -> Table:
    """Ours beside the paper's: means over seeds with 95 % intervals, and the difference."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        for score in SCORES:
            ours = score_over_seeds(cell, score)
            papers = float(paper[name][score] or 0.0) if name in paper else math.nan
            difference = ours.value - papers
            rows.append(
                {"trial": str(name), "score": score, "ours": ours, "paper": papers, "difference": difference}
            )
    title = f"Means over seeds and the paper's scores ({statistics.MEAN_METHOD})"
    return Table("detection_comparison", title, rows, bounds={"ours": ("low", "high", "seeds")})


def score_over_seeds(cell: pd.DataFrame, score: str, confidence: float = 0.95) -> statistics.Estimate:
    """The mean of one score over a cell's trials, and its interval; ratios stay between 0 and 1."""
    most = math.inf if score.endswith("_m") else 1.0
    return statistics.mean(cell[score].tolist(), confidence, within=(0.0, most))


def measures(results: Results) -> pd.DataFrame:
    """Precision, recall and F1, one-to-one F1, GOSPA and further metrics of each trial, a frame of scores."""
    trials = trials_of(results)
    if trials.empty:
        return pd.DataFrame()
    trials = trials.assign(robots=results.column(trials, "robots"))
    scores = tidy(trials, [*dict.fromkeys([*results.factors, "robots"])], [*SCORES, *BESIDE])
    return pd.concat([scores, metric_measures(results)])


def by_seed(cell: pd.DataFrame, score: str) -> dict[int, float]:
    """One column of a cell's trials by seed."""
    return dict(zip(cell["seed"].tolist(), cell[score].tolist(), strict=True))


def paper_of(definition: Definition) -> Mapping[Team, Row]:
    """The paper's table for a campaign in Map 1; empty for any other arena: the paper scores none there."""
    arenas = definition.grid.get("arena") or [definition.parameters.get("arena", PAPER_ARENA)]
    return PAPER if {*arenas} == {PAPER_ARENA} else {}


def with_boxes(results: Results, scores: pd.DataFrame) -> pd.DataFrame:
    """The trials with ``boxes``, the team's boxes however ``tp_boxes`` counts them, and ``f1_one_to_one``."""
    is_in_fp = results.column(scores, "tp_boxes", TP_BOXES) == "surplus_false"
    boxes = scores["matched"] + scores["fp"] + scores["duplicates"] * (1 - is_in_fp)
    counts = zip(scores["matched"].tolist(), boxes.tolist(), scores["missed"].tolist(), strict=True)
    return scores.assign(
        boxes=boxes,
        f1_one_to_one=[ratios(matched, all_of - matched, fn).f1 for matched, all_of, fn in counts],
    )


def counted(cell: pd.DataFrame, counting: TruePositives) -> pd.DataFrame:
    """A cell's trials with tp, fp and their ratios by one of the two countings; fn is the same in both."""
    tp = cell["matched"] + (cell["duplicates"] if counting == "every" else 0)
    cell = cell.assign(tp=tp, fp=cell["boxes"] - tp)
    scored = [ratios(*counts)._asdict() for counts in cell[[*COUNTS]].to_numpy().tolist()]
    return cell.assign(**{score: [one[score] for one in scored] for score in SCORES})


def counting_table(cells: Cells, paper: Mapping[Team, Row] = PAPER) -> Table:
    """A row per cell and counting, and the paper's: means of the ratios over seeds, and counts per frame."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        for counting in COUNTINGS:
            trials = counted(cell, counting)
            means = {score: statistics.mean(trials[score].tolist(), within=(0.0, 1.0)) for score in SCORES}
            sums = {count: sum(trials[count]) for count in COUNTS}
            rows.append(
                {"trial": str(name), "counting": counting, **means, **_per_frame(sums, sum(cell["frames"]))}
            )
        if name in paper:
            printed = {score: paper[name][score] for score in SCORES}
            row = {"trial": str(name), "counting": "paper", **printed}
            rows.append({**row, **_per_frame(paper[name], PAPER_FRAMES)})
    notes = [f"{counting}: {meaning}." for counting, meaning in COUNTINGS.items()]
    title = f"Two ways of counting second boxes on one intruder ({statistics.MEAN_METHOD}, over seeds)"
    return Table("detection_counting", title, rows, notes=notes)


def _per_frame(counts: Mapping[str, Cell], frames: float) -> dict[str, Cell]:
    tp, fp, fn = (float(str(counts[count])) / frames for count in COUNTS)
    return {"tp_per_frame": tp, "fp_per_frame": fp, "fn_per_frame": fn, "boxes_per_frame": tp + fp}


def distance_tables(cells: Cells, paper: Mapping[Team, Row] = PAPER) -> list[Table]:
    """``detection_distance``: how far both teams are from the paper's table, and how sure that is.

    The distance is the root mean square of differences, ours less the paper's, each a mean over the seeds
    that both teams have. ``six ratios`` are precision, recall and F1 of both teams. ``all twelve`` are those
    and tp, fp and fn per frame, whose differences are shares of the paper's tp + fn per frame of that team.
    The interval is the percentile bootstrap's over the seeds. No table without both of the paper's teams.
    """
    if not paper or not paper.keys() <= cells.keys():
        return []
    rows: list[Mapping[str, Cell]] = []
    for counting in COUNTINGS:
        parts = [_differences(name, counted(cells[name], counting)) for name in PAPER]
        twelve = pd.concat(parts, axis=1, join="inner")
        for what, numbers in (("six ratios", twelve[[*SCORES]]), ("all twelve", twelve)):
            value, least, most = distance(numbers.to_numpy(np.float64))
            row: dict[str, Cell] = {"counting": counting, "numbers": what, "distance": value}
            rows.append({**row, "least_without_a_seed": least, "most_without_a_seed": most})
    digits = {"distance": 4, "least_without_a_seed": 4, "most_without_a_seed": 4}
    title = "Distance from the paper's table (root mean square; 95 % intervals: bootstrap of the seeds)"
    bounds = {"distance": ("low", "high", "seeds")}
    return [Table("detection_distance", title, rows, digits, bounds=bounds)]


def _differences(team: Team, trials: pd.DataFrame) -> pd.DataFrame:
    """(seeds, 6) by seed: ours less the paper's, ratios before counts."""
    paper = {key: float(value or 0.0) for key, value in PAPER[team].items()}
    to_find = paper["tp"] + paper["fn"]
    by_seed = trials.set_index("seed")
    off = {score: by_seed[score] - paper[score] for score in SCORES}
    return pd.DataFrame(
        off
        | {
            count: (by_seed[count] / by_seed["frames"] * PAPER_FRAMES - paper[count]) / to_find
            for count in COUNTS
        }
    )
