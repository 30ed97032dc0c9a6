"""Distances from a paper's numbers."""

import math

import numpy as np
import pytest

from midnet_bench.analysis.distance import distance


def test_a_distance_is_that_of_the_means_over_seeds() -> None:
    rng = np.random.default_rng(3)
    differences = rng.normal(0.3, 0.1, (40, 12))
    found = distance(differences)
    assert found.value.value == pytest.approx(math.sqrt(float((differences.mean(axis=0) ** 2).mean())))
    without = [
        math.sqrt(float((np.delete(differences, seed, axis=0).mean(axis=0) ** 2).mean()))
        for seed in range(40)
    ]
    assert (found.least, found.most) == (pytest.approx(min(without)), pytest.approx(max(without)))
    draws = differences[rng.integers(0, 40, (4000, 40))].mean(axis=1)
    low, high = np.quantile(np.sqrt((draws**2).mean(axis=1)), (0.025, 0.975))
    assert (found.value.low, found.value.high) == pytest.approx((low, high), abs=0.001)
    assert found == distance(differences), "the resamples are always the same"


def test_few_seeds_and_numbers_that_are_not_defined() -> None:
    nan = math.nan
    assert distance(np.array([[0.3, nan], [0.1, 0.4]])).value.value == pytest.approx(math.sqrt(0.1))
    one, two = distance(np.array([[3.0, 4.0]])), distance(np.array([[3.0, 4.0], [0.0, 0.0]]))
    assert one.value.value == pytest.approx(math.sqrt(12.5))
    assert all(math.isnan(number) for number in (one.least, one.most, one.value.low, two.value.low))
    assert (two.least, two.most) == (0.0, pytest.approx(math.sqrt(12.5)))
    nothing = distance(np.full((5, 2), nan)).value
    assert all(math.isnan(number) for number in nothing[:3])
