"""What a detection campaign says in words: its headline, and the paper's claims, each judged."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis.claims import Finding, Verdict, comparison, finding, single_run
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MIN_TRIALS, NOT_NEGATIVE, Estimate, Interval, ratio_of_sums
from midnet_bench.analysis.tables import Cell, Table, in_words, team_in_words
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key
from midnet_bench.experiments.detection.tables import (
    HEADS,
    PAPER,
    PAPER_ARENA,
    PAPER_FRAMES,
    SCORES,
    SHOWN,
    Cells,
    Trials,
    cells_of,
    paper_of,
    window_notes,
)
from midnet_bench.experiments.guarded.inputs import arena_from
from midnet_bench.experiments.guarded.tables import METRICS, metric_tables, usable_range
from midnet_bench.experiments.registry import Headline
from midnet_bench.robots.model import ROBOTS

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
DIGITS = 3
MOST_IN_WORDS = 4  # teams that a sentence names one by one
MOST_UNSCORED = 6  # cells without scores that are named one by one
MINOR = 0.10  # the most that a cause "not expected to be significant" may have of the errors
NEVER = 0.01  # the share of frames below which something counts as not happening
TABLE = ("tp_per_frame", "precision", "recall")  # tp, fp, fn and F1 follow from these
RISES = {"recall": True, "precision": False, "f1": True}
"""score -> whether it rises from one robot to five, in the paper's words"""
TEAMS = dict(zip(PAPER, ("1 robot", "5 robots"), strict=True))
ONE, FIVE = PAPER
CALLED = {"f1": "F1"}


def headline(results: Results, reference: Results | None = None) -> Headline:
    """The table, the verdict in words and what to type next, of a campaign with a finished trial.

    The means of ``reference`` stand under those of fewer seeds if the same parameters made them.
    """
    cells = cells_of(results)
    known = {} if reference is None else _reference_cells(results, reference, cells)
    parameters = results.definition.parameters
    seeds = max(map(len, cells.values()))
    frames = f", {parameters['frames']} frames" if parameters.get("frames") is not None else ""
    arena = str(parameters.get("arena", "{"))
    place = "" if arena.startswith("{") else f": {arena}"
    title = f"Detection test{place}{frames}, {_seeds(next(iter(cells.values())).rows)}"
    unscored = _unscored(results, cells)
    has_scores = len(unscored) < len(cells)
    notes = ["F1 one-to-one counts a second box on an intruder as false, the paper as true."] * has_scores
    if seeds > 2 or known:
        notes += ["±: the wider side of the 95 % interval (t, over seeds)."]
    if seeds == 2:
        notes += ["Two seeds give no interval; three do."]
    if known:
        some = next(iter(known.values()))
        notes += [f'"{len(some)} seeds" is the packaged reference, {_seeds(some.rows)}.']
    following = (
        "One seed says little: --seeds 20 gives intervals of your own."
        if seeds == 1
        else f"Next: 'midnet-bench verify {results.directory}' checks each claim of the paper."
    )
    found = [*_finds(results, cells), *_misses(results, cells)] if has_scores else []
    conclusion = [*found, *_without_scores(unscored, len(cells) > 1), *_among_runs(cells)]
    return Headline(
        [_scores(title, cells, known), *(metric_tables(results) if METRICS in results.tables else ())],
        conclusion,
        notes,
        following,
    )


def _scores(title: str, cells: Cells, reference: Cells) -> Table:
    """The scores of each cell: ours, the reference's and the paper's, as text for a terminal."""
    rows: list[Mapping[str, Cell]] = []
    for team, cell in cells.items():
        ours = "this seed" if len(cell) == 1 else f"these {len(cell)} seeds"
        sources = {ours: {score: cell.means[score] for score in SHOWN}}
        if team in reference:
            known = reference[team]
            sources[f"{len(known)} seeds"] = {score: known.means[score] for score in SHOWN}
        if cell.paper is not None:
            printed = {score: Estimate(cell.paper[score], math.nan, math.nan, 0) for score in SCORES}
            sources["paper"] = printed
        for source, scores in sources.items():
            label = team_in_words(str(team)) if source == ours else ""
            texts = {score: _text(one) for score, one in scores.items()}
            if source == ours and not cell.has_scores:
                texts = {SHOWN[0]: _boxes_alone(cell)}
            rows.append({"trial": label, "source": source, **dict.fromkeys(SHOWN, ""), **texts})
    if len({row["source"] for row in rows}) == 1:  # said in the title
        rows = [{name: cell for name, cell in row.items() if name != "source"} for row in rows]
    return Table("detection_headline", title, rows, labels=HEADS)


def _reference_cells(results: Results, reference: Results, cells: Cells) -> Cells:
    """The reference's cells that the same parameters made as ours, where it has more seeds."""
    given = [one.definition.parameters for one in (results, reference)]
    return {
        team: cell
        for team, cell in cells_of(reference).items()
        if team in cells and len(cells[team]) < len(cell)
        if _are_alike(*({**parameters, "robots": team.robots} for parameters in given))
    }


def _are_alike(ours: Row, theirs: Row) -> bool:
    """Whether the parameters of two cells give the same scores; no if this version lacks one of them."""
    if any(ours.get(name) != theirs.get(name) for name in ("arena", "frames", "robots")):
        return False
    usual = DetectionParameters.usual()
    outputs: Row = {"record": usual.record, "metrics": usual.metrics}
    if {**ours, **outputs} == {**theirs, **outputs}:
        return True
    try:
        ours_of, theirs_of = (DetectionParameters.from_flat({**one, **outputs}) for one in (ours, theirs))
    except InputError:
        return False
    return result_key(ours_of) == result_key(theirs_of)


def _seeds(rows: pd.DataFrame) -> str:
    first, last = rows["seed"].min(), rows["seed"].max()
    return f"seed {first}" if first == last else f"seeds {first} to {last}"


def _text(one: Estimate) -> str:
    """``0.987 ±.002``; blanks where there is no interval, so that points stand above each other."""
    if math.isnan(one.value):
        return "n/a"
    half = max(one.high - one.value, one.value - one.low)
    aside = "" if math.isnan(half) else f"±{half:.{DIGITS}f}".replace("±0", "±")
    return f"{one.value:.{DIGITS}f} {aside:{DIGITS + 2}}"


class Unscored(NamedTuple):
    """The trials of a cell in which there was no intruder to be found."""

    name: str
    frames: int
    boxes: int  # all of them false
    has_intruders: bool
    range_m: float | None  # in which none came near; None if cells differ in it


def _boxes_alone(cell: Trials) -> str:
    """What stands in the place of a cell's scores."""
    return f"no intruder in range, {_false_boxes(int(cell.total('boxes')))}"


def _false_boxes(number: int) -> str:
    return f"{number or 'no'} false box{'' if number == 1 else 'es'}"


def _unscored(results: Results, cells: Cells) -> list[Unscored]:
    """The cells without an intruder in range."""
    found, scores = [], results.table("scores")
    range_m = usable_range(results.definition.parameters)
    defaults = {"arena": PAPER_ARENA, "intruders": ""}
    arenas, intruders = (results.column(scores, name, default) for name, default in defaults.items())
    for team, cell in cells.items():
        if not cell.has_scores:
            row = cell.rows.index[0]
            has_intruders = _has_intruders(str(arenas.loc[row]), intruders.loc[row])
            frames, boxes = (int(cell.total(name)) for name in ("frames", "boxes"))
            found.append(Unscored(str(team), frames, boxes, has_intruders, range_m))
    return found


def _has_intruders(arena: str, mobile: object) -> bool:
    """Whether anything intrudes; ``mobile``: how many robots do, empty for as many as the arena has."""
    place = arena_from(arena)
    count = mobile if isinstance(mobile, int) else place.mobile_intruders.count
    return bool(count or place.stationary_intruders.count or place.placed_solids() or place.other_intruders)


def _without_scores(cells: Sequence[Unscored], is_one_of_many: bool) -> Iterator[str]:
    """A sentence for each cell in which there was nothing to score."""
    for cell in cells[:MOST_UNSCORED]:
        which = f"{cell.name}: " if is_one_of_many else ""
        boxes = _false_boxes(cell.boxes)
        per_200 = f"{200.0 * cell.boxes / cell.frames:.2f} in 200 frames"
        if not cell.has_intruders:
            text = f"{boxes} in {cell.frames} frames without intruders: {per_200}."
            yield which + (text if which else text[0].upper() + text[1:])
            continue
        near = "in range of a guard" if cell.range_m is None else f"within {cell.range_m:g} m of a guard"
        aside = f" and {boxes} ({per_200})" if cell.boxes else ""
        yield (
            f"{which}No intruder came {near} in {cell.frames} frames{aside}: nothing to score; give more "
            "--frames or --intruders."
        )
    if len(cells) > MOST_UNSCORED:
        yield f"{len(cells) - MOST_UNSCORED} more cells had no intruder in range."


def _plain_teams(results: Results, cells: Cells) -> Cells:
    """The cells, where nothing else than the team's size differs between them."""
    return {} if set(results.factors) - {"robots"} else cells


def _in_words(number: int) -> str:
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


def _finds(results: Results, cells: Cells) -> list[str]:
    """The share of the intruders within range that each team finds; of many cells, the best one."""
    teams = _plain_teams(results, cells)
    if not teams or len(teams) > MOST_IN_WORDS:
        scores = {team: cell.means["f1_one_to_one"].value for team, cell in cells.items() if cell.has_scores}
        best = max(scores, key=lambda team: (not math.isnan(scores[team]), scores[team]))
        ahead = f"Of {len(cells)} cells, {best} has the highest one-to-one F1: {scores[best]:.3f}."
        return [ahead, *_ranges(results)]
    range_m = usable_range(results.definition.parameters)
    within = "in range" if range_m is None else f"within {range_m:g} m"
    parts: list[str] = []
    for team, cell in teams.items():
        recall = cell.means["recall"].value
        if math.isnan(recall):
            continue
        paper = "" if parts else "paper: "
        beside = "" if cell.paper is None else f" ({paper}{_percent(cell.paper['recall'])})"
        noun = "" if parts else f" robot{'' if team.robots == 1 else 's'}"
        verb = "finds" if team.robots == 1 else "find"
        which = "" if parts else f" of the intruders {within}"
        parts.append(f"{_in_words(team.robots)}{noun} {verb} {_percent(recall)}{which}{beside}")
    text = ", ".join(parts)
    return [f"{text[0].upper()}{text[1:]}."] if text else []


def _ranges(results: Results) -> list[str]:
    """Up to where intruders are looked for by each robot model, where they differ in it."""
    given, robots = results.definition.parameters, results.definition.grid.get("robot", [])
    if usable_range(given) is not None or not all(ROBOTS.is_own(str(robot)) for robot in robots):
        return []
    by_robot = {str(robot): ROBOTS.make(str(robot)).lidar for robot in robots}
    usual = DetectionParameters.usual().costmap
    ranges = [f"{usual.of_lidar(one).obstacle_range_m:g} m ({robot})" for robot, one in by_robot.items()]
    return [f"Intruders are in range within {', '.join(ranges)}."] if ranges else []


def _among_runs(cells: Cells) -> list[str]:
    """How many numbers of the paper's table, which is of one run for each team, lie among our runs."""
    found = [
        single_run(f"{name} of {TEAMS[team]}", *number)
        for team, cell in cells.items()
        if cell.paper is not None and len(cell) >= MIN_TRIALS
        for name, number in cell.numbers().items()
    ]
    known = [each for each in found if each.verdict is not Verdict.INCONCLUSIVE]
    if not known:
        return []
    outside = [in_words(each.claim) for each in known if each.verdict is Verdict.OUTSIDE]
    count = f"{len(known) - len(outside)} of {len(known)} numbers of the paper's table"
    told = f"; outside: {', '.join(outside)}" if outside else ""
    return [f"{count} are within the range of our runs (95 % prediction intervals){told}."]


def _misses(results: Results, cells: Cells) -> list[str]:
    """What most misses of the smallest team that has any come from; without teams, how far costmaps reach."""
    for team, cell in _plain_teams(results, cells).items():
        missed = cell.total("fn")
        if not missed:
            continue
        outside, hidden = (cell.total(name) / missed for name in ("fn_outside_window", "fn_hidden_in_window"))
        size_m = results.definition.parameters.get("local_size_m")
        costmap = f"{size_m:g} m costmap" if isinstance(size_m, int | float) else "local costmap"
        whose, its = ("robot's", "its") if team.robots == 1 else ("robots'", "their")
        who = f"{_in_words(team.robots)} {whose}".capitalize()
        return [
            f"{who} misses: {_percent(outside)} outside {its} {costmap}, {_percent(hidden)} hidden in it."
        ]
    return window_notes(results.definition)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def claims(results: Results) -> list[Finding]:
    """The paper's table, which team is ahead in it, the causes that it names, its words on the fused list.

    Each sentence of the paper is judged once. Its table is of one run for each team: six of its twelve
    numbers, from which the others follow. Nothing is judged of a campaign in another arena than the paper's.
    """
    if not paper_of(results.definition):
        return []
    return [*_claims(cells_of(results))]


def _claims(cells: Cells) -> Iterator[Finding]:
    for team in PAPER:
        if team in cells:
            yield from _table(TEAMS[team], cells[team])
    if PAPER.keys() <= cells.keys():
        yield from (_change(cells, column, rises) for column, rises in RISES.items())
    for team in PAPER:
        if team in cells:
            yield from _delay(TEAMS[team], cells[team].rows)
    if ONE in cells:
        rows = cells[ONE].rows
        share = _share(rows["fn_hidden"], rows["fn"])
        yield finding("1 robot: most misses are hidden intruders", share, 0.5, math.inf, note=_inside(rows))
    if PAPER.keys() <= cells.keys():
        first, second = (_per_frame(cells[team], "fn_hidden") for team in PAPER)
        claim = "a frame has fewer misses of hidden intruders with 5 robots than with 1"
        one, five = (_per_frame(cells[team], "fn_hidden_in_window") for team in PAPER)
        inside = comparison("", one, five, rises=False, within=NOT_NEGATIVE).ours
        note = f"Of intruders inside the local costmaps: {_number(inside)} a frame."
        yield comparison(claim, first, second, rises=False, within=NOT_NEGATIVE, note=note)
    if FIVE in cells:  # section IV.C.2 on the result of Algorithms 3 and 4 (item 35)
        rows = cells[FIVE].rows
        ours = f"The paper says never; up to {_percent(NEVER)} of the frames is our reading of that."
        overlap, order = "no fused boxes overlap", "the order of the robots does not change the boxes"
        for claim, share in (
            (overlap, _share(rows["overlapping"], rows["frames"])),
            (order, _share(rows["reordered"], rows["looked_at"])),
        ):
            yield finding(f"5 robots: {claim}", share, -math.inf, NEVER, note=ours)


def _table(team: str, cell: Trials) -> Iterator[Finding]:
    """True positives per frame, precision and recall of the paper's one run of a team (item 41)."""
    frames = sorted(set(cell.rows["frames"].tolist()))
    note = (
        ""
        if frames == [PAPER_FRAMES]
        else f"Our runs have {' or '.join(map(str, frames))} frames, the paper's {PAPER_FRAMES}, and "
        "shorter runs spread wider."
    )
    numbers = cell.numbers()
    for name in TABLE:
        values, paper, within = numbers[name]
        text = f"{name} is" if name in SCORES else "true positives per frame are"
        yield single_run(f"{team}: {text} {paper:.3f}", values, paper, within, note)


def _delay(team: str, rows: pd.DataFrame) -> Iterator[Finding]:
    """What "is not expected to be significant": misses just come near, false boxes where one just was."""
    ours = f'The paper says "not expected to be significant"; {_percent(MINOR)} is our reading of that.'
    for errors, part, whole in (("false positives", "fp_left", "fp"), ("misses", "fn_new", "fn")):
        claim = f"{team}: few {errors} are due to scan delay"
        yield finding(claim, _share(rows[part], rows[whole]), -math.inf, MINOR, note=ours)


def _change(cells: Cells, score: str, rises: bool) -> Finding:
    """Of a ratio from one robot to five, seed by seed."""
    first, second = (Trials(cells[team].rows.dropna(subset=[score])).by_seed(score) for team in PAPER)
    claim = f"{CALLED.get(score, score)} {'rises' if rises else 'falls'} from 1 robot to 5"
    return comparison(claim, first, second, rises, (0.0, 1.0))


def _inside(rows: pd.DataFrame) -> str:
    """Most misses lie where no local costmap reaches, of which the paper gives no size."""
    share = _share(rows["fn_hidden_in_window"], rows["fn"] - rows["fn_outside_window"])
    return f"Of misses inside the local costmap: {_number(share(0.95))}."


def _per_frame(cell: Trials, count: str) -> dict[int, float]:
    rows = cell.rows
    return dict(zip(rows["seed"].tolist(), (rows[count] / rows["frames"]).tolist(), strict=True))


def _share(part: pd.Series, whole: pd.Series) -> Interval:
    """Sum over sum, over seeds."""
    return partial(ratio_of_sums, part.tolist(), whole.tolist(), within=(0.0, 1.0))


def _number(one: Estimate) -> str:
    """``0.665 [0.547, 0.796]``."""
    if math.isnan(one.value):
        return "not defined"
    interval = "" if math.isnan(one.low) else f" [{one.low:.{DIGITS}f}, {one.high:.{DIGITS}f}]"
    return f"{one.value:.{DIGITS}f}{interval}"
