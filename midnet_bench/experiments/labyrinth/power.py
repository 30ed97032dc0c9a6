"""How many trials a difference needs before it can be told from chance, from the results at hand.

The normal approximation, two-sided: n = (z(1 - alpha / 2) + z(power))^2 v / d^2, where d is the
difference and v the variance of what one trial contributes to it. Trials are the unit, so v is taken
from the spread of whole trials, and what intruders of one trial share is in it. With separate seeds v is
the sum of both cells' variances; with common seeds it is the variance of the differences seed by seed
(items 70 and 71).
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy import stats

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.labyrinth.trials import (
    Cells,
    intruder_counts,
    rates_by_seed,
    team_sizes,
    variants_of,
)

ALPHA = 0.05
POWER = 0.8


def trials_needed(variance: float, difference: float, power: float = POWER, alpha: float = ALPHA) -> float:
    """How many trials (pairs of them, if ``variance`` is that of paired differences) show ``difference``.

    Args:
        variance: of what one trial contributes, in squared units of ``difference``; NaN gives NaN.
        difference: the true difference, not zero.
        power: the probability of finding it.
        alpha: the probability of finding one that is not there.
    """
    if math.isnan(variance):
        return math.nan
    return float(math.ceil(_factor(power, alpha) * variance / difference**2))


def least_difference(variance: float, trials: int, power: float = POWER, alpha: float = ALPHA) -> float:
    """The smallest true difference that ``trials`` would show; the inverse of :func:`trials_needed`."""
    return math.sqrt(_factor(power, alpha) * variance / trials) if trials else math.nan


def power_report(
    directory: Path, difference: float, robots: tuple[int, int] = (4, 5), power: float = POWER
) -> Table:
    """For each number of intruders: the trials per team size that a change of success rate needs.

    Args:
        directory: of a labyrinth campaign.
        difference: in percentage points.
        robots: the two team sizes that are compared.
        power: the probability of finding the difference if it is there.

    Raises:
        InputError: not a labyrinth campaign, a team size that it lacks, or numbers out of range.
    """
    if not 0.0 < abs(difference) <= 100.0:
        raise InputError(f"--difference {difference:g}: expected percentage points, from above 0 to 100")
    if not 0.0 < power < 1.0:
        raise InputError(f"--power {power:g}: expected a probability between 0 and 1")
    with open_store(directory / FILE_NAME) as store:
        if store.definition.experiment != "labyrinth":
            raise InputError(
                f"{directory}: a {store.definition.experiment} campaign; power takes a labyrinth"
            )
        variants = variants_of(store)
    for name, cells in variants.items():
        for size in robots:
            if size not in team_sizes(cells):
                raise InputError(
                    f"{directory}: no finished trials with {size} robots{f' ({name})' if name else ''}"
                )
    return power_table(variants, abs(difference), robots, power)


def power_table(
    variants: Mapping[str, Cells], difference: float, robots: tuple[int, int], power: float = POWER
) -> Table:
    """See :func:`power_report`; a row per number of intruders, and one over all of them."""
    rows: list[Row] = []
    for name, cells in variants.items():
        for intruders in [*intruder_counts(cells), None]:
            first, second = (rates_by_seed(cells, intruders, size) for size in robots)
            common = sorted(first.keys() & second.keys())
            separate = _variance(list(first.values())) + _variance(list(second.values()))
            paired = _variance([second[seed] - first[seed] for seed in common])
            row: Row = {"variant": name} if len(variants) > 1 else {}
            row |= {
                "intruders": "all" if intruders is None else str(intruders),
                "trials": min(len(first), len(second)),
                "sd": math.sqrt(separate / 2.0),
                "sd_of_pairs": math.sqrt(paired),
                "trials_needed": trials_needed(separate, difference, power),
                "pairs_needed": trials_needed(paired, difference, power),
                "least_difference": least_difference(separate, min(len(first), len(second)), power),
                "least_of_pairs": least_difference(paired, len(common), power),
            }
            rows.append(row)
    title = (
        f"Trials per team size to show {difference:g} points between {robots[0]} and {robots[1]} robots"
        f" (two-sided {ALPHA:.0%}, power {power:.0%})"
    )
    digits = {"sd": 1, "sd_of_pairs": 1, "trials_needed": 0, "pairs_needed": 0}
    return Table(title, rows, digits | {"least_difference": 1, "least_of_pairs": 1})


def _factor(power: float, alpha: float) -> float:
    return float((stats.norm.ppf(1.0 - alpha / 2.0) + stats.norm.ppf(power)) ** 2)


def _variance(values: list[float]) -> float:
    """The sample variance; NaN for fewer than two trials or none that differ, which show no spread."""
    if len(values) < 2 or min(values) == max(values):
        return math.nan
    return float(np.var(values, ddof=1))
