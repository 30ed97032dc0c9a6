"""How sure a number is: intervals over trials.

Trials are the unit everywhere. Frames of one trial are 0.2 s apart and intruders of one trial share
guards and walls, so treating either as independent makes intervals too narrow (items 51, 67).

Bootstrap intervals are those of ``scipy.stats.bootstrap`` by the percentile method: it stays defined when
all trials score alike, where BCa does not. Fewer than two trials give an interval of NaN, and so does a
ratio that some resample leaves without a denominator.

scipy.stats takes a second to import. It is imported when there is an interval to find.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

RESAMPLES = 9999
LEAST_RESAMPLES = 1999
DRAWS = 10_000_000
"""numbers drawn for an interval: over more than 1000 trials there are fewer resamples, LEAST_RESAMPLES at
least, whose chance moves an end by 3 % of half the width (standard deviation)"""
BLOCK = 32_768
"""numbers of resamples that are held at once: they fit into a processor's cache"""

FloatArray = npt.NDArray[np.float64]


class Estimate(NamedTuple):
    """A number and the interval around it; NaN where undefined."""

    value: float
    low: float
    high: float
    n: int
    """how many trials it stands on"""


def mean(values: Sequence[float], rng: np.random.Generator, confidence: float = 0.95) -> Estimate:
    """The mean over trials and its percentile bootstrap interval.

    Args:
        values: one per trial; NaN, a ratio undefined in its trial, is left out.
        rng: a generator of its own, so that no other number shifts this one.
        confidence: 0.95 for a 95 % interval.
    """
    defined = np.asarray(values, np.float64)
    defined = defined[~np.isnan(defined)]
    if defined.size == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    return _bootstrap((defined,), np.mean, rng, confidence)


def paired_difference(
    first: Sequence[float], second: Sequence[float], rng: np.random.Generator, confidence: float = 0.95
) -> Estimate:
    """The mean of second - first over pairs of trials, and its percentile bootstrap interval.

    Pairs share a seed, so they share the world, and what a hard world does to both cancels out
    (common random numbers, item 71). A pair with a NaN is left out.

    Raises:
        ValueError: the two differ in length.
    """
    if len(first) != len(second):
        raise ValueError(f"pairs are needed: {len(first)} values against {len(second)}")
    differences = np.asarray(second, np.float64) - np.asarray(first, np.float64)
    return mean(differences.tolist(), rng, confidence)


def ratio_of_sums(
    numerators: Sequence[float],
    denominators: Sequence[float],
    rng: np.random.Generator,
    confidence: float = 0.95,
) -> Estimate:
    """The pooled ratio, sum over sum, and its percentile bootstrap interval; trials are drawn whole.

    Precision is ``tp`` over ``tp + fp``, recall ``tp`` over ``tp + fn``, F1 ``2 tp`` over
    ``2 tp + fp + fn``, each summed within its trial. Without any denominator the ratio is NaN.

    Raises:
        ValueError: the two differ in length.
    """
    if len(numerators) != len(denominators):
        raise ValueError(f"pairs are needed: {len(numerators)} values against {len(denominators)}")
    return _bootstrap(
        (np.asarray(numerators, np.float64), np.asarray(denominators, np.float64)),
        _ratio,
        rng,
        confidence,
    )


def wilson(successes: int, n: int, confidence: float = 0.95) -> Estimate:
    """A proportion and its Wilson score interval, for ``n`` independent yes-or-no trials (scipy).

    Raises:
        ValueError: more successes than trials, or negative ones.
    """
    if n == 0:
        return Estimate(math.nan, math.nan, math.nan, 0)
    from scipy import stats

    interval = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
    return Estimate(successes / n, float(interval.low), float(interval.high), n)


def _ratio(numerators: FloatArray, denominators: FloatArray, axis: int = -1) -> FloatArray:
    above, below = numerators.sum(axis=axis), denominators.sum(axis=axis)
    return np.divide(above, below, out=np.full(np.shape(below), np.nan), where=np.asarray(below > 0.0))


def _bootstrap(
    samples: tuple[FloatArray, ...],
    statistic: Callable[..., FloatArray],
    rng: np.random.Generator,
    confidence: float,
) -> Estimate:
    n = samples[0].size
    value = float(statistic(*samples, axis=-1))
    if n < 2:
        return Estimate(value, math.nan, math.nan, n)
    from scipy import stats

    at_once = max(1, BLOCK // n)
    resampled = np.empty(min(RESAMPLES, max(LEAST_RESAMPLES, DRAWS // n)))
    for first in range(0, resampled.size, at_once):
        part = resampled[first : first + at_once]
        # numbers of a block are those that one call for all resamples would draw
        drawn = rng.integers(0, n, (len(part), n))
        part[:] = statistic(*(sample.take(drawn, mode="clip") for sample in samples), axis=-1)
    tail = (1.0 - confidence) / 2.0
    low, high = stats.quantile(resampled, np.array([tail, 1.0 - tail]))
    return Estimate(value, float(low), float(high), n)
