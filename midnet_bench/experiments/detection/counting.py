"""Second boxes on one intruder: counted as true and as false positives, and how near each is to the paper.

Section V.A defines tp as the boxes that intersect an intruder, and fp as the others. It explains the fp of
five robots by one intruder taken for several, whose boxes all intersect it: both cannot hold (item 43).
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from midnet_bench.analysis.distance import distance
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.trial import Row
from midnet_bench.scoring.frame_counts import TruePositives, ratios


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
            means = {score: mean(trials[score].tolist(), within=(0.0, 1.0)) for score in SCORES}
            sums = {count: sum(trials[count]) for count in COUNTS}
            rows.append(
                {"trial": str(name), "counting": counting, **means, **_per_frame(sums, sum(cell["frames"]))}
            )
        if name in paper:
            printed = {score: paper[name][score] for score in SCORES}
            row = {"trial": str(name), "counting": "paper", **printed}
            rows.append({**row, **_per_frame(paper[name], PAPER_FRAMES)})
    notes = [f"{counting}: {meaning}." for counting, meaning in COUNTINGS.items()]
    title = f"Two ways of counting second boxes on one intruder ({MEAN_METHOD}, over seeds)"
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
