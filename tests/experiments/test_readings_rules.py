"""What a rule of ``calibration.yaml`` chooses, against choices made by hand."""

import math
from dataclasses import replace
from typing import Any

import pytest

from midnet_bench.errors import InputError
from midnet_bench.experiments.readings.parameters import ReadingsParameters
from midnet_bench.experiments.readings.rules import (
    Candidate,
    Rule,
    choosing,
    combined,
    digest,
    distance,
    is_clean,
    name_of,
    ranked,
)
from midnet_bench.experiments.readings.trial import readings_of

TWELVE, BEFORE_RESULTS, WITH_RESULTS = choosing().rules
PLAIN = choosing().plain


def candidate(
    name: str, ratio: float, count: float = 0.0, alone: float = 0.0, worst: float = 0.0, **options: Any
) -> Candidate:
    return Candidate(name, options, {"P(1)": ratio}, {"tp(1)": count}, alone, worst)


def order(rule: Rule, *candidates: Candidate) -> list[str]:
    return [one.name for one in ranked(rule, candidates, PLAIN)]


def of_then(**options: Any) -> dict[str, Any]:
    """One of the 54 candidates of the old rules."""
    common = {"local_size_m": 4.0, "local_map": "persistent", "inf_is_valid": True, "ally_diameter_m": 0.297}
    return {**common, "iou_ally": 0.05, "in_range": "edge", "tp_boxes": "every", **options}


def test_the_first_rule_asks_each_team_to_be_clean_and_weighs_all_numbers_alike() -> None:
    near_in_one = candidate("near in one", 0.0, 0.05)
    assert distance(TWELVE, near_in_one) == pytest.approx(math.sqrt(0.05**2 / 2))
    even = candidate("even", 0.02, -0.02)
    ghosts = candidate("ghosts", 0.0, worst=1.01)
    noise = candidate("noise", 0.001, alone=2.0, worst=2.0)
    assert order(TWELVE, near_in_one, ghosts, noise, even) == ["even", "near in one", "ghosts", "noise"]
    assert is_clean(TWELVE, candidate("at the bound", 0.0, worst=1.0))
    assert is_clean(TWELVE, candidate("empty arena not run", 0.0, alone=math.nan, worst=math.nan))
    assert order(TWELVE, ghosts, noise) == ["ghosts", "noise"], "where none is clean, all compete"


def test_within_the_margin_the_plainest_is_chosen() -> None:
    best = candidate("best", 0.020, 0.020, local_size_m=3.5, in_range="centre")
    plainer = candidate("plainer", 0.024, 0.024, local_size_m=3.5, in_range="edge")
    as_plain = candidate("as plain, farther", 0.0249, 0.0249, local_size_m=3.0, in_range="centre")
    far = candidate("far and plain", 0.0251, 0.0251, local_size_m=3.0, in_range="edge")
    assert order(TWELVE, far, as_plain, best, plainer) == [
        "plainer",
        "as plain, farther",
        "best",
        "far and plain",
    ]


def test_the_earlier_rules_differ_in_whom_they_ask_to_be_clean_and_in_their_ties() -> None:
    persistent = candidate("persistent", 0.014, worst=11.7, **of_then())
    wider = candidate("wider", 0.0135, worst=33.0, **of_then(ally_diameter_m=0.21, iou_ally=0.1))
    single = candidate("single scan", 0.03, worst=0.7, **of_then(local_map="single_scan"))
    new = candidate("no candidate then", 0.0, **of_then(in_range="centre"))
    everything = (wider, persistent, single, new)
    assert order(BEFORE_RESULTS, *everything) == ["single scan", "wider", "persistent"]
    assert order(WITH_RESULTS, *everything) == ["persistent", "wider", "single scan"]


def test_a_missing_number_comes_last() -> None:
    assert order(TWELVE, candidate("none", math.nan), candidate("far", 0.9)) == ["far", "none"]
    assert order(TWELVE) == []


@pytest.mark.slow
def test_every_candidate_is_a_reading_that_can_be_run() -> None:
    usual = ReadingsParameters().flat()
    for changes in combined(choosing().candidates):
        assert ReadingsParameters.from_flat({**usual, **changes}) is not None


def test_the_old_candidates_are_among_the_new_ones() -> None:
    assert len(readings_of("calibration")) == 576
    for rule in (BEFORE_RESULTS, WITH_RESULTS):
        assert rule.among is not None
        among = combined(rule.among)
        found = [one for one in combined(choosing().candidates) if one in among]
        assert len(found) == 54
    assert {key for axis in choosing().second_stage for one in axis for key in one} == {"stationary_scale"}


def test_a_trial_names_the_rules_that_it_was_run_under() -> None:
    named = ReadingsParameters.of(readings="calibration").flat()["readings"]
    assert named == f"calibration:{digest()}"
    assert ReadingsParameters.of(readings=named).flat()["readings"] == named
    for wrong, said in (("calibration:0", "is not the calibration"), ("item", "did you mean 'items'")):
        with pytest.raises(InputError, match=said):
            ReadingsParameters.of(readings=wrong)
    assert replace(ReadingsParameters(), readings="default").readings == "default"
    assert readings_of("default") == {"default": {}}
    assert name_of({}) == "default"
