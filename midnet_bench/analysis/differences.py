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

BETTER, WORSE, UNCLEAR, IDENTICAL = "better", "worse", "no clear difference", "identical"
BySeed = Mapping[int, float]
"""seed -> a measure of the trial with that seed"""


def held_back_notes(places: Sequence[str], found: Sequence["Difference"]) -> list[str]:
    """A sentence on those whose interval leaves out 0 without a verdict; ``places`` says what each is of."""
    names = [place for place, one in zip(places, found, strict=True) if one.is_held_back]
    if not names:
        return []
    return [
        f"{'; '.join(names)}: no clear difference, though the interval leaves out 0: of {len(found)} "
        f"comparisons made together, Holm's adjusted p is above {LEVEL:g}."
    ]


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

    is_identical: bool = False
    """whether both cells have the same number at every seed"""

    def verdict(self, wants_less: bool = False) -> str:
        """What the second cell is beside the first: better, worse, identical, or no clear difference.

        ``wants_less``: whether less of the measure is better.
        """
        if self.is_identical:
            return IDENTICAL
        if not self.p_holm <= LEVEL:
            return UNCLEAR
        return BETTER if (self.change.low > 0.0) != wants_less else WORSE

    @property
    def is_held_back(self) -> bool:
        """Whether the interval leaves out 0 and yet Holm's adjusted p says no: one of many comparisons."""
        leaves_out_0 = self.change.low > 0.0 or self.change.high < 0.0
        return leaves_out_0 and not self.p_holm <= LEVEL


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
        change = difference(1.0 - LEVEL)
        is_identical = all(a == b or (a != a and b != b) for a, b in zip(before, after, strict=True))
        found.append(Difference(*means, change, len(seeds), math.nan, outlier_seed, is_identical))
    return [one._replace(p_holm=p) for one, p in zip(found, holm(p_values), strict=True)]
