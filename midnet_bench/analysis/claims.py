"""Statements of a paper checked against a campaign: reproduced, not reproduced, or inconclusive.

A statement is reproduced if the whole 95 % interval lies where the paper says, not reproduced if the whole
interval lies elsewhere, and inconclusive otherwise. No difference is no evidence of equality: the dips that
the paper saw are below what its trials could show (items 68 to 70). Each interval stands for itself: of
twenty statements without any effect behind them, one is expected to look like one (item 72).
"""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

from midnet_bench.analysis.statistics import Estimate, paired_difference
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.rng import stream


class Verdict(StrEnum):
    """What the results say about a statement."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    INCONCLUSIVE = "inconclusive"


class Finding(NamedTuple):
    """A statement of the paper, our number for it, and the range in which it counts as reproduced."""

    statement: str
    ours: Estimate
    above: float
    below: float
    agreeing_seeds: int | None = None
    """of a comparison seed by seed: how many of the ``ours.n`` seeds agree"""

    @property
    def verdict(self) -> Verdict:
        """By where the interval lies; an interval that is not defined is inconclusive."""
        low, high = self.ours.low, self.ours.high
        if math.isnan(low) or math.isnan(high):
            return Verdict.INCONCLUSIVE
        if self.above < low and high < self.below:
            return Verdict.REPRODUCED
        return Verdict.NOT_REPRODUCED if high < self.above or low > self.below else Verdict.INCONCLUSIVE


def comparison(
    statement: str, first: Mapping[int, float], second: Mapping[int, float], rises: bool, *purpose: str | int
) -> Finding:
    """Whether ``second`` is above ``first`` (or below, unless ``rises``), over the seeds that both have.

    Args:
        statement: what the paper states.
        first: seed -> value.
        second: seed -> value.
        rises: the direction that the paper states.
        purpose: names the bootstrap's random stream.
    """
    pairs = [(first[seed], second[seed]) for seed in first if seed in second]
    ours = paired_difference(
        [before for before, _ in pairs], [after for _, after in pairs], stream(0, "bootstrap", *purpose)
    )
    agreeing = sum(after > before if rises else after < before for before, after in pairs)
    above, below = (0.0, math.inf) if rises else (-math.inf, 0.0)
    return Finding(statement, ours, above, below, agreeing)


def verdict_table(findings: Sequence[Finding]) -> Table:
    """A row per finding: the number with its interval, the range that counts as reproduced, the verdict."""
    rows: list[Mapping[str, Cell]] = [
        {
            "statement": finding.statement,
            "ours": finding.ours,
            "reproduced_above": _bound(finding.above),
            "reproduced_below": _bound(finding.below),
            "n": finding.ours.n,
            "agreeing_seeds": finding.agreeing_seeds,
            "verdict": finding.verdict.value,
        }
        for finding in findings
    ]
    return Table("claims", "What the paper states", rows, bounds={"ours": ("low", "high", "n")})


def _bound(value: float) -> float | None:
    return None if math.isinf(value) else value
