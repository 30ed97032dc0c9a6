import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from midnet_bench.analysis import statistics
from midnet_bench.analysis.statistics import Estimate, mean, paired_difference, ratio_of_sums, wilson


def generator() -> np.random.Generator:
    return np.random.default_rng(7)


# the 95 % intervals of item 67, percent: rate, then n = 20, 40, 60, 80, 100
WILSON = {
    50: ["30-70", "35-65", "38-62", "39-61", "40-60"],
    70: ["48-85", "55-82", "57-80", "59-79", "60-78"],
    80: ["58-92", "65-90", "68-88", "70-87", "71-87"],
    90: ["70-97", "77-96", "80-95", "81-95", "83-94"],
}


@pytest.mark.parametrize("rate", WILSON)
def test_wilson_intervals_of_the_labyrinths_points(rate: int) -> None:
    for n, printed in zip((20, 40, 60, 80, 100), WILSON[rate], strict=True):
        estimate = wilson(n * rate // 100, n)
        assert estimate.value == pytest.approx(rate / 100)
        assert f"{100 * estimate.low:.0f}-{100 * estimate.high:.0f}" == printed


@given(st.integers(0, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_is_its_formula(case: tuple[int, int]) -> None:
    k, n = case
    estimate = wilson(k, n)
    if n == 0:
        assert math.isnan(estimate.value)
        return
    z, p = 1.959963984540054, k / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    assert (estimate.low, estimate.high) == pytest.approx((middle - half, middle + half), abs=1e-9)
    assert 0.0 <= estimate.low <= estimate.value + 1e-12
    assert estimate.value - 1e-12 <= estimate.high <= 1.0


def test_wilson_refuses_more_successes_than_trials() -> None:
    with pytest.raises(ValueError, match="greater"):
        wilson(3, 2)


def test_bootstrap_of_the_mean_is_near_the_normal_interval_for_many_trials() -> None:
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    estimate = mean(values.tolist(), generator())
    half = 1.96 * values.std(ddof=1) / math.sqrt(values.size)
    assert estimate.value == pytest.approx(values.mean())
    assert estimate.n == 400
    assert (estimate.low, estimate.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.02
    )
    wider = mean(values.tolist(), generator(), confidence=0.99)
    assert wider.low < estimate.low < estimate.high < wider.high


def test_bootstrap_of_two_trials_by_hand() -> None:
    # resamples of (0, 1) have the mean 0, 1/2 or 1 with probability 1/4, 1/2 and 1/4
    assert mean([0.0, 1.0], generator(), confidence=0.6)[:3] == (0.5, 0.0, 1.0)
    assert mean([0.0, 1.0], generator(), confidence=0.4)[:3] == (0.5, 0.5, 0.5)


@pytest.mark.parametrize("n", [2, 3, 20, 501])
def test_intervals_are_scipys_to_the_last_bit(n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the resamples are drawn in blocks that do not divide their number."""
    monkeypatch.setattr(statistics, "BLOCK", 7 * n + 1)
    rng = np.random.default_rng(n)
    values, below = rng.normal(50.0, 20.0, n), rng.integers(1, 9, n).astype(float)
    options = {"n_resamples": statistics.RESAMPLES, "paired": True, "method": "percentile"}
    for ours, samples, statistic in (
        (mean(values.tolist(), generator()), (values,), np.mean),
        (
            ratio_of_sums(values.tolist(), below.tolist(), generator()),
            (values, below),
            lambda a, b, axis: a.sum(axis=axis) / b.sum(axis=axis),
        ),
    ):
        scipys = stats.bootstrap(samples, statistic, rng=generator(), **options).confidence_interval
        assert (ours.low, ours.high) == (scipys.low, scipys.high)


@pytest.mark.usefixtures("all_resamples")
@pytest.mark.parametrize(("n", "resamples"), [(1000, 9999), (4000, 2500), (8000, 1999)])
def test_many_trials_are_resampled_less_often(n: int, resamples: int) -> None:
    values = np.random.default_rng(1).normal(size=n)
    ours = mean(values.tolist(), generator())
    drawn = generator().integers(0, n, (resamples, n), dtype=np.int32)
    means = np.array([values[one].mean() for one in drawn])
    assert (ours.low, ours.high) == tuple(stats.quantile(means, np.array([0.025, 0.975])))
    half = 1.96 * values.std() / math.sqrt(n)
    assert (ours.low, ours.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.1 * half
    )


def test_many_trials_take_little_memory() -> None:
    values = np.random.default_rng(1).normal(size=20_000).tolist()
    tracemalloc.start()
    mean(values, generator())
    _, peak_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak_bytes < 5e6  # at once it would be 160 MB of a tenth of the resamples


def test_same_generator_gives_the_same_interval() -> None:
    values = np.random.default_rng(2).normal(size=20).tolist()
    assert mean(values, generator()) == mean(values, generator())
    assert mean(values, generator()) != mean(values, np.random.default_rng(8))


def test_trials_that_all_score_alike_have_an_interval_of_a_point() -> None:
    assert mean([1.0] * 20, generator()) == Estimate(1.0, 1.0, 1.0, 20)


def test_undefined_trials_are_left_out_and_too_few_have_no_interval() -> None:
    nan = math.nan
    assert mean([1.0, nan, 1.0, nan], generator()) == Estimate(1.0, 1.0, 1.0, 2)
    alone = mean([0.5, nan], generator())
    assert (alone.value, alone.n) == (0.5, 1)
    assert math.isnan(alone.low)
    assert math.isnan(alone.high)
    assert math.isnan(mean([], generator()).value)


def test_paired_difference_cancels_what_both_trials_share() -> None:
    rng = np.random.default_rng(3)
    hard_or_easy = rng.normal(0.0, 10.0, 30)
    first = hard_or_easy
    second = hard_or_easy + 0.5 + rng.normal(0.0, 0.1, 30)
    estimate = paired_difference(first.tolist(), second.tolist(), generator())
    assert estimate.value == pytest.approx((second - first).mean())
    assert 0.4 < estimate.low < estimate.high < 0.6
    assert paired_difference([1.0, math.nan], [2.0, 1.0], generator()).n == 1
    with pytest.raises(ValueError, match="pairs are needed: 1 values against 2"):
        paired_difference([1.0], [1.0, 2.0], generator())


def test_ratio_of_sums_pools_before_it_divides() -> None:
    # trial ratios 1 and 0.1, but the second trial is a hundred times as long
    estimate = ratio_of_sums([1, 10], [1, 100], generator())
    assert estimate.value == pytest.approx(11 / 101)
    assert (estimate.low, estimate.high) == (0.1, 1.0)


def test_ratio_of_sums_is_the_bootstrap_written_out() -> None:
    rng = np.random.default_rng(5)
    below = rng.integers(50, 150, 25)
    above = rng.binomial(below, 0.8)
    draws = np.random.default_rng(11).integers(0, 25, (9999, 25))
    low, high = np.quantile(above[draws].sum(axis=1) / below[draws].sum(axis=1), [0.025, 0.975])
    estimate = ratio_of_sums(above.tolist(), below.tolist(), generator())
    assert (estimate.low, estimate.high) == pytest.approx((low, high), abs=0.002)


def test_ratio_without_a_denominator_is_undefined() -> None:
    for estimate in (ratio_of_sums([0, 0], [0, 0], generator()), ratio_of_sums([], [], generator())):
        assert all(math.isnan(number) for number in estimate[:3])
    # one resample in four draws the empty trial twice
    half = ratio_of_sums([0, 3], [0, 4], generator())
    assert half.value == 0.75
    assert math.isnan(half.low)
    with pytest.raises(ValueError, match="pairs are needed"):
        ratio_of_sums([1], [1, 2], generator())


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 50), st.integers(1, 50)), min_size=2, max_size=12))
def test_intervals_stay_within_what_the_trials_span(trials: list[tuple[int, int]]) -> None:
    tp, fp = [hit for hit, _ in trials], [miss for _, miss in trials]
    estimate = ratio_of_sums(tp, [a + b for a, b in trials], generator())
    assert estimate.value == pytest.approx(sum(tp) / (sum(tp) + sum(fp)))
    assert 0.0 <= estimate.low <= estimate.high <= 1.0
    single = [a / (a + b) for a, b in trials]
    average = mean(single, generator())
    assert min(single) - 1e-12 <= average.low <= average.high <= max(single) + 1e-12
