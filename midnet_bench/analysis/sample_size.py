"""How many trials it takes to show a difference, or to tell a probability from a threshold.

Sample sizes are those of Student's t test, two-sided, by the noncentral t distribution: the same statistic as
the intervals' but for their correction for skewness. Trials are the unit, so the variance is taken from the
spread of whole trials, and what intruders of one trial share is in it. With separate seeds the test compares
two groups of n trials each; with common seeds it is the test of n differences seed by seed (items 70 and 71).
``variance`` is that of what one trial contributes, in squared units of ``difference``: with two ``groups``
(separate seeds) the sum of both, with one (pairs) that of the paired differences.

``SequentialTest`` runs as many trials as the answer takes. After each batch it looks at the ratio of two
likelihoods of all trials so far: of a mixture of all probabilities (Robbins 1970), and of the threshold. It
decides once the ratio reaches a bound, the lowest one with which the chance to ever decide is at most
``ALPHA`` where the probability is the threshold itself; that chance is counted over all ways in which the
trials may go. Elsewhere a wrong decision is rarer still.

Trials that end when they look good make a plain interval too narrow. The interval here counts all ways to
end, ordered by stage (Jennison and Turnbull 2000, section 8.4): an end above the threshold is a sign of a
higher probability the earlier it comes. ``benchmarks/sequential_coverage.py`` measures how often it holds the
truth: 95 % in the mean, 93 to 98 % at single probabilities, since shares come in steps.
"""

import math
from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.analysis.statistics import Estimate, FloatArray, exact_mean, exact_sum
from midnet_bench.analysis.tables import Cell

ALPHA = 0.05  # the chance of a wrong decision, at most; of a sequential interval, that it misses the truth
POWER = 0.8
PILOT = 0.9  # the confidence at which a pilot's variance is bounded
MAX_TRIALS = 10**9

BySeed = Mapping[int, float]
Spread = tuple[float, float]  # a variance, and the degrees of freedom that it stands on
BATCH = 40  # trials between two looks


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


class Ends(NamedTuple):
    """All ways in which the trials may end, (n,) each."""

    stages: npt.NDArray[np.int64]  # how many batches were run
    successes: npt.NDArray[np.int64]
    sides: npt.NDArray[np.int64]
    """1 if the decision is that the probability is above the threshold, -1 below, 0 without a decision"""
    log_ways: FloatArray  # logarithm of the number of sequences of trials that lead there

    def probabilities(self, p: float) -> FloatArray:
        """Of each end, where each trial succeeds with the probability ``p``."""
        failures, logs = self.stages * BATCH - self.successes, self.log_ways
        with np.errstate(divide="ignore", invalid="ignore"):
            logs = logs + np.where(self.successes > 0, self.successes * np.log(p), 0.0)
            logs = logs + np.where(failures > 0, failures * np.log1p(-p), 0.0)
        return np.exp(logs)


class SequentialTest:
    """Whether a probability is above ``threshold``, by batches of trials, ``most`` at most.

    Args:
        threshold: above 0 and below 1.
        most: trials; a multiple of ``BATCH``.
    """

    def __init__(self, threshold: float, most: int) -> None:
        self.threshold, self.most = threshold, most

    def decision(self, successes: int, trials: int) -> bool | None:
        """Whether the probability is above the threshold; None if these trials cannot tell."""
        is_decided = self._log_ratio(successes, trials) >= self._bound
        return successes / trials > self.threshold if is_decided else None

    def is_over(self, successes: int, trials: int) -> bool:
        """Whether no further trial is needed."""
        return trials >= self.most or self.decision(successes, trials) is not None

    def interval(self, successes: int, trials: int) -> Estimate:
        """The share of successes at the end of the trials, with its 95 % interval.

        Args:
            successes: of the trials.
            trials: a multiple of ``BATCH``, where :meth:`is_over` is true for the first time.
        """
        from scipy.optimize import brentq

        ends = self._ends
        # ends that speak for a higher probability come later
        orders = np.stack((ends.sides, -ends.sides * ends.stages, ends.successes), axis=1).tolist()
        is_here = (ends.stages == trials // BATCH) & (ends.successes == successes)
        here = orders[int(is_here.argmax())]
        above = np.array([(order > here) + 0.5 * (order == here) for order in orders])

        def tail(p: float, shares: FloatArray) -> float:
            """The probability of an end that is as extreme, this one counted by half, less half the level."""
            return float(shares @ ends.probabilities(p)) - ALPHA / 2.0

        low = 0.0 if successes == 0 else brentq(tail, 0.0, 1.0, (above,))
        high = 1.0 if successes == trials else brentq(tail, 0.0, 1.0, (1.0 - above,))
        return Estimate(successes / trials, low, high, trials)

    def _log_ratio(self, successes: int, trials: int) -> float:
        """Of the mixture by Jeffreys' prior to the threshold."""
        failures = trials - successes
        return (
            math.lgamma(successes + 0.5)
            + math.lgamma(failures + 0.5)
            - math.lgamma(trials + 1.0)
            - math.log(math.pi)
            - successes * math.log(self.threshold)
            - failures * math.log1p(-self.threshold)
        )

    @cached_property
    def _bound(self) -> float:
        """Found to 1e-3 by halving."""
        low, high = 0.0, -math.log(ALPHA)  # where Ville's inequality holds, however many looks there are
        while high - low > 1e-3:
            middle = (low + high) / 2.0
            ends = self._ends_by(middle)
            chance = float(ends.probabilities(self.threshold) @ (ends.sides != 0))
            low, high = (low, middle) if chance <= ALPHA else (middle, high)
        return high

    @cached_property
    def _ends(self) -> Ends:
        return self._ends_by(self._bound)

    def _ends_by(self, bound: float) -> Ends:
        """All ways to end with a bound."""
        ends: list[tuple[int, int, int, float]] = []
        batch = np.array([math.comb(BATCH, k) for k in range(BATCH + 1)], dtype=np.float64)
        ways = np.ones(1)
        for stage in range(1, self.most // BATCH + 1):
            ways, trials = np.convolve(ways, batch), stage * BATCH
            for successes in np.flatnonzero(ways).tolist():
                is_decided = self._log_ratio(successes, trials) >= bound
                if is_decided or trials >= self.most:
                    side = (1 if successes / trials > self.threshold else -1) if is_decided else 0
                    ends.append((stage, successes, side, math.log(ways[successes])))
                    ways[successes] = 0.0
        stages, successes_of, sides, log_ways = map(np.array, zip(*ends, strict=True))
        return Ends(stages, successes_of, sides, log_ways)
