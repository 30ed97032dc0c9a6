"""How sure a number is: 95 % intervals over trials, for few trials as for many.

Trials are the unit everywhere: frames of one trial are 0.2 s apart and its intruders share guards and walls,
so treating either as independent makes intervals too narrow (items 51, 67). ``benchmarks/coverage.py``
measures how often the methods hold the truth:

* a mean, a difference seed by seed, a ratio of sums: Student's t, from five trials on corrected for
  skewness by Hall's transformation (Hall 1992, "On the removal of skewness by transformation");
* a share, which lies between 0 and 1: Wilson's score interval on the effective sample size, with Student's
  quantile (Dean and Pagano 2015). Where all trials are 0 or all are 1 a trial counts as one yes or no;
* one further trial: Student's t prediction interval (Hahn and Meeker 1991, section 4.2).

Two trials cannot tell how far trials spread: an interval takes three. Nor can trials that all give one
number, unless it is a share. Sums are exact and rounded once (``math.fsum``), so the order of trials,
Python's version and the processor do not change them; Student's quantile (SciPy) and the cube root (the C
library) may differ in the last digits on another processor.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

MIN_TRIALS = 3  # for an interval
MIN_FOR_SKEWNESS = 5  # three or four numbers show no skewness: theirs is Student's plain interval
WIDE = 1.5  # times Student's length: from there on the correction for skewness makes an interval wide
RESAMPLES = 10_000  # of the seeds, always the same ones
MEAN_METHOD = "95 % intervals: Student's t, corrected for skewness"
SHARE_METHOD = "95 % intervals: Wilson's score"  # for titles of tables and figures
OUTLIER_NOTE = (
    "outlier_seed: the difference at this seed is far from those at the others and makes the interval wide; "
    "run more seeds."
)
"""for tables with a column of that name"""

FloatArray = npt.NDArray[np.float64]


class Estimate(NamedTuple):
    """A number and the interval around it; NaN where undefined."""

    value: float
    low: float
    high: float
    n: int  # how many trials it stands on

    def times(self, factor: float) -> "Estimate":
        """The number in another unit."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high, self.n)


Interval = Callable[[float], Estimate]  # The estimate with its interval at a confidence, such as 0.95.
Range = tuple[float, float]  # the least and the greatest value that a number can have
ANY: Range = (-math.inf, math.inf)
NOT_NEGATIVE: Range = (0.0, math.inf)


def mean(values: Sequence[float], confidence: float = 0.95, within: Range = ANY) -> Estimate:
    """The mean over trials and its interval, Student's t with Hall's correction for skewness.

    Args:
        values: one per trial; NaN, a ratio undefined in its trial, is left out.
        confidence: 0.95 for a 95 % interval.
        within: the range of possible values, which the interval does not leave.
    """
    defined = _defined(values)
    if not defined:
        return _undefined(0)
    value = exact_mean(defined)
    below, above = _halls_bounds([each - value for each in defined], max(map(abs, defined)), confidence)
    # NaN comes first: max and min give it back then
    return Estimate(value, max(value - below, within[0]), min(value + above, within[1]), len(defined))


class Prediction(NamedTuple):
    """Where a number of one further trial lies, and how far out a given number is."""

    run: Estimate  # the trials' mean, and the interval of one further trial
    p_value: float
    """two-sided: how probably a further trial lies as far from the mean as the given number, or farther"""


def prediction(
    values: Sequence[float], number: float, confidence: float = 0.95, within: Range = ANY
) -> Prediction:
    """Student's t prediction interval for one further trial, mean +- t s sqrt(1 + 1/n), and a number's p.

    A mean's interval narrows with more trials; this one keeps the spread of single trials. It assumes that
    trials are independent and normal. Of skewed ones 20 trials hold 93 to 95 % of further trials, but those
    that are missed lie on the long side.

    Args:
        values: one per trial; NaN, a ratio undefined in its trial, is left out.
        number: of another trial, such as the paper's only one.
        confidence: 0.95 for a 95 % interval.
        within: the range of possible values, which the interval does not leave.

    Returns:
        Bounds and p are NaN for fewer than three trials and for trials that all give one number.
    """
    from scipy.special import stdtr

    defined = _defined(values)
    if not defined:
        return Prediction(_undefined(0), math.nan)
    n, value = len(defined), exact_mean(defined)
    rounding = 1e-14 * max(map(abs, defined))
    spread = exact_sum((each - value) * (each - value) for each in defined)
    if n < MIN_TRIALS or spread <= n * rounding * rounding:
        return Prediction(Estimate(value, math.nan, math.nan, n), math.nan)
    deviation = math.sqrt(spread / (n - 1) * (1.0 + 1.0 / n))
    half = _student(confidence, n) * deviation
    run = Estimate(value, max(value - half, within[0]), min(value + half, within[1]), n)
    return Prediction(run, 2.0 * float(stdtr(n - 1, -abs(number - value) / deviation)))


def share(values: Sequence[float], confidence: float = 0.95) -> Estimate:
    """The mean over trials of shares between 0 and 1, and its interval, which lies there too.

    Args:
        values: one per trial, such as its precision; NaN is left out.
        confidence: 0.95 for a 95 % interval.

    Raises:
        ValueError: a value below 0 or above 1.
    """
    defined = _defined(values)
    n = len(defined)
    if n == 0:
        return _undefined(0)
    least, most = min(defined), max(defined)
    if least < 0.0 or most > 1.0:
        raise ValueError(f"a share lies between 0 and 1, got {least:g} to {most:g}")
    value = exact_mean(defined)
    # the mean of equal numbers may be off by a rounding, and so their variance
    spread = exact_mean([(each - value) * (each - value) for each in defined]) if least < most else 0.0
    if n < MIN_TRIALS or (spread == 0.0 and 0.0 < value < 1.0):
        return Estimate(value, math.nan, math.nan, n)
    # so many yes-or-no trials would spread as these do
    effective = n * value * (1.0 - value) / spread if spread > 0.0 else float(n)
    quantile = _student(confidence, n)
    weight = quantile * quantile / effective
    middle = (value + weight / 2.0) / (1.0 + weight)
    half = quantile / (1.0 + weight) * math.sqrt((value * (1.0 - value) + weight / 4.0) / effective)
    return Estimate(value, max(0.0, min(middle - half, value)), min(1.0, max(middle + half, value)), n)


def paired_difference(
    first: Sequence[float], second: Sequence[float], confidence: float = 0.95, within: Range = ANY
) -> Estimate:
    """The mean of second - first over pairs of trials, and its interval as of ``mean``.

    Pairs share a seed, so what a hard world does to both cancels out (common random numbers, item 71). A pair
    with a NaN is left out. ``within`` is the range of the numbers themselves: two shares differ by 1 at most.

    Raises:
        ValueError: the two differ in length.
    """
    _check_pairs(first, second)
    most = within[1] - within[0]
    return mean(
        [after - before for before, after in zip(first, second, strict=True)], confidence, (-most, most)
    )


class Paired(NamedTuple):
    """A measure of two cells at the seeds that both have."""

    before: list[float]
    after: list[float]
    difference: Interval  # of second less first, see :func:`paired_difference`
    outlier_seed: int | None  # the seed whose difference makes the interval wide, if one does


def pair(first: Mapping[int, float], second: Mapping[int, float], within: Range = ANY) -> Paired:
    """Two cells' values by seed, paired; ``within``: the least and the greatest value that there can be."""
    seeds = [seed for seed in first if seed in second]
    before, after = [first[seed] for seed in seeds], [second[seed] for seed in seeds]
    index = outlier([b - a for a, b in zip(before, after, strict=True)])
    difference = partial(paired_difference, before, after, within=within)
    return Paired(before, after, difference, None if index is None else seeds[index])


def outlier(values: Sequence[float]) -> int | None:
    """The index of the value farthest from the mean, if it makes the interval of ``mean`` wide; else None.

    Wide is more than ``WIDE`` times the length that it has without the correction for skewness. It is so
    where one value lies far from all others: few trials cannot tell how often such ones come.
    """
    estimate, defined = mean(values), _defined(values)
    if estimate.n < MIN_FOR_SKEWNESS or math.isnan(estimate.low):
        return None
    squares = exact_sum((each - estimate.value) * (each - estimate.value) for each in defined)
    error = math.sqrt(squares / (estimate.n - 1) / estimate.n)
    if estimate.high - estimate.low <= WIDE * 2.0 * _student(0.95, estimate.n) * error:
        return None
    far = [-1.0 if math.isnan(value) else abs(value - estimate.value) for value in values]
    return far.index(max(far))


def outlier_notes(outlier_seeds: Iterable[int | None]) -> list[str]:
    """The note of a table with these in its column ``outlier_seed``; none where no row has one."""
    return [OUTLIER_NOTE] if any(seed is not None for seed in outlier_seeds) else []


def ratio_of_sums(
    numerators: Sequence[float], denominators: Sequence[float], confidence: float = 0.95, within: Range = ANY
) -> Estimate:
    """The pooled ratio, sum over sum, and its interval as of ``mean`` on the ratio linearised in each trial.

    A time per capture is the sum of times over the number of captures. A trial moves the ratio R by about
    (numerator - R denominator) / mean denominator. Without any denominator the ratio is NaN. The interval
    does not leave ``within``.

    Raises:
        ValueError: the two differ in length.
    """
    _check_pairs(numerators, denominators)
    n, below = len(denominators), exact_sum(denominators)
    each = below / n if n else 0.0
    if not each > 0.0:  # the mean of a denormal sum is 0
        return _undefined(n)
    ratio = exact_sum(numerators) / below
    deviations = [
        (above - ratio * other) / each for above, other in zip(numerators, denominators, strict=True)
    ]
    down, up = _halls_bounds(deviations, max(map(abs, numerators)) / each, confidence)
    return Estimate(ratio, max(ratio - down, within[0]), min(ratio + up, within[1]), n)


def p_value(interval: Interval, above: float, below: float) -> float:
    """How sure it is on which side of a range the truth lies: 1 less the highest confidence that decides.

    An interval decides where it lies wholly within (above, below) or wholly outside. 1 where none does;
    NaN where there is no interval. Found to 1e-9 by halving.
    """

    def decides(confidence: float) -> bool:
        _, low, high, _ = interval(confidence)
        return (above < low and high < below) or high < above or low > below

    if math.isnan(interval(0.95).low):
        return math.nan
    lower, upper = 0.0, 1.0 - 1e-9
    if decides(upper):
        return 1.0 - upper
    while upper - lower > 1e-9:
        middle = (lower + upper) / 2.0
        lower, upper = (middle, upper) if decides(middle) else (lower, middle)
    return 1.0 - lower


def standard_deviation(interval: Interval) -> float:
    """Of what one trial contributes to an estimate, from its interval; NaN where there is none.

    By the 50 % interval, which hardly any range cuts short and skewness hardly moves.
    """
    _, low, high, n = interval(0.5)
    if math.isnan(low):
        return math.nan
    return (high - low) / 2.0 / _student(0.5, n) * math.sqrt(n)


def holm(p_values: Sequence[float]) -> list[float]:
    """The p-values of one table, adjusted by Holm for how many they are; NaN counts for nothing."""
    order = sorted((p, i) for i, p in enumerate(p_values) if not math.isnan(p))
    adjusted, reached = list(p_values), 0.0
    for rank, (p, i) in enumerate(order):
        reached = max(reached, min(1.0, (len(order) - rank) * p))
        adjusted[i] = reached
    return adjusted


class Distance(NamedTuple):
    """A root mean square of differences."""

    value: Estimate  # its interval is the percentile bootstrap's at 95 %, which resamples seeds
    least: float  # when one seed is left out; NaN of a single seed
    most: float


def distance(differences: FloatArray) -> Distance:
    """How far many numbers are from a paper's: the root mean square of their mean differences over seeds.

    Args:
        differences: (seeds, numbers), at least one seed; NaN where a number is not defined at a seed.
    """
    seeds = len(differences)
    (value,) = _distances(differences, np.ones((1, seeds)))
    low = high = least = most = math.nan
    if seeds > 1:
        without_one = _distances(differences, 1.0 - np.eye(seeds))
        least, most = float(without_one.min()), float(without_one.max())
    if seeds >= MIN_TRIALS and not math.isnan(value):
        often = np.random.default_rng(1).multinomial(seeds, [1.0 / seeds] * seeds, RESAMPLES)
        low, high = np.nanquantile(_distances(differences, often.astype(np.float64)), (0.025, 0.975))
    return Distance(Estimate(float(value), float(low), float(high), seeds), least, most)


def _distances(differences: FloatArray, weights: FloatArray) -> FloatArray:
    """(samples,) with ``weights`` (samples, seeds), how often each seed is in a sample.

    Sums run over seeds and numbers in their order, so that they are the same on every processor.
    """
    is_defined = ~np.isnan(differences)
    shape = (len(weights), differences.shape[1])
    totals, counts, squares = np.zeros(shape), np.zeros(shape), np.zeros(len(weights))
    for seed, (numbers, defined) in enumerate(zip(differences, is_defined, strict=True)):
        totals += weights[:, seed, None] * np.where(defined, numbers, 0.0)
        counts += weights[:, seed, None] * defined
    with np.errstate(invalid="ignore"):
        means = totals / counts
    for column in means.T:
        squares += column * column
    return np.asarray(np.sqrt(squares / shape[1]))


def exact_sum(values: Iterable[float]) -> float:
    """The exact sum, rounded once, whatever the order of the values; NaN if it is no float's."""
    try:
        return math.fsum(values)
    except (OverflowError, ValueError):  # beyond the largest float, or infinities of both signs
        return math.nan


def exact_mean(values: Collection[float]) -> float:
    """The mean of at least one value by :func:`exact_sum`."""
    return exact_sum(values) / len(values)


def _check_pairs(first: Sequence[float], second: Sequence[float]) -> None:
    if len(first) != len(second):
        raise ValueError(f"pairs are needed: {len(first)} values against {len(second)}")


def _undefined(n: int) -> Estimate:
    return Estimate(math.nan, math.nan, math.nan, n)


def _defined(values: Sequence[float]) -> list[float]:
    return [value for value in values if not math.isnan(value)]


def _student(confidence: float, n: int) -> float:
    """The two-sided quantile of Student's t for n trials."""
    from scipy.special import stdtrit  # scipy is imported when there is an interval to find

    return float(stdtrit(n - 1, 0.5 + confidence / 2.0))


def _halls_bounds(deviations: Sequence[float], size: float, confidence: float) -> tuple[float, float]:
    """How far the interval of a mean reaches below and above it; NaN where trials show no spread.

    ``deviations`` from the mean, one per trial; ``size`` of the numbers, which decides what is rounding.
    Hall's transformation makes Student's ratio T = mean error / (s / sqrt n) nearly symmetric:
    T + g (T**2 / 3 + 1 / 6) / sqrt n + g**2 T**3 / (27 n), where g is the sample's skewness.
    Its inverse at the two quantiles gives the bounds.
    """
    n, rounding = len(deviations), 1e-14 * size
    spread = exact_sum(each * each for each in deviations)
    if n < MIN_TRIALS or spread <= n * rounding * rounding:
        return math.nan, math.nan
    deviation = math.sqrt(spread / (n - 1))
    skewness, cubed = 0.0, deviation * deviation * deviation
    if n >= MIN_FOR_SKEWNESS and cubed > 0.0:  # which underflows below 1e-108
        skewness = exact_mean([each * each * each for each in deviations]) / cubed
    quantile = _student(confidence, n)
    return (
        deviation * _untransformed(quantile / math.sqrt(n), skewness, n),
        -deviation * _untransformed(-quantile / math.sqrt(n), skewness, n),
    )


def _untransformed(scaled: float, skewness: float, n: int) -> float:
    """T / sqrt n whose transformed value is sqrt n ``scaled``; odd roots of negative numbers are negative."""
    if abs(skewness) < 1e-6:
        return scaled
    return 3.0 / skewness * (math.cbrt(1.0 + skewness * (scaled - skewness / (6.0 * n))) - 1.0)
