"""What a paper states, each claim judged by a campaign.

A direction or a cause holds if the whole 95 % interval of our mean lies where the paper says, does not hold
if the whole interval lies elsewhere, and is inconclusive otherwise. No difference is no evidence of equality:
the dips that the paper saw are below what its trials could show (items 68 to 70). A campaign answers many
such claims at once, so their verdicts go by Holm's adjusted p-values: the chance that even one of them is
wrong by chance is at most 5 % (item 72). The intervals that are printed stand for themselves.

A number of the paper's only run lies within the range of our runs or outside it: the range is the 95 %
prediction interval of one further run. Each such number is judged by itself, so that none outside is hidden.
"""

import math
from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

from midnet_bench.analysis.compare import LEVEL
from midnet_bench.analysis.sample_size import POWER, sample_size
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
    prediction,
    standard_deviation,
)
from midnet_bench.analysis.tables import Cell, Table

RUN, MEAN = "one further run", "the mean"  # what an interval is of
SHOWN_DIGITS = 2  # of a number of seeds in a sentence


class Verdict(StrEnum):
    """What the results say about a claim."""

    OUTSIDE = "outside the range of our runs"
    DOES_NOT_HOLD = "does not hold"
    INCONCLUSIVE = "inconclusive"
    WITHIN = "within the range of our runs"
    HOLDS = "holds"

    def of(self, count: int) -> str:
        """With its verb: ``6 are within the range of our runs``, ``1 holds``, ``2 do not hold``."""
        if self is Verdict.HOLDS:
            return f"{count} {'holds' if count == 1 else 'hold'}"
        if self is Verdict.DOES_NOT_HOLD:
            return f"{count} {'does' if count == 1 else 'do'} not hold"
        return f"{count} {'is' if count == 1 else 'are'} {self.value}"


UNSURPRISING = (Verdict.WITHIN, Verdict.HOLDS)


class Finding(NamedTuple):
    """A claim of the paper, and our number for it."""

    claim: str
    ours: Estimate  # with the interval of the mean, or, where there is a ``paper``, of one further run
    above: float  # the range in which the claim holds; unbounded where there is a ``paper``
    below: float
    agreeing_seeds: int | None = None  # of a comparison seed by seed: how many of the ``ours.n`` seeds agree
    p_value: float = math.nan
    """1 less the highest confidence whose interval decides; of a run: two-sided, of the paper's number among
    our runs; NaN where there is no interval"""
    outlier_seed: int | None = None
    """of a comparison: the seed whose difference makes the interval wide, if one does"""
    paper: float | None = None  # the number of the paper's only run
    deviation: float = math.nan  # standard deviation of what a seed contributes to a mean
    note: str = ""  # a sentence that a reader of the verdict needs

    @property
    def verdict(self) -> Verdict:
        """Of this claim by itself; inconclusive where there is no interval."""
        low, high = self.ours.low, self.ours.high
        if self.paper is not None and not math.isnan(low):
            return Verdict.WITHIN if low <= self.paper <= high else Verdict.OUTSIDE
        if self.paper is None and self.above < low and high < self.below:
            return Verdict.HOLDS
        is_elsewhere = self.paper is None and (high < self.above or low > self.below)
        return Verdict.DOES_NOT_HOLD if is_elsewhere else Verdict.INCONCLUSIVE

    @property
    def nearest_bound(self) -> float:
        """The end of the range that our number is nearest to."""
        bounds = [each for each in (self.above, self.below) if not math.isinf(each)]
        return min(bounds, key=lambda bound: abs(self.ours.value - bound), default=math.nan)


def finding(
    claim: str,
    interval: Interval,
    above: float,
    below: float,
    agreeing_seeds: int | None = None,
    note: str = "",
) -> Finding:
    """Whether a number lies between ``above`` and ``below``.

    Args:
        claim: what the paper states.
        interval: our number with its interval at a confidence, such as ``partial(mean, values)``.
        above: lower end of where the paper has it, may be -inf.
        below: upper end, may be inf.
        agreeing_seeds: of a comparison: how many seeds agree.
        note: what a reader of the verdict needs.
    """
    return Finding(
        claim,
        interval(1.0 - LEVEL),
        above,
        below,
        agreeing_seeds,
        p_value(interval, above, below),
        deviation=standard_deviation(interval),
        note=note,
    )


def comparison(
    claim: str,
    first: Mapping[int, float],
    second: Mapping[int, float],
    rises: bool,
    within: Range = ANY,
    note: str = "",
) -> Finding:
    """Whether ``second`` is above ``first`` (or below, unless ``rises``), over the seeds that both have.

    Args:
        claim: what the paper states.
        first: seed -> value.
        second: seed -> value.
        rises: the direction that the paper states.
        within: the least and the greatest value that there can be.
        note: what a reader of the verdict needs.
    """
    paired = pair(first, second, within)
    agreeing = sum(b > a if rises else b < a for a, b in zip(paired.before, paired.after, strict=True))
    above, below = (0.0, math.inf) if rises else (-math.inf, 0.0)
    found = finding(claim, paired.difference, above, below, agreeing, note)
    return found._replace(outlier_seed=paired.outlier_seed)


def single_run(
    claim: str, values: Sequence[float], paper: float, within: Range = ANY, note: str = ""
) -> Finding:
    """Whether the number of the paper's only run lies within the range of our runs.

    Args:
        claim: what the paper states.
        values: our number of each trial.
        paper: the paper's.
        within: the least and the greatest value that there can be.
        note: what a reader of the verdict needs.
    """
    run, p = prediction(values, paper, 1.0 - LEVEL, within)
    return Finding(claim, run, *ANY, p_value=p, paper=paper, note=note)


class Judgement(NamedTuple):
    """A finding among the others of a campaign."""

    verdict: Verdict
    p_holm: float  # adjusted for the directions and causes; NaN of a single run
    seeds_needed: float  # how many seeds would decide an inconclusive claim; NaN of others, or not known
    reason: str  # why a claim is inconclusive, and the finding's note


def judged(findings: Sequence[Finding]) -> list[Judgement]:
    """Each finding beside the others: verdicts of directions and causes are wrong in 5 % of campaigns (Holm).

    A finding without a p-value is judged by its own interval and does not count among the others. The seeds
    that an inconclusive claim needs are those of a test at 5 % over the number of claims that are still open.
    """
    adjusted = holm([math.nan if each.paper is not None else each.p_value for each in findings])
    verdicts = [
        each.verdict if math.isnan(p) or p <= LEVEL else Verdict.INCONCLUSIVE
        for each, p in zip(findings, adjusted, strict=True)
    ]
    claims = sum(not math.isnan(p) for p in adjusted)
    still_open = sum(
        verdict is Verdict.INCONCLUSIVE and not math.isnan(p)
        for verdict, p in zip(verdicts, adjusted, strict=True)
    )
    found = []
    for each, verdict, p in zip(findings, verdicts, adjusted, strict=True):
        needed, reason = math.nan, ""
        if verdict is Verdict.INCONCLUSIVE:
            needed = math.nan if math.isnan(p) else _seeds_needed(each, LEVEL / still_open)
            reason = _reason(each, claims, needed)
        found.append(Judgement(verdict, p, needed, " ".join(filter(None, (reason, each.note)))))
    return found


def _seeds_needed(finding: Finding, alpha: float) -> float:
    """More than there are, if the truth is what they show: a test that has not decided yet."""
    distance = abs(finding.ours.value - finding.nearest_bound)
    if distance == 0.0:
        return math.inf
    needed = sample_size(finding.deviation * finding.deviation, distance, POWER, alpha=alpha)
    return max(needed, finding.ours.n + 1.0)


def _reason(finding: Finding, claims: int, needed: float) -> str:
    """Why a finding is inconclusive."""
    value, low, _, n = finding.ours
    if math.isnan(value):
        return "Not defined in these trials: there is nothing to divide by."
    if n < MIN_TRIALS:
        return f"Fewer than {MIN_TRIALS} seeds give no interval."
    if math.isnan(low):
        return "All seeds give the same number: they show no spread."
    bound = finding.nearest_bound
    # an interval may hold the farther bound, too; the nearer one is what is in the way
    why = (
        f"The 95 % interval holds {bound:g}"
        if finding.verdict is Verdict.INCONCLUSIVE
        else f"The 95 % interval leaves out {bound:g}, but not after Holm's adjustment for {claims} claims"
    )
    if math.isinf(needed):
        return f"{why}; no number of seeds that can be run would decide it."
    places = SHOWN_DIGITS - 1 - math.floor(math.log10(needed))
    about = round(needed, min(0, places))
    return f"{why}; about {about:.0f} seeds would decide it, were the truth what these {n} show."


def verdict_table(findings: Sequence[Finding]) -> Table:
    """A row per finding: the number with its interval, the range in which the claim holds, the verdict."""
    rows: list[Mapping[str, Cell]] = [
        {
            "claim": each.claim,
            "paper": each.paper,
            "ours": each.ours,
            "n": each.ours.n,
            "interval_of": MEAN if each.paper is None else RUN,
            "holds_above": None if math.isinf(each.above) else each.above,
            "holds_below": None if math.isinf(each.below) else each.below,
            "agreeing_seeds": each.agreeing_seeds,
            "outlier_seed": each.outlier_seed,
            "p_value": each.p_value,
            "p_holm": None if each.paper is not None else judgement.p_holm,
            "verdict": judgement.verdict.value,
            "seeds_needed": None if math.isnan(judgement.seeds_needed) else judgement.seeds_needed,
            "reason": judgement.reason,
        }
        for each, judgement in zip(findings, judged(findings), strict=True)
    ]
    title = (
        "What the paper states (its single runs: 95 % prediction intervals of one further run, Student's t; "
        f"the others: {MEAN_METHOD}, verdicts by Holm at 5 %)"
    )
    notes = outlier_notes(each.outlier_seed for each in findings)
    digits, bounds = {"p_value": 4, "p_holm": 4, "seeds_needed": 0}, {"ours": ("low", "high", "n")}
    return Table("claims", title, rows, digits, bounds, notes)


def is_decided(table: Table) -> bool:
    """Whether a :func:`verdict_table` stands on enough seeds to decide anything."""
    return any(int(str(row["n"])) >= MIN_TRIALS for row in table.rows)


def summary(table: Table) -> str:
    """How many claims of a :func:`verdict_table` have which verdict, a sentence."""
    found = [str(row["verdict"]) for row in table.rows]
    n = max((int(str(row["n"])) for row in table.rows), default=0)
    counts = [verdict.of(found.count(verdict)) for verdict in (*UNSURPRISING, *Verdict) if verdict in found]
    parts = ", ".join(dict.fromkeys(counts))
    return f"Of {len(found)} claims {parts} ({n} seed{'' if n == 1 else 's'})."


def lines_by_verdict(table: Table, everything: bool = False) -> dict[Verdict, list[tuple[str, str]]]:
    """The claims of a :func:`verdict_table`, and what the results say of each, by verdict.

    Those that hold or lie within the range of our runs are there with ``everything``.
    """
    found: dict[Verdict, list[tuple[str, str]]] = {}
    for verdict in Verdict:
        rows = [row for row in table.rows if row["verdict"] == verdict.value]
        if rows and (everything or verdict not in UNSURPRISING):
            found[verdict] = [(str(row["claim"]), _in_words(row)) for row in rows]
    return found


def _in_words(row: Mapping[str, Cell]) -> str:
    """Our number, its interval, p and the reason: ``0.170 [0.117, 0.227], p 0.0714 (Holm). ...``."""
    ours, paper, reason = row["ours"], row["paper"], str(row["reason"])
    assert isinstance(ours, Estimate)
    number = "n/a" if math.isnan(ours.value) else f"{ours.value:.3f}"
    if not math.isnan(ours.low):
        number += f" [{ours.low:.3f}, {ours.high:.3f}]"
    parts = [f"our runs {number}" if paper is not None else number]
    if (wanted := _range(row)) and paper is None:
        parts.append(f"stated: {wanted}")
    if row["agreeing_seeds"] is not None and ours.n >= MIN_TRIALS:
        parts.append(f"so in {row['agreeing_seeds']} of {ours.n} seeds")
    p = float(str(row["p_value"] if paper is not None else row["p_holm"]))
    if not math.isnan(p):
        shown = "< 0.0001" if p < 0.0001 else f"{p:.4f}" if p < 0.01 else f"{p:.2f}"
        parts.append(f"p {shown}" + (" (Holm)" if paper is None else ""))
    return " ".join(filter(None, (f"{', '.join(parts)}.", reason)))


def _range(row: Mapping[str, Cell]) -> str:
    """The range in which a claim holds, in words."""
    above, below = row["holds_above"], row["holds_below"]
    if above is None:
        return "" if below is None else f"below {below:.4g}"
    return f"above {above:.4g}" if below is None else f"{above:.4g} to {below:.4g}"
