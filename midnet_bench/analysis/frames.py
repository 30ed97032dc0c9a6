"""``Results``: a campaign's definition, provenance and tables as pandas data frames.

They come from a store, or, where there is none, from the files that a report writes: ``configuration.json``,
``provenance.json`` and a CSV file for each table of the trials, which may be compressed (``.csv.gz``). A
store is written out as such files first, so the data frames are the same.
"""

import csv
import gzip
import json
import logging
import shutil
import tempfile
import weakref
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar, cast

import pandas as pd

from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.export import FAILURES, TIMING, cell_text, export_csv
from midnet_bench.campaign.provenance import Provenance, versions_note
from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.errors import InputError, nearest_name

CONFIGURATION = "configuration.json"
PROVENANCE = "provenance.json"
ENDINGS = (".csv", ".csv.gz")
_EXACTLY: dict[str, Any] = {"float_precision": "round_trip"} if pd.__version__ < "3.1" else {}
"""floats to their last digit, which is what pandas does unasked since 3.1"""


Made = TypeVar("Made")


@dataclass(frozen=True)
class Results:
    """A campaign and what its trials gave."""

    directory: Path
    definition: Definition
    provenance: list[Provenance]
    """one for each run that added trials"""
    tables: Mapping[str, pd.DataFrame]
    """Those of the finished trials by name, such as ``scores``, each read when it is asked for.

    Rows stand in the campaign's order and begin with the factors of its grid and the seed; what is not
    defined is NaN."""
    timing: pd.DataFrame
    """a row for each trial: ``status`` (finished, failed), ``wall_s``, ``simulated_s``, ``finished_utc``"""
    failures: pd.DataFrame
    """a row for each trial that failed, with its ``reason``; no columns if none did"""
    _made: dict[object, object] = field(default_factory=dict, init=False, repr=False, compare=False)

    def once(self, make: Callable[["Results"], Made]) -> Made:
        """What ``make`` makes of these results: made when it is first asked for, by whoever it is."""
        if make not in self._made:
            self._made[make] = make(self)
        return cast(Made, self._made[make])

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

    def column(self, frame: pd.DataFrame, parameter: str) -> pd.Series:
        """A parameter's value for each row of one of the tables, whether or not it is a factor of the grid.

        Raises:
            InputError: the campaign has no such parameter.
        """
        if parameter in self.definition.grid:
            return frame[parameter]
        if parameter not in self.definition.parameters:
            raise InputError(f"{self.directory / CONFIGURATION}: parameters.{parameter}: missing")
        return pd.Series([self.definition.parameters[parameter]] * len(frame), index=frame.index)

    def others(self, frame: pd.DataFrame, *known: str, separator: str = ", ") -> list[str]:
        """``factor=value`` of the grid's factors but ``known``, for each row of one of the tables."""
        factors = [factor for factor in self.factors if factor not in known]
        columns = [[f"{factor}={value}" for value in frame[factor]] for factor in factors]
        return [separator.join(parts) for parts in zip(*columns, strict=True)] or [""] * len(frame)

    def by_value(self, factor: str) -> "dict[str, Results]":
        """The campaign in parts, one for each value of a factor of the grid, which is a parameter there.

        Raises:
            InputError: the grid has no such factor.
        """
        if factor not in self.definition.grid:
            known = self.factors
            raise InputError(
                f"{self.directory}: the grid has no factor '{factor}'{nearest_name(factor, known)}"
            )
        return {str(value): self._part(factor, value) for value in self.definition.grid[factor]}

    def _part(self, factor: str, value: Scalar) -> "Results":
        grid = {name: values for name, values in self.definition.grid.items() if name != factor}
        parameters = {**self.definition.parameters, factor: value}
        return replace(
            self,
            definition=replace(self.definition, grid=grid, parameters=parameters),
            tables=_Part(self.tables, factor, value),
            timing=_rows_of(self.timing, factor, value),
            failures=_rows_of(self.failures, factor, value),
        )


def _rows_of(frame: pd.DataFrame, factor: str, value: Scalar) -> pd.DataFrame:
    """The rows with that value, without its column; the frame itself if it has no such column."""
    if factor not in frame:
        return frame
    return frame[frame[factor] == value].drop(columns=factor).reset_index(drop=True)


def records(frame: pd.DataFrame) -> list[Row]:
    """The rows of a data frame as dictionaries of Python's own numbers."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def load_results(directory: str | Path) -> Results:
    """The results in a campaign's folder.

    Args:
        directory: with ``campaign.sqlite``, or with the files that a report wrote.

    Raises:
        InputError: neither is there, or it is damaged, foreign or of a newer version.
    """
    directory = Path(directory)
    if (directory / FILE_NAME).exists():
        return _from_store(directory)
    if (directory / CONFIGURATION).exists():
        return _from_files(directory)
    raise InputError(
        f"{directory}: there is no campaign here: neither {FILE_NAME} nor {CONFIGURATION}; give the folder "
        "of one, such as results/labyrinth"
    )


def _from_store(directory: Path) -> Results:
    folder = Path(tempfile.mkdtemp(prefix="midnet-bench-"))
    try:
        with open_store(directory / FILE_NAME) as store:
            results = results_of(store, directory, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    weakref.finalize(results.tables, shutil.rmtree, folder, ignore_errors=True)
    return results


def results_of(store: Store, directory: Path, folder: Path) -> Results:
    """The results in a store.

    Args:
        store: open; it is no longer needed afterwards.
        directory: where the store is.
        folder: the CSV files of the trials' tables are written here, and read from here when they are asked
            for.

    Raises:
        InputError: a trial is damaged, or the folder cannot be written.
    """
    files = {path.stem: _File(path, store.definition) for path in export_csv(store, folder)}
    return _results(directory, store.definition, store.runs(), files)


def _from_files(directory: Path) -> Results:
    try:
        definition = Definition.from_json((directory / CONFIGURATION).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{directory / CONFIGURATION}: is not the configuration of a campaign") from error
    place = [*definition.grid, "seed"]
    files = {
        path.name.removesuffix(ending): _File(path, definition)
        for path in sorted(directory.iterdir())
        for ending in ENDINGS
        if path.name.endswith(ending)
    }
    # tables made of the trials' tables stand beside them and begin otherwise
    tables = {name: file for name, file in files.items() if file.columns[: len(place)] == place}
    about_trials = {name: files[name] for name in (TIMING, FAILURES) if name in files}
    return _results(directory, definition, _provenance(directory / PROVENANCE), tables | about_trials)


def _results(
    directory: Path, definition: Definition, provenance: list[Provenance], files: "dict[str, _File]"
) -> Results:
    for note in versions_note(provenance):
        logging.getLogger("midnet_bench").warning("%s: note: %s", directory, note)
    timing, failures = (files.pop(name, None) for name in (TIMING, FAILURES))
    empty = pd.DataFrame()
    return Results(
        directory,
        definition,
        provenance,
        _Lazily(files),
        empty if timing is None else timing.frame,
        empty if failures is None else failures.frame,
    )


def _provenance(path: Path) -> list[Provenance]:
    try:
        runs = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    return [run for run in (runs if isinstance(runs, list) else [runs]) if isinstance(run, dict)]


@dataclass(frozen=True)
class _File:
    """A table in a CSV file, compressed or not."""

    path: Path
    definition: Definition

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
        try:
            frame = pd.read_csv(
                self.path,
                dtype=dict.fromkeys(grid, "category"),
                keep_default_na=False,
                na_values=[""],
                **_EXACTLY,
            )
        except pd.errors.EmptyDataError:
            return pd.DataFrame()
        except (OSError, EOFError, ValueError, zlib.error) as error:  # pandas' own errors are among them
            raise InputError(f"{self.path}: cannot be read: {error}") from error
        for factor, values in grid.items():
            if factor not in frame:
                raise InputError(f"{self.path}: the column '{factor}' is missing, a factor of the grid")
            by_text = {cell_text(value): value for value in values}
            codes = frame[factor].cat.codes.to_numpy()
            texts = [str(text) for text in frame[factor].cat.categories] + [""] * bool((codes < 0).any())
            if unknown := [text for text in texts if text not in by_text]:
                raise InputError(f"{self.path}: {factor}: '{unknown[0][:60]}' is no value of the grid")
            present = pd.Series([by_text[text] for text in texts])
            # an empty cell has the code -1, which takes the last one
            frame[factor] = present.take(codes % len(texts)).set_axis(frame.index)
        return frame


class _Lazily(Mapping[str, pd.DataFrame]):
    """Data frames that are read when they are asked for."""

    def __init__(self, files: Mapping[str, _File]) -> None:
        self._files = files

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self._files[name].frame

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)


class _Part(Mapping[str, pd.DataFrame]):
    """The rows of a campaign's tables that have one value of a factor, cut out when they are asked for."""

    def __init__(self, tables: Mapping[str, pd.DataFrame], factor: str, value: Scalar) -> None:
        self._tables, self._factor, self._value = tables, factor, value
        self._cut: dict[str, pd.DataFrame] = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._cut:
            self._cut[name] = _rows_of(self._tables[name], self._factor, self._value)
        return self._cut[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tables)

    def __len__(self) -> int:
        return len(self._tables)
