"""Campaigns of one experiment side by side: what differs, seed by seed."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.errors import InputError
from midnet_bench.experiments.trial import Row
from midnet_bench.report.detection import SCORES, cells_of
from midnet_bench.report.labyrinth_trials import number, rates_by_seed, team_sizes, variants_of
from midnet_bench.report.success import write_labyrinth_comparison
from midnet_bench.report.tables import Table
from midnet_bench.rng import stream
from midnet_bench.scoring.statistics import paired_difference

Measures = Mapping[tuple[str, str], Mapping[int, float]]
"""(cell, measure) -> its value at each seed"""


def write_comparison(directories: Sequence[Path], output: Path) -> list[Table]:
    """Several campaigns of one experiment in one table of differences; labyrinths in one figure too.

    Raises:
        InputError: they are not of one experiment, it has no comparison, or two folders have one name.
    """
    if len({directory.name for directory in directories}) < max(2, len(directories)):
        raise InputError("compare: give two or more folders of different names")
    with ExitStack() as opened:
        stores = {
            directory.name: opened.enter_context(open_store(directory / FILE_NAME))
            for directory in directories
        }
        kinds = {store.definition.experiment for store in stores.values()}
        if kinds not in ({"detection"}, {"labyrinth"}):
            named = " and ".join(sorted(kinds))
            raise InputError(f"compare: detection or labyrinth campaigns only, of one kind, not {named}")
        measure = _scores if kinds == {"detection"} else _success_rates
        differences = differences_table({name: measure(store) for name, store in stores.items()})
    differences.write(output / "differences")
    both = write_labyrinth_comparison(directories, output) if kinds == {"labyrinth"} else []
    return [*both, differences]


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
