"""What each reading of the paper's gaps moves, and which one each rule of ``calibration.yaml`` chooses."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import exact_mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.experiments.detection.counting import COUNTS, PAPER, PAPER_FRAMES, SCORES
from midnet_bench.experiments.readings.rules import (
    Candidate,
    Rule,
    choosing,
    distance,
    is_clean,
    ranked,
    root_mean_square,
)
from midnet_bench.experiments.readings.trial import readings_of
from midnet_bench.scoring.frame_counts import ratios
from midnet_bench.settings import Scalar

HEADINGS = {"precision": "P", "recall": "R", "f1": "F1"}
NOISE, FALSE = "noise_per_200_frames", "false_per_200_frames"
"""False boxes per 200 frames without intruders: of one guard, where only noise causes any; of a team."""
FRAMES = 200
LEADERS = 20
"""rows of a calibration's hundreds that a reader is shown"""


class _Judged(NamedTuple):
    """A reading for people and for a rule."""

    row: dict[str, Cell]
    candidate: Candidate


def tables(results: Results) -> list[Table]:
    """``readings_table``: a row per reading, nearest to the paper's table first, by the first rule there is.

    A calibration also has ``calibration_choice``, a row per rule with what it picks, and
    ``calibration_table``, all candidates; ``readings_table`` then has the first of them.
    """
    judged = _judged(results)
    which = str(results.definition.parameters.get("readings", "items"))
    rule, *_ = choosing().rules
    rows = [judged[one.name].row for one in _ranked(rule, judged)]
    scores = {f"{HEADINGS[score]}({team[0]})" for score in SCORES for team in PAPER}
    beside = [name for row in rows[:1] for name in row if name not in {"reading", *scores}]
    title = f"Readings, the best by the rule '{rule.name}' first; counts are per frame"
    if which == "items":
        return [Table("readings_table", title, rows, beside=beside)]
    choice = [_chosen(one, judged) for one in choosing().rules]
    choices = Table(
        "calibration_choice",
        "What each rule chooses; counts are per frame",
        [row for row in choice if row],
        beside=[*beside, *sorted(scores)],
    )
    if len(rows) <= LEADERS:
        return [choices, Table("readings_table", title, rows, beside=beside)]
    note = f"The first {LEADERS} of {len(rows)} candidates; calibration_table has all."
    return [
        choices,
        Table("readings_table", title, rows[:LEADERS], notes=[note], beside=beside),
        Table("calibration_table", title, rows),
    ]


def _judged(results: Results) -> dict[str, _Judged]:
    """The readings by name, in the campaign's order."""
    frame = results.table("readings")
    if frame.empty:
        return {}
    changes = readings_of(str(results.definition.parameters.get("readings", "items")))
    factors = [factor for factor in results.factors if factor not in ("robots", "arena")]
    teams = frame.assign(team=[f"{size}-robot" for size in results.column(frame, "robots")])
    found = {}
    for place, runs in teams.groupby(["reading", *factors], sort=False):
        reading, *values = place
        options: dict[str, Any] = dict(zip(factors, values, strict=True))
        others = [f"{key}={value}" for key, value in options.items()]
        name = " ".join([str(reading), *others])
        found[name] = _judge(name, {**changes.get(str(reading), {}), **options}, runs)
    return found


def _judge(name: str, options: Mapping[str, Scalar], runs: pd.DataFrame) -> _Judged:
    """One reading, from its rows of all teams and seeds."""
    has_intruders = runs["has_intruders"].astype(bool)
    means: dict[str, Cell] = {}
    per_frame: dict[str, Cell] = {}
    of_ratios: dict[str, float] = {}
    of_counts: dict[str, float] = {}
    for team, paper in PAPER.items():
        seen = runs[has_intruders & (runs["team"] == team)]
        scored = [ratios(*counts)._asdict() for counts in seen[[*COUNTS]].to_numpy().tolist()]
        for score in SCORES:
            key = f"{HEADINGS[score]}({team[0]})"
            means[key] = mean = exact_mean([one[score] for one in scored]) if scored else math.nan
            of_ratios[key] = mean - float(paper[score] or 0.0)
        to_find = float(paper["tp"] or 0) + float(paper["fn"] or 0)
        for count in COUNTS:
            key = f"{count}({team[0]})"
            per_frame[key] = mean = _per_frame(seen, count)
            of_counts[key] = (mean * PAPER_FRAMES - float(paper[count] or 0)) / to_find
    empty = {
        str(team): FRAMES * _per_frame(one, "fp")
        for team, one in runs[~has_intruders].groupby("team", sort=False)
    }
    alone, worst = empty.get("1-robot", math.nan), max(empty.values(), default=math.nan)
    gaps = [*of_ratios.values()]
    twelve = [*gaps, *of_counts.values()]
    row: dict[str, Cell] = {
        "reading": name,
        **means,
        "largest gap": max(map(abs, gaps)),
        "rms gap": root_mean_square(gaps),
        **per_frame,
        "largest of 12": max(map(abs, twelve)),
        "rms of 12": root_mean_square(twelve),
    }
    if empty:
        row |= {NOISE: alone, FALSE: worst}
    return _Judged(row, Candidate(name, options, of_ratios, of_counts, alone, worst))


def _chosen(rule: Rule, judged: Mapping[str, _Judged]) -> dict[str, Cell] | None:
    """What a rule picks, among how many; None if it looks at none of them."""
    order = _ranked(rule, judged)
    if not order:
        return None
    return {
        "rule": rule.name,
        "candidates": len(order),
        "clean": sum(is_clean(rule, one) for one in order),
        "distance": distance(rule, order[0]),
        **judged[order[0].name].row,
    }


def _ranked(rule: Rule, judged: Mapping[str, _Judged]) -> list[Candidate]:
    return ranked(rule, [one.candidate for one in judged.values()], choosing().plain)


def _per_frame(runs: pd.DataFrame, count: str) -> float:
    frames = sum(runs["frames"])
    return float(sum(runs[count]) / frames) if frames else math.nan
