"""``Results``: a campaign's definition, provenance and tables as pandas data frames.

They come from a store, or, where there is none, from the files that a report writes: ``configuration.json``,
``provenance.json`` and a CSV file for each table of the trials, which may be compressed (``.csv.gz``). Both
ways end in one reader of CSV text, so the data frames are the same.
"""

import csv
import gzip
import io
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.export import FAILURES, TIMING, cell_text, csv_text, tables_of
from midnet_bench.campaign.provenance import Provenance
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError

CONFIGURATION = "configuration.json"
PROVENANCE = "provenance.json"
ENDINGS = (".csv", ".csv.gz")
_EXACTLY: dict[str, Any] = {"float_precision": "round_trip"} if pd.__version__ < "3.1" else {}
"""floats to their last digit, which is what pandas does unasked since 3.1"""


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
    with open_store(directory / FILE_NAME) as store:
        definition, runs, tables = store.definition, store.runs(), tables_of(store)
    source = str(directory / FILE_NAME)
    stored = {name: _Rows(rows, definition, source) for name, rows in tables.items()}
    timing, failures = stored.pop(TIMING, None), stored.pop(FAILURES, None)
    return _results(directory, definition, runs, stored, timing, failures)


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
    timing, failures = files.pop(TIMING, None), files.pop(FAILURES, None)
    # tables made of the trials' tables stand beside them and begin otherwise
    tables = {name: file for name, file in files.items() if file.columns[: len(place)] == place}
    return _results(directory, definition, _provenance(directory / PROVENANCE), tables, timing, failures)


def _results(
    directory: Path,
    definition: Definition,
    provenance: list[Provenance],
    tables: "Mapping[str, _Rows | _File]",
    timing: "_Rows | _File | None",
    failures: "_Rows | _File | None",
) -> Results:
    empty = pd.DataFrame()
    return Results(
        directory,
        definition,
        provenance,
        _Lazily(tables),
        empty if timing is None else timing.frame,
        empty if failures is None else failures.frame,
    )


def _provenance(path: Path) -> list[Provenance]:
    try:
        runs = json.loads(path.read_text(encoding="utf-8")) if path.exists() else []
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from error
    return list(runs) if isinstance(runs, list) else [runs]


@dataclass(frozen=True)
class _Rows:
    """A table as the store has it."""

    rows: list[Row]
    definition: Definition
    source: str

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The data frame. Raises InputError if the rows are no table of this campaign."""
        return _frame(csv_text(self.rows), self.definition, self.source)


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
        """The data frame. Raises InputError if the file is damaged or no table of this campaign."""
        try:
            packed = self.path.read_bytes()
            text = (gzip.decompress(packed) if self.path.suffix == ".gz" else packed).decode()
        except (OSError, EOFError, ValueError, zlib.error) as error:
            raise InputError(f"{self.path}: cannot be read: {error}") from error
        return _frame(text, self.definition, str(self.path))


class _Lazily(Mapping[str, pd.DataFrame]):
    """Data frames that are read when they are asked for."""

    def __init__(self, sources: Mapping[str, _Rows | _File]) -> None:
        self._sources = sources

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self._sources[name].frame

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)


def _frame(text: str, definition: Definition, source: str) -> pd.DataFrame:
    """CSV text as a data frame; factors of the grid have the grid's values, whose types CSV does not keep."""
    if not text.strip():
        return pd.DataFrame()
    try:
        frame = pd.read_csv(
            io.StringIO(text),
            dtype=dict.fromkeys(definition.grid, str),
            keep_default_na=False,
            na_values=[""],
            **_EXACTLY,
        )
    except ValueError as error:  # pandas' own errors are among them
        raise InputError(f"{source}: cannot be read: {error}") from error
    for factor, values in definition.grid.items():
        if factor not in frame:
            raise InputError(f"{source}: the column '{factor}' is missing, a factor of the grid")
        by_text = {cell_text(value): value for value in values}
        texts = frame[factor].fillna("")
        if unknown := [text for text in texts.unique() if text not in by_text]:
            raise InputError(f"{source}: {factor}: '{unknown[0][:60]}' is no value of the grid")
        frame[factor] = pd.Series([by_text[text] for text in texts], index=frame.index)
    return frame
