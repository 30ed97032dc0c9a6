"""What pages quote of the committed results: for ``python -m benchmarks.recount``.

A quote is a page, the words with a format specification for each number, and how the numbers are computed
from the files under ``results/reference`` or ``docs/studies/data``. Intervals are those of the tables.
"""

import functools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.recount import ROOT, Quote
from midnet_bench.analysis import statistics
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.scoring.frame_counts import ratios

REFERENCE, DATA = ROOT / "results/reference", ROOT / "docs/studies/data"
README, RESULTS = "README.md", "results/README.md"
ERRORS, RIVALS_PAGE = "docs/studies/errors.md", "docs/studies/rivals.md"
ROBUSTNESS, CALIBRATION = "docs/studies/robustness.md", "docs/studies/calibration.md"
DURATION = "docs/studies/duration.md"
MISSES = ("outside_window", "merged", "occluded_outside_window", "occluded", "pose_error")
FALSE = (
    "intruder_trail",
    "ally_trail",
    "ally_left",
    "misplaced_by_pose",
    "misplaced_by_crop",
    "misplaced_by_noise",
    "stale",
)
ORACLES = {
    "outside_window": "window",
    "fragment": "fusion",
    "merged": "fusion",
    "intruder_trail": "marks",
    "ally_trail": "marks",
}
COMMANDS = {
    "detection": "run detection-report",
    "detection-edge": "run detection-edge",
    "no-intruders": "run no-intruders",
    "labyrinth": "run labyrinth-report",
    "pursuit": "run pursuit",
    "improved": "run improved",
    "best": "run best",
    "rivals-labyrinth": "run rivals-labyrinth",
    "ablation": "run ablation",
    "people": "run people",
    "robustness": "run robustness",
    "mapping": "run mapping",
    "readings-main": "run readings-main",
}
"""folder -> command in the table of ``results/README.md``"""
TEAMS = ("1-robot", "5-robot")
SCORES = ("precision", "recall", "f1")


class Number(NamedTuple):
    """A number with its interval, printed as ``0.987 [0.984, 0.990]``; bold where it is told from 0."""

    value: float
    low: float = math.nan
    high: float = math.nan
    bold: bool = False

    def __format__(self, form: str) -> str:
        text = format(self.value, form)
        if not math.isnan(self.low):
            inner = form.lstrip("+")
            text += f" [{format(self.low, inner)}, {format(self.high, inner)}]"
        return f"**{text}**" if self.bold else text


def to_bare(engine: str) -> float:
    """How many times the speed of bare PyBullet a whole trial has, of 30 steps a second."""
    page = (ROOT / "benchmarks/results/standing.md").read_text(encoding="utf-8")
    found = re.search(rf"whole trial, `{engine}` \|[^|]*\| \*\*([\d.]+)\*\*", page)
    assert found is not None, engine
    return float(found[1])


def of(estimate: Estimate, factor: float = 1.0) -> Number:
    return Number(estimate.value * factor, estimate.low * factor, estimate.high * factor)


class Identical:
    """Stands for a difference where every score is the same."""

    def __format__(self, form: str) -> str:
        return "identical"


IDENTICAL = Identical()


# the files


@functools.cache
def table(name: str) -> pd.DataFrame:
    """``detection/scores_by_seed`` of the references, or ``data/duration`` of the studies."""
    path = DATA / f"{name[5:]}.csv" if name.startswith("data/") else REFERENCE / f"{name}.csv"
    return pd.read_csv(path)


def rows(name: str, **where: object) -> pd.DataFrame:
    """Rows of a table in which each column named has its value."""
    found = table(name)
    for column, value in where.items():
        found = found[found[column] == value]
    if found.empty:
        raise LookupError(f"{name}.csv: no row with {where}")
    return found


def value(name: str, column: str, **where: object) -> Any:
    """The one cell."""
    (cell,) = rows(name, **where)[column]
    return cell


def number(name: str, column: str, **where: object) -> Number:
    """The one cell with the interval beside it."""
    (row,) = rows(name, **where).to_dict("records")
    low, high = (f"{column}_low", f"{column}_high") if f"{column}_low" in row else ("low", "high")
    return Number(row[column], row[low], row[high], row.get("verdict") in {"better", "worse"})


def seeds(folder: str) -> tuple[int, int]:
    """The first and the last one."""
    found = table(f"{folder}/timing")["seed"]
    return int(found.min()), int(found.max())


def total(name: str, column: str, **where: object) -> float:
    return float(rows(name, **where)[column].sum())


def pooled(name: str, part: str, whole: str, **where: object) -> float:
    """Sum over sum, of all seeds."""
    return total(name, part, **where) / total(name, whole, **where)


def by_seed(name: str, column: str, **where: object) -> "pd.Series[float]":
    """The mean of each seed."""
    return rows(name, **where).groupby("seed")[column].mean()


def over_seeds(values: "pd.Series[float]") -> Number:
    return of(statistics.mean(list(values)))


@functools.cache
def ranks(folder: str) -> list[tuple[str, dict[str, str]]]:
    """Rows of ``leaderboard.md``, which ``compare --rank`` writes: what is ranked by, and the cells."""
    found: list[tuple[str, dict[str, str]]] = []
    measure, heads = "", list[str]()
    for line in (REFERENCE / folder / "leaderboard.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("## Ranked by "):
            measure, heads = re.split(", the (?:highest|lowest) first", line)[0][len("## Ranked by ") :], []
        elif line.startswith("|") and not heads:
            heads = cells
        elif line.startswith("|") and ":" not in cells[0]:
            found.append((measure, dict(zip(heads, cells, strict=True))))
    return found


def rank(folder: str, measure: str, column: str = "difference", **where: str) -> Number:
    """A cell of ``leaderboard.md``; a difference is bold where Holm's verdict is better or worse."""
    (row,) = [
        row
        for ranked, row in ranks(folder)
        if ranked == measure and all(row[name] == cell for name, cell in where.items())
    ]
    parts = [float(part) for part in re.findall(r"-?[\d.]+", row[column])]
    return Number(*parts, bold=column == "difference" and row["verdict"] in {"better", "worse"})


def ceiling(number: float, digits: int) -> float:
    """The bound that the number is within, at so many digits."""
    return math.ceil(number * 10**digits - 1e-9) / 10**digits


# the detection test


def score(team: str, counting: str = "every", folder: str = "detection") -> list[Number]:
    """Precision, recall, F1."""
    return [number(f"{folder}/detection_counting", name, trial=team, counting=counting) for name in SCORES]


def one_to_one(team: str, folder: str = "detection") -> Number:
    return number(f"{folder}/detection_summary", "f1_one_to_one", trial=team, source="mean over seeds")


def per_frame(counting: str, *teams: str) -> list[float]:
    names = [f"{count}_per_frame" for count in ("tp", "fp", "fn")]
    cells = {team: rows("detection/detection_counting", trial=team, counting=counting) for team in teams}
    return [float(cells[team][name].iloc[0]) for team in teams for name in names]


def largest_gap() -> float:
    """The bound of the six ratios' differences from the paper's."""
    return ceiling(max(map(abs, ratio_gaps())), 3)


def ratio_gaps() -> list[float]:
    """The differences of the six ratios from the paper's."""
    frame = table("detection/detection_comparison")
    return list(frame[frame["score"].isin(SCORES)]["difference"])


def change(column: str) -> Number:
    """Of the means over seeds, from one robot to five."""
    one, five = (by_seed("detection/scores_by_seed", column, trial=team) for team in TEAMS)
    return of(statistics.paired_difference(list(one), list(five), within=(0.0, 1.0)))


def fall() -> Number:
    """Of precision, as a positive number."""
    value, low, high, _ = change("precision")
    return Number(-value, -high, -low)


def near_the_paper() -> list[int]:
    """Ratios within 0.02 of the paper's, counts per frame within 10 %, numbers in the range of our runs."""
    ours, papers = per_frame("every", *TEAMS), per_frame("paper", *TEAMS)
    close = [abs(one / other - 1.0) <= 0.1 for one, other in zip(ours, papers, strict=True)]
    numbers = table("detection/detection_comparison")
    within = (numbers["run_low"] <= numbers["paper"]) & (numbers["paper"] <= numbers["run_high"])
    return [sum(abs(gap) <= 0.02 for gap in ratio_gaps()), sum(close), int(within.sum())]


def fp_range() -> list[float]:
    """Where one further run of ours has one robot's false positives per frame, in 95 % of cases."""
    row = rows("detection/detection_comparison", trial=TEAMS[0], score="fp_per_frame").iloc[0]
    return [row["run_low"], row["run_high"]]


def distances() -> list[float | Number]:
    """From the paper's table: six ratios with interval and range, all twelve, and two other countings."""
    name = "detection/detection_distance"
    (row,) = rows(name, counting="every", numbers="six ratios").to_dict("records")
    return [
        number(name, "distance", counting="every", numbers="six ratios"),
        row["least_without_a_seed"],
        row["most_without_a_seed"],
        number(name, "distance", counting="every", numbers="all twelve"),
        value(name, "distance", counting="surplus_false", numbers="six ratios"),
        value("detection-edge/detection_distance", "distance", counting="every", numbers="six ratios"),
    ]


def pursued_targets(variant: str) -> list[float]:
    """Targets, those that were no intruder and their share, the share of guards' time, intruders caught."""
    sums = rows("data/false-targets", variant=variant).sum(numeric_only=True)
    targets, false = int(sums["targets"]), int(sums["false_targets"])
    return [
        targets,
        false,
        false / targets,
        sums["false_target_s"] / sums["guard_s"],
        int(sums["caught"]),
    ]


def motion() -> list[float]:
    """Metres driven on average and at least, the longest time stuck, collisions a trial, walls crossed."""
    frame = rows("detection/robots", robots=5)
    collisions = frame.groupby("seed")["collisions"].sum().mean()
    return [
        frame["distance_m"].mean(),
        frame["distance_m"].min(),
        frame["stuck_s"].max(),
        collisions,
        total("detection/robots", "walls_crossed"),
    ]


def detection_seeds() -> int:
    first, last = seeds("detection")
    return last - first + 1


def ordered_seeds() -> int:
    """Seeds in which recall and F1 rise from one robot to five, and precision falls."""
    frame = table("detection/scores_by_seed").pivot(index="seed", columns="trial", values=[*SCORES])
    rises = {name: frame[name, TEAMS[1]] > frame[name, TEAMS[0]] for name in SCORES}
    return int((rises["recall"] & rises["f1"] & ~rises["precision"]).sum())


def misses(part: str, team: str) -> float:
    """A share of all misses of all seeds."""
    return pooled("detection/scores_by_seed", part, "fn", trial=team)


def hidden_in_window() -> Number:
    frame = rows("detection/scores_by_seed", trial=TEAMS[0])
    inside = list(frame["fn"] - frame["fn_outside_window"])
    return of(statistics.ratio_of_sums(list(frame["fn_hidden_in_window"]), inside, within=(0.0, 1.0)))


def claims(folder: str) -> list[Any]:
    """How many claims there are, and how many have each verdict."""
    verdicts = table(f"{folder}/claims")["verdict"].value_counts()
    plural = {"holds": "hold", "does not hold": "do not hold"}
    return [
        verdicts.sum(),
        ", ".join(
            f"{count} {plural.get(str(verdict), verdict) if count > 1 else verdict}"
            for verdict, count in verdicts.items()
        ),
    ]


def empty_arena() -> Number:
    """False positives of five guards in 200 frames."""
    frame = rows("no-intruders/scores", robots=5)
    return of(statistics.mean(list(200.0 * frame["fp"] / frame["frames"])))


def team_shares() -> list[float]:
    """Five robots' frames with overlapping boxes; of those looked at, those that the order changes."""
    name = "detection/scores_by_seed"
    return [
        pooled(name, "overlapping", "frames", trial=TEAMS[1]),
        pooled(name, "reordered", "looked_at", trial=TEAMS[1]),
    ]


def ours(part: str) -> list[int]:
    """Of the table of sources in the page of readings: choices of ours, all values, options that are off."""
    text = (ROOT / "midnet_bench/docs/readings.md").read_text(encoding="utf-8")
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    (heads,) = [cells for cells in lines if cells[:2] == ["source", "all"]]
    kinds = {cells[0]: cells for cells in lines if len(cells) == len(heads)}
    found = [
        next(int(cells[heads.index(part)]) for kind, cells in kinds.items() if kind.startswith(name))
        for name in ("`ours`", "sum", "`ours: off`")
    ]
    return found


def boxes(counting: str) -> float:
    """Per frame, of five robots."""
    return float(value("detection/detection_counting", "boxes_per_frame", trial="5-robot", counting=counting))


# the labyrinth


CELL = ["intruders", "robots", "seed"]


def caught(folder: str = "labyrinth", **where: object) -> list[Number]:
    """Percent of the intruders, by team size."""
    name = f"{folder}/success_rate"
    columns = [column for column in table(name).columns if re.fullmatch(r"\d+ robots?", column)]
    return [number(name, column, **{"intruders": "all", **where}) for column in columns]


def curve_falls(first: int, second: int) -> int:
    """Curves, one for each number of intruders, that fall between two team sizes."""
    frame = table("labyrinth/success_rate")
    frame = frame[frame["intruders"].astype(str) != "all"]
    return int((frame[f"{second} robots"] < frame[f"{first} robots"]).sum())


def rise(first: int, second: int) -> Number:
    """Points by which the rate changes between two team sizes, over all intruders, paired by seed."""
    low, high = (by_seed("labyrinth/trial", "success_rate", robots=robots) for robots in (first, second))
    return of(statistics.paired_difference(list(low), list(high), within=(0.0, 100.0)))


def pursuit_difference() -> Number:
    """Points, boxes alone less ground-truth targets, over all cells, paired by seed."""
    oracle, nearest = (
        by_seed("pursuit/trial", "success_rate", pursuit=name) for name in ("oracle", "nearest")
    )
    return of(statistics.paired_difference(list(oracle), list(nearest), within=(0.0, 100.0)))


def duration() -> Number:
    """Mean seconds of a trial."""
    return over_seeds(by_seed("labyrinth/trial", "duration_s"))


def false_targets() -> list[float]:
    false, targets = (total("labyrinth/trial", name) for name in ("ghost_targets", "targets"))
    return [int(false), int(targets), false / targets]


def guards() -> list[float]:
    """Share of the time stuck, the worst guard's, goals given up, all goals, collisions, recoveries."""
    trials = table("labyrinth/trial")[[*CELL, "duration_s"]]
    frame = rows("labyrinth/robots", role="guard").merge(trials, on=CELL)
    given_up = int(frame["goals_given_up"].sum())
    return [
        frame["stuck_s"].sum() / frame["duration_s"].sum(),
        (frame["stuck_s"] / frame["duration_s"]).max(),
        given_up,
        given_up + int(frame["goals_reached"].sum()),
        int(frame["collisions"].sum()),
        int(frame["recoveries"].sum()),
    ]


def stuck_intruders() -> list[float]:
    """The share of them that is ever stuck, and the mean time."""
    stuck_s = rows("labyrinth/robots", role="intruder")["stuck_s"]
    return [float((stuck_s > 0.0).mean()), stuck_s.mean()]


# mapping


def explorations() -> list[float]:
    maps = table("mapping/maps")
    return [
        len(maps),
        int(maps["finished"].sum()),
        int((maps["coverage"] >= 0.98).sum()),
        100.0 * maps["coverage"].min(),
    ]


def map_row(arena: str, robots: int) -> list[float]:
    means = {
        name: float(rows(f"mapping/{name}", arena=arena, robots=robots).iloc[0][column])
        for name, column in (("mapping", "covered_percent"),)
    }
    where = {"arena": arena, "robots": robots}
    worst = [
        value("mapping/mapping_measures", "worst", measure=f"occupied_{name}", **where)
        for name in ("precision", "recall")
    ]
    mean = [value("mapping/mapping_walls", f"occupied_{name}", **where) for name in ("precision", "recall")]
    error_cm = value("mapping/mapping_walls", "wall_error_cm", **where)
    time_s, driven_m = (value("mapping/mapping", name, **where) for name in ("time_s", "distance_m"))
    return [means["mapping"], mean[0], worst[0], mean[1], worst[1], error_cm, time_s, driven_m]


def gaps(arena: str) -> list[float]:
    """Maps with a gap in a wall, all maps, the mean length among those with a gap, the greatest, metres."""
    lengths = table("mapping/gaps").query(f"arena == {arena!r}").groupby(["robots", "seed"])["length_m"].sum()
    return [len(lengths), len(rows("mapping/maps", arena=arena)), lengths.mean(), lengths.max()]


def speed_up(arena: str, robots: int) -> Number:
    return number("mapping/mapping_speedup", "time_ratio", arena=arena, robots=robots)


def chosen(arena: str) -> list[float]:
    (row,) = rows("mapping/mapping_choice", arena=arena, choice="chosen").to_dict("records")
    return [row["robots"], row["seed"], row["occupied_f1"], 100.0 * row["wall_error_m"]]


# other readings


def reading(**where: object) -> list[float]:
    """Precision, recall and F1 of one robot and of five, means over seeds."""
    found: list[float] = []
    for robots in (1, 5):
        frame = rows("readings-main/scores", robots=robots, **where)
        found += [statistics.mean(list(frame[name])).value for name in SCORES]
    return found


def reading_extremes() -> list[float]:
    """Recall of one robot at both ends of the window; precision that falls; the largest other change."""
    usual = reading(variant="none")
    others = ("stationary_scale 0.5", "stationary_scale 2", "iou_fuse 0.03")
    moved = [abs(a - b) for variant in others for a, b in zip(reading(variant=variant), usual, strict=True)]
    windows = [reading(variant=f"local_size_m {size}")[1] for size in ("2.5", "10")]
    return [*windows, reading(variant="inf_is_valid false")[3], ceiling(max(moved), 3)]


PURSUED = {
    "the same with t 0.1": "t 0.1, boxes on guards are targets",
    "boxes on guards are targets": "t 0.03, boxes on guards are targets",
    "none": "t 0.03, they are not (default)",
}
"""variants of ``campaigns/false-targets.yaml`` -> their words on the page"""
FURTHER_RUNS = {
    "a further run: normal": "normal",
    "beta(95, 5), a precision": "beta(95, 5), a precision",
    "beta(20, 0.5), nearly all at 1": "beta(20, 0.5), nearly all at 1",
    "a precision near 0.95, skewed": "a precision near 0.95, skewed",
    "clustered counts": "clustered counts: Poisson of gamma(4)",
    "lognormal": "lognormal(0.5)",
    "exponential": "exponential",
}
"""samples of which one further run is foretold -> their words on the page"""
ROW = "{:.3f} | {:.3f} | {:.3f} | {:.3f} |"
OTHER_READINGS = {
    "none changed": "none",
    'local costmap 2.5 m wide: "6.25 m2" (V.B)': "local_size_m 2.5",
    "local costmap 5 m wide: twice the usable range (IV.B.1)": "local_size_m 5",
    "local costmap 10 m wide: costmap_2d's default": "local_size_m 10",
    "a beam without a return clears nothing: costmap_2d's default": "inf_is_valid false",
    "large intruders half as large": "stationary_scale 0.5",
    "large intruders twice as large": "stationary_scale 2",
    "t of the fusion 0.03, one t for Algorithms 2 to 4": "iou_fuse 0.03",
}
"""row of the table in ``results/README.md`` -> variant of ``campaigns/readings-main.yaml``"""

# studies


def recorded(team: str, kind: str, cause: str) -> Number:
    """A cause's share of the errors of its kind, the mean over seeds; 0 where it has none."""
    name, where = "errors/error_causes", {"trial": f"{team}, oracle=none", "kind": kind, "cause": cause}
    frame = table(name)
    if not (frame[list(where)] == pd.Series(where)).all(axis=1).any():
        return Number(0.0)
    return number(name, "mean_share", **where)


def recorded_errors(team: str, kind: str) -> int:
    return int(total("errors/error_causes", "errors", trial=f"{team}, oracle=none", kind=kind))


def unexplained() -> list[int]:
    """All errors without an oracle, and those without a cause."""
    frame = table("errors/error_causes")
    frame = frame[frame["trial"].str.endswith("oracle=none")]
    return [int(frame["errors"].sum()), int(frame.loc[frame["cause"] == "unexplained", "errors"].sum())]


def removed(cause: str, oracle: str) -> list[float]:
    """For both teams: the cause's share of all errors, and how many of them go with the oracle."""
    found: list[float] = []
    for team in TEAMS:
        row = rows("errors/counterfactuals", trial=team, oracle=oracle, cause=cause).iloc[0]
        found += [row["attributed_share"], row["removed_share"] if row["errors"] else 0.0]
    return found


def least_removed() -> list[float]:
    """Of the causes with more than 5 % of a team's errors."""
    frame = table("errors/counterfactuals")
    causes = frame[(frame["attributed_share"] > 0.05) & (frame["cause"] != "all errors")]
    return [causes["removed_share"].min()]


IMPROVED = {
    "`align=origin`": ("3.5", "paper", "origin"),
    "`components(iou=0.02)`": ("3.5", "components(iou=0.02)", "floor"),
    "`local_size_m=6`": ("6.0", "paper", "floor"),
    "all three": ("6.0", "components(iou=0.02)", "origin"),
}
"""row of the table -> window, fusion, align"""


def improved(window: str, fusion: str, align: str, column: str = "difference") -> list[Number]:
    where = {"local_size_m": window, "fusion": fusion, "align": align}
    return [rank("improved", F1, column, world=team, **where) for team in TEAMS]


def best(measure: str) -> list[Number]:
    cells = [("paper", measure), ("best", measure), ("best", "difference")]
    return [
        rank("best", measure, name, world=team, preset=preset) for team in TEAMS for preset, name in cells
    ]


ABLATION = {
    "`thresh_local=100`": "thresh_local 100",
    "`fusion=none`": "fusion none",
    "`thresh_global=100`": "thresh_global 100",
    "`inf_is_valid=false`": "inf_is_valid false",
    "`iou_ally=1`": "iou_ally 1",
    "`local_size_m=6`": "local_size_m 6",
    "`detector=subtraction`": "detector subtraction",
    "`local_map=single_scan`": "local_map single_scan",
    "`local_map=decay decay_s=0.5`": "local_map decay decay_s 0.5",
}

STAGES = {
    "`thresh_local=100`": "returns are not inflated (IV.A)",
    "`fusion=none`": "no fusion (IV.C)",
    "`thresh_global=100`": "mapped walls are not inflated (IV.A)",
    "`inf_is_valid=false`": "a beam without return clears nothing",
    "`iou_ally=1`": "allies stay in (IV.C)",
    "`local_size_m=6`": "a costmap that holds the whole range",
    "`detector=subtraction`": "returns against walls, no costmaps",
    "`local_map=single_scan`": "no memory",
    "`local_map=decay decay_s=0.5`": "marks live for half a second",
}


def changed(folder: str, variant: str, team: str, measure: str = "f1_one_to_one") -> "Number | Identical":
    where = {"variant": variant, "trial": team, "measure": measure}
    name = f"{folder}/differences_by_variant"
    return (
        IDENTICAL if value(name, "verdict", **where) == "identical" else number(name, "difference", **where)
    )


def baseline(folder: str, team: str, measure: str = "f1_one_to_one") -> float:
    """Without any change."""
    return float(rows(f"{folder}/differences_by_variant", trial=team, measure=measure)["baseline"].iloc[0])


F1, GOSPA, CAUGHT = "F1 one-to-one", "GOSPA per frame, m", "caught, %"


def rival(folder: str, detector: str, fusion: str, *beside: str) -> list[float]:
    """F1 one-to-one and GOSPA, each with its difference from MIDNet but for itself; then other columns."""
    found: list[Any] = []
    for measure in (F1, GOSPA):
        where = {"detector": detector, "fusion": fusion}
        found += [rank(folder, measure, measure, **where).value]
        if (detector, fusion) != ("midnet", "paper"):
            found += [rank(folder, measure, **where)]
    return [*found, *(rank(folder, F1, column, detector=detector, fusion=fusion).value for column in beside)]


RIVALS = (
    ("subtraction", "components(iou=0.02)", ""),
    ("midnet", "components(iou=0.02)", ""),
    ("midnet", "suppression(iou=0.02)", ", the rule's choice"),
    ("midnet", "paper", ""),
    ("subtraction", "paper", ""),
    ("clusters", "components(iou=0.02)", ""),
)
OFFICE = (
    ("subtraction", "suppression(iou=0.02)"),
    ("subtraction", "paper"),
    ("clusters", "suppression(iou=0.02)"),
    ("midnet", "suppression(iou=0.02)"),
    ("midnet", "components"),
    ("midnet", "paper"),
)


def office_row(detector: str, fusion: str) -> str:
    if (detector, fusion) == ("midnet", "paper"):
        return "| `midnet` | `paper` | {:.3f} | | {:.3f} | |"
    return f"| `{detector}` | `{fusion}` | {{:.3f}} | {{:+.3f}} | {{:.3f}} | {{:+.3f}} |"


def pursued(pursuing: bool) -> list[dict[str, str]]:
    """Rows of the labyrinth's ranking with a pursuit, or without; not the paper's own."""
    found = [row for measure, row in ranks("rivals-labyrinth") if measure == CAUGHT]
    return [row for row in found if (row["pursuit"] != "none") == pursuing]


def told_apart(found: Sequence[Mapping[str, str]]) -> int:
    return sum(row["verdict"] in {"better", "worse"} for row in found)


def largest_gain() -> Number:
    names = [row for row in pursued(True) if row["verdict"] != "the first"]
    found = [rank("rivals-labyrinth", CAUGHT, patrol=row["patrol"], pursuit=row["pursuit"]) for row in names]
    return max(found, key=lambda gain: gain.value)


def people(team: str, detector: str) -> list[float]:
    arenas = ("people", "people-pausing")
    cells = [(arena, column) for column in ("recall", "precision") for arena in arenas]
    return [
        rank("people", "recall", column, world=f"{team}, arena={arena}", detector=detector).value
        for arena, column in cells
    ]


def people_gain(arena: str) -> list[Number]:
    """Of recall by motion detection, against MIDNet."""
    return [rank("people", "recall", world=f"{team}, arena={arena}", detector="background") for team in TEAMS]


# the other studies


DISTURBED = (
    "noise datasheet",
    "dropout 20 %",
    "dropout 50 %",
    "LiDAR 10 Hz",
    "LiDAR 2 Hz",
    "LiDAR 1 Hz",
    "encoder",
    "encoder slips",
    "start 0.1 m",
    "start 5 deg",
    "start 0.1 m 5 deg",
    "start 0.1 m 5 deg with ukf+map",
    "start 0.1 m 5 deg with gyroscope",
    "ukf+map",
    "true pose",
    "delay 0.1 s",
    "delay 0.3 s",
    "delay 0.5 s",
    "delay 1 s",
    "loss 5 %",
    "loss 20 %",
    "mobile x 0.5",
    "mobile x 2",
    "stationary x 0.5",
    "intruders 0.05 m/s",
    "intruders 0.1 m/s",
    "exact map",
    "worst map",
    "guard dies",
    "guard dies with time-out",
)


def disturbances() -> list[int]:
    """All differences, the significant ones, worse, better."""
    verdicts = table("robustness/differences_by_variant")["verdict"]
    worse, better = int((verdicts == "worse").sum()), int((verdicts == "better").sum())
    return [len(verdicts), worse + better, worse, better]


def undisturbed() -> list[float]:
    return [baseline("robustness", team, name) for team in TEAMS for name in ("precision", "recall")]


def scenes(fusion: str, remove: str, robots: int) -> list[Any]:
    """F1 one-to-one and GOSPA per intruder, means over seeds; the share of orders that change the boxes."""
    seen = rows("scale/scenes", fusion=fusion, ally_remove=remove, robots=robots)
    counts = zip(seen["matched"], seen["fp"] + seen["duplicates"], seen["missed"], strict=True)
    f1 = pd.Series([ratios(*three).f1 for three in counts])
    per_intruder = seen["gospa_m"] / seen["intruders_in_range"]
    return [over_seeds(f1), over_seeds(per_intruder), float((seen["reordered"] / seen["orders"]).mean())]


def scale_seeds() -> tuple[int, int]:
    found = table("scale/scenes")["seed"]
    return int(found.min()), int(found.max())


CANDIDATES = ("the rule's pick", "nearest", "not among the candidates")
COUNTED = ("P(1)", "R(1)", "F1(1)", "P(5)", "R(5)", "F1(5)", "rms of 12", "team_per_200")


def candidate(note: str) -> list[float]:
    return [value("data/calibration", column, note=note) for column in COUNTED]


def drawn_shares() -> list[float]:
    """How often each of the four most frequent picks wins, seeds drawn with replacement."""
    frame = rows("data/calibration-picks", change="five seeds drawn with replacement")
    return list(frame["share of resamples"].head(4))


def nearest_ratios() -> list[float]:
    return [
        value("data/detection-nearest", name, trial=team, source="mean over seeds")
        for team in TEAMS
        for name in SCORES
    ]


def duration_of(reading: str, baseline: str) -> list[Number]:
    """Seconds and percent caught of a change, each with its difference from another reading."""
    frame = table("data/duration").assign(percent=lambda one: 100.0 * one["caught"] / one["intruders"])
    found: list[Number] = []
    for column in ("duration_s", "percent"):
        means = frame.groupby(["reading", "seed"])[column].mean()
        before, after = list(means[baseline]), list(means[reading])
        most = (0.0, 100.0) if column == "percent" else statistics.ANY
        found += [
            Number(statistics.mean(after).value),
            of(statistics.paired_difference(before, after, within=most)),
        ]
    return found


CHANGES = {
    "| a caught intruder drives on | `after_capture=drives_on` |": ("drives-on", "default"),
    "| escape by the doors | `escape_at=doors` |": ("doors", "default"),
    "| escapes 16 m or more away | `escape_distance_m=16` |": ("escape16", "default"),
    "| caught by touch | `capture=contact` |": ("contact", "default"),
    "| intruders flee | `evasion=flee` |": ("flee", "default"),
    "| guards do not pursue | `pursuit=none` |": ("no-pursuit", "default"),
    "| exact prior map | `prior_map=exact` |": ("exact", "default"),
    "| longer ways, exact map | `arena=longer-ways.yaml` |": ("longer-ways", "exact"),
    "| starts 7 m or more from guards, exact map | `arena=far-starts.yaml` |": ("far-starts", "exact"),
}


def slower() -> float:
    """How many times as long a trial is with the defaults of d031e48."""
    means = table("data/duration").groupby("reading")["duration_s"].mean()
    return float(means["d031e48"] / means["default"])


def map_errors(slips: bool, method: str) -> list[float]:
    """The least and the greatest over seeds, metres."""
    frame = rows("data/recorded-log", method=method)
    errors_m = frame.loc[(frame["slips"] > 0) == slips, "mean_error_m"]
    return [errors_m.min(), errors_m.max()]


def recording(name: str, preset: str) -> list[float]:
    where = {"recording": name, "preset": preset}
    scores = [
        value("data/recordings-scores", column, **where) for column in ("in_range", "precision", "recall")
    ]
    return [*scores, value("data/recordings-matching", "precision", **where)]


def recording_cause(name: str, cause: str) -> int:
    return int(value("data/recordings-causes", "count", recording=name, preset="paper", cause=cause))


SAMPLES = (
    "normal",
    "skewed: a duration, lognormal",
    "very skewed: lognormal(1)",
    "skewed: a time to capture, exponential",
    "skewed: a precision near 0.95",
    "0/1: one intruder, caught at 0.2",
    "0/1: one intruder, caught at 0.6",
    "shares of three intruders at 0.7",
    "shares of five, trials unlike, at 0.5",
)
PAIRS = ("a paired difference of precisions", "a time per capture, sum over sum")
COVERED = (3, 5, 10, 20, 50)


def coverage(sample: str, other: str) -> list[float]:
    """Percent held, and the other column if there is one, for each number of trials."""
    columns = ["held", other] if other else ["held"]
    return [value("data/coverage", column, sample=sample, n=n) for n in COVERED for column in columns]


def ablated(column: str) -> list[Any]:
    """Of five robots with the paper's fusion and with none: both means and the paired difference."""
    frame = rows("ablation/scores", robots=5).assign(
        one_to_one=lambda one: (
            2 * one["matched"] / (one["matched"] * 2 + one["missed"] + one["fp"] + one["duplicates"])
        ),
        gospa=lambda one: one["gospa_m"] / one["frames"],
    )
    before, after = (
        list(frame[frame["variant"] == name].sort_values("seed")[column]) for name in ("none", "fusion none")
    )
    return [
        statistics.mean(before).value,
        statistics.mean(after).value,
        of(statistics.paired_difference(before, after)),
    ]


def second_boxes() -> list[float]:
    """The share of tp that are further boxes on an intruder: without fusion, with it."""
    return [
        pooled("ablation/scores", "duplicates", "tp", robots=5, variant=name)
        for name in ("fusion none", "none")
    ]


QUOTES = [
    Quote(README, "Means over the seeds {} to {} with", lambda: seeds("detection")),
    Quote(README, "| 1 robot | " + ROW, lambda: [*score("1-robot"), one_to_one("1-robot")]),
    Quote(README, "| 5 robots | " + ROW, lambda: [*score("5-robot"), one_to_one("5-robot")]),
    Quote(
        README,
        "from us: {} of the {} values of the detection test are choices of ours, {} more are options that are off",
        lambda: ours("detection"),
    ),
    Quote(README, "All six ratios are within {:.3f} of the paper's", lambda: [largest_gap()]),
    Quote(README, "Precision falls by {:.3f} from one robot to five", lambda: [fall().value]),
    Quote(
        README, "while recall and F1 rise, in {} of {} seeds", lambda: [ordered_seeds(), detection_seeds()]
    ),
    Quote(
        README,
        "outside its 3.5 m costmap ({:.0%} of the misses)",
        lambda: [misses("fn_outside_window", "1-robot")],
    ),
    Quote(
        README,
        "catch {:.0f}, {:.0f}, {:.0f}, {:.0f} and {:.0f} % of the intruders",
        lambda: [rate.value for rate in caught()],
    ),
    Quote(README, "From two robots to three {} of our five curves fall", lambda: [curve_falls(2, 3)]),
    Quote(README, "over all intruders that is {:+.1f} points", lambda: [rise(2, 3)]),
    Quote(README, "of the paper's curves and in {} of ours", lambda: [curve_falls(4, 5)]),
    Quote(README, "has {:.2f} times the speed of bare PyBullet", lambda: [to_bare("fast")]),
    Quote(
        "docs/engines.md",
        "has {:.2f} times the speed of bare PyBullet on `fast` and {:.2f} times on `bullet`",
        lambda: [to_bare("fast"), to_bare("bullet")],
    ),
    Quote(README, "A trial lasts {:.0f} s;", lambda: [duration().value]),
    Quote(
        README, "judges the paper's {} claims about the detection test: {:s}.", lambda: claims("detection")
    ),
    Quote(
        README,
        "one robot has {:.3f} false positives a frame (paper:",
        lambda: [per_frame("every", "1-robot")[1]],
    ),
    Quote(README, "{:.0%} of its misses are hidden intruders", lambda: [misses("fn_hidden", "1-robot")]),
    Quote(
        README,
        "overlap in {:.0%} of five robots' frames, and their order changes {:.0%} of",
        lambda: team_shares(),
    ),
    Quote(README, "five guards report {:.0f} false boxes per 200 frames", lambda: [empty_arena().value]),
    *(
        Quote(RESULTS, f"| `{name}` | `midnet-bench {command}` | {{}} to {{}}", lambda name=name: seeds(name))
        for name, command in COMMANDS.items()
    ),
    Quote(
        RESULTS,
        "| `errors` | `midnet-bench run errors` (without its large tables `errors` and `recorded`) | {} to {}",
        lambda: seeds("errors"),
    ),
    Quote(
        RESULTS,
        "| `rivals`, `rivals-office` | `midnet-bench run rivals`, `run rivals-office` | {} to {}, {} to {}",
        lambda: [*seeds("rivals"), *seeds("rivals-office")],
    ),
    Quote(RESULTS, "| `standard` | `make leaderboard` | {} to {}", lambda: seeds("standard")),
    Quote(RESULTS, "| `scale` | `python -m benchmarks.scale scenes.csv` | {} to {}", scale_seeds),
    Quote("docs/studies/scale.md", "Seeds {} to {}, ten scenes each", scale_seeds),
    Quote(
        RESULTS,
        "{} of the {} values of the detection test are choices of ours, {} more are options that are off",
        lambda: ours("detection"),
    ),
    Quote(
        RESULTS, "Seeds {} to {}, 1999 frames, engine `bullet`, the explored map", lambda: seeds("detection")
    ),
    *(
        Quote(
            RESULTS,
            f"| **{head}** | {ROW} | second boxes false | {{:.3f}} | {{:.3f}} | {{:.3f}} | | "
            "| in range by the nearest point | {:.3f} | {:.3f} | {:.3f} | | | both of these | {:.3f} | {:.3f} | {:.3f} | |",
            lambda team=team: [
                *score(team),
                one_to_one(team),
                *score(team, "surplus_false"),
                *score(team, "every", "detection-edge"),
                *score(team, "surplus_false", "detection-edge"),
            ],
        )
        for team, head in zip(TEAMS, ("1 robot", "5 robots"), strict=True)
    ),
    *(
        Quote(
            RESULTS,
            f"| {head} |" + " {:.3f} |" * 7,
            lambda counting=counting: [*per_frame(counting, *TEAMS), boxes(counting)],
        )
        for head, counting in (
            ("ours, as the paper words it", "every"),
            ("ours, second boxes false", "surplus_false"),
        )
    ),
    Quote(
        README, "Of the paper's twelve numbers {} lie in the range of our runs", lambda: near_the_paper()[2:]
    ),
    Quote(
        RESULTS,
        "{} of six ratios are within 0.02, all six within {:.3f}; {} of six counts per frame within 10 %",
        lambda: [near_the_paper()[0], largest_gap(), near_the_paper()[1]],
    ),
    Quote(
        RESULTS,
        "the six differences is {:.3f} (bootstrap over seeds; {:.3f} to {:.3f} with any one seed left out), of all twelve numbers {:.3f}. "
        "With second boxes false it is {:.3f}, with the nearest point {:.3f}.",
        distances,
    ),
    Quote(RESULTS, "Of its twelve numbers {} lie in the range", lambda: near_the_paper()[2:]),
    Quote(RESULTS, "That of one robot's false positives per frame is {:.3f} to {:.3f}", fp_range),
    Quote(RESULTS, "the paper's in {} of {} seeds**", lambda: [ordered_seeds(), detection_seeds()]),
    Quote(RESULTS, "precision falls, by {:.3f} (paper: 0.040)", lambda: [fall()]),
    Quote(
        RESULTS,
        "one robot has {:.3f} false positives a frame for the paper's",
        lambda: [per_frame("every", "1-robot")[1]],
    ),
    Quote(RESULTS, "five report {:.3f} boxes a frame", lambda: [boxes("every")]),
    Quote(
        RESULTS,
        "{:.0%} of one robot's lie outside its 3.5 m costmap, {:.0%} are hidden",
        lambda: [misses("fn_outside_window", "1-robot"), misses("fn_hidden", "1-robot")],
    ),
    Quote(
        RESULTS,
        "Of those inside the costmap {:.2f} are hidden.",
        lambda: [hidden_in_window()],
    ),
    Quote(
        RESULTS, "With five robots {:.0%} lie outside every", lambda: [misses("fn_outside_window", "5-robot")]
    ),
    Quote(RESULTS, "of {} of the detection test: {:s}. Inconclusive:", lambda: claims("detection")),
    Quote(
        RESULTS,
        "overlap in {:.0%} of five robots' frames, and the robots' order changes {:.0%} of",
        lambda: team_shares(),
    ),
    Quote(
        RESULTS,
        "one guard reports {:.0f} boxes",
        lambda: [total("no-intruders/detection_scores", "fp", trial="1-robot")],
    ),
    Quote(
        RESULTS,
        "(`no-intruders`, {} seeds x 1999 frames)",
        lambda: [rows("no-intruders/scores", robots=5)["seed"].nunique()],
    ),
    Quote(RESULTS, "Five guards report {:.1f} false positives per 200 frames", lambda: [empty_arena()]),
    Quote(
        RESULTS,
        "{:.0%} are teammates that Algorithm 2 did not remove, {:.0%} places",
        lambda: [
            value("no-intruders/error_causes", "share", cause=cause, trial="5-robot")
            for cause in ("ally_left", "ally_trail")
        ],
    ),
    Quote(
        RESULTS,
        "drive {:.0f} m each in 400 s on average (at least {:.0f} m); the one that is stuck longest for {:.0f} s. {:.1f} collisions a trial; robots crossed a wall {:.0f} times",
        motion,
    ),
    *(
        Quote(
            RESULTS,
            f"| {head} |" + " {:.3f} |" * 6,
            lambda variant=variant: reading(variant=variant),
            "readings-main",
        )
        for head, variant in OTHER_READINGS.items()
    ),
    Quote(
        RESULTS,
        "recall: it is {:.3f} in the narrowest and {:.3f} in the widest. Where a beam without a return "
        "clears nothing, five robots have a precision of {:.3f}. The other values move no number by more than {:.3f}",
        reading_extremes,
        "readings-main",
    ),
    Quote(
        RESULTS,
        "leaves {:.1f} boxes on a teammate in 1000 frames, 0.1 leaves {:.1f}, 0.01 leaves {:.1f}",
        lambda: [value("data/ally-threshold", "per_1000_frames", iou_ally=t) for t in (0.03, 0.1, 0.01)],
    ),
    Quote(
        RESULTS,
        "{} instead of {} of {} boxes on intruders within 0.5 m of a teammate",
        lambda: [
            value("data/ally-threshold", "removed", iou_ally=0.03),
            value("data/ally-threshold", "removed", iou_ally=0.1),
            value("data/ally-threshold", "on_intruders", iou_ally=0.1),
        ],
    ),
    Quote(RESULTS, "engine `bullet`, seeds {} to {}. Guards use", lambda: seeds("labyrinth")),
    Quote(RESULTS, "| caught, % |" + " {:.1f} |" * 5, caught),
    Quote(
        RESULTS,
        "A trial lasts {:.1f} s [{:.1f}, {:.1f}], all of them {:.1f} h",
        lambda: [*duration()[:3], total("labyrinth/trial", "duration_s") / 3600.0],
    ),
    Quote(RESULTS, "from one robot to four by {:.0f} points over all", lambda: [rise(1, 4).value]),
    Quote(
        RESULTS,
        "From two robots to three {} of the five curves fall, by {:+.1f} points",
        lambda: [curve_falls(2, 3), rise(2, 3)],
    ),
    Quote(RESULTS, "From four to five {} of ours falls", lambda: [curve_falls(4, 5)]),
    Quote(RESULTS, "Claims: {:s}.", lambda: claims("labyrinth")[1:]),
    Quote(RESULTS, "{} of {} pursued targets ({:.0%}) were no intruder", false_targets),
    *(
        Quote(
            RESULTS,
            f"| {words} | {{}} | {{}} ({{:.0%}}) | {{:.1%}} | {{}} |",
            lambda variant=variant: pursued_targets(variant),
        )
        for variant, words in PURSUED.items()
    ),
    Quote(
        RESULTS,
        "stuck for {:.1%} of the time, the worst for {:.0%} of its trial; they give up {} of {} goals; {} collisions, {} recoveries",
        guards,
    ),
    Quote(RESULTS, "{:.0%} are ever stuck, {:.1f} s of a trial in the mean", stuck_intruders),
    Quote(
        RESULTS,
        "which box is on which intruder catch {:.1f}, {:.1f} and {:.1f} %, guards that use MIDNet's boxes alone {:.1f}, {:.1f} and {:.1f} %",
        lambda: [
            rate.value
            for name in ("oracle", "nearest")
            for rate in caught("pursuit", variant=f"pursuit={name}")
        ],
    ),
    Quote(RESULTS, "boxes alone make a difference of {:+.1f} points", lambda: [pursuit_difference()]),
    Quote(
        RESULTS,
        "{} explorations by one, two and three Burgers at 0.18 m/s; {} finished, {} cover at least 98 % of the free space within reach, the least {:.1f} %.",
        explorations,
    ),
    *(
        Quote(
            RESULTS,
            f"| Map {arena} | {robots} | {{:.2f}} | {{:.3f}}; {{:.3f}} | {{:.3f}}; {{:.3f}} | {{:.2f}} | {{:.0f}} | {{:.0f}} |",
            lambda arena=arena, robots=robots: map_row(f"map{arena}", robots),
        )
        for arena in (1, 2)
        for robots in (1, 2, 3)
    ),
    Quote(RESULTS, "{} of {} maps of Map 1 keep a gap", lambda: gaps("map1")[:2]),
    Quote(
        RESULTS, "and {} of {} of Map 2, of {:.2f} m on average and {:.2f} m at most", lambda: gaps("map2")
    ),
    Quote(
        RESULTS,
        "Three robots need {:.3f} of one robot's time in Map 2 and {:.3f} in Map 1; two need {:.3f} and {:.3f}.",
        lambda: [speed_up(arena, robots) for robots in (3, 2) for arena in ("map2", "map1")],
    ),
    Quote(RESULTS, "for Map 1 that of {} robot with seed {} (F1 {:.4f})", lambda: chosen("map1")[:3]),
    Quote(RESULTS, "for Map 2 that of {} with seed {} (F1 {:.4f}, {:.2f} cm)", lambda: chosen("map2")),
    # docs/studies/errors.md
    Quote(ERRORS, "Map 1, seeds {} to {}, 1999 frames", lambda: seeds("errors")),
    Quote(ERRORS, "engine `fast`: {:,} errors, of which {} are `unexplained`", unexplained),
    *(
        Quote(
            ERRORS,
            f"{head}\n| --- | --- | --- |\n| all | {{:,}} | {{:,}} |",
            lambda kind=kind: [recorded_errors(team, kind) for team in TEAMS],
        )
        for head, kind in (
            ("| misses, one-to-one | 1 guard | 5 guards |", "miss"),
            ("| false positives | 1 guard | 5 guards |", "false"),
        )
    ),
    *(
        Quote(
            ERRORS,
            f"| `{cause}`{' (no miss of the paper' + chr(39) + 's)' if cause == 'merged' else ''} | {{:.3f}} | {{:.3f}} |",
            lambda kind=kind, cause=cause: [recorded(team, kind, cause) for team in TEAMS],
        )
        for kind, causes in (("miss", MISSES), ("false", FALSE))
        for cause in causes
    ),
    Quote(
        ERRORS,
        "stand {:,} and {:,} second boxes on intruders that have one",
        lambda: [recorded_errors(team, "fragment") for team in TEAMS],
    ),
    Quote(ERRORS, "with five guards {:.0%} of all errors", lambda: [removed("fragment", "fusion")[2]]),
    *(
        Quote(
            ERRORS,
            f"| `{cause}` | `{oracle}` | {{:.3f}}, {{:.1%}} | {{:.3f}}, {{:.1%}} |",
            lambda cause=cause, oracle=oracle: removed(cause, oracle),
        )
        for cause, oracle in ORACLES.items()
    ),
    Quote(
        ERRORS,
        "hidden misses are {:.1%} and {:.1%}, delay has {:.1%} and {:.1%}.",
        lambda: [misses(part, team) for part in ("fn_hidden", "fn_new") for team in TEAMS],
    ),
    Quote(
        ERRORS,
        "**inside a costmap** {:.2f} are hidden.",
        lambda: [hidden_in_window()],
    ),
    Quote(
        ERRORS,
        "does not name: {:.0%} and {:.0%} of the misses lie outside",
        lambda: [misses("fn_outside_window", team) for team in TEAMS],
    ),
    Quote(ERRORS, "down before the run, on seeds {} to {}", lambda: seeds("improved")),
    Quote(
        ERRORS,
        "| F1 one-to-one, nothing changed | {:.3f} | {:.3f} |",
        lambda: [cell.value for cell in improved("3.5", "paper", "floor", F1)],
    ),
    *(
        Quote(ERRORS, f"| {head} | {{:+.3f}} | {{:+.3f}} |", lambda change=change: improved(*change))
        for head, change in IMPROVED.items()
    ),
    Quote(ERRORS, "reported on {} to {}", lambda: seeds("best")),
    *(
        Quote(
            ERRORS,
            f"| {head} | {{:.3f}} | {{:.3f}} | {{:+.3f}} | {{:.3f}} | {{:.3f}} | {{:+.3f}} |",
            lambda measure=measure: [cell if cell.bold else cell.value for cell in best(measure)],
        )
        for head, measure in (("F1 one-to-one", F1), ("GOSPA, m a frame", GOSPA))
    ),
    Quote("docs/errors.md", "{} of {:,} errors are `unexplained`", lambda: unexplained()[::-1]),
    Quote(
        "docs/studies/counterfactuals.md",
        "of one team's errors at least {:.1%} go with its oracle",
        least_removed,
    ),
    # docs/studies/rivals.md
    *(
        Quote(RIVALS_PAGE, f"{words} {{}} to {{}}", lambda folder=folder: seeds(folder))
        for folder, words in (
            ("ablation", "one at a time; seeds"),
            ("rivals", "five guards, Map 1, seeds"),
            ("rivals-office", "exact map, seeds"),
            ("rivals-labyrinth", "20 trials each, seeds"),
            ("people", "Two people in Map 1, seeds"),
        )
    ),
    Quote(
        RIVALS_PAGE,
        "| nothing | F1 one-to-one | {:.3f} | {:.3f} |",
        lambda: [baseline("ablation", team) for team in TEAMS[::-1]],
    ),
    *(
        Quote(
            RIVALS_PAGE,
            f"| {head} | {STAGES[head]} | {{:+.3f}} | {{:+.3f}} |",
            lambda variant=variant: [changed("ablation", variant, team) for team in TEAMS[::-1]],
        )
        for head, variant in ABLATION.items()
    ),
    *(
        Quote(
            RIVALS_PAGE,
            f"| `{detector}` | `{fusion}`{more} | {{:.3f}} | {'' if detector + fusion == 'midnetpaper' else '{:+.3f} '}| {{:.3f}} | {'' if detector + fusion == 'midnetpaper' else '{:+.3f} '}| {{:.3f}} | {{:.3f}} |",
            lambda detector=detector, fusion=fusion: rival("rivals", detector, fusion, "precision", "recall"),
        )
        for detector, fusion, more in RIVALS
    ),
    *(
        Quote(RIVALS_PAGE, office_row(*names), lambda names=names: rival("rivals-office", *names))
        for names in OFFICE
    ),
    *(
        Quote(
            RIVALS_PAGE,
            f"| `{patrol}` |" + " {:.1f} |" * 4,
            lambda patrol=patrol: [
                rank("rivals-labyrinth", CAUGHT, CAUGHT, patrol=patrol, pursuit=pursuit).value
                for pursuit in ("nearest", "none", "all", "assignment")
            ],
        )
        for patrol in ("paper", "cyclic", "coordinated", "reactive")
    ),
    Quote(
        RIVALS_PAGE,
        "Of the {} patrols with a pursuit {} are better or worse than the paper's",
        lambda: [len(pursued(True)) - 1, told_apart(pursued(True))],
    ),
    Quote(
        RIVALS_PAGE,
        "the largest gain is {:+.1f} points. Of the {} that do not pursue {} is worse; `reactive` has {:+.1f} points",
        lambda: [
            largest_gain(),
            len(pursued(False)),
            told_apart(pursued(False)),
            rank("rivals-labyrinth", CAUGHT, patrol="reactive", pursuit="none"),
        ],
    ),
    *(
        Quote(
            RIVALS_PAGE,
            f"| {team[0]} | `{detector}` | {{:.3f}} | {{:.3f}} | {{:.3f}} | {{:.3f}} |",
            lambda team=team, detector=detector: people(team, detector),
        )
        for team in TEAMS
        for detector in ("midnet", "background")
    ),
    Quote(
        RIVALS_PAGE,
        "introduction says: {:+.3f} of recall with one guard and {:+.3f} with five against MIDNet. Of people who walk it finds {:+.3f} and {:+.3f} more",
        lambda: [*people_gain("people-pausing"), *people_gain("people")],
    ),
    # docs/studies/robustness.md
    Quote(ROBUSTNESS, "100 s a trial, seeds {} to {}", lambda: seeds("robustness")),
    Quote(
        ROBUSTNESS,
        "Of {} differences {} are significant after Holm's adjustment (bold below): {} are worse, {} are better.",
        disturbances,
    ),
    Quote(
        ROBUSTNESS,
        "one guard has precision {:.3f} and recall {:.3f}, five have {:.3f} and {:.3f}.",
        undisturbed,
    ),
    *(
        Quote(
            ROBUSTNESS,
            f"| {variant} |" + " {:+.3f} |" * 4,
            lambda variant=variant: [
                changed("robustness", variant, team, name)
                for team in TEAMS
                for name in ("precision", "recall")
            ],
        )
        for variant in DISTURBED
    ),
    # docs/studies/scale.md
    *(
        Quote(
            "docs/studies/scale.md",
            f"| `{fusion}`, `{remove}`{more} | {robots} | {{:.3f}} | {{:.3f}} | {{:.0%}} |",
            lambda fusion=fusion, remove=remove, robots=robots: scenes(fusion, remove, robots),
        )
        for fusion, remove, robots, more in (
            ("paper", "first", 5, " (the paper's)"),
            ("paper", "first", 200, ""),
            ("components", "all", 5, ""),
            ("components", "all", 200, ""),
        )
    ),
    # docs/studies/calibration.md
    Quote(
        CALIBRATION,
        "rms {:.3f}, {:.3f} and {:.3f} at 0.75, 1 and 1.25",
        lambda: [
            value("data/calibration-sizes", "rms of 12", reading=f"default stationary_scale={size}")
            for size in ("0.75", "1.0", "1.25")
        ],
    ),
    Quote(
        CALIBRATION,
        "The best of the {} clean candidates",
        lambda: [int(value("data/calibration-picks", "clean", change="none"))],
    ),
    *(
        Quote(
            CALIBRATION,
            f"{head} | {{:.3f}} {{:.3f}} {{:.3f}} | {{:.3f}} {{:.3f}} {{:.3f}} | {{:.3f}} | {{:{form}}} |",
            lambda note=note: candidate(note),
        )
        for note, head, form in zip(
            CANDIDATES,
            ("every box counts", "one box per intruder", "second boxes are false positives"),
            (".2f", ".1f", ".2f"),
            strict=True,
        )
    ),
    Quote(
        CALIBRATION,
        "one scan ({:.0f} clean candidates, rms {:.3f})",
        lambda: [
            value("data/calibration-picks", column, change="without seed 1001")
            for column in ("clean", "rms of 12")
        ],
    ),
    Quote(
        CALIBRATION,
        "Without 1005 {:.0f} are clean",
        lambda: [value("data/calibration-picks", "clean", change="without seed 1005")],
    ),
    Quote(
        CALIBRATION,
        "a 3.5 m window (rms {:.3f})",
        lambda: [value("data/calibration-picks", "rms of 12", change="bar of 1.5 per 200 frames")],
    ),
    Quote(
        CALIBRATION,
        "the pick wins {:.0%}, the nearest {:.0%}, the 4 m window {:.0%}, the 3.5 m window {:.0%}.",
        drawn_shares,
    ),
    Quote(
        CALIBRATION,
        "with one guard all {:.0f} are clean",
        lambda: [value("data/calibration-picks", "clean", change="one guard is enough to be clean")],
    ),
    Quote(
        CALIBRATION,
        "with {:.2f} boxes a frame of five robots",
        lambda: [sum(value("data/calibration", column, note=CANDIDATES[2]) for column in ("tp(5)", "fp(5)"))],
    ),
    Quote(CALIBRATION, "the nearest gave {:.3f} {:.3f} {:.3f} and {:.3f} {:.3f} {:.3f}", nearest_ratios),
    # docs/studies/duration.md
    Quote(
        DURATION,
        "| defaults of 29f5ce0 | | {:.1f} | | {:.1f} | |",
        lambda: [cell.value for cell in duration_of("default", "default")[::2]],
    ),
    *(
        Quote(
            DURATION,
            f"{head} {{:.1f}} | {{:+.1f}} | {{:.1f}} | {{:+.1f}} |",
            lambda readings=readings: duration_of(*readings),
        )
        for head, readings in CHANGES.items()
    ),
    Quote(
        DURATION,
        "| **defaults of d031e48**, 0.18 m/s, nothing set | | {:.1f} | {:+.1f} | {:.1f} | |",
        lambda: duration_of("d031e48", "default")[:3],
    ),
    Quote(DURATION, "a trial is {:.2f} times as long", lambda: [slower()]),
    Quote(
        DURATION,
        "the mean is {:.1f} s [{:.1f}, {:.1f}], {:.1f} h in all",
        lambda: [*duration()[:3], total("labyrinth/trial", "duration_s") / 3600.0],
    ),
    # docs/studies/slips.md
    Quote(
        "docs/studies/slips.md",
        "| log, seeds {} to {} | graph SLAM, m | GMapping, m |",
        lambda: [table("data/recorded-log")["seed"].min(), table("data/recorded-log")["seed"].max()],
    ),
    *(
        Quote(
            "docs/studies/slips.md",
            f"| {head} | {{:.3f}} to {{:.3f}} | {{:.3f}} to {{:.3f}} |",
            lambda slips=slips: [*map_errors(slips, "graph SLAM"), *map_errors(slips, "GMapping")],
        )
        for head, slips in (("as it is", False), ("three slips", True))
    ),
    # docs
    *(
        Quote(
            "docs/recordings.md",
            f"| `{name}` | `{preset}` | {{:.0f}} | {{:.3f}} | {{:.3f}} | {{:.3f}} |",
            lambda name=name, preset=preset: recording(name, preset),
        )
        for name in ("overtake_red", "intersection")
        for preset in ("real", "paper")
    ),
    Quote(
        "docs/recordings.md",
        "has {} boxes of one return alone (`ghost`) on `overtake_red`, and {} misses outside",
        lambda: [
            recording_cause("overtake_red", "ghost"),
            recording_cause("intersection", "outside_window"),
        ],
    ),
    *(
        Quote(
            "docs/statistics.md",
            f"| {sample} |" + " {:.1f} ({:.1f}) |" * 5,
            lambda sample=sample: coverage(sample, "held_before"),
        )
        for sample in SAMPLES
    ),
    *(
        Quote(
            "docs/statistics.md",
            f"| {words} |" + " {:.1f} ({:.1f}, {:.1f}) |" * 5,
            lambda sample=sample: [
                value("data/coverage", column, sample=sample, n=n)
                for n in COVERED
                for column in ("held", "below", "above")
            ],
        )
        for sample, words in FURTHER_RUNS.items()
    ),
    *(
        Quote(
            "docs/statistics.md",
            f"| {sample} |" + " {:.1f} |" * 5,
            lambda sample=sample: coverage(sample, ""),
        )
        for sample in PAIRS
    ),
    Quote(
        "docs/statistics.md",
        "| a difference that one pair in ten has: percent of all samples (without any interval) |"
        + " {:.0f} ({:.0f}) |" * 5,
        lambda: coverage("a difference that one pair in ten has", "without_interval"),
    ),
    Quote(
        "docs/metrics.md",
        "| five robots, seeds {} to {}, 500 frames each | fusion at IoU 0.1 | no fusion (`fusion=none`) | difference |",
        lambda: seeds("ablation"),
    ),
    *(
        Quote(
            "docs/metrics.md",
            f"| {head} | {{:.3f}} | {{:.3f}} | {{:+.3f}} |",
            lambda column=column: ablated(column),
        )
        for head, column in (
            ("F1 as the paper counts", "f1"),
            ("one-to-one F1", "one_to_one"),
            ("GOSPA per frame, m", "gospa"),
        )
    ),
    Quote(
        "docs/metrics.md",
        "Without fusion {:.0%} of the true positives are further boxes on an intruder that has one; with it {:.0%}.",
        second_boxes,
    ),
]
