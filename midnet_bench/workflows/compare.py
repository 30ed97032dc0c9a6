"""Campaigns of one experiment side by side: what differs, seed by seed."""

import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from midnet_bench.analysis.statistics import paired_difference
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.tables import SCORES, cells_of
from midnet_bench.experiments.labyrinth.tables import write_labyrinth_comparison
from midnet_bench.experiments.labyrinth.trials import number, rates_by_seed, team_sizes, variants_of
from midnet_bench.rng import stream

COLUMNS = ("trial", "measure", "difference", "low", "high", "seeds")
"""of a table of differences, beside one for each campaign's means"""

Measures = Mapping[tuple[str, str], Mapping[int, float]]
"""(cell, measure) -> its value at each seed"""


def write_comparison(directories: Sequence[Path], output: Path) -> list[Table]:
    """Several campaigns of one experiment in one table of differences; labyrinths in one figure too.

    Raises:
        InputError: they are not of one experiment, it has no comparison, one folder is given twice, or a
            campaign has no seed in common with the first.
    """
    names = names_of(directories)
    with ExitStack() as opened:
        stores = {
            name: opened.enter_context(open_store(directory / FILE_NAME))
            for name, directory in zip(names, directories, strict=True)
        }
        kinds = {store.definition.experiment for store in stores.values()}
        if kinds not in ({"detection"}, {"labyrinth"}):
            named = " and ".join(sorted(kinds))
            raise InputError(f"compare: detection or labyrinth campaigns only, of one kind, not {named}")
        measure = _scores if kinds == {"detection"} else _success_rates
        differences = differences_table({name: measure(store) for name, store in stores.items()})
    for name in names[1:]:
        if not any(name in row for row in differences.rows):
            raise InputError(
                f"compare: {names[0]} and {name} have no finished trials with a cell and a seed in common"
            )
    differences.write(output / "differences")
    both = write_labyrinth_comparison(directories, output, names) if kinds == {"labyrinth"} else []
    return [*both, differences]


def names_of(directories: Sequence[Path]) -> list[str]:
    """What to call the folders: the shortest ends of their paths that tell them apart.

    None is called as a column of the table. Raises InputError for fewer than two folders, or one given twice.
    """
    # absolute, but not through links: a link's own name is what its owner calls the campaign
    parts = [Path(os.path.abspath(directory)).parts for directory in directories]
    for length in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(each[-length:]) for each in parts]
        if len(set(names)) == len(names) > 1 and not set(names) & set(COLUMNS):
            return names
    raise InputError("compare: give two or more different folders")


def differences_table(campaigns: Mapping[str, Measures]) -> Table:
    """A row per cell, measure and further campaign: means of both, and their difference from the first.

    Over the seeds that both have; the interval is the bootstrap's over seeds, both values of a seed together.
    """
    (first_name, first), *others = campaigns.items()
    rows: list[Row] = []
    for name, other in others:
        for (cell, measure), values in first.items():
            seeds = [seed for seed in values if seed in other.get((cell, measure), {})]
            if not seeds:
                continue
            before = [values[seed] for seed in seeds]
            after = [other[cell, measure][seed] for seed in seeds]
            change = paired_difference(before, after, stream(0, "bootstrap", "difference", cell, measure))
            rows.append(
                {
                    "trial": cell,
                    "measure": measure,
                    first_name: sum(before) / len(before),
                    name: sum(after) / len(after),
                    "difference": change.value,
                    "low": change.low,
                    "high": change.high,
                    "seeds": len(seeds),
                }
            )
    return Table(f"Differences from {first_name} on the same seeds (95 % intervals)", rows)


def _scores(store: Store) -> Measures:
    return {
        (name, score): {int(number(row["seed"])): number(row[score]) for row in trials}
        for name, trials in cells_of(store).items()
        for score in SCORES
    }


def _success_rates(store: Store) -> Measures:
    """Percent caught over all numbers of intruders."""
    return {
        (", ".join(filter(None, (f"{robots}-robot", variant))), "caught_percent"): rates_by_seed(
            cells, None, robots
        )
        for variant, cells in variants_of(store).items()
        for robots in team_sizes(cells)
    }
