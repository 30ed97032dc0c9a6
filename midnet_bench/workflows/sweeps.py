"""How scores go with a numeric factor of a campaign's grid."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import pandas as pd

from midnet_bench.analysis.compare import (
    BOUNDS,
    MEASURE,
    BySeed,
    Key,
    columns_of,
    compare,
    joined,
    label,
    series,
    tidy,
)
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, mean, outlier_notes
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import factor_text
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.registry import experiment_of
from midnet_bench.settings import leaves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FEWEST = 3
"""values of a factor that is drawn without being asked for: two of them are as well read in a table"""

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
    """Figures of the factor that a campaign's key ``compare`` names; else of each long numeric factor.

    None where the experiment's own figures show the factors, or without main scores.
    """
    record = experiment_of(results)
    compared = compared_values(results)
    if compared is not None:
        return [compared]
    if record.measures is None or (record.has_figures and not record.sweeps_beside) or not results.finished:
        return []
    return [
        sweep(results, factor)
        for factor, values in results.definition.grid.items()
        if len(values) >= FEWEST and _is_numeric(results, factor)
    ]


def compared_values(results: Results) -> tuple[Table, "Figure"] | None:
    """What the campaign's key ``compare`` asks for: a row for each value, cell and score; and its figure.

    None without that key, main scores or finished trials.
    """
    record, preset = experiment_of(results), results.definition.compare
    if preset is None or record.measures is None or not results.finished:
        return None
    baseline = str(preset.baseline)
    parts = results.by_value(preset.by)
    ordered = {name: parts[name] for name in [baseline, *parts]}
    frame = joined({(name,): record.measures(part) for name, part in ordered.items()}, [preset.by])
    compared = compare(frame, [preset.by], record.range_of, preset.measures, with_baseline=True)
    rows: list[Mapping[str, Cell]] = [
        {
            preset.by: str(one.contestant[0]),
            "trial": one.cell,
            "measure": one.measure,
            "baseline": one.difference.before,
            "value": one.difference.after,
            **columns_of(one.difference, record.wants_less(one.measure)),
        }
        for one in compared
        if one.contestant[0] != baseline
    ]
    means: dict[str, dict[str, dict[str, Estimate]]] = {}
    for one in compared:
        estimate = mean(list(one.values.values()), within=record.range_of(one.measure))
        means.setdefault(one.measure, {}).setdefault(one.cell, {})[str(one.contestant[0])] = estimate
    changes = [one.difference for one in compared]
    title = f"Differences from {baseline} on the same seeds ({MEAN_METHOD}; verdicts by Holm at 5 %)"
    name = f"differences_by_{preset.by}"
    beside = ("seeds", "p_holm", "outlier_seed", "value", "baseline")
    notes = outlier_notes(one.outlier_seed for one in changes)
    table = Table(name, title, rows, {"p_holm": 4}, bounds=BOUNDS, notes=notes, beside=beside)
    from midnet_bench.drawing.values import values_figure

    return table, values_figure(list(ordered), means, preset.by)


def _is_numeric(results: Results, factor: str) -> bool:
    return all(
        isinstance(value, int | float) and not isinstance(value, bool)
        for value in results.definition.grid[factor]
    )


def _main_scores(record: Experiment, results: Results, x: str) -> Mapping[str, Curves]:
    if record.measures is None:
        return {}
    parts: dict[Key, pd.DataFrame] = {
        (float(name),): record.measures(part) for name, part in results.by_value(x).items()
    }
    return _curves(joined(parts, [x]), x, label)


def _curves(frame: pd.DataFrame, x: str, label: Callable[[Sequence[str], Key], str]) -> Mapping[str, Curves]:
    """A frame of scores as the curves of each measure; points from left to right."""
    names = [str(name) for name in frame if name not in (x, MEASURE, "seed", "value")]
    found: dict[str, dict[str, dict[float, BySeed]]] = {}
    points = series(frame, [x, *names, MEASURE]) if len(frame) else {}
    for (at, *others, measure), values in sorted(points.items(), key=_place):
        curves = found.setdefault(str(measure), {})
        curves.setdefault(label(names, tuple(others)), {})[float(str(at))] = values
    return found


def _place(point: tuple[Key, BySeed]) -> float:
    return float(str(point[0][0]))


def _factors(names: Sequence[str], key: Key) -> str:
    return ", ".join(map(factor_text, names, key))


def _columns(results: Results, x: str) -> Mapping[str, Curves]:
    """Every number of the tables with a row for each trial."""
    found: dict[str, Curves] = {}
    place = [*results.factors, "seed"]
    for frame in results.tables.values():
        if not set(place) <= set(frame) or frame.duplicated(place).any():
            continue
        numbers = [str(name) for name in frame if frame[name].dtype.kind in "iuf" and name not in place]
        frame = frame.assign(**{x: frame[x].astype(float)})
        found.update(_curves(joined({(): tidy(frame, results.factors, numbers)}, []), x, _factors))
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
