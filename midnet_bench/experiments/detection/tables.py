"""The paper's detection table from a campaign's results: ours, the paper's, and how sure ours is.

Section V.A defines tp as the boxes that intersect an intruder, and fp as the others. It explains the fp of
five robots by one intruder taken for several, whose boxes all intersect it: both cannot hold (item 43).
Second boxes on one intruder are counted both ways.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.compare import tidy
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.statistics import (
    MEAN_METHOD,
    NOT_NEGATIVE,
    Estimate,
    Range,
    distance,
    exact_sum,
    prediction,
)
from midnet_bench.analysis.tables import Cell, Table, team_in_words
from midnet_bench.campaign.definition import Definition
from midnet_bench.experiments.guarded.tables import (
    METRICS,
    error_tables,
    metric_measures,
    metric_tables,
    usable_range,
)
from midnet_bench.scoring.frame_counts import TruePositives, ratios


class Team(NamedTuple):
    """The cell of a detection campaign: the team's size, and in words what else it differs by."""

    robots: int
    others: str = ""

    def __str__(self) -> str:
        """``5-robot, oracle=window``, as tables have it."""
        return ", ".join(filter(None, (f"{self.robots}-robot", self.others)))


SCORES = ("precision", "recall", "f1")
COUNTS = ("tp", "fp", "fn")
PAPER: Mapping[Team, Mapping[str, float]] = {  # The paper's only table.
    Team(1): {"tp": 6967, "fp": 176, "fn": 1889, "precision": 0.975, "recall": 0.787, "f1": 0.871},
    Team(5): {"tp": 14953, "fp": 1047, "fn": 619, "precision": 0.935, "recall": 0.960, "f1": 0.947},
}
PAPER_FRAMES = 1999
PAPER_ARENA = "map1"

TP_BOXES: TruePositives = "every"  # of results that do not have the option
COUNTINGS: Mapping[TruePositives, str] = {  # value of ``tp_boxes`` -> its meaning
    "every": "each box on an intruder is a true positive, as section V.A defines it",
    "surplus_false": "one box on each intruder is a true positive and a second one false, as section V.A "
    "explains the false positives of five robots",
}
BESIDE = ("f1_one_to_one", "gospa_per_frame_m")  # measures that the paper does not have
SHOWN = (*SCORES, "f1_one_to_one")
HEADS = {"trial": "", "source": "", "f1": "F1", "f1_one_to_one": "F1 one-to-one"}
"""the scores that a reader sees first, and what stands above them"""
MANY_DUPLICATES = 0.05  # share of the true positives from which a note says so


class PaperNumber(NamedTuple):
    """A number of the paper's table."""

    ours: list[float]  # by trial
    paper: float
    within: Range  # the least and the greatest value that it can have


@dataclass(frozen=True)
class Trials:
    """The finished trials of one cell."""

    rows: pd.DataFrame
    """The rows of the table ``scores``, seeds ascending, without the grid's columns; with ``boxes``,
    ``f1_one_to_one``, ``gospa_per_frame_m`` and ``collisions`` of the trial's robots."""
    paper: Mapping[str, float] | None = None  # the paper's row of such a team, in the paper's arena

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def has_scores(self) -> bool:
        """Whether some intruder was found or missed; else no ratio but precision is defined."""
        return bool(self.total("tp") + self.total("fn"))

    def total(self, column: str) -> float:
        """Of a column over the seeds; exact, a whole number where the column has such."""
        return exact_sum(self.rows[column]) if column.endswith("_m") else sum(self.rows[column])

    @cached_property
    def means(self) -> dict[str, Estimate]:
        """Score -> its mean over the seeds, with its interval; ratios stay between 0 and 1."""
        names = [name for name in (*SCORES, *BESIDE) if name in self.rows]
        values = {name: self.rows[name].tolist() for name in names}
        limits = {name: (0.0, math.inf if name.endswith("_m") else 1.0) for name in names}
        return {name: statistics.mean(values[name], within=limits[name]) for name in names}

    def estimates(self, scores: Sequence[str]) -> dict[str, Cell]:
        """The means of several scores."""
        return {score: self.means[score] for score in scores}

    def numbers(self) -> dict[str, PaperNumber]:
        """The numbers of the paper's table: its ratios, and its counts per frame; NaN without its row."""
        paper = dict.fromkeys((*SCORES, *COUNTS), math.nan) if self.paper is None else self.paper
        rows = self.rows
        ratios_of = {name: PaperNumber(rows[name].tolist(), paper[name], (0.0, 1.0)) for name in SCORES}
        return ratios_of | {
            f"{name}_per_frame": PaperNumber(
                (rows[name] / rows["frames"]).tolist(), paper[name] / PAPER_FRAMES, NOT_NEGATIVE
            )
            for name in COUNTS
        }

    def by_seed(self, column: str) -> dict[int, float]:
        """One column by seed."""
        return dict(zip(self.rows["seed"].tolist(), self.rows[column].tolist(), strict=True))

    @cached_property
    def matched_ratios(self) -> dict[str, float]:
        """Precision, recall and F1 by one-to-one matching, of the summed counts."""
        matched = self.total("matched")
        return ratios(matched, self.total("boxes") - matched, self.total("missed"))._asdict()

    def counted(self, counting: TruePositives) -> "Trials":
        """With tp, fp and their ratios by one of the two countings; fn is the same in both."""
        tp = self.rows["matched"] + (self.rows["duplicates"] if counting == "every" else 0)
        rows = self.rows.assign(tp=tp, fp=self.rows["boxes"] - tp)
        scored = [ratios(*counts)._asdict() for counts in rows[[*COUNTS]].to_numpy().tolist()]
        return replace(self, rows=rows.assign(**{score: [one[score] for one in scored] for score in SCORES}))


Cells = Mapping[Team, Trials]
Rows = Iterator[Mapping[str, Cell]]


def tables(results: Results) -> list[Table]:
    """The tables of a detection campaign."""
    cells = cells_of(results)
    return [
        *own_tables(cells, window_notes(results.definition)),
        *distance_tables(cells),
        _table("scores_by_seed", "Scores by seed", cells, _by_seed),
        *(metric_tables(results) if METRICS in results.tables else ()),
        *error_tables(results),
    ]


def own_tables(cells: Cells, notes: Sequence[str] = ()) -> list[Table]:
    """Those that have rows for each cell; ``notes`` stand below the first."""
    both = ", ours and the paper's" * any(cell.paper is not None for cell in cells.values())
    duplicates = itertools.chain.from_iterable(map(_note_on_duplicates, cells, cells.values()))
    return [
        _table(
            "detection_summary",
            f"Detection scores{both} ({MEAN_METHOD}, over seeds)",
            cells,
            _summary,
            digits={"collisions_per_trial": 2},
            notes=[*(notes if any(cell.has_scores for cell in cells.values()) else ()), *duplicates],
        ),
        _table(
            "detection_table",
            "Detection scores, means over seeds with 95 % t intervals",
            cells,
            _to_paste,
            labels=HEADS,
        ),
        _table("detection_scores", "Detection scores", cells, _scores),
        _table("detection_matching", "Same trials, counting one box per intruder", cells, _matching),
        _table(
            "detection_comparison",
            f"Means over seeds and the paper's scores ({MEAN_METHOD}; run: 95 % prediction interval of one "
            "further run, Student's t)",
            cells,
            _comparison,
            digits={"p_value": 4},
            bounds={"ours": ("low", "high", "seeds")},
        ),
        _table(
            "detection_counting",
            f"Two ways of counting second boxes on one intruder ({MEAN_METHOD}, over seeds)",
            cells,
            _counting,
            notes=[f"{counting}: {meaning}." for counting, meaning in COUNTINGS.items()],
        ),
    ]


def _table(name: str, title: str, cells: Cells, rows_of: Any, **more: Any) -> Table:
    rows = [row for team, cell in cells.items() for row in rows_of(team, cell)]
    return Table(name, title, rows, **more)


def _scores(team: Team, cell: Trials) -> Rows:
    """Counts summed over seeds, ratios of the sums (Eqs. 8 to 10)."""
    counts = {key: cell.total(key) for key in ("frames", *COUNTS)}
    yield {"trial": str(team), **counts, **ratios(*(counts[key] for key in COUNTS))._asdict()}


def _summary(team: Team, cell: Trials) -> Rows:
    """The paper's table: counts and ratios over all frames, means over seeds, and the paper's row.

    One-to-one F1 and GOSPA stand beside them, since the paper's way of counting rewards boxes that should
    have been fused.
    """
    pooled: dict[str, Cell] = {"f1_one_to_one": cell.matched_ratios["f1"]}
    pooled["gospa_per_frame_m"] = cell.total("gospa_m") / cell.total("frames")
    if "collisions" in cell.rows:
        pooled["collisions_per_trial"] = cell.total("collisions") / len(cell)
    (scored,) = _scores(team, cell)
    yield {"trial": str(team), "source": "ours", "seeds": len(cell), **scored, **pooled}
    if len(cell) > 1:
        means = cell.estimates((*SCORES, *BESIDE))
        yield {"trial": str(team), "source": "mean over seeds", "seeds": len(cell), **means}
    if cell.paper is not None:
        yield {"trial": str(team), "source": "paper", "frames": PAPER_FRAMES, **cell.paper}


def _note_on_duplicates(team: Team, cell: Trials) -> list[str]:
    """A sentence if a good part of the true positives are further boxes on intruders that have one."""
    found = cell.total("tp")
    further = (found - cell.total("matched")) / found if found else 0.0
    if further <= MANY_DUPLICATES:
        return []
    return [
        f"{team}: {further:.0%} of tp are further boxes on an intruder that has one. By the paper's "
        "definition they are true, by its explanation of false positives false: see detection_counting."
    ]


def _to_paste(team: Team, cell: Trials) -> Rows:
    """Ours with intervals and the paper's row, for a paper (LaTeX) or a page."""
    yield {"trial": team_in_words(str(team)), "source": "ours", "seeds": len(cell), **cell.estimates(SHOWN)}
    if cell.paper is not None:
        yield {"trial": "", "source": "paper", **{score: cell.paper[score] for score in SCORES}}


def _matching(team: Team, cell: Trials) -> Rows:
    """The same frames by one-to-one matching: an intruder is found once, further boxes are false."""
    counts = {key: cell.total(key) for key in ("matched", "duplicates", "missed")}
    matched = counts["matched"]
    error_m = cell.total("error_sum_m") / matched if matched else math.nan
    yield {"trial": str(team), **counts, **cell.matched_ratios, "mean_error_m": error_m}


def _comparison(team: Team, cell: Trials) -> Rows:
    """Ours beside the paper's: means over seeds with 95 % intervals, and the difference.

    Beside them stands where one further run of ours lies, and the p of the paper's among our runs.
    """
    for score, (values, paper, within) in cell.numbers().items():
        ours, (run, p) = statistics.mean(values, within=within), prediction(values, paper, within=within)
        yield {
            "trial": str(team),
            "score": score,
            "ours": ours,
            "paper": paper,
            "difference": ours.value - paper,
            "run_low": run.low,
            "run_high": run.high,
            "p_value": p,
        }


def _counting(team: Team, cell: Trials) -> Rows:
    """By each counting and the paper's: means of the ratios over seeds, and counts per frame."""
    for counting in COUNTINGS:
        trials = cell.counted(counting)
        sums = {count: trials.total(count) for count in COUNTS}
        row = {"trial": str(team), "counting": counting, **trials.estimates(SCORES)}
        yield {**row, **_per_frame(sums, cell.total("frames"))}
    if cell.paper is not None:
        printed = {score: cell.paper[score] for score in SCORES}
        yield {"trial": str(team), "counting": "paper", **printed, **_per_frame(cell.paper, PAPER_FRAMES)}


def _per_frame(counts: Mapping[str, float], frames: float) -> dict[str, Cell]:
    tp, fp, fn = (counts[count] / frames for count in COUNTS)
    return {"tp_per_frame": tp, "fp_per_frame": fp, "fn_per_frame": fn, "boxes_per_frame": tp + fp}


def _by_seed(team: Team, cell: Trials) -> Rows:
    for row in records(cell.rows):
        yield {"trial": str(team), **row}


def distance_tables(cells: Cells) -> list[Table]:
    """``detection_distance``: how far both teams are from the paper's table, and how sure that is.

    The distance is the root mean square of differences, ours less the paper's, each a mean over the seeds
    that both teams have. ``six ratios`` are precision, recall and F1 of both teams. ``all twelve`` are those
    and tp, fp and fn per frame, whose differences are shares of the paper's tp + fn per frame of that team.
    The interval is the percentile bootstrap's over the seeds. No table without both of the paper's teams.
    """
    teams = [cells[team] for team in PAPER if team in cells and cells[team].paper is not None]
    if len(teams) < len(PAPER):
        return []
    rows: list[Mapping[str, Cell]] = []
    for counting in COUNTINGS:
        parts = [_differences(cell.counted(counting)) for cell in teams]
        twelve = pd.concat(parts, axis=1, join="inner")
        for what, numbers in (("six ratios", twelve[[*SCORES]]), ("all twelve", twelve)):
            value, least, most = distance(numbers.to_numpy(np.float64))
            row: dict[str, Cell] = {"counting": counting, "numbers": what, "distance": value}
            rows.append({**row, "least_without_a_seed": least, "most_without_a_seed": most})
    digits = dict.fromkeys(("distance", "least_without_a_seed", "most_without_a_seed"), 4)
    title = "Distance from the paper's table (root mean square; 95 % intervals: bootstrap of the seeds)"
    bounds = {"distance": ("low", "high", "seeds")}
    return [Table("detection_distance", title, rows, digits, bounds=bounds)]


def _differences(cell: Trials) -> pd.DataFrame:
    """(seeds, 6) by seed: ours less the paper's, ratios before counts."""
    paper, seeds = cell.paper or {}, cell.rows.set_index("seed")
    to_find = paper["tp"] + paper["fn"]
    off = {score: seeds[score] - paper[score] for score in SCORES}
    for count in COUNTS:
        off[count] = (seeds[count] / seeds["frames"] * PAPER_FRAMES - paper[count]) / to_find
    return pd.DataFrame(off)


@lru_cache(maxsize=2)  # what a report is made of, and the packaged reference beside it
def cells_of(results: Results) -> Mapping[Team, Trials]:
    """Each cell's finished trials, in the campaign's order."""
    scores = trials_of(results)
    if scores.empty:
        return {}
    robots, others = results.column(scores, "robots").tolist(), results.other_factors(scores, "robots")
    teams = [Team(*one) for one in zip(robots, others, strict=True)]
    known = [name for name in results.factors if name != "frames"]  # which the table has of itself, too
    rows, paper = scores.drop(columns=known), paper_of(results.definition)
    return {
        team: Trials(rows[[one == team for one in teams]], paper.get(team)) for team in dict.fromkeys(teams)
    }


def trials_of(results: Results) -> pd.DataFrame:
    """The table ``scores`` with the columns that :class:`Trials` has; empty without a finished trial."""
    scores = results.table("scores")
    if scores.empty:
        return scores
    keys = [*results.factors, "seed"]
    scores = with_boxes(results, scores)
    if not (fleet := results.table("robots")).empty:
        scores = scores.join(fleet.groupby(keys, sort=False)["collisions"].sum(), on=keys)
    return scores.assign(gospa_per_frame_m=scores["gospa_m"] / scores["frames"])


def with_boxes(results: Results, scores: pd.DataFrame) -> pd.DataFrame:
    """The trials with ``boxes``, the team's boxes however ``tp_boxes`` counts them, and ``f1_one_to_one``."""
    is_in_fp = results.column(scores, "tp_boxes", TP_BOXES) == "surplus_false"
    boxes = scores["matched"] + scores["fp"] + scores["duplicates"] * (1 - is_in_fp)
    counts = zip(scores["matched"].tolist(), boxes.tolist(), scores["missed"].tolist(), strict=True)
    return scores.assign(
        boxes=boxes,
        f1_one_to_one=[ratios(matched, all_of - matched, fn).f1 for matched, all_of, fn in counts],
    )


def window_notes(definition: Definition) -> list[str]:
    """A sentence for each local costmap of the campaign that ends before the usable range does."""
    given = {**{name: [value] for name, value in definition.parameters.items()}, **definition.grid}
    oracles, sizes, ranges = (given.get(name, []) for name in ("oracle", "local_size_m", "obstacle_range_m"))
    if oracles and set(oracles) <= {"window", "sight"}:  # whose costmaps hold the whole range
        return []
    return [
        f"The {size_m:g} m local costmap ends {size_m / 2.0:g} m ahead; the usable range is {range_m:g} m: "
        "objects in between are missed."
        for size_m, asked_m in itertools.product(sizes, ranges)
        for range_m in [usable_range({**definition.parameters, "obstacle_range_m": asked_m})]
        if isinstance(size_m, int | float) and isinstance(range_m, int | float) and size_m / 2.0 < range_m
    ]


def measures(results: Results) -> pd.DataFrame:
    """Precision, recall and F1, one-to-one F1, GOSPA and further metrics of each trial, a frame of scores."""
    trials = trials_of(results)
    if trials.empty:
        return pd.DataFrame()
    trials = trials.assign(robots=results.column(trials, "robots"))
    scores = tidy(trials, [*dict.fromkeys([*results.factors, "robots"])], [*SCORES, *BESIDE])
    return pd.concat([scores, metric_measures(results)])


def paper_of(definition: Definition) -> Mapping[Team, Mapping[str, float]]:
    """The paper's table for a campaign in Map 1; empty for any other arena: the paper scores none there."""
    arenas = definition.grid.get("arena") or [definition.parameters.get("arena", PAPER_ARENA)]
    return PAPER if {*arenas} == {PAPER_ARENA} else {}
