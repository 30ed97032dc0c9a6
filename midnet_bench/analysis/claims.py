"""Claims of a paper checked against a campaign: reproduced, not reproduced, or inconclusive.

A claim is reproduced if the whole interval lies where the paper says, not reproduced if the whole
interval lies elsewhere, and inconclusive otherwise. No difference is no evidence of equality: the dips that
the paper saw are below what its trials could show (items 68 to 70). A campaign answers many claims at
once, so verdicts go by Holm's adjusted p-values: the chance that even one of a table's verdicts is wrong by
chance is at most 5 % (item 72). The intervals that are printed stand for themselves.
"""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

from midnet_bench.analysis.statistics import (
    ANY,
    MEAN_METHOD,
    MIN_TRIALS,
    Estimate,
    Interval,
    Range,
    holm,
    outlier_notes,
    p_value,
    pair,
)
from midnet_bench.analysis.tables import Cell, Table

LEVEL = 0.05  # the chance of a wrong verdict anywhere in one table


class Verdict(StrEnum):
    """What the results say about a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    INCONCLUSIVE = "inconclusive"


class Finding(NamedTuple):
    """A claim of the paper, our number for it, and the range in which it counts as reproduced."""

    claim: str
    ours: Estimate
    above: float
    below: float
    agreeing_seeds: int | None = None  # of a comparison seed by seed: how many of the ``ours.n`` seeds agree
    p_value: float = math.nan  # 1 less the highest confidence whose interval decides; NaN if it is not known
    outlier_seed: int | None = None
    """of a comparison: the seed whose difference makes the interval wide, if one does"""

    @property
    def verdict(self) -> Verdict:
        """Of this claim by itself: where its 95 % interval lies; inconclusive where there is none."""
        low, high = self.ours.low, self.ours.high
        if self.above < low and high < self.below:
            return Verdict.REPRODUCED
        return Verdict.NOT_REPRODUCED if high < self.above or low > self.below else Verdict.INCONCLUSIVE


class Claim(NamedTuple):
    """What :func:`findings` takes: the arguments of :func:`finding`."""

    claim: str
    interval: Interval
    above: float
    below: float
    agreeing_seeds: int | None = None


def findings(claims: Sequence[Claim]) -> list[Finding]:
    """As :func:`finding`, of each."""
    p_values = [p_value(each.interval, each.above, each.below) for each in claims]
    ours = [each.interval(1.0 - LEVEL) for each in claims]
    return [
        Finding(each.claim, number, *each[2:], p)
        for each, number, p in zip(claims, ours, p_values, strict=True)
    ]


def finding(
    claim: str, interval: Interval, above: float, below: float, agreeing_seeds: int | None = None
) -> Finding:
    """Whether a number lies between ``above`` and ``below``.

    Args:
        claim: what the paper states.
        interval: our number with its interval at a confidence, such as ``partial(mean, values)``.
        above: lower end of where the paper has it, may be -inf.
        below: upper end, may be inf.
        agreeing_seeds: of a comparison: how many seeds agree.
    """
    (found,) = findings([Claim(claim, interval, above, below, agreeing_seeds)])
    return found


def comparison(
    claim: str, first: Mapping[int, float], second: Mapping[int, float], rises: bool, within: Range = ANY
) -> Finding:
    """Whether ``second`` is above ``first`` (or below, unless ``rises``), over the seeds that both have.

    Args:
        claim: what the paper states.
        first: seed -> value.
        second: seed -> value.
        rises: the direction that the paper states.
        within: the least and the greatest value that there can be.
    """
    paired = pair(first, second, within)
    agreeing = sum(b > a if rises else b < a for a, b in zip(paired.before, paired.after, strict=True))
    above, below = (0.0, math.inf) if rises else (-math.inf, 0.0)
    found = finding(claim, paired.difference, above, below, agreeing)
    return found._replace(outlier_seed=paired.outlier_seed)


def verdicts(findings: Sequence[Finding]) -> list[Verdict]:
    """The verdict of each finding, all of them together being wrong by chance in 5 % of campaigns (Holm).

    A finding without a p-value is judged by its own interval and does not count among the others.
    """
    adjusted = holm([each.p_value for each in findings])
    return [
        each.verdict if math.isnan(p) or p <= LEVEL else Verdict.INCONCLUSIVE
        for each, p in zip(findings, adjusted, strict=True)
    ]


def verdict_table(findings: Sequence[Finding]) -> Table:
    """A row per finding: the number with its interval, the range that counts as reproduced, the verdict."""
    adjusted = holm([each.p_value for each in findings])
    rows: list[Mapping[str, Cell]] = [
        {
            "claim": each.claim,
            "ours": each.ours,
            "reproduced_above": None if math.isinf(each.above) else each.above,
            "reproduced_below": None if math.isinf(each.below) else each.below,
            "n": each.ours.n,
            "agreeing_seeds": each.agreeing_seeds,
            "outlier_seed": each.outlier_seed,
            "p_value": each.p_value,
            "p_holm": p,
            "verdict": verdict.value,
        }
        for each, p, verdict in zip(findings, adjusted, verdicts(findings), strict=True)
    ]
    title = f"What the paper states ({MEAN_METHOD}; verdicts by Holm at 5 % over the table)"
    notes = outlier_notes(each.outlier_seed for each in findings)
    digits, bounds = {"p_value": 4, "p_holm": 4}, {"ours": ("low", "high", "n")}
    return Table("claims", title, rows, digits, bounds, notes)


def shown_claims(table: Table, everything: bool = False) -> tuple[str, list[Table]]:
    """What a terminal shows of :func:`verdict_table`: the counts in a line, and a table for each verdict.

    Claims that are reproduced are listed with ``everything``.
    """
    order = (Verdict.NOT_REPRODUCED, Verdict.INCONCLUSIVE, Verdict.REPRODUCED)
    found = {verdict: [row for row in table.rows if row["verdict"] == verdict.value] for verdict in order}
    counts = [f"{len(found[verdict])} {verdict}" for verdict in order[:2]]
    n = max((int(str(row["n"])) for row in table.rows), default=0)
    reproduced = f"{len(found[Verdict.REPRODUCED])} of {len(table.rows)} claims reproduced"
    summary = f"{', '.join([reproduced, *counts])} ({n} seed{'' if n == 1 else 's'}, Holm)"
    if n < MIN_TRIALS:
        summary += f"; fewer than {MIN_TRIALS} seeds give no interval and decide nothing: run --seeds 20"
    return summary, [
        Table(
            f"claims_{verdict}",
            verdict.value,
            [{"claim": row["claim"], "ours": row["ours"], "accepted": _accepted(row)} for row in rows],
        )
        for verdict, rows in found.items()
        if rows and (everything or verdict != Verdict.REPRODUCED)
    ]


def _accepted(row: Mapping[str, Cell]) -> str:
    """The range in which a claim counts as reproduced, in words."""
    above, below = row["reproduced_above"], row["reproduced_below"]
    if above is None:
        return f"below {below:.3g}"
    return f"above {above:.3g}" if below is None else f"{above:.3g} to {below:.3g}"
