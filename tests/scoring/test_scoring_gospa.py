"""GOSPA by hand, by its definition, and as a metric."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.scoring.frame_counts import gospa

COORDINATES = st.integers(0, 12).map(lambda quarters: quarters / 4)
PLACES = st.lists(st.tuples(COORDINATES, COORDINATES), max_size=4)


def test_by_hand() -> None:
    assert gospa([], [], []) == 0.0
    assert gospa([(0.0, 0.0)], [(0.0, 0.3)], [True]) == pytest.approx(0.3)
    assert gospa([], [(0.0, 0.0)], [True]) == 0.5, "a miss"
    assert gospa([(0.0, 0.0)], [], []) == 0.5, "a false box"
    assert gospa([(0.0, 0.0)], [(5.0, 0.0)], [True]) == 1.0, "too far to be a pair"
    assert gospa([(0.0, 0.0), (0.2, 0.0)], [(0.0, 0.0)], [True]) == 0.5, "a further box on an intruder"


def test_an_intruder_out_of_range_may_be_missed_and_may_be_found() -> None:
    assert gospa([], [(0.0, 0.0)], [False]) == 0.0
    assert gospa([(0.0, 0.1)], [(0.0, 0.0)], [False]) == pytest.approx(0.1)
    assert gospa([(0.0, 0.6)], [(0.0, 0.0)], [False]) == 0.5, "nearer to false than to it"


@given(PLACES, PLACES)
def test_it_is_its_definition(boxes: list[tuple[float, float]], intruders: list[tuple[float, float]]) -> None:
    """The least over all assignments of the smaller set, distances cut off at 1 m."""
    few, many = sorted((boxes, intruders), key=len)
    least = min(
        sum(min(math.dist(a, b), 1.0) for a, b in zip(few, chosen, strict=True))
        for chosen in itertools.permutations(many, len(few))
    )
    expected = least + 0.5 * (len(many) - len(few))
    assert gospa(boxes, intruders, [True] * len(intruders)) == pytest.approx(expected)


@given(PLACES, PLACES, PLACES)
def test_it_is_a_metric(
    a: list[tuple[float, float]], b: list[tuple[float, float]], c: list[tuple[float, float]]
) -> None:
    def distance(one: list[tuple[float, float]], other: list[tuple[float, float]]) -> float:
        return gospa(one, other, [True] * len(other))

    assert distance(a, a) == 0.0
    assert distance(a, b) == pytest.approx(distance(b, a))
    assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9
