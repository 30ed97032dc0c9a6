"""What a detection campaign says in words: its headline, and the paper's claims, each judged."""

import math
from collections.abc import Callable, Mapping
from functools import partial

import pandas as pd

from midnet_bench.analysis.compare import Claim, Finding, comparison, findings
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import Estimate, mean, ratio_of_sums
from midnet_bench.analysis.tables import Cell, Table, team_in_words
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key
from midnet_bench.experiments.detection.tables import (
    COUNTS,
    HEADS,
    PAPER,
    PAPER_FRAMES,
    SCORES,
    SHOWN,
    Cells,
    Trials,
    cells_of,
    paper_of,
    window_notes,
)
from midnet_bench.experiments.guarded.tables import METRICS, metric_tables
from midnet_bench.experiments.registry import Headline

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
DIGITS = 3
MOST_IN_WORDS = 4  # teams that a sentence names one by one
TOLERANCE = 0.05  # how near a mean counts as the paper's
COUNT_TOLERANCE = 0.10  # how near a count per frame does, as a share of the paper's
MINOR = 0.10  # the most that a cause "not expected to be significant" may have of the errors
NEVER = 0.01  # the share of frames below which something counts as not happening
RISES = {  # column of the scores -> whether it rises from one robot to five, in the paper's words or table
    "recall": True,
    "precision": False,
    "f1": True,
    "fp": True,
    "fn": False,
    "fn_hidden": False,
    "fn_hidden_in_window": False,
}
TEAMS = dict(zip(PAPER, ("1 robot", "5 robots"), strict=True))
ONE, FIVE = PAPER
CALLED = {  # column of the scores -> its words
    "f1": "F1",
    "tp": "true positives",
    "fp": "false positives",
    "fn": "misses",
    "fn_hidden": "misses of hidden intruders",
    "fn_hidden_in_window": "misses of hidden intruders inside the local costmaps",
}
MISSES = {  # which misses are judged -> columns: how many, how many of them hidden, how many new
    "": ("fn", "fn_hidden", "fn_new"),
    " inside the local costmaps": ("fn_in_window", "fn_hidden_in_window", "fn_new_in_window"),
}


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
    notes = ["F1 one-to-one counts a second box on an intruder as false, the paper as true."]
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
    conclusion = [*_verdicts(results, cells), *_misses(results, cells)]
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


def _plain_teams(results: Results, cells: Cells) -> Cells:
    """The cells, where nothing else than the team's size differs between them."""
    return {} if set(results.factors) - {"robots"} else cells


def _in_words(number: int) -> str:
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


def _verdicts(results: Results, cells: Cells) -> list[str]:
    """The share of the intruders within range that each team finds; of many cells, the best one."""
    teams = _plain_teams(results, cells)
    if not teams or len(teams) > MOST_IN_WORDS:
        scores = {team: cell.means["f1_one_to_one"].value for team, cell in cells.items()}
        best = max(scores, key=lambda team: (not math.isnan(scores[team]), scores[team]))
        return [f"Of {len(cells)} cells, {best} has the highest one-to-one F1: {scores[best]:.3f}."]
    reach_m = results.definition.parameters.get("obstacle_range_m")
    parts: list[str] = []
    for team, cell in teams.items():
        recall = cell.means["recall"].value
        if math.isnan(recall):
            continue
        paper = "" if parts else "paper: "
        beside = "" if cell.paper is None else f" ({paper}{_percent(cell.paper['recall'])})"
        noun = "" if parts else f" robot{'' if team.robots == 1 else 's'}"
        verb = "finds" if team.robots == 1 else "find"
        within = "" if parts else f" of the intruders within {reach_m or 2.5:g} m"
        parts.append(f"{_in_words(team.robots)}{noun} {verb} {_percent(recall)}{within}{beside}")
    text = ", ".join(parts)
    return [f"{text[0].upper()}{text[1:]}."] if text else []


def _misses(results: Results, cells: Cells) -> list[str]:
    """What most misses of the smallest team that has any come from; without teams, how far costmaps reach."""
    for team, cell in _plain_teams(results, cells).items():
        missed = cell.total("fn")
        if not missed:
            continue
        outside, hidden = (cell.total(name) / missed for name in ("fn_outside_window", "fn_hidden_in_window"))
        size_m = results.definition.parameters.get("local_size_m")
        costmap = "local costmap" if size_m is None else f"{size_m:g} m costmap"
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

    Causes of misses are judged twice: over all misses, and over those of intruders that a local costmap
    reaches, since the paper does not say how large its local costmap is. Nothing is judged of a campaign in
    another arena than the paper's.
    """
    if not paper_of(results.definition):
        return []
    cells = {
        team: cell.rows.assign(fn_in_window=cell.rows["fn"] - cell.rows["fn_outside_window"])
        for team, cell in cells_of(results).items()
    }
    tables, found, causes = list[Claim](), list[Finding](), list[Claim]()
    for team in PAPER:
        if team in cells:
            tables += _table(TEAMS[team], PAPER[team], cells[team])
            tables += _delay(TEAMS[team], cells[team])
    if PAPER.keys() <= cells.keys():
        found = [_change(cells[ONE], cells[FIVE], column, rises) for column, rises in RISES.items()]
    if ONE in cells:
        for which, (misses, hidden, _) in MISSES.items():
            claim = f"1 robot: most misses{which} are hidden intruders"
            causes.append(Claim(claim, _share(cells[ONE], hidden, misses), 0.5, math.inf))
    if FIVE in cells:  # section IV.C.2 on the result of Algorithms 3 and 4 (item 35)
        most = f"in at most {100 * NEVER:.0f} % of the frames"
        for claim, part, whole in (
            ("fused boxes overlap", "overlapping", "frames"),
            ("the order of the robots changes the boxes", "reordered", "looked_at"),
        ):
            share = _share(cells[FIVE], part, whole)
            causes.append(Claim(f"5 robots: {claim} {most}", share, -math.inf, NEVER))
    return [*findings(tables), *found, *findings(causes)]


def _table(team: str, paper: Mapping[str, float], rows: pd.DataFrame) -> list[Claim]:
    """The three ratios of one team, and its three counts per frame (item 41)."""
    found = []
    for score in SCORES:
        value = paper[score]
        claim = f"{team}: {CALLED.get(score, score)} is {value:.3f}, within {TOLERANCE}"
        # no score is above 1: what would lie there accepts all that is high enough
        below = value + TOLERANCE if value + TOLERANCE <= 1.0 else math.inf
        ours = partial(mean, rows[score].tolist(), within=(0.0, 1.0))
        found.append(Claim(claim, ours, value - TOLERANCE, below))
    for count in COUNTS:
        value = paper[count] / PAPER_FRAMES
        claim = f"{team}: a frame has {value:.3f} {CALLED[count]}, within {100 * COUNT_TOLERANCE:.0f} %"
        ours = partial(mean, (rows[count] / rows["frames"]).tolist(), within=(0.0, math.inf))
        found.append(Claim(claim, ours, (1.0 - COUNT_TOLERANCE) * value, (1.0 + COUNT_TOLERANCE) * value))
    return found


def _delay(team: str, cell: pd.DataFrame) -> list[Claim]:
    """What "is not expected to be significant": misses just come near, false boxes where one just was."""
    shares = {"false positives": ("fp_left", "fp")}
    shares |= {f"misses{which}": (new, misses) for which, (misses, _, new) in MISSES.items()}
    return [
        Claim(
            f"{team}: at most {100 * MINOR:.0f} % of the {errors} are due to scan delay",
            _share(cell, part, whole),
            -math.inf,
            MINOR,
        )
        for errors, (part, whole) in shares.items()
    ]


def _change(one: pd.DataFrame, five: pd.DataFrame, column: str, rises: bool) -> Finding:
    """Seed by seed; counts are per frame."""
    is_count = column not in SCORES
    first, second = (
        Trials(
            cell.assign(**{column: cell[column] / cell["frames"]})
            if is_count
            else cell.dropna(subset=[column])
        ).by_seed(column)
        for cell in (one, five)
    )
    what, verb = CALLED.get(column, column), "rise" if rises else "fall"
    claim = f"{what} per frame {verb}" if is_count else f"{what} {verb}s"
    within = (0.0, math.inf) if is_count else (0.0, 1.0)
    return comparison(f"{claim} from 1 robot to 5", first, second, rises, within)


def _share(cell: pd.DataFrame, part: str, whole: str) -> Callable[[float], Estimate]:
    """Sum over sum, over seeds."""
    return partial(ratio_of_sums, cell[part].tolist(), cell[whole].tolist(), within=(0.0, 1.0))
