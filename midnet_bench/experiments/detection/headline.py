"""The first lines of a detection campaign: one table of five columns, and the result in words."""

import math
from collections.abc import Mapping
from dataclasses import replace

import pandas as pd

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import Estimate, exact_sum
from midnet_bench.analysis.tables import Cell, Table, rounded
from midnet_bench.analysis.words import team_in_words
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key
from midnet_bench.experiments.detection.tables import (
    HEADS,
    SCORES,
    SHOWN,
    Cells,
    Team,
    cells_of,
    paper_of,
    score_over_seeds,
    window_notes,
)
from midnet_bench.experiments.experiment import Headline
from midnet_bench.experiments.guarded.metric_tables import metric_tables

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
DIGITS = 3
MOST_IN_WORDS = 4
"""teams that a sentence names one by one"""


def headline(results: Results, reference: Results | None = None) -> Headline:
    """The table, the verdict in words and what to type next.

    Args:
        results: of a detection campaign with a finished trial.
        reference: of the campaign whose numbers the package reports; its means stand under those of fewer
            seeds if the same parameters made them.
    """
    cells = cells_of(results)
    known = {} if reference is None else reference_cells(results, reference, cells)
    definition = results.definition
    seeds = max(map(len, cells.values()))
    paper = paper_of(definition)
    table = headline_table(cells, known, paper)
    scored = definition.parameters.get("frames")
    frames = "" if scored is None else f", {scored} frames"
    arena = str(definition.parameters.get("arena", "{"))
    place = "" if arena.startswith("{") else f": {arena}"
    title = f"Detection test{place}{frames}, {_seeds(next(iter(cells.values())))}"
    conclusion = [*_verdicts(results, cells, paper), *_misses(results, cells)]
    notes = ["F1 one-to-one counts a second box on an intruder as false, the paper as true."]
    if seeds > 1 or known:
        notes += ["±: the wider side of the 95 % interval (t, over seeds)."]
    if seeds == 2:
        notes += ["Two seeds give no interval; three do."]
    if known:
        some = next(iter(known.values()))
        notes += [f'"{len(some)} seeds" is the packaged reference, {_seeds(some)}.']
    following = (
        "One seed says little: --seeds 20 gives intervals of your own."
        if seeds == 1
        else f"Next: 'midnet-bench verify {results.directory}' checks each claim of the paper."
    )
    return Headline([replace(table, title=title), *metric_tables(results)], conclusion, notes, following)


def headline_table(cells: Cells, reference: Cells, paper: Mapping[Team, Row]) -> Table:
    """The scores of each cell: ours, the reference's and the paper's, as text for a terminal."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in cells.items():
        sources = {_named(len(cell)): {score: score_over_seeds(cell, score) for score in SHOWN}}
        if name in reference:
            known = reference[name]
            sources[f"{len(known)} seeds"] = {score: score_over_seeds(known, score) for score in SHOWN}
        texts = {
            source: {score: _text(one) for score, one in means.items()} for source, means in sources.items()
        }
        if name in paper:
            # blanks in place of an interval, so that digits stand above each other
            texts["paper"] = {score: _text(_exactly(float(paper[name][score] or 0.0))) for score in SCORES}
        for source, scores in texts.items():
            label = team_in_words(str(name)) if source == next(iter(texts)) else ""
            rows.append({"trial": label, "source": source, **dict.fromkeys(SHOWN, ""), **scores})
    if len({row["source"] for row in rows}) == 1:  # said in the title
        rows = [{name: cell for name, cell in row.items() if name != "source"} for row in rows]
    return Table("detection_headline", "Detection test", rows, labels=HEADS)


def reference_cells(results: Results, reference: Results, cells: Cells) -> Cells:
    """The reference's cells that the same parameters made as ours, where it has more seeds."""
    found = {}
    for name, cell in cells_of(reference).items():
        if name not in cells or len(cells[name]) >= len(cell):
            continue
        ours, theirs = (_result_key(campaign, name.robots) for campaign in (results, reference))
        if ours is not None and ours == theirs:
            found[name] = cell
    return found


def _result_key(results: Results, robots: int) -> DetectionParameters | None:
    """What numbers depend on; None where this version has no such parameters."""
    usual = DetectionParameters.usual()
    outputs: Row = {"record": usual.record, "metrics": usual.metrics}
    values = {**results.definition.parameters, "robots": robots, **outputs}
    try:
        return result_key(DetectionParameters.from_flat(values))
    except InputError:
        return None


def _named(seeds: int) -> str:
    return "this seed" if seeds == 1 else f"these {seeds} seeds"


def _seeds(cell: pd.DataFrame) -> str:
    first, last = cell["seed"].min(), cell["seed"].max()
    return f"seed {first}" if first == last else f"seeds {first} to {last}"


def _exactly(value: float) -> Estimate:
    return Estimate(value, math.nan, math.nan, 0)


def _text(one: Estimate) -> str:
    """``0.987 ±.002``; blanks where there is no interval, so that points stand above each other."""
    if math.isnan(one.value):
        return "n/a"
    half = max(one.high - one.value, one.value - one.low)
    aside = "" if math.isnan(half) else f"±{rounded(half, DIGITS).removeprefix('0')}"
    return f"{rounded(one.value, DIGITS)} {aside:{DIGITS + 2}}"


def _plain_teams(results: Results, cells: Cells) -> dict[int, pd.DataFrame]:
    """The cells by team size, where nothing else differs between them."""
    if set(results.factors) - {"robots"}:
        return {}
    return {name.robots: cell for name, cell in cells.items()}


def _in_words(number: int) -> str:
    return NUMBERS[number] if number < len(NUMBERS) else str(number)


def _verdicts(results: Results, cells: Cells, paper: Mapping[Team, Row]) -> list[str]:
    """The share of the intruders within range that each team finds; of many cells, the best one."""
    teams = _plain_teams(results, cells)
    if not teams or len(teams) > MOST_IN_WORDS:
        scores = {name: score_over_seeds(cell, "f1_one_to_one").value for name, cell in cells.items()}
        best = max(scores, key=lambda name: (not math.isnan(scores[name]), scores[name]))
        return [f"Of {len(cells)} cells, {best} has the highest one-to-one F1: {scores[best]:.3f}."]
    reach_m = results.definition.parameters.get("obstacle_range_m")
    parts: list[str] = []
    for robots, cell in teams.items():
        recall = score_over_seeds(cell, "recall").value
        if math.isnan(recall):
            continue
        papers = paper.get(Team(robots))
        beside = "" if papers is None else f" ({'paper: ' if not parts else ''}{_percent(papers['recall'])})"
        noun = "" if parts else f" robot{'' if robots == 1 else 's'}"
        verb = "finds" if robots == 1 else "find"
        within = "" if parts else f" of the intruders within {reach_m or 2.5:g} m"
        parts.append(f"{_in_words(robots)}{noun} {verb} {_percent(recall)}{within}{beside}")
    text = ", ".join(parts)
    return [f"{text[0].upper()}{text[1:]}."] if text else []


def _misses(results: Results, cells: Cells) -> list[str]:
    """What most misses of the smallest team that has any come from; without teams, how far costmaps reach."""
    for robots, cell in _plain_teams(results, cells).items():
        missed = exact_sum(cell["fn"])
        if not missed:
            continue
        outside, hidden = (
            exact_sum(cell[name]) / missed for name in ("fn_outside_window", "fn_hidden_in_window")
        )
        size_m = results.definition.parameters.get("local_size_m")
        costmap = "local costmap" if size_m is None else f"{size_m:g} m costmap"
        whose, its = ("robot's", "its") if robots == 1 else ("robots'", "their")
        team = f"{_in_words(robots)} {whose}".capitalize()
        return [
            f"{team} misses: {_percent(outside)} outside {its} {costmap}, {_percent(hidden)} hidden in it."
        ]
    return window_notes(results.definition)


def _percent(share: Cell) -> str:
    return f"{100.0 * float(str(share)):.0f} %"
