"""Campaigns of one experiment side by side: what differs, seed by seed."""

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis import compare as analysis
from midnet_bench.analysis.compare import BOUNDS, MEASURE, WORSE, columns_of, holm_notes, joined, label
from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, outlier_notes
from midnet_bench.analysis.tables import Cell, Table, signed
from midnet_bench.analysis.words import in_words, team_in_words
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import code_of
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.workflows.report import write_figures_of

CAMPAIGN = "campaign"
"""the column of a frame of scores of several campaigns"""
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
MOST_SETTINGS = 4
"""that a line names"""
MAX_SHOWN = 60
"""characters of a setting's value: an arena taken in from a file is long"""


class Comparison(NamedTuple):
    """Campaigns side by side."""

    experiment: Experiment
    tables: list[Table]
    """for files and programs"""
    lines: list[str]
    """for a terminal: what was compared"""
    shown: list[Table]
    """for a terminal: the differences of each cell"""


def compare(
    directories: Sequence[str | Path],
    output: str | Path | None = None,
    by: str | None = None,
    baseline: str | None = None,
) -> tuple[Experiment, list[Table]]:
    """The experiment and the tables of :func:`comparison`."""
    found = comparison(directories, output, by, baseline)
    return found.experiment, found.tables


def comparison(
    directories: Sequence[str | Path],
    output: str | Path | None = None,
    by: str | None = None,
    baseline: str | None = None,
) -> Comparison:
    """Two or more campaigns of one experiment, on the seeds that they share with the first.

    Args:
        directories: of the campaigns.
        output: a folder for the tables and figures; nothing is written unless it is given.
        by: a factor of the grid of the only campaign; then the parts with each of its values are compared,
            by seed and by the other factors.
        baseline: the value with which the others are compared; the first unless given.

    Returns:
        Among its tables are those that the experiment adds, ``differences`` (of the main scores) and
        ``settings`` (which ones differ).

    Raises:
        InputError: they are not of one experiment, it has no main scores, one folder is given twice, a
            campaign has no seed in common with the first, ``by`` does not part the only campaign, or the
            factor has no value ``baseline``.
    """
    if by is None and baseline is not None:
        raise InputError(f"compare: --baseline {baseline}: say by --by of which factor")
    if by is None and len(directories) == 1:
        only = load_results(directories[0], tables_of)
        if (preset := only.definition.compare) is not None:
            return comparison(directories, output, preset.by, str(preset.baseline))
        factors = only.factors
        hint = f", or --by {' or --by '.join(factors)}" if factors else ""
        raise InputError(f"compare: give two or more different folders{hint}")
    campaigns = _load(directories) if by is None else _parts(directories, by, baseline)
    names = list(campaigns)
    kinds = sorted({results.definition.experiment for results in campaigns.values()})
    record = experiment_of(campaigns[names[0]])
    if len(kinds) > 1 or record.measures is None:
        raise InputError(
            "compare: give campaigns of one experiment that has main scores, such as detection or labyrinth, "
            f"not {' and '.join(kinds)}"
        )
    frame = joined({(name,): record.measures(results) for name, results in campaigns.items()}, [CAMPAIGN])
    changes = differences_table(record, frame.drop(columns=[by] if by in frame else []), names)
    for name in names[1:]:
        if not any(name in row for row in changes.rows):
            raise InputError(_nothing_to_pair(frame, names[0], name))
    settings = settings_table(campaigns)
    tables = [*record.comparison_tables(campaigns), changes, settings]
    if output is not None:
        for table in tables:
            table.write(Path(output))
        write_figures_of(campaigns, Path(output))
    return Comparison(record, tables, *_shown_differences(record, names, changes, campaigns, settings))


def _nothing_to_pair(frame: pd.DataFrame, first: str, name: str) -> str:
    """Why two campaigns have no trials to compare, and what to run."""
    parts = {one: frame[frame[CAMPAIGN] == one] for one in (first, name)}
    seeds = {one: sorted(set(part["seed"])) for one, part in parts.items()}
    if not seeds[first] or not seeds[name]:
        return f"compare: {name if seeds[first] else first} has no finished trial"
    if not set(seeds[first]) & set(seeds[name]):
        both = ", ".join(f"{one} has {_seeds(found)}" for one, found in seeds.items())
        return f"nothing to pair: {both}; run {name} with --seed {seeds[first][0]}"
    names = [str(column) for column in frame if column not in (CAMPAIGN, MEASURE, "seed", "value")]
    keys = {one: part[names].itertuples(index=False, name=None) for one, part in parts.items()}
    cells = {one: ", ".join(dict.fromkeys(label(names, key) for key in keys[one]))[:80] for one in keys}
    return f"nothing to pair: {first} has {cells[first]}; {name} has {cells[name]}"


def _seeds(seeds: Sequence[int]) -> str:
    return f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"


def _shown_differences(
    record: Experiment,
    names: Sequence[str],
    changes: Table,
    campaigns: Mapping[str, Results],
    settings: Table,
) -> tuple[list[str], list[Table]]:
    """What a terminal shows: lines on what was compared, and a table for each other campaign and cell."""
    first, *others = names
    lines: list[str] = []
    tables: list[Table] = []
    codes = {name: code_of(results.provenance) for name, results in campaigns.items()}
    for name in others:
        if codes[name] != codes[first]:
            lines.append(f"Different code: {first} was run by {codes[first]}, {name} by {codes[name]}.")
        rows = [row for row in changes.rows if name in row]
        seeds = max(int(str(row["seeds"])) for row in rows)
        shared = f"{seeds} shared seed{'' if seeds == 1 else 's'}"
        lines.append(f"{name} against {first}: {shared}{_settings_in_words(settings, first, name)}")
        if _are_the_same(campaigns[first], campaigns[name]):
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
    return [*lines, *(note for note in changes.notes)], tables


def _settings_in_words(settings: Table, first: str, name: str) -> str:
    changed = [
        row
        for row in settings.rows
        # of a campaign in parts by a factor, the names of the parts say it
        if row[first] != row[name] and not name.startswith(f"{row['setting']}=")
    ]
    if not changed:
        return "" if settings.rows else "; no setting differs"
    texts = [
        f"{row['setting']} ({row[first]} -> {row[name]})".replace("(not set)", "not set")
        for row in changed[:MOST_SETTINGS]
    ]
    more = len(changed) - len(texts)
    texts += [f"{more} more (--wide lists them)"] if more else []
    return f"; settings that differ: {', '.join(texts)}"


def _are_the_same(first: Results, other: Results) -> bool:
    """Whether all tables of both campaigns' trials agree in the seeds that both have."""
    if set(first.tables) != set(other.tables) or first.factors != other.factors:
        return False
    for name in first.tables:
        one, two = first.tables[name], other.tables[name]
        if "seed" not in one or "seed" not in two:
            return False
        seeds = set(one["seed"]) & set(two["seed"])
        one, two = (each[each["seed"].isin(seeds)].reset_index(drop=True) for each in (one, two))
        if not seeds or not one.equals(two):
            return False
    return True


def worse(experiment: Experiment, tables: Sequence[Table], measure: str) -> list[str]:
    """What is worse than the first campaign in a score, a line each; by the verdicts of ``differences``.

    Raises:
        InputError: the experiment has no such main score.
    """
    (rows,) = [table.rows for table in tables if table.name == "differences"]
    known = list(dict.fromkeys(str(row["measure"]) for row in rows))
    if measure not in known:
        raise InputError(f"compare: --fail-if-worse {measure}: no such score{nearest_name(measure, known)}")
    found = []
    for row in rows:
        if row["measure"] == measure and row["verdict"] == WORSE:
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
        alike = alike or [name for name in names if _is_number(baseline, name)]
        if len(alike) != 1:
            what = "several values are called so" if alike else "no such value"
            raise InputError(f"compare: --baseline {baseline}: {what} of {by}{nearest_name(baseline, names)}")
        names = [*alike, *(name for name in names if name not in alike)]
    return {f"{by}={name}": parts[name] for name in names}


def _is_number(text: str, other: str) -> bool:
    """Whether both texts are the same number, such as 3 and 3.0."""
    try:
        return float(text) == float(other)
    except ValueError:
        return False


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


def differences_table(record: Experiment, frame: pd.DataFrame, campaigns: Sequence[str]) -> Table:
    """A row per cell, measure and further campaign: means of both, and their difference from the first.

    Over the seeds that both have; the seed is the unit. Verdicts go by p-values adjusted by Holm.

    Args:
        record: the campaigns' experiment.
        frame: of scores, with the column ``campaign``.
        campaigns: their names, the first one's first.
    """
    first = campaigns[0]
    compared = analysis.compare(frame, [CAMPAIGN], record.range_of) if len(frame) else []
    rows: list[Mapping[str, Cell]] = [
        {
            "trial": one.cell,
            "measure": one.measure,
            first: one.difference.before,
            str(one.contestant[0]): one.difference.after,
            **columns_of(one.difference, record.wants_less(one.measure)),
        }
        for one in compared
    ]
    notes = outlier_notes(one.difference.outlier_seed for one in compared)
    places = [
        f"{one.cell} {in_words(one.measure)}" + f" ({one.contestant[0]})" * (len(campaigns) > 2)
        for one in compared
    ]
    notes += holm_notes(places, [one.difference for one in compared])
    title = f"Differences from {first} on the same seeds ({MEAN_METHOD}; verdicts by Holm at 5 %)"
    labels = {name: name for name in campaigns}
    return Table("differences", title, rows, {"p_holm": 4}, bounds=BOUNDS, notes=notes, labels=labels)


def settings_table(campaigns: Mapping[str, Results]) -> Table:
    """A row per setting that is not the same in all campaigns, with its value in each."""
    settings = {name: _settings(results.definition) for name, results in campaigns.items()}
    keys = dict.fromkeys(key for one in settings.values() for key in one)
    rows: list[Mapping[str, Cell]] = [
        {"setting": key, **{name: _shown(one.get(key, "(not set)")) for name, one in settings.items()}}
        for key in keys
        if len({_shown(one.get(key, "(not set)")) for one in settings.values()}) > 1
    ]
    title = "Settings that differ" if rows else "No setting differs"
    return Table("settings", title, rows, labels={name: name for name in campaigns})


def _settings(definition: Definition) -> dict[str, object]:
    seeds = {"base_seed": definition.base_seed, "trials": definition.trials}
    return {**seeds, **definition.grid, **definition.parameters}


def _shown(value: object) -> str:
    text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."
