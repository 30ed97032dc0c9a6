"""Campaigns of one experiment side by side: what differs, seed by seed."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from midnet_bench.analysis.differences import differences
from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, outlier_notes
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.experiment import Experiment, Measures
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.workflows.report import write_figures_of
from midnet_bench.workflows.sweeps import scores_without

COLUMNS = (
    "trial",
    "measure",
    "difference",
    "low",
    "high",
    "n",
    "seeds",
    "outlier_seed",
    "p_holm",
    "verdict",
    "setting",
)
"""of the tables, beside one for each campaign"""
MAX_SHOWN = 60
"""characters of a setting's value: an arena taken in from a file is long"""


def compare(
    directories: Sequence[str | Path],
    output: str | Path | None = None,
    by: str | None = None,
    baseline: str | None = None,
) -> tuple[Experiment, list[Table]]:
    """Two or more campaigns of one experiment, on the seeds that they share with the first.

    Args:
        directories: of the campaigns.
        output: a folder for the tables and figures; nothing is written unless it is given.
        by: a factor of the grid of the only campaign; then the parts with each of its values are compared,
            by seed and by the other factors.
        baseline: the value with which the others are compared; the first unless given.

    Returns:
        The experiment, and its tables: those that the experiment adds, ``differences`` (of the main
        scores) and ``settings`` (which ones differ).

    Raises:
        InputError: they are not of one experiment, it has no main scores, one folder is given twice, a
            campaign has no seed in common with the first, ``by`` does not part the only campaign, or the
            factor has no value ``baseline``.
    """
    if by is None and baseline is not None:
        raise InputError(f"compare: --baseline {baseline}: say by --by of which factor")
    campaigns = _load(directories) if by is None else _parts(directories, by, baseline)
    names = list(campaigns)
    kinds = sorted({results.definition.experiment for results in campaigns.values()})
    record = experiment_of(campaigns[names[0]])
    if len(kinds) > 1 or record.measures is None:
        raise InputError(
            "compare: give campaigns of one experiment that has main scores, such as detection or labyrinth, "
            f"not {' and '.join(kinds)}"
        )
    measured = {
        name: scores_without(by or "", record.measures(results)) for name, results in campaigns.items()
    }
    changes = differences_table(record, measured)
    for name in names[1:]:
        if not any(name in row for row in changes.rows):
            raise InputError(
                f"compare: {names[0]} and {name} have no finished trials with a cell and a seed in common"
            )
    tables = [*record.comparison_tables(campaigns), changes, settings_table(campaigns)]
    if output is not None:
        for table in tables:
            table.write(Path(output))
        write_figures_of(campaigns, Path(output))
    return record, tables


def worse(experiment: Experiment, tables: Sequence[Table], measure: str) -> list[str]:
    """What is worse than the first campaign in a score, a line each; by the verdicts of ``differences``.

    Raises:
        InputError: the experiment has no such main score.
    """
    (rows,) = [table.rows for table in tables if table.name == "differences"]
    known = list(dict.fromkeys(str(row["measure"]) for row in rows))
    if measure not in known:
        raise InputError(f"compare: --fail-if-worse {measure}: no such score{nearest_name(measure, known)}")
    bad = "higher" if experiment.wants_less(measure) else "lower"
    found = []
    for row in rows:
        if row["measure"] == measure and row["verdict"] == bad:
            (name,) = [key for key in list(row)[3:] if key not in COLUMNS]
            change = row["difference"]
            assert isinstance(change, Estimate)
            place = ", ".join(filter(None, (name, str(row["trial"]))))
            found.append(
                f"{measure} is worse: {place}: {change.value:+.3f} [{change.low:+.3f}, {change.high:+.3f}],"
                f" p {row['p_holm']:.2g}"
            )
    return found


def _load(directories: Sequence[str | Path]) -> dict[str, Results]:
    names = names_of([Path(directory) for directory in directories])
    return {name: load_results(path, tables_of) for name, path in zip(names, directories, strict=True)}


def _parts(directories: Sequence[str | Path], by: str, baseline: str | None) -> dict[str, Results]:
    """The only campaign by the values of a factor, called ``factor=value``, the baseline first."""
    if len(directories) != 1:
        raise InputError(f"compare: --by {by} parts one campaign; give one folder")
    parts = load_results(directories[0], tables_of).by_value(by)
    if len(parts) == 1:
        raise InputError(f"{directories[0]}: '{by}' has one value only; there is nothing to compare")
    names = list(parts)
    if baseline is not None:
        # code of one's own has a digest or a version behind it, which nobody wants to type
        alike = [name for name in names if baseline in (name, re.split("[#@]", name)[0])]
        if len(alike) != 1:
            what = "several values are called so" if alike else "no such value"
            raise InputError(f"compare: --baseline {baseline}: {what} of {by}{nearest_name(baseline, names)}")
        names = [*alike, *(name for name in names if name not in alike)]
    return {f"{by}={name}": parts[name] for name in names}


def names_of(directories: Sequence[Path]) -> list[str]:
    """What to call the folders: the shortest ends of their paths that tell them apart.

    None is called as a column of a table. Raises InputError for fewer than two folders, or one given twice.
    """
    # absolute, but not through links: a link's own name is what its owner calls the campaign
    parts = [Path(os.path.abspath(directory)).parts for directory in directories]
    for length in range(1, max(map(len, parts), default=0) + 1):
        names = ["/".join(each[-length:]) for each in parts]
        if len(set(names)) == len(names) > 1 and not set(names) & set(COLUMNS):
            return names
    raise InputError("compare: give two or more different folders")


def differences_table(record: Experiment, campaigns: Mapping[str, Measures]) -> Table:
    """A row per cell, measure and further campaign: means of both, and their difference from the first.

    Over the seeds that both have; the seed is the unit. Verdicts go by p-values adjusted by Holm.
    """
    (first_name, first), *others = campaigns.items()
    shared = [
        (name, key, values, other[key])
        for name, other in others
        for key, values in first.items()
        if any(seed in other.get(key, {}) for seed in values)
    ]
    changes = differences(
        [(before, after) for *_, before, after in shared],
        [record.range_of(measure) for _, (_, measure), *_ in shared],
    )
    rows: list[Mapping[str, Cell]] = [
        {
            "trial": cell,
            "measure": measure,
            first_name: one.before,
            name: one.after,
            "difference": one.change,
            "seeds": one.seeds,
            "outlier_seed": one.outlier_seed,
            "p_holm": one.p_holm,
            "verdict": one.verdict,
        }
        for (name, (cell, measure), *_), one in zip(shared, changes, strict=True)
    ]
    notes = outlier_notes(one.outlier_seed for one in changes)
    title = f"Differences from {first_name} on the same seeds ({MEAN_METHOD}; verdicts by Holm at 5 %)"
    bounds = {"difference": ("low", "high", "n")}
    return Table("differences", title, rows, {"p_holm": 4}, bounds=bounds, notes=notes)


def settings_table(campaigns: Mapping[str, Results]) -> Table:
    """A row per setting that is not the same in all campaigns, with its value in each."""
    settings = {name: _settings(results.definition) for name, results in campaigns.items()}
    keys = dict.fromkeys(key for one in settings.values() for key in one)
    rows: list[Mapping[str, Cell]] = [
        {"setting": key, **{name: _shown(one.get(key, "(not set)")) for name, one in settings.items()}}
        for key in keys
        if len({_shown(one.get(key, "(not set)")) for one in settings.values()}) > 1
    ]
    return Table("settings", "Settings that differ" if rows else "No setting differs", rows)


def _settings(definition: Definition) -> dict[str, object]:
    seeds = {"base_seed": definition.base_seed, "trials": definition.trials}
    return {**seeds, **definition.grid, **definition.parameters}


def _shown(value: object) -> str:
    text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
