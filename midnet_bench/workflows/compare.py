"""Scores side by side: campaigns, the values of a factor, and curves over a factor."""

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from midnet_bench.analysis.compare import (
    BOUNDS,
    MEASURE,
    SCOPE,
    WORSE,
    BySeed,
    Key,
    cell_columns,
    joined,
    label,
    notes_on,
    paired,
    series,
    tidy,
)
from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, mean
from midnet_bench.analysis.tables import Cell, Table, in_words, signed, team_in_words
from midnet_bench.campaign.provenance import code_of
from midnet_bench.campaign.trial import factor_text
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.registry import Experiment, experiment_of, tables_of
from midnet_bench.settings import leaves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAMPAIGN = "campaign"  # the column of a frame of scores of several campaigns
COLUMNS = (
    *("trial", "measure", "difference", "low", "high", "n", "seeds", "outlier_seed", "p_holm", "verdict"),
    "setting",
)
"""of the tables, beside one for each campaign"""
HOW = f"on the same seeds ({MEAN_METHOD}; verdicts by Holm at 5 %)"
HIDDEN = ("seeds", "p_holm", "outlier_seed")  # columns of differences that a terminal may leave out
FEWEST = 3  # values of a factor whose curve the report draws by itself
MOST_SETTINGS, MAX_SHOWN = 4, 60
"""settings that a line names; characters of a setting's value, which may be a whole arena"""

Curves = Mapping[str, Mapping[float, BySeed]]
"""the other factors' values -> the value of the factor along x -> a score of each seed"""


class Comparison(NamedTuple):
    """Campaigns side by side."""

    experiment: Experiment
    campaigns: Mapping[str, Results]  # by name, the baseline first
    tables: list[Table]  # for files and programs: the experiment's own, ``differences`` and ``settings``

    @property
    def differences(self) -> Table:
        """A row per cell, measure and further campaign."""
        return self.tables[-2]


def compare(
    directories: Sequence[str | Path], by: str | None = None, baseline: str | None = None
) -> Comparison:
    """Two or more campaigns of one experiment, on the seeds that they share with the first.

    Args:
        directories: of the campaigns.
        by: a factor of the grid of the only campaign, whose values are compared, by seed and cell; its
            key ``compare`` names one unless given.
        baseline: the value with which the others are compared; the first unless given.

    Raises:
        InputError: they are not of one experiment, it has no main scores, one folder is given twice, a
            campaign has no seed in common with the first, ``by`` has one value only, or there is no value
            ``baseline``.
    """
    if by is None and baseline is not None:
        raise InputError(f"compare: --baseline {baseline}: say by --by of which factor")
    if by is None and len(directories) == 1:
        only = load_results(directories[0], tables_of)
        if (preset := only.definition.compare) is None:
            hint = f", or --by {' or --by '.join(only.factors)}" if only.factors else ""
            raise InputError(f"compare: give two or more different folders{hint}")
        by, baseline = preset.by, str(preset.baseline)
    if by is None:
        folders = dict(zip(names_of([Path(one) for one in directories]), directories, strict=True))
        campaigns = {name: load_results(folder, tables_of) for name, folder in folders.items()}
    else:
        campaigns = _by_value(directories, by, baseline)
    kinds = sorted({results.definition.experiment for results in campaigns.values()})
    record = experiment_of(next(iter(campaigns.values())))
    if len(kinds) > 1 or record.report.measures is None:
        raise InputError(
            "compare: give campaigns of one experiment that has main scores, such as detection or labyrinth, "
            f"not {' and '.join(kinds)}"
        )
    frame = scores_of(record, {(name,): results for name, results in campaigns.items()}, [CAMPAIGN])
    differences = _differences(record, frame.drop(columns=[by] if by in frame else []), list(campaigns))
    first, *others = campaigns
    for name in others:
        if not any(name in row for row in differences.rows):
            raise InputError(_nothing_to_pair(frame, first, name))
    tables = [*record.report.comparison_tables(campaigns), differences, _settings(campaigns)]
    return Comparison(record, campaigns, tables)


def names_of(directories: Sequence[Path]) -> list[str]:
    """What to call the folders: the shortest different ends of their paths, none of them a table's column.

    Raises InputError for fewer than two folders, or one given twice.
    """
    # absolute, but not through links: a link's own name is what its owner calls the campaign
    parts = [Path(os.path.abspath(directory)).parts for directory in directories]
    for length in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(each[-length:]) for each in parts]
        if len(set(names)) == len(names) > 1 and not set(names) & set(COLUMNS):
            return names
    raise InputError("compare: give two or more different folders")


def _by_value(directories: Sequence[str | Path], by: str, baseline: str | None) -> dict[str, Results]:
    """The only campaign by the values of a factor, called ``factor=value``, the baseline first."""
    if len(directories) != 1:
        raise InputError(f"compare: --by {by} parts one campaign; give one folder")
    parts = load_results(directories[0], tables_of).by_value(by)
    if len(parts) == 1:
        raise InputError(f"{directories[0]}: '{by}' has one value only; there is nothing to compare")
    names = list(parts)
    if baseline is not None:
        # a digest or a version follows the name of a user's own code
        alike = [name for name in names if baseline in (name, re.split("[#@]", name)[0])]
        alike = alike or [name for name in names if _is_same_number(baseline, name)]
        if len(alike) != 1:
            what = "several values are called so" if alike else "no such value"
            raise InputError(f"compare: --baseline {baseline}: {what} of {by}{nearest_name(baseline, names)}")
        names = list(dict.fromkeys([*alike, *names]))
    return {f"{by}={name}": parts[name] for name in names}


def _is_same_number(text: str, other: str) -> bool:
    try:
        return float(text) == float(other)
    except ValueError:
        return False


def scores_of(record: Experiment, parts: Mapping[Key, Results], by: Sequence[str]) -> pd.DataFrame:
    """The main scores of parts of campaigns in one frame, with a column ``by`` for each place of the key.

    A column that is no factor, such as robots, and has one value in each part and not the same in all, goes:
    the parts' own variant or campaign sets it, and it would leave no cell that two parts share.
    """
    assert record.report.measures is not None
    frames = {key: record.report.measures(part) for key, part in parts.items()}
    frame, factors = joined(frames, by), {SCOPE, *(name for part in parts.values() for name in part.factors)}
    set_by_parts = []
    for name in cell_columns(frame, [*by, *factors]):
        values = [set(one[name].dropna()) for one in frames.values() if name in one]
        if len(set().union(*values)) > 1 and all(len(each) < 2 for each in values):
            set_by_parts.append(name)
    return frame.drop(columns=set_by_parts)


def _nothing_to_pair(frame: pd.DataFrame, first: str, name: str) -> str:
    """Why two campaigns have no trials to compare, and what to run."""
    has, of = {}, {}
    for one in (first, name):
        of[one] = seeds = sorted(set(frame[frame[CAMPAIGN] == one]["seed"]))
        if not seeds:
            return f"compare: {one} has no finished trial"
        has[one] = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    if {*of[first]} & {*of[name]}:
        return f"nothing to pair: {first} and {name} have no cell in common"
    return (
        f"nothing to pair: {first} has {has[first]}, {name} has {has[name]}; "
        f"run {name} with --seed {has[first].split()[1]}"
    )


def seed_mean(record: Experiment, measure: str, values: BySeed) -> Estimate:
    """The mean of a score over seeds with its interval, which stays where the score can be."""
    return mean(list(values.values()), within=record.range_of(measure))


def _differences(record: Experiment, frame: pd.DataFrame, campaigns: Sequence[str]) -> Table:
    """Means of the first campaign (``campaigns[0]``) and of each other, and their difference, by cell."""
    first = campaigns[0]
    compared = paired(frame, [CAMPAIGN], record.range_of, record.wants_less) if len(frame) else []
    rows: list[Mapping[str, Cell]] = []
    names = []
    for one in compared:
        other = str(one.contestant[0])
        means = {first: one.before, other: one.after}
        rows.append({"trial": one.cell, "measure": one.measure, **means, **one.columns})
        names.append(f"{one.cell} {in_words(one.measure)}" + f" ({other})" * (len(campaigns) > 2))
    title, labels = f"Differences from {first} {HOW}", {name: name for name in campaigns}
    notes = notes_on(compared, names)
    return Table("differences", title, rows, {"p_holm": 4}, bounds=BOUNDS, notes=notes, labels=labels)


def _settings(campaigns: Mapping[str, Results]) -> Table:
    """A row per setting that is not the same in all campaigns, with its value in each."""
    settings: dict[str, dict[str, str]] = {}
    for name, results in campaigns.items():
        given = results.definition
        seeds = {"base_seed": given.base_seed, "trials": given.trials}
        for key, value in {**seeds, **given.grid, **given.parameters}.items():
            text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
            cut = text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
            settings.setdefault(key, dict.fromkeys(campaigns, "(not set)"))[name] = cut
    rows = [{"setting": key, **by} for key, by in settings.items() if len(set(by.values())) > 1]
    title = "Settings that differ" if rows else "No setting differs"
    return Table("settings", title, rows, labels={name: name for name in campaigns})


def shown(found: Comparison) -> tuple[list[str], list[Table]]:
    """What a terminal shows: lines on what was compared, and a table for each other campaign and cell."""
    first, *others = found.campaigns
    codes = {name: code_of(results.provenance) for name, results in found.campaigns.items()}
    lines: list[str] = []
    tables: list[Table] = []
    for name in others:
        if codes[name] != codes[first]:
            lines.append(f"Different code: {first} was run by {codes[first]}, {name} by {codes[name]}.")
        rows = [row for row in found.differences.rows if name in row]
        seeds = max(int(str(row["seeds"])) for row in rows)
        shared = f"{seeds} shared seed{'' if seeds == 1 else 's'}"
        lines.append(f"{name} against {first}: {shared}{_settings_in_words(found.tables[-1], first, name)}")
        if _are_identical(found.campaigns[first], found.campaigns[name]):
            lines.append(f"The trials of {name} and {first} are the same, byte for byte.")
        for cell in dict.fromkeys(str(row["trial"]) for row in rows):
            own: list[Mapping[str, Cell]] = [
                {
                    "measure": in_words(str(row["measure"])),
                    first: row[first],
                    name: row[name],
                    "difference": signed(row["difference"]),  # type: ignore[arg-type]
                    "verdict (Holm)": row["verdict"],
                }
                for row in rows
                if row["trial"] == cell
            ]
            labels = {"measure": "", first: first, name: name}
            tables.append(Table(f"differences_{cell}", team_in_words(cell), own, labels=labels))
    return [*lines, *found.differences.notes], tables


def _settings_in_words(settings: Table, first: str, name: str) -> str:
    changed = [
        f"{row['setting']} ({row[first]} -> {row[name]})"
        for row in settings.rows
        # of a campaign in parts by a factor, the names of the parts say it
        if row[first] != row[name] and not name.startswith(f"{row['setting']}=")
    ]
    if not changed:
        return "" if settings.rows else "; no setting differs"
    if more := len(changed[MOST_SETTINGS:]):
        changed = [*changed[:MOST_SETTINGS], f"{more} more (--wide lists them)"]
    return f"; settings that differ: {', '.join(changed)}".replace("(not set)", "not set")


def _are_identical(first: Results, other: Results) -> bool:
    """Whether all tables of both campaigns' trials agree in the seeds that both have."""
    if set(first.tables) != set(other.tables) or first.factors != other.factors:
        return False
    for name, one in first.tables.items():
        two = other.tables[name]
        if "seed" not in one or "seed" not in two:
            return False
        seeds = set(one["seed"]) & set(two["seed"])
        one, two = (each[each["seed"].isin(seeds)].reset_index(drop=True) for each in (one, two))
        if not seeds or not one.equals(two):
            return False
    return True


def worse(found: Comparison, measure: str) -> list[str]:
    """What is worse than the first campaign in a score, a line each; by the verdicts of ``differences``.

    Raises InputError: the experiment has no such main score.
    """
    rows = found.differences.rows
    known = list(dict.fromkeys(str(row["measure"]) for row in rows))
    if measure not in known:
        raise InputError(f"compare: --fail-if-worse {measure}: no such score{nearest_name(measure, known)}")
    lines = []
    for row in rows:
        change = row["difference"]
        if row["measure"] == measure and row["verdict"] == WORSE and isinstance(change, Estimate):
            (name,) = [name for name in list(found.campaigns)[1:] if name in row]
            cell = ", ".join(filter(None, (name, str(row["trial"]))))
            lines.append(f"{measure} is worse: {cell}: {signed(change)}, p {row['p_holm']:.2g}")
    return lines


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
    key = f"{results.directory}: --x {x}"
    if x not in results.definition.grid:
        raise InputError(f"{key}: the grid has no such factor{nearest_name(x, results.factors)}")
    if not _is_numeric(results, x):
        values = ", ".join(map(str, results.definition.grid[x]))
        raise InputError(f"{key}: its values are no numbers ({values[:60]})")
    record = experiment_of(results)
    panels: Mapping[str, Curves] = {}
    if record.report.measures is not None:
        parts: dict[Key, Results] = {(float(name),): part for name, part in results.by_value(x).items()}
        panels = _curves(scores_of(record, parts, [x]), x, label)
    if y is not None:
        known = panels if y in panels else {**panels, **_number_columns(results, x)}
        if y not in known:
            raise InputError(f"{results.directory}: --y {y}: no such column{nearest_name(y, [*known])}")
        panels = {y: known[y]}
    if not panels:
        raise InputError(f"{key}: no main score to draw; give a column by --y")
    means = {
        measure: {
            cell: {at: seed_mean(record, measure, seeds) for at, seeds in points.items()}
            for cell, points in curves.items()
        }
        for measure, curves in panels.items()
    }
    rows: list[Mapping[str, Cell]] = [
        {"measure": measure, "cell": cell, x: at, "mean": estimate}
        for measure, curves in means.items()
        for cell, points in curves.items()
        for at, estimate in points.items()
    ]
    title = f"Scores by {x} ({MEAN_METHOD}, over seeds)"
    table = Table(f"{y or 'scores'}_by_{x}", title, rows, bounds={"mean": ("low", "high", "seeds")})
    from midnet_bench.drawing.charts import axis_label, scores_figure

    leaf = leaves(record.parameters).get(x)
    ranges = {measure: record.range_of(measure) for measure in means}
    return table, scores_figure(axis_label(x, leaf.help if leaf else ""), means, panels, ranges)


def sweeps(results: Results) -> list[tuple[Table, "Figure"]]:
    """Figures of the factor that a campaign's key ``compare`` names; else of each long numeric factor.

    None where the experiment's own figures show the factors, or without main scores or finished trials.
    """
    record, grid = experiment_of(results), results.definition.grid
    if record.report.measures is None or not results.finished:
        return []
    if results.definition.compare is not None:
        return [_compared_values(results, record)]
    if record.report.has_figures and not record.report.sweeps_beside:
        return []
    return [sweep(results, x) for x in grid if len(grid[x]) >= FEWEST and _is_numeric(results, x)]


def _compared_values(results: Results, record: Experiment) -> tuple[Table, "Figure"]:
    """What the campaign's key ``compare`` asks for: a row for each value, cell and score; its figure."""
    preset = results.definition.compare
    assert preset is not None
    baseline, parts = str(preset.baseline), results.by_value(preset.by)
    ordered = list(dict.fromkeys([baseline, *parts]))
    frame = scores_of(record, {(name,): parts[name] for name in ordered}, [preset.by])
    compared = paired(
        frame, [preset.by], record.range_of, record.wants_less, preset.measures, with_baseline=True
    )
    rows: list[Mapping[str, Cell]] = []
    means: dict[str, dict[str, dict[str, Estimate]]] = {}
    for one in compared:
        value = str(one.contestant[0])
        if value != baseline:
            row = {preset.by: value, "trial": one.cell, "measure": one.measure}
            rows.append({**row, "baseline": one.before, "value": one.after, **one.columns})
        estimate = seed_mean(record, one.measure, one.values)
        means.setdefault(one.measure, {}).setdefault(one.cell, {})[value] = estimate
    name, title = f"differences_by_{preset.by}", f"Differences from {baseline} {HOW}"
    hidden, known = (*HIDDEN, "value", "baseline"), list(dict.fromkeys(frame[MEASURE]))
    notes = [
        f"compare.measures: there is no score '{one}'{nearest_name(one, known)}"
        for one in preset.measures
        if one not in known
    ]
    notes += notes_on(compared)
    table = Table(name, title, rows, {"p_holm": 4}, bounds=BOUNDS, notes=notes, beside=hidden)
    from midnet_bench.drawing.charts import scores_figure

    return table, scores_figure(preset.by, means, baseline=baseline)


def _is_numeric(results: Results, factor: str) -> bool:
    values = results.definition.grid[factor]
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _number_columns(results: Results, x: str) -> dict[str, Curves]:
    """Every number of the tables with a row for each trial."""
    found: dict[str, Curves] = {}
    key = [*results.factors, "seed"]
    for frame in results.tables.values():
        if set(key) <= set(frame) and not frame.duplicated(key).any():
            numbers = [str(name) for name in frame if frame[name].dtype.kind in "iuf" and name not in key]
            frame = frame.assign(**{x: frame[x].astype(float)})
            scores = joined({(): tidy(frame, results.factors, numbers)}, [])
            found |= _curves(scores, x, lambda names, values: ", ".join(map(factor_text, names, values)))
    return found


def _curves(frame: pd.DataFrame, x: str, named: Callable[[Sequence[str], Key], str]) -> dict[str, Curves]:
    """A frame of scores as the curves of each measure; points from left to right."""
    names = cell_columns(frame, [x])
    found: dict[str, dict[str, dict[float, BySeed]]] = {}
    points = series(frame, [x, *names, MEASURE]) if len(frame) else {}
    for (at, *others, measure), values in sorted(points.items(), key=lambda point: float(str(point[0][0]))):
        curves = found.setdefault(str(measure), {})
        curves.setdefault(named(names, tuple(others)), {})[float(str(at))] = values
    return dict(found)
