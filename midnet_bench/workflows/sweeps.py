"""How scores go with a numeric factor of a campaign's grid."""

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.experiment import Experiment, Measures
from midnet_bench.experiments.registry import experiment_of
from midnet_bench.settings import leaves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEWEST = 3
"""values of a factor that is drawn without being asked for: two of them are as well read in a table"""

BySeed = Mapping[int, float]
Curves = Mapping[str, Mapping[float, BySeed]]
"""the other factors' values -> the value of the factor along x -> a score of each seed"""


def sweep(results: Results, x: str, y: str | None = None) -> tuple[Table, "Figure"]:
    """A score over a numeric factor, as a table and as a figure of the table's name.

    Args:
        results: of a campaign.
        x: the factor along x.
        y: a main score, or a column of a table with one row for each trial; all main scores unless given, a
            panel for each.

    Raises:
        InputError: there is no such factor or column, its values are no numbers, or no trial has finished.
    """
    if x not in results.definition.grid:
        raise InputError(
            f"{results.directory}: --x {x}: the grid has no such factor{nearest_name(x, results.factors)}"
        )
    if not _is_numeric(results, x):
        values = ", ".join(map(str, results.definition.grid[x]))
        raise InputError(f"{results.directory}: --x {x}: its values are no numbers ({values[:60]})")
    record = experiment_of(results)
    known = _main_scores(record, results, x)
    if y is not None and y not in known:
        known = _columns(results, x)
        if y not in known:
            names = [*_main_scores(record, results, x), *known]
            raise InputError(f"{results.directory}: --y {y}: no such column{nearest_name(y, names)}")
    panels = known if y is None else {y: known[y]}
    if not panels:
        raise InputError(f"{results.directory}: --x {x}: no main score to draw; give a column by --y")
    means = {
        measure: {
            label: {
                at: mean(list(seeds.values()), within=record.range_of(measure))
                for at, seeds in points.items()
            }
            for label, points in curves.items()
        }
        for measure, curves in panels.items()
    }
    from midnet_bench.drawing.curves import curves_figure
    from midnet_bench.drawing.labels import axis_label

    leaf = leaves(record.model).get(x)
    label = axis_label(x, leaf.option.help if leaf else "")
    ranges = {measure: record.range_of(measure) for measure in means}
    return _table(x, f"{y or 'scores'}_by_{x}", means), curves_figure(label, panels, means, ranges)


def sweeps(results: Results) -> list[tuple[Table, "Figure"]]:
    """The figures of a campaign that nobody asks for: of each numeric factor with ``FEWEST`` values.

    None where the experiment's own figures show the factors, or without main scores.
    """
    record = experiment_of(results)
    if record.measures is None or (record.has_figures and not record.sweeps_beside) or not results.finished:
        return []
    return [
        sweep(results, factor)
        for factor, values in results.definition.grid.items()
        if len(values) >= FEWEST and _is_numeric(results, factor)
    ]


def _is_numeric(results: Results, factor: str) -> bool:
    return all(
        isinstance(value, int | float) and not isinstance(value, bool)
        for value in results.definition.grid[factor]
    )


def _main_scores(record: Experiment, results: Results, x: str) -> Mapping[str, Curves]:
    found: dict[str, dict[str, dict[float, BySeed]]] = {}
    if record.measures is None:
        return found
    for value in sorted(map(float, results.definition.grid[x])):  # type: ignore[arg-type]
        part = next(one for name, one in results.by_value(x).items() if float(name) == value)
        for (label, measure), by_seed in scores_without(x, record.measures(part)).items():
            found.setdefault(measure, {}).setdefault(label, {})[value] = by_seed
    return found


def scores_without(factor: str, scores: Measures) -> Measures:
    """The scores of a part of a campaign that has one value of ``factor``, whose cells are called by others.

    The size of the team stands first in a cell's name, whether or not it is a factor.
    """
    if factor != "robots":
        return scores
    return {(re.sub(r"^\d+-robot(, )?", "", cell), measure): one for (cell, measure), one in scores.items()}


def _columns(results: Results, x: str) -> Mapping[str, Curves]:
    found: dict[str, dict[str, dict[float, dict[int, float]]]] = {}
    place = [*results.factors, "seed"]
    for frame in results.tables.values():
        if not set(place) <= set(frame) or frame.duplicated(place).any():
            continue
        labels = results.others(frame, x)
        for column in frame.columns.difference(place):
            if frame[column].dtype.kind not in "iuf":
                continue
            rows = zip(labels, frame[x].tolist(), frame["seed"].tolist(), frame[column].tolist(), strict=True)
            for label, at, seed, value in sorted(rows):
                curves = found.setdefault(str(column), {})
                curves.setdefault(label, {}).setdefault(float(at), {})[seed] = float(value)
    return found


def _table(x: str, name: str, means: Mapping[str, Mapping[str, Mapping[float, Estimate]]]) -> Table:
    """A row for each point of each curve."""
    rows: Sequence[Mapping[str, Cell]] = [
        {"measure": measure, "cell": label, x: at, "mean": estimate}
        for measure, curves in means.items()
        for label, points in curves.items()
        for at, estimate in points.items()
    ]
    title = f"Scores by {x} ({MEAN_METHOD}, over seeds)"
    return Table(name, title, rows, bounds={"mean": ("low", "high", "seeds")})
