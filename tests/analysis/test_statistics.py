"""Intervals: against formulas, by hand, and by how often they hold the truth."""

import math
from collections.abc import Callable
from functools import partial
from random import Random

import numpy as np
import pytest
import scipy
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.analysis.statistics import (
    Estimate,
    distance,
    exact_sum,
    holm,
    mean,
    outlier,
    p_value,
    paired_difference,
    prediction,
    ratio_of_sums,
    share,
    standard_deviation,
)

FINITE = st.integers(-(10**9), 10**9).map(lambda thousandths: thousandths / 1000)


@given(st.integers(3, 200).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_a_share_of_yes_and_no_has_wilsons_interval_with_students_quantile(case: tuple[int, int]) -> None:
    k, n = case
    estimate = share([1.0] * k + [0.0] * (n - k))
    t, p = scipy.stats.t.ppf(0.975, n - 1), k / n
    middle = (p + t * t / (2 * n)) / (1 + t * t / n)
    half = t / (1 + t * t / n) * math.sqrt(p * (1 - p) / n + t * t / (4 * n * n))
    assert estimate == pytest.approx((p, middle - half, middle + half, n), abs=1e-9)
    assert 0.0 <= estimate.low <= estimate.value <= estimate.high <= 1.0


def test_a_share_of_many_yes_and_no_is_scipys_wilson_interval() -> None:
    expected = scipy.stats.binomtest(1234, 5000).proportion_ci(method="wilson")
    estimate = share([1.0] * 1234 + [0.0] * 3766)
    assert (estimate.low, estimate.high) == pytest.approx((expected.low, expected.high), abs=1e-5)


def test_trials_that_are_more_alike_than_chance_count_for_more() -> None:
    alike = share([0.4, 0.6] * 10)
    unlike = share([0.0, 1.0] * 10)
    assert alike.value == pytest.approx(unlike.value)
    assert alike.high - alike.low < 0.3 * (unlike.high - unlike.low)


def test_a_share_is_no_other_number() -> None:
    with pytest.raises(ValueError, match=r"between 0 and 1, got 0\.5 to 50"):
        share([0.5, 50.0, 1.0])


@given(st.lists(st.integers(-1000, 1000).map(lambda k: k / 8), min_size=2, max_size=40))
def test_a_sample_and_its_mirror_image_have_students_interval(half: list[float]) -> None:
    """Without skewness Hall's correction vanishes."""
    values = half + [10.0 - value for value in half]
    estimate = mean(values)
    if max(values) == min(values):
        assert math.isnan(estimate.low)
        return
    low, high = scipy.stats.t.interval(0.95, len(values) - 1, np.mean(values), scipy.stats.sem(values))
    assert (estimate.low, estimate.high) == pytest.approx((low, high), rel=1e-6, abs=1e-6)


def test_halls_transformation_maps_both_ends_to_students_quantiles() -> None:
    values = np.random.default_rng(1).exponential(2.0, 8)
    n, skewness = len(values), scipy.stats.moment(values, 3) / values.std(ddof=1) ** 3
    estimate = mean(values.tolist(), confidence=0.9)
    transformed = []
    for end in (estimate.low, estimate.high):
        ratio = (estimate.value - end) / values.std(ddof=1)
        inner = ratio + skewness * ratio**2 / 3 + skewness**2 * ratio**3 / 27 + skewness / (6 * n)
        transformed.append(math.sqrt(n) * inner)
    assert transformed == pytest.approx([scipy.stats.t.ppf(0.95, n - 1), -scipy.stats.t.ppf(0.95, n - 1)])
    # a long tail to the right may hide a higher mean
    assert estimate.high - estimate.value > estimate.value - estimate.low


@given(st.lists(FINITE, min_size=3, max_size=30))
def test_a_mean_lies_in_its_interval_which_grows_with_confidence(values: list[float]) -> None:
    estimate, wider = mean(values), mean(values, confidence=0.99)
    if math.isnan(estimate.low):
        assert np.ptp(values) <= 1e-9 * max(map(abs, values))
        return
    assert wider.low <= estimate.low <= estimate.value <= estimate.high <= wider.high


def test_an_interval_stays_within_what_is_possible() -> None:
    scores = [0.999, 0.9, 0.998, 0.997]
    assert mean(scores).high > 1.0
    assert mean(scores, within=(0.0, 1.0))[:3] == (*mean(scores)[:2], 1.0)
    assert math.isnan(mean(scores[:2], within=(0.0, 1.0)).low)


def test_a_difference_stays_within_what_two_such_numbers_can_differ_by() -> None:
    before, after = [0.0] * 8, [0.0] * 7 + [1.0]
    assert paired_difference(before, after).high > 1.0
    cut = paired_difference(before, after, within=(0.0, 1.0))
    assert cut[:3] == (*paired_difference(before, after)[:2], 1.0)
    assert paired_difference(after, before, within=(0.0, 1.0)).low == -1.0
    assert paired_difference(before, [100.0 * one for one in after], within=(0.0, 100.0)).high == 100.0
    whole = ratio_of_sums([0, 0, 0, 0, 0, 9], [9, 9, 9, 9, 9, 9])
    assert whole.low < 0.0 < 1.0 < whole.high
    assert ratio_of_sums([0, 0, 0, 0, 0, 9], [9] * 6, within=(0.0, 1.0))[1:3] == (0.0, 1.0)


def test_the_value_that_makes_an_interval_wide_is_named() -> None:
    nan = math.nan
    assert outlier([0.1, 0.0, nan, 0.1, 5.0, 0.0]) == 4
    assert outlier([0.1, 0.0, nan, 0.1, -5.0, 0.0]) == 4
    assert outlier([1.0, 2.0, 3.0, 4.0, 5.0]) is None
    assert outlier([0.0, 0.1, 5.0]) is None, "three have Student's plain interval"
    assert outlier([1.0] * 9) is None
    # Hall's interval is up to 2.4 times as long
    one = mean([0.0] * 9 + [1.0])
    student = 2 * scipy.stats.t.ppf(0.975, 9) * scipy.stats.sem([0.0] * 9 + [1.0])
    assert 2.0 < (one.high - one.low) / student < 2.5


def test_two_trials_and_trials_without_spread_cannot_tell() -> None:
    for estimate in (mean([0.0, 1.0]), share([0.0, 1.0]), mean([0.1] * 20), share([0.1] * 20)):
        assert math.isnan(estimate.low)
        assert math.isnan(estimate.high)
    assert ratio_of_sums([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])[:1] == pytest.approx((0.1,))
    assert math.isnan(ratio_of_sums([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]).low)
    assert share([1.0] * 20).low == pytest.approx(0.82, abs=0.01)
    assert share([1.0] * 20).high == 1.0


def test_undefined_trials_are_left_out() -> None:
    nan = math.nan
    assert mean([1.0, nan, 2.0, 4.0, nan]) == mean([1.0, 2.0, 4.0])
    assert share([1.0, nan, 0.0, 0.5]) == share([1.0, 0.0, 0.5])
    assert (mean([]).n, share([nan]).n) == (0, 0)
    assert math.isnan(mean([]).value)


def test_paired_difference_cancels_what_both_trials_share() -> None:
    rng = np.random.default_rng(3)
    hard_or_easy = rng.normal(0.0, 10.0, 30)
    first = hard_or_easy
    second = hard_or_easy + 0.5 + rng.normal(0.0, 0.1, 30)
    estimate = paired_difference(first.tolist(), second.tolist())
    assert estimate.value == pytest.approx((second - first).mean())
    assert 0.4 < estimate.low < estimate.high < 0.6
    assert paired_difference([1.0, math.nan], [2.0, 1.0]).n == 1
    with pytest.raises(ValueError, match="pairs are needed: 1 values against 2"):
        paired_difference([1.0], [1.0, 2.0])


def test_ratio_of_sums_pools_before_it_divides() -> None:
    # trial ratios 1, 0.1 and 0.1, but the later trials are a hundred times as long
    assert ratio_of_sums([1, 10, 10], [1, 100, 100]).value == pytest.approx(21 / 201)
    assert ratio_of_sums([3.0, 1.0, 5.0, 4.0], [1, 1, 1, 1]) == pytest.approx(mean([3.0, 1.0, 5.0, 4.0]))


def test_ratio_of_sums_is_near_its_bootstrap() -> None:
    rng = np.random.default_rng(5)
    below = rng.integers(50, 150, 40)
    above = rng.binomial(below, 0.8)
    draws = np.random.default_rng(11).integers(0, 40, (9999, 40))
    low, high = np.quantile(above[draws].sum(axis=1) / below[draws].sum(axis=1), [0.025, 0.975])
    estimate = ratio_of_sums(above.tolist(), below.tolist())
    assert (estimate.low, estimate.high) == pytest.approx((low, high), abs=0.003)


def test_ratio_without_a_denominator_is_undefined() -> None:
    for estimate in (ratio_of_sums([0, 0, 0], [0, 0, 0]), ratio_of_sums([], [])):
        assert all(math.isnan(number) for number in estimate[:3])
    assert ratio_of_sums([0, 3], [0, 4]).value == 0.75
    with pytest.raises(ValueError, match="pairs are needed"):
        ratio_of_sums([1], [1, 2])


Draw = Callable[[np.random.Generator, int], "np.ndarray[tuple[int], np.dtype[np.float64]]"]


@pytest.mark.parametrize(
    ("method", "draw", "truth", "least", "most"),
    [
        (mean, lambda rng, n: rng.normal(5.0, 2.0, n), 5.0, 0.93, 0.97),
        (mean, lambda rng, n: rng.lognormal(0.0, 0.5, n), math.exp(0.125), 0.90, 0.98),
        (mean, lambda rng, n: rng.beta(30, 2, n), 30 / 32, 0.90, 0.98),
        (share, lambda rng, n: rng.binomial(1, 0.3, n) / 1.0, 0.3, 0.90, 1.0),
        (share, lambda rng, n: rng.binomial(3, 0.7, n) / 3.0, 0.7, 0.90, 1.0),
    ],
)
@pytest.mark.parametrize("n", [5, 20])
def test_95_percent_of_the_intervals_hold_the_truth(
    method: Callable[[list[float]], Estimate], draw: Draw, truth: float, least: float, most: float, n: int
) -> None:
    """``benchmarks/coverage.py`` tells more, from more samples."""
    rng = np.random.default_rng(n)
    held = 0
    for _ in range(2000):
        _, low, high, _ = method(draw(rng, n).tolist())
        held += low - 1e-12 <= truth <= high + 1e-12
    assert least <= held / 2000 <= most


def test_a_p_value_is_that_of_students_test() -> None:
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]  # no skewness
    expected = scipy.stats.ttest_1samp(values, 2.0).pvalue
    assert p_value(partial(mean, values), 2.0, math.inf) == pytest.approx(expected, abs=1e-8)
    # on which side is not asked
    assert p_value(partial(mean, values), -math.inf, 2.0) == pytest.approx(expected, abs=1e-8)
    assert p_value(partial(mean, values), 4.0, math.inf) == pytest.approx(1.0)
    assert math.isnan(p_value(partial(mean, [1.0, 2.0]), 0.0, math.inf))


def test_a_range_is_decided_at_its_nearer_end() -> None:
    values = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    one_sided = p_value(partial(mean, values), 2.0, math.inf)
    assert p_value(partial(mean, values), 2.0, 100.0) == pytest.approx(one_sided)


def test_skewness_is_corrected_from_five_trials_on() -> None:
    four, five = [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0, 1.0]
    assert mean(four).high - mean(four).value == pytest.approx(mean(four).value - mean(four).low)
    assert mean(five).high - mean(five).value > 1.5 * (mean(five).value - mean(five).low)


def test_holm_by_hand() -> None:
    # 0.01 of four, then 0.02 of three, then 0.03 of two, and never less than the one before
    assert holm([0.03, 0.01, 0.5, 0.02]) == pytest.approx([0.06, 0.04, 0.5, 0.06])
    # 2 x 0.03 is above 0.04: the larger p-value is adjusted to no less
    assert holm([0.04, 0.03]) == pytest.approx([0.06, 0.06])
    adjusted = holm([0.02, math.nan, 0.9])
    assert adjusted[0] == pytest.approx(0.04)
    assert math.isnan(adjusted[1])
    assert holm([]) == []


PAIRS = st.lists(st.tuples(st.floats(0.0, 1.0), st.floats(1.0, 1e3)), min_size=5, max_size=40)


@pytest.mark.slow
@given(PAIRS, st.randoms())
def test_the_order_of_trials_changes_no_bit(pairs: list[tuple[float, float]], random: Random) -> None:
    shuffled = random.sample(pairs, len(pairs))
    (first, second), (first_, second_) = zip(*pairs, strict=True), zip(*shuffled, strict=True)
    for method in (mean, share):
        assert repr(method(first)) == repr(method(first_))
    for method in (paired_difference, ratio_of_sums):
        assert repr(method(second, first)) == repr(method(second_, first_))
    tested, tested_ = (p_value(partial(mean, values), 0.5, math.inf) for values in (first, first_))
    assert repr(tested) == repr(tested_)


def test_a_sum_is_exact_and_nan_where_no_float_is_it() -> None:
    assert exact_sum([1e100, 1.0, -1e100]) == 1.0
    assert exact_sum([math.inf, 1.0]) == math.inf
    assert math.isnan(exact_sum([math.inf, -math.inf]))
    assert math.isnan(exact_sum([1e308, 1e308]))
    assert all(math.isnan(number) for number in mean([math.inf, -math.inf, 0.0])[:3])


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


@given(
    st.lists(FINITE, min_size=3, max_size=30).filter(lambda values: max(values) - min(values) > 0.01), FINITE
)
def test_a_further_runs_interval_and_p_are_students(values: list[float], number: float) -> None:
    """By scipy: two-sample t test of one run against the others, whose pooled variance is theirs."""
    run, p = prediction(values, number)
    n = len(values)
    scale = float(np.std(values, ddof=1)) * math.sqrt(1 + 1 / n)
    low, high = scipy.stats.t.interval(0.95, n - 1, np.mean(values), scale)
    assert (run.low, run.high, run.n) == (
        pytest.approx(low, rel=1e-9, abs=1e-6),
        pytest.approx(high, rel=1e-9, abs=1e-6),
        n,
    )
    t = abs(number - np.mean(values)) / scale
    assert p == pytest.approx(2 * scipy.stats.t.sf(t, n - 1), rel=1e-6, abs=1e-12)


def test_a_further_run_of_five_by_hand() -> None:
    """1 to 5: mean 3, s**2 2.5, so 3 +- 2.776 * sqrt(2.5 * 1.2); a range cuts it short and not its p."""
    run, p = prediction([1.0, 2.0, 3.0, 4.0, 5.0], 3.0 + 2.7764451 * math.sqrt(3.0), within=(0.0, 6.0))
    assert run == (3.0, 0.0, 6.0, 5)
    assert p == pytest.approx(0.05, abs=1e-6)
    run, _ = prediction([1.0, 2.0, 3.0, 4.0, 5.0], 3.0)
    assert (run.low, run.high) == pytest.approx((3.0 - 4.8090, 3.0 + 4.8090), abs=1e-3)


def test_few_or_equal_runs_say_nothing_of_a_further_one() -> None:
    for values in ([], [0.5], [0.5, 0.6], [0.3, 0.3, 0.3], [0.1 + 0.2, 0.3, 0.3]):
        run, p = prediction(values, 0.5)
        assert run.n == len(values)
        assert math.isnan(run.low)
        assert math.isnan(run.high)
        assert math.isnan(p)
    assert prediction([0.5, math.nan, 0.6, 0.7], 0.6).run.n == 3, "a ratio that is undefined in its trial"


@pytest.mark.parametrize(
    ("draw", "least", "most"),
    [
        (lambda rng, shape: rng.normal(0.9, 0.02, shape), 0.935, 0.965),
        (lambda rng, shape: rng.beta(95.0, 5.0, shape), 0.935, 0.965),  # a precision
        (lambda rng, shape: rng.exponential(1.0, shape), 0.925, 0.955),  # strongly skewed
    ],
)
def test_a_prediction_interval_holds_a_further_run_as_often_as_it_says(
    draw: Callable[[np.random.Generator, tuple[int, int]], np.ndarray], least: float, most: float
) -> None:
    runs = draw(np.random.default_rng(2), (2000, 21)).tolist()
    held = 0
    for *ours, theirs in runs:
        run = prediction(ours, theirs).run
        held += run.low <= theirs <= run.high
    assert least < held / len(runs) < most


def test_a_trials_standard_deviation_is_read_from_any_interval() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(5.0, 2.0, 40).tolist()
    assert standard_deviation(partial(mean, values)) == pytest.approx(np.std(values, ddof=1), rel=0.01)
    assert math.isnan(standard_deviation(partial(mean, [1.0, 2.0])))
    hits, tries = rng.binomial(10, 0.3, 400).tolist(), [10] * 400
    assert standard_deviation(partial(ratio_of_sums, hits, tries)) == pytest.approx(math.sqrt(0.021), rel=0.1)
