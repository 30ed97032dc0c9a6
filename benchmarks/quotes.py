"""What pages quote of the committed results: for ``python -m benchmarks.recount``.

A quote is a page, the words with a format specification for each number, and how the numbers are computed
from the files under ``results/reference`` or ``docs/studies/data``. Intervals are those of the tables.
"""

import functools
import math
import re
from typing import Any, NamedTuple

import pandas as pd

from benchmarks.recount import ROOT, Quote
from midnet_bench.analysis import statistics
from midnet_bench.analysis.statistics import Estimate

REFERENCE, DATA = ROOT / "results/reference", ROOT / "docs/studies/data"
README, RESULTS, STUDIES = "README.md", "results/README.md", "docs/studies/"
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


def of(estimate: Estimate, factor: float = 1.0) -> Number:
    return Number(estimate.value * factor, estimate.low * factor, estimate.high * factor)


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
            measure, heads = line.split()[3].strip(","), []
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
    return ceiling(table("detection/detection_comparison")["difference"].abs().max(), 3)


def change(column: str) -> Number:
    """Of the means over seeds, from one robot to five."""
    one, five = (by_seed("detection/scores_by_seed", column, trial=team) for team in TEAMS)
    return of(statistics.paired_difference(list(one), list(five), within=(0.0, 1.0)))


def fall() -> Number:
    """Of precision, as a positive number."""
    value, low, high, _ = change("precision")
    return Number(-value, -high, -low)


def near_the_paper() -> list[int]:
    """Ratios within 0.02 of the paper's, counts per frame within 10 %, numbers within our seeds' range."""
    gaps = table("detection/detection_comparison")["difference"].abs()
    ours, papers = per_frame("every", *TEAMS), per_frame("paper", *TEAMS)
    close = [abs(one / other - 1.0) <= 0.1 for one, other in zip(ours, papers, strict=True)]
    within = 0
    for team in TEAMS:
        seeds = rows("detection/scores_by_seed", trial=team)
        paper = rows("detection/detection_counting", trial=team, counting="paper").iloc[0]
        for count in ("tp", "fp", "fn"):
            within += (
                (seeds[count] / seeds["frames"]).min()
                <= paper[f"{count}_per_frame"]
                <= (seeds[count] / seeds["frames"]).max()
            )
        within += sum(seeds[name].min() <= paper[name] <= seeds[name].max() for name in SCORES)
    return [int((gaps <= 0.02).sum()), sum(close), int(within)]


def fp_range() -> list[float]:
    """The least and the greatest number of one robot's false positives per frame among the seeds."""
    frame = rows("detection/scores_by_seed", trial=TEAMS[0])
    each = frame["fp"] / frame["frames"]
    return [each.min(), each.max()]


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


def verdict(folder: str, claim: str) -> str:
    return str(value(f"{folder}/claims", "verdict", claim=claim))


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
    return [verdicts.sum(), ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())]


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


ROW = "{:.3f} | {:.3f} | {:.3f} | {:.3f} |"
OTHER_READINGS = {
    "none changed": "none",
    'local costmap 2.5 m wide: "6.25 m2" (V.B)': "local_size_m 2.5",
    "local costmap 5 m wide: twice the usable range (IV.B.1)": "local_size_m 5",
    "local costmap 10 m wide: costmap_2d's default": "local_size_m 10",
    "a beam without a return clears nothing: costmap_2d's default": "inf_is_valid false",
    "large intruders half as large": "stationary_scale 0.5",
    "large intruders twice as large": "stationary_scale 2",
    "t of the fusion 0.05": "iou_fuse 0.05",
    "t of the fusion 0.2": "iou_fuse 0.2",
}
"""row of the table in ``results/README.md`` -> variant of ``campaigns/readings-main.yaml``"""

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
        Quote(
            RESULTS, f"| `{name}` | `midnet-bench {command}` | {{}} to {{}} |", lambda name=name: seeds(name)
        )
        for name, command in COMMANDS.items()
    ),
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
            "| in range by the nearest point | {:.3f} | {:.3f} | {:.3f} | | | both of these | {:.3f} | {:.3f} | {:.3f} |",
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
    Quote(RESULTS, "Of its twelve numbers {} lie within", lambda: near_the_paper()[2:]),
    Quote(RESULTS, "One robot's false positives per frame are {:.3f} to {:.3f} there", fp_range),
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
        "Of those inside the costmap {:.2f} are hidden; that most of these are hidden, as the paper says, is {:s}.",
        lambda: [
            hidden_in_window(),
            verdict("detection", "1 robot: most misses inside the local costmaps are hidden intruders"),
        ],
    ),
    Quote(
        RESULTS, "With five robots {:.0%} lie outside every", lambda: [misses("fn_outside_window", "5-robot")]
    ),
    Quote(RESULTS, "of {} of the detection test: {:s}. Fused", lambda: claims("detection")),
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
]

PAPER_ROWS = ["0.975 | 0.787 | 0.871", "0.935 | 0.960 | 0.947"]
ALLOWED: dict[str, list[str]] = {
    README: [
        *PAPER_ROWS,
        "95 % intervals",
        "the local costmap is 3.5 m wide, where the paper's words allow 2.5, 3.5 and 5 m",
        "(paper: 0.040)",
        "its 3.5 m costmap",
        "17 hours for 500 trials, 122 s each",
        "(paper: 0.088)",
        "Python 3.12",
        "Apache 2.0",
    ],
    RESULTS: [
        *PAPER_ROWS,
        "3.485 | 0.088 | 0.945 | 7.480 | 0.524 | 0.310 | 8.004",
        "95 % intervals",
        "within 0.02,",
        "within 10 %",
        "the paper has 0.088",
        "(paper: 0.040)",
        "for the paper's 0.088",
        "for its 8.004",
        "its 3.5 m costmap",
        "in 400 s",
        'local costmap 2.5 m wide: "6.25 m2"',
        "local costmap 5 m wide",
        "local costmap 10 m wide",
        "t of the fusion 0.05",
        "t of the fusion 0.2",
        "about 17 h",
        "at 0.18 m/s",
        "at least 98 %",
        "one cell, 5 cm",
        "version 0.1.0's",
    ],
}
"""page -> phrases whose numbers come from no result: settings, the paper's numbers, commands' arguments"""
