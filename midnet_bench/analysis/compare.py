"""Differences seed by seed: between cells, and as a paper claims them, with verdicts by Holm.

A frame of scores has a row for each score of each trial: the factors of its cell, ``seed``, ``measure`` and
``value``. A factor is None in a row that is over all its values, and ``scope`` names what such a row is over.

A claim is reproduced if the whole interval lies where the paper says, not reproduced if the whole
interval lies elsewhere, and inconclusive otherwise. No difference is no evidence of equality: the dips that
the paper saw are below what its trials could show (items 68 to 70). A campaign answers many claims at
once, so verdicts go by Holm's adjusted p-values: the chance that even one of a table's verdicts is wrong by
chance is at most 5 % (item 72). The intervals that are printed stand for themselves.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis.statistics import (
    ANY,
    MEAN_METHOD,
    MIN_TRIALS,
    Estimate,
    Interval,
    Range,
    exact_mean,
    holm,
    outlier_notes,
    p_value,
    pair,
)
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import factor_text

BETTER, WORSE, UNCLEAR, IDENTICAL = "better", "worse", "no clear difference", "identical"
BySeed = Mapping[int, float]  # seed -> a measure of the trial with that seed
Key = tuple[object, ...]  # a value of each of some columns
SCOPE, MEASURE = "scope", "measure"
BOUNDS = {"difference": ("low", "high", "n")}  # the columns of a table's differences
LEVEL = 0.05  # the chance of a wrong verdict anywhere in one table


class Difference(NamedTuple):
    """A measure in two cells on the seeds that they share."""

    before: float  # mean in the first cell
    after: float  # mean in the second cell
    change: Estimate  # second less first, seed by seed
    seeds: int
    p_holm: float  # adjusted by Holm for all that are compared together; NaN where there is no interval
    outlier_seed: int | None = None  # the seed whose difference makes the interval wide, if one does
    is_identical: bool = False  # whether both cells have the same number at every seed

    def verdict(self, wants_less: bool = False) -> str:
        """What the second cell is beside the first: better, worse, identical, or no clear difference.

        ``wants_less``: whether less of the measure is better.
        """
        if self.is_identical:
            return IDENTICAL
        if not self.p_holm <= LEVEL:
            return UNCLEAR
        return BETTER if (self.change.low > 0.0) != wants_less else WORSE


def holm_notes(names: Sequence[str], differences: Sequence[Difference]) -> list[str]:
    """A sentence on differences without a verdict whose interval leaves out 0; ``names``: of each."""
    withheld = [
        name
        for name, each in zip(names, differences, strict=True)
        if (each.change.low > 0.0 or each.change.high < 0.0) and not each.p_holm <= LEVEL
    ]
    if not withheld:
        return []
    return [
        f"{'; '.join(withheld)}: no clear difference, though the interval leaves out 0: of "
        f"{len(differences)} comparisons made together, Holm's adjusted p is above {LEVEL:g}."
    ]


def tidy(frame: pd.DataFrame, factors: Sequence[str], measures: Sequence[str]) -> pd.DataFrame:
    """The columns ``measures`` of a table with a row for each trial as a frame of scores, trial by trial."""
    kept = frame[[*factors, "seed", *measures]].reset_index(drop=True)
    melted = kept.melt([*factors, "seed"], var_name=MEASURE, ignore_index=False)
    return melted.sort_index(kind="stable")


def joined(parts: Mapping[Key, pd.DataFrame], by: Sequence[str]) -> pd.DataFrame:
    """Frames of scores in one, with the columns ``by`` before the others; an absent factor is None."""
    frames = []
    for key, part in parts.items():
        frame = part.drop(columns=[name for name in by if name in part]).astype(object)
        for name, value in zip(by, key, strict=True):
            frame[name] = pd.Series([value] * len(frame), frame.index, dtype=object)
        frames.append(frame)
    columns = dict.fromkeys([*by, *(str(name) for frame in frames for name in frame)])
    whole = pd.concat(frames)[[*columns]]
    keys = [name for name in columns if name != "value"]
    return whole.assign(**{name: whole[name].where(whole[name].notna(), None) for name in keys})


def series(frame: pd.DataFrame, keys: Sequence[str]) -> dict[Key, dict[int, float]]:
    """The values of a frame of scores by seed for each combination of ``keys``, in the frame's order."""
    found: dict[Key, dict[int, float]] = {}
    for *key, seed, value in frame[[*keys, "seed", "value"]].itertuples(index=False, name=None):
        found.setdefault(tuple(key), {})[seed] = value
    return found


def label(names: Sequence[str], key: Key) -> str:
    """A cell in words: ``5-robot, oracle=window``; ``key`` has the values of the columns ``names``."""
    cell = {name: value for name, value in zip(names, key, strict=True) if value is not None}
    parts = [str(cell.pop(SCOPE))] if SCOPE in cell else []
    parts += [f"{cell.pop('robots')}-robot"] if "robots" in cell else []
    return ", ".join([*parts, *(factor_text(name, value) for name, value in cell.items())])


def columns_of(one: Difference, wants_less: bool) -> dict[str, Cell]:
    """The columns of a difference in every table."""
    return {
        "difference": one.change,
        "seeds": one.seeds,
        "outlier_seed": one.outlier_seed,
        "p_holm": one.p_holm,
        "verdict": one.verdict(wants_less),
    }


class Compared(NamedTuple):
    """A score of one of the compared, beside the baseline's."""

    contestant: Key
    key: Key  # of the cell: the factors that are not compared
    cell: str  # the same in words
    measure: str
    difference: Difference
    values: BySeed


def compare(
    frame: pd.DataFrame,
    by: Sequence[str],
    range_of: Callable[[str], Range],
    measures: Sequence[str] = (),
    with_baseline: bool = False,
) -> list[Compared]:
    """Each score of each combination of ``by`` less that of the first, on the seeds that both have.

    Holm goes over all differences; an interval holds none that two such numbers cannot have.

    Args:
        frame: of scores, with the columns ``by``; the baseline's rows stand first.
        by: the columns that are compared; the others tell the cells apart.
        range_of: the least and the greatest value of a measure.
        measures: those that are compared; all unless given.
        with_baseline: whether the baseline is compared with itself, too.
    """
    names = [name for name in frame.columns if name not in (*by, MEASURE, "seed", "value")]
    values = series(frame, [*by, *names, MEASURE])
    contestants = list(dict.fromkeys(key[: len(by)] for key in values))
    baseline = {key[len(by) :]: each for key, each in values.items() if key[: len(by)] == contestants[0]}
    shared = [
        (contestant, cell, pair(before, after, range_of(str(cell[-1]))), after)
        for contestant in contestants[0 if with_baseline else 1 :]
        for cell, before in baseline.items()
        if not measures or cell[-1] in measures
        for after in [values.get((*contestant, *cell), {})]
        if any(seed in after for seed in before)
    ]
    adjusted = holm([p_value(paired.difference, 0.0, math.inf) for _, _, paired, _ in shared])
    return [
        Compared(
            contestant,
            cell[:-1],
            label(names, cell[:-1]),
            str(cell[-1]),
            Difference(
                exact_mean(paired.before),
                exact_mean(paired.after),
                paired.difference(1.0 - LEVEL),
                len(paired.before),
                p_holm,
                paired.outlier_seed,
                all(a == b or (a != a and b != b) for a, b in zip(paired.before, paired.after, strict=True)),
            ),
            after,
        )
        for (contestant, cell, paired, after), p_holm in zip(shared, adjusted, strict=True)
    ]


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
