"""How many trials it takes to show a difference.

Sample sizes are those of Student's t test, two-sided, by the noncentral t distribution: the same statistic as
the intervals' but for their correction for skewness. Trials are the unit, so the variance is taken from the
spread of whole trials, and what intruders of one trial share is in it. With separate seeds the test compares
two groups of n trials each; with common seeds it is the test of n differences seed by seed (items 70 and 71).
``variance`` is that of what one trial contributes, in squared units of ``difference``: with two ``groups``
(separate seeds) the sum of both, with one (pairs) that of the paired differences.
"""

import math
from collections.abc import Iterable

import numpy as np

from midnet_bench.analysis.compare import BySeed
from midnet_bench.analysis.statistics import exact_mean, exact_sum
from midnet_bench.analysis.tables import Cell

ALPHA = 0.05  # the chance that a test finds a difference where there is none
POWER = 0.8
PILOT = 0.9  # the confidence at which a pilot's variance is bounded
MAX_TRIALS = 10**9

Spread = tuple[float, float]  # a variance, and the degrees of freedom that it stands on


def probability_to_detect(
    variance: float, difference: float, trials: int, groups: int, alpha: float = ALPHA
) -> float:
    """How probably a test at ``alpha`` finds a true difference with so many trials a group, at least 2."""
    from scipy.special import nctdtr, stdtrit  # scipy.stats takes a second to import

    freedom = groups * (trials - 1)
    shift = abs(difference) * math.sqrt(trials / variance)
    critical = stdtrit(freedom, 1.0 - alpha / 2.0)
    # scipy gives NaN for tails that are next to nothing
    below, wrong_side = np.nan_to_num(nctdtr(freedom, shift, [critical, -critical]))
    return float(1.0 - below + wrong_side)


def sample_size(
    variance: float, difference: float, power: float = POWER, groups: int = 1, alpha: float = ALPHA
) -> float:
    """How many trials show ``difference`` with probability ``power``, by a test at ``alpha``.

    NaN where the variance is; infinite above a thousand million.
    """
    if math.isnan(variance):
        return math.nan
    low, high = 1, 2
    while probability_to_detect(variance, difference, high, groups, alpha) < power:
        low, high = high, 2 * high
        if high > MAX_TRIALS:
            return math.inf
    while high - low > 1:
        middle = (low + high) // 2
        enough = probability_to_detect(variance, difference, middle, groups, alpha) >= power
        low, high = (low, middle) if enough else (middle, high)
    return float(high)


def minimum_detectable_effect(variance: float, trials: int, power: float = POWER, groups: int = 1) -> float:
    """The smallest true difference that ``trials`` would show; NaN for fewer than two or no variance."""
    if trials < 2 or math.isnan(variance):
        return math.nan
    from scipy import optimize

    scale = math.sqrt(variance / trials)

    def missing(shift: float) -> float:
        return probability_to_detect(variance, shift * scale, trials, groups) - power

    high = 1.0
    while missing(high) < 0.0:
        high *= 2.0
    return scale * float(optimize.brentq(missing, 0.0, high))


def true_power(
    variance: float, freedom: float, difference: float, power: float = POWER, groups: int = 1
) -> tuple[float, float]:
    """Between what the power really is with as many trials as :func:`sample_size` advises; NaN as there.

    The variance is a pilot's, with so many degrees of freedom: the true one lies within its chi-square
    interval at 90 %.
    """
    trials = sample_size(variance, difference, power, groups)
    if not math.isfinite(trials):
        return math.nan, math.nan
    from scipy.special import chdtri

    low, high = (
        probability_to_detect(variance * freedom / chdtri(freedom, tail), difference, int(trials), groups)
        for tail in ((1.0 + PILOT) / 2.0, (1.0 - PILOT) / 2.0)
    )
    return float(low), float(high)


def pilot_note(pilots: Iterable[tuple[BySeed, BySeed]], difference: float, power: float = POWER) -> list[str]:
    """How sure the advice is that two cells' trials give, over all such ``pilots``: a sentence, or none."""
    found: dict[str, list[tuple[float, float]]] = {}
    fewest = math.inf
    for first, second in pilots:
        paired, separate = _spreads(first, second)
        for kind, spread, groups in (("pairs", paired, 1), ("separate trials", separate, 2)):
            low, high = true_power(*spread, difference, power, groups)
            if not math.isnan(low):
                found.setdefault(kind, []).append((low, high))
                fewest = min(fewest, len(first), len(second))
    if not found:
        return []
    parts = [
        f"{min(low for low, _ in found[kind]):.2f} to {max(high for _, high in found[kind]):.2f} with the "
        f"advised {kind}"
        for kind in sorted(found)
    ]
    return [
        f"The advice stands on {fewest:.0f} trials per team size, which tell the spread only roughly: the "
        f"true power is {' and '.join(parts)} ({100 * PILOT:.0f} % chi-square interval of the variance)."
    ]


def power_cells(first: BySeed, second: BySeed, difference: float, power: float = POWER) -> dict[str, Cell]:
    """Sample sizes for a difference between two cells, with separate and with common seeds.

    Args:
        first: seed -> its value, in the unit of ``difference``.
        second: the same of the other cell.
        difference: the true difference, not zero.
        power: the probability of finding it.
    """
    (paired, _), (separate, _) = _spreads(first, second)
    trials, common = min(len(first), len(second)), len(first.keys() & second.keys())
    return {
        "trials": trials,
        "sd": math.sqrt(separate / 2.0),
        "sd_paired": math.sqrt(paired),
        "trials_needed": sample_size(separate, difference, power, groups=2),
        "pairs_needed": sample_size(paired, difference, power, groups=1),
        "mde": minimum_detectable_effect(separate, trials, power, groups=2),
        "mde_paired": minimum_detectable_effect(paired, common, power, groups=1),
    }


def _spreads(first: BySeed, second: BySeed) -> tuple[Spread, Spread]:
    """Of differences seed by seed; of both cells together, by Satterthwaite."""
    common = sorted(first.keys() & second.keys())
    paired = _variance([second[seed] - first[seed] for seed in common]), len(common) - 1.0
    one, other = _variance(list(first.values())), _variance(list(second.values()))
    if math.isnan(one + other):
        return paired, (math.nan, math.nan)
    below = one**2 / (len(first) - 1) + other**2 / (len(second) - 1)
    return paired, (one + other, (one + other) ** 2 / below)


def _variance(values: list[float]) -> float:
    """The sample variance; NaN for fewer than two trials or none that differ, which show no spread."""
    if len(values) < 2 or min(values) == max(values):
        return math.nan
    mean = exact_mean(values)
    return exact_sum((value - mean) * (value - mean) for value in values) / (len(values) - 1)
