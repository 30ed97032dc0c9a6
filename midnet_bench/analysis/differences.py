"""Differences seed by seed, many in one table: each with its interval, and a verdict by Holm."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

from midnet_bench.analysis.claims import LEVEL
from midnet_bench.analysis.statistics import (
    ANY,
    Estimate,
    Range,
    exact_mean,
    holm,
    outlier,
    p_value,
    paired_difference,
)

BySeed = Mapping[int, float]
"""seed -> a measure of the trial with that seed"""


class Difference(NamedTuple):
    """A measure in two cells on the seeds that they share."""

    before: float
    """mean in the first cell"""
    after: float
    """mean in the second cell"""
    change: Estimate
    """second less first, seed by seed"""
    seeds: int
    p_holm: float
    """adjusted by Holm for all that were asked about together; NaN where there is no interval"""
    outlier_seed: int | None = None
    """the seed whose difference makes the interval wide, if one does"""

    @property
    def verdict(self) -> str:
        """``higher`` or ``lower`` in the second cell, or ``inconclusive``."""
        if not self.p_holm <= LEVEL:
            return "inconclusive"
        return "higher" if self.change.low > 0.0 else "lower"


def differences(
    pairs: Sequence[tuple[BySeed, BySeed]], ranges: Sequence[Range] | None = None
) -> list[Difference]:
    """The difference of each pair, whose two cells share at least one seed; Holm goes over all pairs.

    ``ranges``: of each pair's measure; an interval holds no difference that two such numbers cannot have.
    """
    found: list[Difference] = []
    p_values: list[float] = []
    for (first, second), within in zip(pairs, ranges or [ANY] * len(pairs), strict=True):
        seeds = [seed for seed in first if seed in second]
        before, after = [first[seed] for seed in seeds], [second[seed] for seed in seeds]
        difference = partial(paired_difference, before, after, within=within)
        far = outlier([b - a for a, b in zip(before, after, strict=True)])
        p_values.append(p_value(difference, 0.0, math.inf))
        means = exact_mean(before), exact_mean(after)
        outlier_seed = None if far is None else seeds[far]
        found.append(Difference(*means, difference(1.0 - LEVEL), len(seeds), math.nan, outlier_seed))
    return [one._replace(p_holm=p) for one, p in zip(found, holm(p_values), strict=True)]
