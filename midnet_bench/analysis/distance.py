"""How far many numbers are from those of a paper, and how sure that is: by the bootstrap and seed by seed."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.analysis.statistics import MIN_TRIALS, Estimate

RESAMPLES = 10_000
"""of the seeds, always the same ones"""

FloatArray = npt.NDArray[np.float64]


class Distance(NamedTuple):
    """A root mean square of differences."""

    value: Estimate
    """its interval is the percentile bootstrap's at 95 %, which resamples seeds"""
    least: float
    """when one seed is left out; NaN of a single seed"""
    most: float


def distance(differences: FloatArray) -> Distance:
    """The root mean square over numbers of their mean differences over seeds.

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
