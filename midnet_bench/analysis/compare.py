"""Differences seed by seed between cells, with verdicts by Holm.

A frame of scores has a row for each score of each trial: the factors of its cell, ``seed``, ``measure`` and
``value``. A factor is None in a row that is over all its values, and ``scope`` names what such a row is over.

A campaign answers many questions at once, so verdicts go by Holm's adjusted p-values: the chance that even
one of a table's verdicts is wrong by chance is at most 5 % (item 72). The intervals that are printed stand
for themselves.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis.statistics import Estimate, Range, exact_mean, holm, outlier_notes, p_value, pair
from midnet_bench.analysis.tables import Cell
from midnet_bench.campaign.trial import factor_text

BETTER, WORSE, UNCLEAR, IDENTICAL = "better", "worse", "no clear difference", "identical"
BySeed = Mapping[int, float]  # seed -> a measure of the trial with that seed
Key = tuple[object, ...]  # a value of each of some columns
SCOPE, MEASURE = "scope", "measure"
BOUNDS = {"difference": ("low", "high", "n")}  # the columns of a table's differences
LEVEL = 0.05  # the chance of a wrong verdict anywhere in one table


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


def cell_columns(frame: pd.DataFrame, by: Sequence[str]) -> list[str]:
    """The columns of a frame of scores that tell cells apart."""
    return [str(name) for name in frame if name not in (*by, MEASURE, "seed", "value")]


def label(names: Sequence[str], key: Key) -> str:
    """A cell in words: ``5-robot, oracle=window``; ``key`` has the values of the columns ``names``."""
    cell = {name: value for name, value in zip(names, key, strict=True) if value is not None}
    parts = [str(cell.pop(SCOPE))] if SCOPE in cell else []
    parts += [f"{cell.pop('robots')}-robot"] if "robots" in cell else []
    return ", ".join([*parts, *(factor_text(name, value) for name, value in cell.items())])


class Compared(NamedTuple):
    """A score of one of the compared beside the baseline's, on the seeds that both have."""

    contestant: Key
    key: Key  # of the cell: the factors that are not compared
    cell: str  # the same in words
    measure: str
    wants_less: bool  # whether less of the score is better
    before: float  # the baseline's mean
    after: float  # the contestant's mean
    change: Estimate  # the contestant's less the baseline's, seed by seed
    seeds: int  # how many both have
    p_holm: float  # adjusted by Holm for all that are compared together; NaN where there is no interval
    outlier_seed: int | None  # the seed whose difference makes the interval wide, if one does
    is_identical: bool  # whether both have the same number at every seed
    values: BySeed  # the contestant's, of all its seeds

    @property
    def verdict(self) -> str:
        """What the contestant is beside the baseline: better, worse, identical, or no clear difference."""
        if self.is_identical:
            return IDENTICAL
        if not self.p_holm <= LEVEL:
            return UNCLEAR
        return BETTER if (self.change.low > 0.0) != self.wants_less else WORSE

    @property
    def columns(self) -> dict[str, Cell]:
        """The columns of a difference in every table."""
        return {
            "difference": self.change,
            "seeds": self.seeds,
            "outlier_seed": self.outlier_seed,
            "p_holm": self.p_holm,
            "verdict": self.verdict,
        }


def paired(
    frame: pd.DataFrame,
    by: Sequence[str],
    range_of: Callable[[str], Range],
    wants_less: Callable[[str], bool],
    measures: Sequence[str] = (),
    with_baseline: bool = False,
) -> list[Compared]:
    """Each score of each combination of ``by`` less that of the first, on the seeds that both have.

    Holm goes over all differences; an interval holds none that two such numbers cannot have.

    Args:
        frame: of scores, with the columns ``by``; the baseline's rows stand first.
        by: the columns that are compared; the others tell the cells apart.
        range_of: the least and the greatest value of a measure.
        wants_less: whether less of a measure is better.
        measures: those that are compared; all unless given.
        with_baseline: whether the baseline is compared with itself, too.
    """
    names = cell_columns(frame, by)
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
    adjusted = holm([p_value(both.difference, 0.0, math.inf) for _, _, both, _ in shared])
    return [
        Compared(
            contestant,
            cell[:-1],
            label(names, cell[:-1]),
            str(cell[-1]),
            wants_less(str(cell[-1])),
            exact_mean(both.before),
            exact_mean(both.after),
            both.difference(1.0 - LEVEL),
            len(both.before),
            p_holm,
            both.outlier_seed,
            all(a == b or (a != a and b != b) for a, b in zip(both.before, both.after, strict=True)),
            after,
        )
        for (contestant, cell, both, after), p_holm in zip(shared, adjusted, strict=True)
    ]


def notes_on(compared: Sequence[Compared], names: Sequence[str] = ()) -> list[str]:
    """What a reader has to know of differences: what makes an interval wide, verdicts withheld.

    The latter, whose interval leaves out 0, only with the ``names`` of all.
    """
    notes = outlier_notes(one.outlier_seed for one in compared)
    withheld = [
        name
        for name, one in zip(names, compared, strict=bool(names))
        if (one.change.low > 0.0 or one.change.high < 0.0) and not one.p_holm <= LEVEL
    ]
    if withheld:
        notes.append(
            f"{'; '.join(withheld)}: no clear difference, though the interval leaves out 0: of "
            f"{len(compared)} comparisons made together, Holm's adjusted p is above {LEVEL:g}."
        )
    return notes
