"""Candidates for what the paper leaves open, and the rules that choose among them: ``calibration.yaml``."""

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from midnet_bench.analysis.statistics import exact_mean
from midnet_bench.io.checked_yaml import Spec, parse, read_yaml
from midnet_bench.settings import Scalar

FILE = Path(__file__).with_name("calibration.yaml")
Changes = dict[str, Scalar]
"""what a reading sets"""
Axes = list[list[Changes]]
"""one entry of each list makes a reading"""
Deviations = Mapping[str, float]
"""of each number of the paper's table: ours less the paper's"""


class Ties(Spec):
    """Which distances are as good as equal, and who comes first among them; the file says more."""

    to: Literal["plainest", "fewest_false"]
    within: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    rounded_to: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Rule(Spec):
    """One rule of choosing; the file says what each key means."""

    name: str
    source: str
    among: Axes | None = None
    """None: all candidates"""
    clean_for: Literal["one", "all"]
    clean_at_most: Annotated[float, Field(ge=0.0)]
    compared: Annotated[tuple[Literal["ratios", "counts"], ...], Field(min_length=1)]
    distance: Literal["rms", "largest"]
    ties: Ties | None = None


class Choosing(Spec):
    """The file as a whole."""

    candidates: Axes
    second_stage: Axes
    plain: Changes
    rules: Annotated[tuple[Rule, ...], Field(min_length=1)]


class Candidate(NamedTuple):
    """One reading and what its runs gave, all that a rule may look at."""

    name: str
    options: Mapping[str, Scalar]
    ratios: Deviations
    """precision, recall, F1 of each team size"""
    counts: Deviations
    """tp, fp and fn per frame, as shares of the paper's tp + fn of that team size"""
    false_alone: float
    """false boxes of one robot per 200 frames without intruders; NaN if that was not run"""
    false_worst: float
    """the same of the worst team size"""


@cache
def choosing() -> Choosing:
    """What ``calibration.yaml`` says. Raises InputError in one line that names file and key."""
    return parse(Choosing, read_yaml(FILE), str(FILE))


@cache
def digest() -> str:
    """8 hex digits of what ``calibration.yaml`` says, its comments apart."""
    text = json.dumps(choosing().model_dump(), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def combined(axes: Axes) -> list[Changes]:
    """Every combination of one entry of each list, the last list changing fastest."""
    return [dict(itertools.chain(*(one.items() for one in parts))) for parts in itertools.product(*axes)]


def name_of(changes: Mapping[str, Scalar]) -> str:
    """``key=value key=value``; ``default`` of no change."""
    return " ".join(f"{key}={str(value).lower()}" for key, value in changes.items()) or "default"


def ranked(rule: Rule, candidates: Sequence[Candidate], plain: Mapping[str, Scalar]) -> list[Candidate]:
    """The candidates that a rule looks at, the one that it chooses first; of none, an empty list.

    Clean ones come before the others, so that the first of all is chosen where none is clean.
    """
    if rule.among is not None:
        names = {name_of(_sorted(changes)) for changes in combined(rule.among)}
        candidates = [one for one in candidates if name_of(_sorted(one.options)) in names]
    clean = [one for one in candidates if is_clean(rule, one)]
    others = [one for one in candidates if not is_clean(rule, one)]
    return _by_distance(rule, clean, plain) + _by_distance(rule, others, plain)


def is_clean(rule: Rule, candidate: Candidate) -> bool:
    """Whether the arena without intruders is; true of all where nobody ran it."""
    false = candidate.false_alone if rule.clean_for == "one" else candidate.false_worst
    return not false > rule.clean_at_most


def distance(rule: Rule, candidate: Candidate) -> float:
    """How far a candidate is from the paper's table by this rule; infinite where a number is missing."""
    deviations = [value for kind in rule.compared for value in (candidate._asdict()[kind]).values()]
    if any(math.isnan(value) for value in deviations):
        return math.inf
    if rule.distance == "largest":
        return max(map(abs, deviations))
    return root_mean_square(deviations)


def root_mean_square(values: Sequence[float]) -> float:
    """Of at least one value."""
    return math.sqrt(exact_mean([value * value for value in values]))


def departures(options: Mapping[str, Scalar], plain: Mapping[str, Scalar]) -> int:
    """How many options differ from the plain ones, those that a reading leaves alone not counted."""
    return sum(1 for key, value in plain.items() if options.get(key, value) != value)


def _by_distance(rule: Rule, candidates: Sequence[Candidate], plain: Mapping[str, Scalar]) -> list[Candidate]:
    """Nearest first, ties as the rule says."""
    distances = {one.name: distance(rule, one) for one in candidates}
    least = min(distances.values(), default=math.inf)

    def key(one: Candidate) -> tuple[float, float, float]:
        far = distances[one.name]
        if rule.ties is None or math.isinf(far):
            return far, 0.0, 0.0
        if rule.ties.rounded_to:
            far = round(far / rule.ties.rounded_to) * rule.ties.rounded_to
        if far <= least + rule.ties.within:
            far = min(far, least)
        if rule.ties.to == "fewest_false":
            return far, 0.0 if math.isnan(one.false_worst) else one.false_worst, 0.0
        return far, departures(one.options, plain), distances[one.name]

    return sorted(candidates, key=key)


def _sorted(changes: Mapping[str, Scalar]) -> Changes:
    return dict(sorted(changes.items()))
