"""Sample sizes: how many trials a difference needs before it can be told from chance.

The normal approximation, two-sided: n = (z(1 - alpha / 2) + z(power))^2 v / d^2, where d is the
difference and v the variance of what one trial contributes to it. Trials are the unit, so v is taken
from the spread of whole trials, and what intruders of one trial share is in it. With separate seeds v is
the sum of both cells' variances; with common seeds it is the variance of the differences seed by seed
(items 70 and 71).
"""

import math
from collections.abc import Mapping

import numpy as np

from midnet_bench.analysis.tables import Cell

ALPHA = 0.05
POWER = 0.8


def sample_size(variance: float, difference: float, power: float = POWER, alpha: float = ALPHA) -> float:
    """How many trials (pairs of them, if ``variance`` is that of paired differences) show ``difference``.

    Args:
        variance: of what one trial contributes, in squared units of ``difference``; NaN gives NaN.
        difference: the true difference, not zero.
        power: the probability of finding it.
        alpha: the probability of finding one that is not there.
    """
    if math.isnan(variance):
        return math.nan
    return float(math.ceil(_factor(power, alpha) * variance / difference**2))


def minimum_detectable_effect(
    variance: float, trials: int, power: float = POWER, alpha: float = ALPHA
) -> float:
    """The smallest true difference that ``trials`` would show; the inverse of :func:`sample_size`."""
    return math.sqrt(_factor(power, alpha) * variance / trials) if trials else math.nan


def power_cells(
    first: Mapping[int, float], second: Mapping[int, float], difference: float, power: float = POWER
) -> dict[str, Cell]:
    """Sample sizes for a difference between two cells, with separate and with common seeds.

    Args:
        first: seed -> its value, in the unit of ``difference``.
        second: the same of the other cell.
        difference: the true difference, not zero.
        power: the probability of finding it.
    """
    common = sorted(first.keys() & second.keys())
    separate = _variance(list(first.values())) + _variance(list(second.values()))
    paired = _variance([second[seed] - first[seed] for seed in common])
    trials = min(len(first), len(second))
    return {
        "trials": trials,
        "sd": math.sqrt(separate / 2.0),
        "sd_paired": math.sqrt(paired),
        "trials_needed": sample_size(separate, difference, power),
        "pairs_needed": sample_size(paired, difference, power),
        "mde": minimum_detectable_effect(separate, trials, power),
        "mde_paired": minimum_detectable_effect(paired, len(common), power),
    }


def _factor(power: float, alpha: float) -> float:
    from scipy import stats  # takes a second to import, and tables are made without any power

    return float((stats.norm.ppf(1.0 - alpha / 2.0) + stats.norm.ppf(power)) ** 2)


def _variance(values: list[float]) -> float:
    """The sample variance; NaN for fewer than two trials or none that differ, which show no spread."""
    if len(values) < 2 or min(values) == max(values):
        return math.nan
    return float(np.var(values, ddof=1))
