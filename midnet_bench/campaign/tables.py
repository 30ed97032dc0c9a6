"""The tables of one trial: what their columns hold, their bytes in a store, and their text in CSV files."""

import csv
import json
import math
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import NamedTuple

from midnet_bench.campaign.trial import Row, Scalar, TrialResult

LARGEST = 1e12
"""no count, time or length of a trial is beyond it, and a million of them can be added up and squared"""
LONGEST_TEXT = 2000
SHOWN = 40  # characters of a cell in a message
MOST_CHOICES = 3  # of a column, that a page lists beside it
TABLE_NAME = re.compile("[a-z][a-z0-9_]{0,63}")
"""what a trial's table may be called; it becomes the name of a file"""
TIMING, FAILURES = "timing", "failures"  # tables of the whole campaign, which no trial has
UNPACKED_BYTES = 8_000_000
UNPACKED_TIMES = 12
"""tables unpack to at most ``UNPACKED_BYTES`` and so many times their packed size; ours to 8 times"""
_WORDS = {bool: "True or False", int: "a whole number", float: "a number", str: "a text of one line"}


class Drift(NamedTuple):
    """How far another platform's number may lie off: absolutely, plus as a share of ours."""

    absolute: float
    share: float = 0.0


ANY_DRIFT = Drift(math.inf)  # of single events and their times, which differ between platforms


@dataclass(frozen=True)
class Column:
    """What each cell of a column holds."""

    kind: type[bool] | type[int] | type[float] | type[str]
    about: str = ""  # what it means, for ``docs/results.md``
    unit: str = ""  # of a number: ``m``, ``s``, ``%``; none of counts and shares
    least: float = 0.0  # of a number; none is NaN or infinite
    most: float = LARGEST
    choices: tuple[str, ...] = ()  # of a text; any unless given
    may_be_empty: bool = False  # whether it may be undefined: NaN or None, an empty cell in CSV
    at_most: str | None = None  # a column of the same row, or a parameter of the trial, that no cell is above
    longest: int = LONGEST_TEXT  # characters of a text
    drift: Drift | None = None  # what ``compare --exact`` allows on another platform; nothing unless given

    @property
    def wanted(self) -> str:
        """What is needed, in words."""
        if self.choices:
            return " or ".join(self.choices)
        words = _WORDS[self.kind]
        return f"{words} from {self.least:g} to {self.most:g}" if self.kind in (int, float) else words

    @property
    def range(self) -> str:
        """Its unit and the values that it may have, for ``docs/results.md``; blank if any."""
        few = len(self.choices) <= MOST_CHOICES
        text = "true, false" if self.kind is bool else ", ".join(self.choices) if few else ""
        if self.kind in (int, float) and (self.least not in (0.0, -LARGEST) or self.most != LARGEST):
            text = f"{self.least:g} to {self.most:g}" if self.most != LARGEST else f"from {self.least:g}"
        return f"{self.unit} {text}".strip()

    def holds(self, value: object) -> bool:
        """Whether a cell may have this value."""
        if value is None or value != value:
            return self.may_be_empty
        if isinstance(value, bool):
            return self.kind is bool
        if isinstance(value, str):
            is_known = not self.choices or value in self.choices
            return self.kind is str and is_known and len(value) <= self.longest and value.isprintable()
        is_number = self.kind is float or (self.kind is int and isinstance(value, int))
        return is_number and isinstance(value, int | float) and self.least <= value <= self.most

    def of_text(self, text: str) -> Scalar:
        """The value of a cell of a CSV file; the text itself if it is none that the column can have."""
        try:
            value = {"True": True, "False": False}[text] if self.kind is bool else self.kind(text)
            return value if value == value else text  # nan is written as an empty cell
        except (KeyError, ValueError):
            return text


@dataclass(frozen=True)
class Columns:
    """A table of one trial: its columns by name."""

    columns: Mapping[str, Column]
    about: str = ""  # what a row is, for ``docs/results.md``
    one_row: bool = False  # whether each trial has one row; else it has at least one
    optional: bool = False  # whether a trial may lack it


Tables = Mapping[str, Columns]
"""the tables of one trial by name; nothing is known of them where there are none"""

TIMING_TABLE: Tables = {
    TIMING: Columns(
        {
            "status": Column(str, choices=("finished", "failed")),
            "wall_s": Column(
                float,
                "wall time of the trial in its worker process; of trials that share a simulation, each an "
                "equal part",
                "s",
            ),
            "simulated_s": Column(
                float, "how long the trial lasted in its world; empty if it failed", "s", may_be_empty=True
            ),
            "finished_utc": Column(str, "when it was stored, ISO 8601"),
        },
        "One row per trial. Wall times differ from run to run, hence a file for them alone.",
        one_row=True,
    )
}


def check_tables(expected: Tables, tables: Mapping[str, Sequence[Row]], trial: Mapping[str, Scalar]) -> None:
    """Whether one trial's tables are those that its experiment has.

    Args:
        expected: any tables do if it is empty.
        tables: rows of plain values by name.
        trial: its parameters and its seed.

    Raises:
        ValueError: which table and column are missing, odd or of another kind, in one line.
    """
    if not expected:
        return
    for name, known in expected.items():
        if name not in tables and not known.optional:
            raise ValueError(f"the table '{name}' is missing")
    for name, rows in tables.items():
        if name not in expected:
            raise ValueError(f"no trial has a table '{name}'")
        known = expected[name]
        if not rows or (known.one_row and len(rows) > 1):
            needed = "one is" if known.one_row else "some are"
            raise ValueError(f"table '{name}' has {len(rows)} rows; {needed} needed")
        for row in rows:
            if fault := _fault(known.columns, row, trial):
                raise ValueError(f"table '{name}', {fault}")


def _fault(columns: Mapping[str, Column], row: Row, trial: Mapping[str, Scalar]) -> str | None:
    """What is wrong with a row, beginning with the column; None if nothing is."""
    for name, column in columns.items():
        if name not in row:
            return f"column '{name}': missing"
        if not column.holds(row[name]):
            return f"column '{name}': {column.wanted} is needed (got {shown(row[name])})"
    for name in row:
        if name not in columns:
            return f"column {shown(name)}: no such column is known"
    for name, column in columns.items():
        if column.at_most is not None:
            limit = row.get(column.at_most, trial.get(column.at_most))
            if isinstance(limit, int | float) and row[name] > limit:  # type: ignore[operator]
                return f"column '{name}': {row[name]} is more than {column.at_most} ({limit})"
    return None


def shown(value: object) -> str:
    """A cell as messages quote it."""
    if isinstance(value, int) and abs(value) > 10**SHOWN:  # Python refuses to write out very long ones
        return f"a number of about {round(math.log10(abs(value)))} digits"
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


def encode_tables(result: TrialResult) -> bytes:
    """A result's tables as compressed JSON: equal results give equal bytes, columns keep their order.

    Raises:
        ValueError: :func:`decode_tables` would not take them.
    """
    tables = {name: result.tables[name] for name in sorted(result.tables)}
    _check_form(tables)
    text = json.dumps(tables, separators=(",", ":")).encode()
    payload = zlib.compress(text, level=6)
    if len(text) > _most_unpacked(payload):
        raise ValueError(f"the tables of a trial take {len(text)} bytes, nearly all of them repetitions")
    return payload


def decode_tables(payload: bytes) -> dict[str, list[Row]]:
    """The tables that :func:`encode_tables` packed.

    Raises:
        ValueError: ``payload`` is damaged, or of another origin. No table has a name with a path in it,
            and no more memory is taken than the tables of a trial need.
    """
    try:
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(payload, _most_unpacked(payload))
        if not unpacking.eof or unpacking.unused_data:
            raise ValueError("the tables are cut off, or larger than a trial's")
        tables: dict[str, list[Row]] = json.loads(text)
    except (TypeError, RecursionError, zlib.error) as error:
        raise ValueError(str(error)) from error
    _check_form(tables)
    return tables


def _most_unpacked(payload: bytes) -> int:
    return UNPACKED_BYTES + UNPACKED_TIMES * len(payload)


def _check_form(tables: object) -> None:
    """Raises ValueError unless these are lists of rows of numbers, texts and None by name."""
    if not isinstance(tables, dict):
        raise ValueError("not tables by name")
    for name, rows in tables.items():
        if not isinstance(name, str) or not TABLE_NAME.fullmatch(name) or name in (TIMING, FAILURES):
            raise ValueError(f"no table can be called {name!r}")
        if not isinstance(rows, list):
            raise ValueError(f"{name}: not a list of rows")
        for row in rows:
            if not isinstance(row, dict):
                raise ValueError(f"{name}: a row is not columns with values")
            for column, value in row.items():
                if not isinstance(value, bool | int | float | str | NoneType):
                    raise ValueError(f"{name}: {column!r}: neither a number nor a text")


class CsvFile:
    """A CSV file that is written row by row; a context manager. Its columns may become more on the way."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._columns: dict[str, None] = {}
        self._header: tuple[str, ...] | None = None

    def add(self, key: Mapping[str, Scalar], rows: Iterable[Row]) -> None:
        """Rows behind what they all begin with."""
        for row in rows:
            values = {**key, **row}
            if tuple(values) != self._header:
                self._columns |= dict.fromkeys(values)
                if self._header is None:
                    self._header = tuple(values)
                    self._writer.writerow(values)
                values = {column: values.get(column) for column in self._columns}
            # the writer leaves None empty, and writes floats as repr does
            self._writer.writerow([None if value != value else value for value in values.values()])

    def __enter__(self) -> "CsvFile":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._file:
            if kind is None and self._header is None:
                self._writer.writerow([])
        if kind is None and len(self._columns) > len(self._header or ()):
            # under all columns; rows that came before a column have an empty cell in it
            with self._path.open(encoding="utf-8", newline="") as file:
                lines = list(csv.reader(file))[1:]
            with self._path.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file, lineterminator="\n")
                writer.writerow(self._columns)
                writer.writerows(line + [""] * (len(self._columns) - len(line)) for line in lines)


def cell_text(value: Scalar) -> str:
    """A value as CSV files have it, without quotes."""
    if value is None or value != value:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
