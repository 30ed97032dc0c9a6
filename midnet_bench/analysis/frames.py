"""``Results``: a campaign's definition, provenance and tables as pandas data frames.

They come from a store, or, where there is none, from the files that a report writes: ``configuration.json``,
``provenance.json`` and a CSV file for each table of the trials, which may be compressed (``.csv.gz``). A
store is written out as such files first, so the data frames are the same.
"""

import contextlib
import csv
import gzip
import json
import logging
import tempfile
import warnings
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from midnet_bench.campaign.definition import Definition, shown_cell
from midnet_bench.campaign.provenance import Provenance, versions_note
from midnet_bench.campaign.store import FILE_NAME, Store, export_csv, open_store
from midnet_bench.campaign.trial import (
    FAILURES,
    TIMING,
    TIMING_TABLE,
    VARIANT,
    Column,
    Columns,
    Row,
    Scalar,
    Tables,
    cell_text,
    factor_text,
    shown,
)
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.files import read_bounded, temporary_folder

CONFIGURATION = "configuration.json"
PROVENANCE = "provenance.json"
ENDINGS = (".csv", ".csv.gz")
MOST_JSON_BYTES = 100_000_000
RESTORE = "take the file from where it was made, or run the campaign again"
SEED = Column(int, least=-(2.0**63), most=2.0**63)
_EXACTLY: dict[str, Any] = {"float_precision": "round_trip"} if pd.__version__ < "3.1" else {}
"""floats to their last digit, which is what pandas does unasked since 3.1"""


@dataclass(frozen=True, repr=False, eq=False)
class Results:
    """A campaign and what its trials gave."""

    directory: Path
    definition: Definition
    provenance: list[Provenance]  # one for each run that added trials
    tables: Mapping[str, pd.DataFrame]
    """Those of the finished trials by name, such as ``scores``, each read at its first use.

    Rows stand in the campaign's order and begin with the factors of its grid and the seed; what is not
    defined is NaN."""
    timing: pd.DataFrame
    """a row for each trial: ``status`` (finished, failed), ``wall_s``, ``simulated_s``, ``finished_utc``"""
    failures: pd.DataFrame  # a row for each trial that failed, with its ``reason``; no columns if none did

    def __repr__(self) -> str:
        grid = ", ".join(f"{name}={values}" for name, values in self.definition.grid.items())
        return (
            f"<Results of {self.definition.experiment} in {self.directory}: {self.finished} trials"
            f"{f' over {grid}' if grid else ''}; tables: {', '.join(self.tables)}>"
        )

    @property
    def factors(self) -> list[str]:
        """The factors of the grid."""
        return list(self.definition.grid)

    @cached_property
    def finished(self) -> int:
        """How many trials finished."""
        return int((self.timing["status"] == "finished").sum()) if "status" in self.timing else 0

    def table(self, name: str) -> pd.DataFrame:
        """The table of that name; without rows if no trial has finished.

        Raises:
            InputError: trials have finished and there is no such table.
        """
        if name in self.tables:
            return self.tables[name]
        if self.finished or len(self.tables):
            raise InputError(
                f"{self.directory / name}.csv: missing; this folder has no store and lacks that table of the "
                "trials, so run the campaign again or give a folder that has it"
            )
        return pd.DataFrame()

    def column(self, frame: pd.DataFrame, parameter: str, default: Scalar = None) -> pd.Series:
        """A parameter's value for each row of one of the tables, whether or not it is a factor of the grid.

        Args:
            frame: the table.
            parameter: its flat key.
            default: where the campaign has no such parameter.

        Raises:
            InputError: the campaign has no such parameter, and there is no default.
        """
        given, variants = self.definition.parameters, self.definition.variants
        if parameter in self.definition.grid:
            return frame[parameter]
        if any(parameter in changes for changes in variants.values()):
            return frame[VARIANT].map(
                {name: {**given, **changes}.get(parameter) for name, changes in variants.items()}
            )
        if default is None and parameter not in given:
            raise InputError(f"{self.directory / CONFIGURATION}: parameters.{parameter}: missing")
        return pd.Series([given.get(parameter, default)] * len(frame), index=frame.index)

    def whole_numbers(self, frame: pd.DataFrame, parameter: str) -> pd.Series:
        """As :meth:`column`. Raises InputError too if they are no whole numbers."""
        values = self.column(frame, parameter)
        if values.dtype.kind not in "iu":
            raise InputError(f"{self.directory}: {parameter}: whole numbers are needed for these results")
        return values

    def other_factors(self, frame: pd.DataFrame, *known: str, separator: str = ", ") -> list[str]:
        """``factor=value`` of the grid's factors but ``known``, for each row of one of the tables."""
        factors = [factor for factor in self.factors if factor not in known]
        columns = [[factor_text(factor, value) for value in frame[factor]] for factor in factors]
        return [separator.join(parts) for parts in zip(*columns, strict=True)] or [""] * len(frame)

    def teams(self, frame: pd.DataFrame, *known: str) -> list[str]:
        """The paper's name of each row's team, ``5-robot``, and its :meth:`other_factors`."""
        each = zip(self.column(frame, "robots"), self.other_factors(frame, "robots", *known), strict=True)
        return [f"{size}-robot{', ' if others else ''}{others}" for size, others in each]

    def by_value(self, factor: str) -> "dict[str, Results]":
        """The campaign in parts, one for each value of a factor of the grid, which is a parameter there.

        Raises:
            InputError: the grid has no such factor.
        """
        given, known = self.definition, self.factors
        if factor not in given.grid:
            raise InputError(
                f"{self.directory}: the grid has no factor '{factor}'{nearest_name(factor, known)}"
            )
        grid = {name: values for name, values in given.grid.items() if name != factor}
        variants = {} if factor == VARIANT else given.variants
        parts = {}
        for value in given.grid[factor]:
            parameters = given.parameters_of({factor: value})
            of_value = replace(given, grid=grid, parameters=parameters, variants=variants)
            parts[str(value)] = self._part(of_value, factor, value)
        return parts

    def of_seed(self, seed: int) -> "Results":
        """The campaign's trials of one seed."""
        return self._part(replace(self.definition, base_seed=seed, trials=1), "seed", seed)

    def _part(self, definition: Definition, column: str, value: Scalar) -> "Results":
        """The trials with that value in a column, which is there no more unless it is the seed."""

        def part(frame: pd.DataFrame) -> pd.DataFrame:
            if column not in frame:
                return frame
            rows = frame[frame[column] == value]
            return (rows if column == "seed" else rows.drop(columns=column)).reset_index(drop=True)

        parts = _Tables({name: partial(lambda name: part(self.tables[name]), name) for name in self.tables})
        timing, failures = part(self.timing), part(self.failures)
        return replace(self, definition=definition, tables=parts, timing=timing, failures=failures)


def records(frame: pd.DataFrame) -> list[Row]:
    """The rows of a data frame as dictionaries of Python's own numbers."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


TablesOf = Callable[[Definition, Path], Tables]
"""(a campaign's definition, its folder) -> the tables that its experiment has"""


def load_results(directory: str | Path, tables_of: TablesOf | None = None) -> Results:
    """The results in a campaign's folder.

    Args:
        directory: with ``campaign.sqlite``, or with the files that a report wrote.
        tables_of: what the tables are held to, ``registry.tables_of`` in all commands; to nothing unless
            given.

    Raises:
        InputError: neither is there, or it is damaged, foreign or of a newer version.
    """
    directory = Path(directory)
    if (directory / FILE_NAME).exists():
        with contextlib.ExitStack() as held:
            temporary = temporary_folder(Path(tempfile.gettempdir(), "midnet-bench-tables"))
            folder = held.enter_context(temporary)
            with open_store(directory / FILE_NAME) as store:
                results = results_of(store, directory, folder, tables_of)
            weakref.finalize(results.tables, held.pop_all().close)
        return results
    if (directory / CONFIGURATION).exists():
        return _from_files(directory, tables_of)
    raise InputError(
        f"{directory}: there is no campaign here: neither {FILE_NAME} nor {CONFIGURATION}; give the folder "
        "of one, such as results/labyrinth"
    )


def results_of(store: Store, directory: Path, folder: Path, tables_of: TablesOf | None = None) -> Results:
    """The results in a store.

    Args:
        store: open; it is no longer needed afterwards.
        directory: where the store is.
        folder: the CSV files of the trials' tables are written here, and read from here at their first use.
        tables_of: as for :func:`load_results`.

    Raises:
        InputError: a trial is damaged or has other tables, or the folder cannot be written.
    """
    definition = store.definition
    expected = {} if tables_of is None else tables_of(definition, directory)
    exported = export_csv(store, folder, expected)
    expected = _beside_factors(expected, definition)
    files = {
        path.stem: _File(path, definition, expected.get(path.stem), is_checked=True) for path in exported
    }
    return _results(directory, definition, store.runs(), files)


def _from_files(directory: Path, tables_of: TablesOf | None) -> Results:
    try:
        text = read_bounded(directory / CONFIGURATION, MOST_JSON_BYTES).decode()
        definition = Definition.from_json(text)
    except (OSError, ValueError) as error:
        raise InputError(f"{directory / CONFIGURATION}: is not the configuration of a campaign") from error
    keys = [*definition.grid, "seed"]
    known = {} if tables_of is None else tables_of(definition, directory)
    expected = {**_beside_factors(known, definition), **TIMING_TABLE}
    files = {
        name: _File(path, definition, expected.get(name))
        for path in sorted(directory.iterdir())
        for ending in ENDINGS
        if path.name.endswith(ending) and path.is_file()
        for name in (path.name.removesuffix(ending),)
    }
    # tables made of the trials' tables stand beside them and begin otherwise
    tables = {name: file for name, file in files.items() if file.columns[: len(keys)] == keys}
    about_trials = {name: files[name] for name in (TIMING, FAILURES) if name in files}
    if tables and (TIMING not in files or files[TIMING].frame.empty):
        raise InputError(f"{directory / TIMING}.csv: missing, or without trials; {RESTORE}")
    path = directory / PROVENANCE
    try:
        runs = json.loads(read_bounded(path, MOST_JSON_BYTES)) if path.exists() else []
    except (OSError, RecursionError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    provenance = [run for run in (runs if isinstance(runs, list) else [runs]) if isinstance(run, dict)]
    return _results(directory, definition, provenance, tables | about_trials)


def _beside_factors(tables: Tables, definition: Definition) -> Tables:
    """The tables as files have them, which begin with the factors of the grid."""
    return {name: table.beside_factors(definition.grid) for name, table in tables.items()}


def _results(
    directory: Path, definition: Definition, provenance: list[Provenance], files: "dict[str, _File]"
) -> Results:
    for note in versions_note(provenance):
        logging.getLogger("midnet_bench").warning("%s: note: %s", directory, note)
    timing, failures = (
        files.pop(name).frame if name in files else pd.DataFrame() for name in (TIMING, FAILURES)
    )
    tables = _Tables({name: partial(getattr, file, "frame") for name, file in files.items()})
    return Results(directory, definition, provenance, tables, timing, failures)


@dataclass(frozen=True)
class _File:
    """A table in a CSV file, compressed or not."""

    path: Path
    definition: Definition
    table: Columns | None = None  # what its columns hold
    is_checked: bool = False  # whether its columns are known to hold that

    @cached_property
    def columns(self) -> list[str]:
        """The names of its columns; none if it cannot be read."""
        opened = gzip.open if self.path.suffix == ".gz" else open
        try:
            with opened(self.path, "rt", encoding="utf-8") as file:
                return next(csv.reader(file), [])
        except (OSError, EOFError, ValueError, zlib.error):
            return []

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The data frame, whose factors of the grid have the grid's values; CSV does not keep their types.

        Raises:
            InputError: the file is damaged or no table of this campaign.
        """
        grid = self.definition.grid
        known = {} if self.table is None else self.table.columns
        # pandas would take a column of texts such as 'false' for booleans
        texts = [name for name, column in known.items() if column.kind is str]
        kinds = {**dict.fromkeys(texts, "str"), **dict.fromkeys(grid, "category")}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", pd.errors.DtypeWarning)  # texts among numbers: see _check
                frame = pd.read_csv(self.path, dtype=kinds, keep_default_na=False, na_values=[""], **_EXACTLY)
        except pd.errors.EmptyDataError:
            return pd.DataFrame()
        except (OSError, EOFError, ValueError, zlib.error) as error:  # pandas' own errors are among them
            why = " ".join(str(error).split())
            raise InputError(f"{self.path}: cannot be read: {why}; {RESTORE}") from error
        for factor, values in grid.items():
            if factor not in frame:
                raise InputError(f"{self.path}: the column '{factor}' is missing, a factor of the grid")
            by_text = {cell_text(value): value for value in values}
            codes = frame[factor].cat.codes.to_numpy()
            there = [str(text) for text in frame[factor].cat.categories] + [""] * bool((codes < 0).any())
            if unknown := [text for text in there if text not in by_text]:
                raise InputError(f"{self.path}: {factor}: '{unknown[0][:60]}' is no value of the grid")
            present = pd.Series([by_text[text] for text in there])
            # an empty cell has the code -1, which takes the last one
            frame[factor] = present.take(codes % len(there)).set_axis(frame.index)
        for name in texts:
            if name in frame and name not in grid and not _may_be_empty(known[name]):
                frame[name] = frame[name].fillna("")
        for name, column in known.items():
            if name not in frame and column.may_be_missing:
                frame[name] = np.nan if column.kind in (int, float) else None
        if self.table is not None and not self.is_checked:
            self._check(frame, self.table)
        return frame

    def _check(self, frame: pd.DataFrame, table: Columns) -> None:
        """Raises InputError unless the columns hold what those of this table do."""
        columns = {"seed": SEED, **table.columns}
        columns = {name: replace(one, may_be_empty=_may_be_empty(one)) for name, one in columns.items()}
        for name, column in columns.items():
            if name not in frame:
                raise InputError(f"{self.path}: the column '{name}' is missing; {RESTORE}")
            if (row := first_invalid(frame[name], column)) is not None:
                got = shown(frame[name].tolist()[row])
                raise self._fault(frame, row, f"column '{name}': {column.wanted} is needed (got {got})")
        is_repeated = frame.duplicated([*self.definition.grid, "seed"]).to_numpy()
        if table.one_row and is_repeated.any():
            raise self._fault(frame, int(is_repeated.argmax()), "the same trial is there twice")
        for name, column in columns.items():
            if column.at_most is not None:
                limits = frame.get(column.at_most, self.definition.parameters.get(column.at_most))
                above = (frame[name] > limits).to_numpy()
                if above.any():
                    what = f"column '{name}': more than {column.at_most}"
                    raise self._fault(frame, int(above.argmax()), what)

    def _fault(self, frame: pd.DataFrame, row: int, what: str) -> InputError:
        key = {name: frame[name].tolist()[row] for name in [*self.definition.grid, "seed"]}
        return InputError(f"{self.path}: row {row + 1} ({shown_cell(key)}): {what}; {RESTORE}")


def first_invalid(cells: pd.Series, column: Column) -> int | None:
    """The index of the first cell that a column cannot have; None if there is none."""
    is_number = column.kind in (int, float)
    if is_number and cells.dtype.kind in "iuf":
        values = cells.to_numpy(np.float64)
        odd = ~((values >= column.least) & (values <= column.most))
        if column.kind is int:
            odd |= values != np.floor(values)
        if column.may_be_empty:
            odd &= ~np.isnan(values)
    elif column.kind is bool and cells.dtype.kind == "b":
        return None
    else:
        is_held = {
            value: column.holds(column.of_text(value) if isinstance(value, str) else value)
            for value in cells.unique().tolist()
        }
        odd = ~cells.map(is_held).to_numpy(bool)
        if is_number and len(odd) and not odd.any():
            return 0  # pandas has found a text that Python takes for a number, such as 1_000
    return int(odd.argmax()) if odd.any() else None


def _may_be_empty(column: Column) -> bool:
    """Whether a file may have empty cells in it; where it is missing, they stand for it."""
    return column.may_be_empty or column.may_be_missing


class _Tables(Mapping[str, pd.DataFrame]):
    """Data frames by name, each made at its first use."""

    def __init__(self, makers: Mapping[str, Callable[[], pd.DataFrame]]) -> None:
        self._makers = makers
        self._made: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._makers:
            raise KeyError(f"no table '{name}'; there are {', '.join(self) or 'none'}")
        if name not in self._made:
            self._made[name] = self._makers[name]()
        return self._made[name]

    def __contains__(self, name: object) -> bool:
        return name in self._makers

    def __repr__(self) -> str:
        return f"<tables {', '.join(self)}>"

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)
