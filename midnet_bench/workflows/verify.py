"""What the paper states, one statement at a time, against a campaign: does it hold here?

A statement holds if the whole 95 % interval lies where the paper says, it fails if the whole interval
lies elsewhere, and otherwise this many trials cannot tell. No difference is not evidence of equality:
the dips that the paper saw are below what its trials could show (items 68 to 70). Each interval stands for
itself: of twenty statements that tell nothing, one is expected to look like something (item 72).
"""

import itertools
import math
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import NamedTuple

from midnet_bench.analysis.statistics import Estimate, paired_difference
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection import tables as detection
from midnet_bench.experiments.labyrinth.trials import (
    Cells,
    intruder_counts,
    number,
    rates_by_seed,
    team_sizes,
    variants_of,
)
from midnet_bench.rng import stream

TOLERANCE = 0.05
"""how near a mean counts as the paper's"""


class Verdict(StrEnum):
    """What can be said of a statement."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    CANNOT_BE_TOLD = "cannot be told"


class Finding(NamedTuple):
    """A statement of the paper, our number for it, and where the number must lie for it to hold."""

    statement: str
    ours: Estimate
    above: float
    below: float
    agree: str = ""
    """of a comparison seed by seed: how many seeds agree, ``19 of 20``"""

    @property
    def verdict(self) -> Verdict:
        """By where the interval lies; an interval that is not defined tells nothing."""
        low, high = self.ours.low, self.ours.high
        if math.isnan(low) or math.isnan(high):
            return Verdict.CANNOT_BE_TOLD
        if self.above < low and high < self.below:
            return Verdict.REPRODUCED
        return Verdict.NOT_REPRODUCED if high < self.above or low > self.below else Verdict.CANNOT_BE_TOLD


EXIT_CODES = {Verdict.REPRODUCED: 0, Verdict.CANNOT_BE_TOLD: 3, Verdict.NOT_REPRODUCED: 4}


def verify(directory: Path) -> tuple[Table, int]:
    """Every statement of the paper that the campaign in ``directory`` bears on, and an exit code.

    The code is 0 if all were reproduced, 4 if one was not, 3 if none failed but some cannot be told.

    Raises:
        InputError: a campaign that the paper states nothing about, or without the trials it takes.
    """
    with open_store(directory / FILE_NAME) as store:
        found = _findings(store)
    if not found:
        raise InputError(f"{directory}: nothing here that the paper states a result for")
    verdicts = {finding.verdict for finding in found}
    worst = max(verdicts, key=EXIT_CODES.__getitem__)
    return verdict_table(found), EXIT_CODES[worst]


def verdict_table(findings: Sequence[Finding]) -> Table:
    """A row per finding: the number with its interval, where it must lie, and the verdict."""
    rows: list[Row] = [
        {
            "statement": finding.statement,
            "ours": finding.ours.value,
            "low": finding.ours.low,
            "high": finding.ours.high,
            "holds above": _bound(finding.above),
            "and below": _bound(finding.below),
            "n": finding.ours.n,
            "agree": finding.agree,
            "verdict": finding.verdict.value,
        }
        for finding in findings
    ]
    return Table("What the paper states", rows)


def detection_findings(cells: detection.Cells) -> list[Finding]:
    """The six means of the paper's table, and which team is ahead in each score."""
    found = []
    for name, paper in detection.PAPER.items():
        for score in detection.SCORES if name in cells else ():
            value = number(paper[score])
            ours = detection.score_over_seeds(cells[name], score)
            statement = f"{name} {score} is {value:.3f}, within {TOLERANCE}"
            found.append(Finding(statement, ours, value - TOLERANCE, value + TOLERANCE))
    if "1-robot" in cells and "5-robot" in cells:
        for score, rises in (("recall", True), ("precision", False), ("f1", True)):
            one, five = (_by_seed(cells[name], score) for name in ("1-robot", "5-robot"))
            statement = f"{score} {'rises' if rises else 'falls'} from 1 to 5 robots"
            found.append(_comparison(statement, one, five, rises, score))
    return found


def labyrinth_findings(cells: Cells) -> list[Finding]:
    """The shape of the paper's figure: a rise with the team, and for 1 and 5 intruders a dip at its end.

    "Generally increase" is read as a rise from the smallest team to four robots for every number of
    intruders, and from each size to the next, up to four, over all of them. Differences are seed by seed.
    """
    sizes, counts = team_sizes(cells), intruder_counts(cells)
    up_to_four = [size for size in sizes if size <= 4]
    found = []
    if len(up_to_four) > 1:
        for intruders in counts:
            found.append(_change(cells, intruders, up_to_four[0], up_to_four[-1], rises=True))
        for smaller, larger in itertools.pairwise(up_to_four):
            found.append(_change(cells, None, smaller, larger, rises=True))
    if {4, 5} <= set(sizes):
        found += [_change(cells, intruders, 4, 5, rises=False) for intruders in counts if intruders in (1, 5)]
    return found


def _findings(store: Store) -> list[Finding]:
    if store.definition.experiment == "detection":
        return detection_findings(detection.cells_of(store))
    if store.definition.experiment != "labyrinth":
        return []
    return [
        finding._replace(statement=f"{name}: {finding.statement}" if name else finding.statement)
        for name, cells in variants_of(store).items()
        for finding in labyrinth_findings(cells)
    ]


def _by_seed(trials: Sequence[Row], score: str) -> dict[int, float]:
    """The seeds at which ``score`` is defined."""
    values = {int(number(row["seed"])): number(row[score]) for row in trials}
    return {seed: value for seed, value in values.items() if not math.isnan(value)}


def _change(cells: Cells, intruders: int | None, smaller: int, larger: int, *, rises: bool) -> Finding:
    first, second = rates_by_seed(cells, intruders, smaller), rates_by_seed(cells, intruders, larger)
    whom = "all intruders" if intruders is None else f"{intruders} intruder{'s' if intruders > 1 else ''}"
    statement = f"{whom}: success (points) {'rises' if rises else 'dips'} from {smaller} to {larger} robots"
    return _comparison(statement, first, second, rises, intruders or "all", smaller, larger)


def _comparison(
    statement: str, first: dict[int, float], second: dict[int, float], rises: bool, *purpose: str | int
) -> Finding:
    """Whether ``second`` is above ``first`` (or below), over the seeds that both have."""
    pairs = [(first[seed], second[seed]) for seed in first if seed in second]
    ours = paired_difference(
        [before for before, _ in pairs], [after for _, after in pairs], stream(0, "bootstrap", *purpose)
    )
    agree = sum(after > before if rises else after < before for before, after in pairs)
    above, below = (0.0, math.inf) if rises else (-math.inf, 0.0)
    return Finding(statement, ours, above, below, f"{agree} of {len(pairs)}")


def _bound(value: float) -> str:
    return "" if math.isinf(value) else f"{value:g}"
