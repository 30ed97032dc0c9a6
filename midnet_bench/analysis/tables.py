"""``Table``: typed rows, for programs as CSV and JSON, for people as Markdown, LaTeX, or on a terminal."""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate  # type: ignore[import-untyped]

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import write_atomically

JSON_SCHEMA = 1  # of what ``--json`` prints; raised when a key changes its meaning or goes
NOT_DEFINED = "n/a"

_NAMES = {
    "f1": "F1",
    "f1_one_to_one": "F1 one-to-one",
    "tp": "true positives",
    "fp": "false positives",
    "fn": "misses",
}
"""what people read instead of a column's name"""
_UNITS = {"_m": "m", "_s": "s", "_percent": "%"}

Cell = Scalar | Estimate | np.generic
"""A number, a text, or an estimate with its interval; NaN is not defined, None does not apply."""


@dataclass(frozen=True)
class Table:
    """Rows under named columns."""

    name: str  # stable: the key in JSON and the stem of the files
    title: str  # for people
    rows: Sequence[Mapping[str, Cell]]
    digits: Mapping[str, int] = field(default_factory=dict)
    """digits after the point by column, in the forms for people; 3 unless given"""
    bounds: Mapping[str, tuple[str, str, str]] = field(default_factory=dict)
    """CSV columns of an estimate's low end, high end and n; ``x_low``, ``x_high``, ``x_n`` unless given"""
    notes: Sequence[str] = ()  # sentences that a reader of the table needs, below it in the forms for people
    beside: Sequence[str] = ()  # columns that a terminal may leave out, the last of them first
    labels: Mapping[str, str] = field(default_factory=dict)
    """what people read at the head of a column; its name unless given"""

    @cached_property
    def columns(self) -> list[str]:
        """Names in order of first appearance, an estimate being one column."""
        return list(dict.fromkeys(name for row in self.rows for name in row))

    @property
    def heads(self) -> list[str]:
        """What stands above the columns in the forms for people."""
        return [self.labels.get(name, name) for name in self.columns]

    def cells(self) -> list[list[str]]:
        """The rows as text, ready to print; blank where a row has no such column."""
        return [
            [self._text(name, row[name]) if name in row else "" for name in self.columns] for row in self.rows
        ]

    def flat_rows(self) -> list[Row]:
        """The rows with plain cells, as in the CSV: an estimate takes four columns."""
        return [
            {key: value for name, cell in row.items() for key, value in self._flat(name, cell)}
            for row in self.rows
        ]

    def to_csv(self) -> str:
        """Every digit of every number; an undefined one is an empty cell."""
        return csv_text(self.flat_rows())

    def to_markdown(self) -> str:
        """A pipe table, numbers to the right."""
        # a bar in a cell would begin another one
        cells = [[cell.replace("|", "\\|") for cell in line] for line in [self.heads, *self.cells()]]
        return "\n".join([self._tabulated(cells, "pipe"), *(f"{note}\n" for note in self.notes)])

    def to_latex(self) -> str:
        """A tabular that needs the package booktabs; estimates with their intervals."""
        notes = ("\n" + note.replace("%", "\\%") + "\n" for note in self.notes)
        return self._tabulated([self.heads, *self.cells()], "latex_booktabs") + "".join(notes)

    def to_json(self) -> list[dict[str, Any]]:
        """The rows, ready for JSON: an estimate is ``{"value", "low", "high", "n"}``, undefined is None."""
        return [{name: _json(cell) for name, cell in row.items()} for row in self.rows]

    def write(self, directory: Path, stem: str | None = None) -> list[Path]:
        """As :func:`write_tables`, this one."""
        return write_tables([self], directory, stem)

    def _flat(self, name: str, cell: Cell) -> list[tuple[str, Scalar]]:
        if not isinstance(cell, Estimate):
            return [(name, _scalar(cell))]
        low, high, n = self.bounds.get(name, (f"{name}_low", f"{name}_high", f"{name}_n"))
        return [(name, float(cell.value)), (low, float(cell.low)), (high, float(cell.high)), (n, cell.n)]

    def _tabulated(self, lines: list[list[str]], form: str) -> str:
        if not self.rows:
            return ""
        texts = {name for name in self.columns for row in self.rows if isinstance(row.get(name), str)}
        align = ["left" if name in texts else "right" for name in self.columns]
        return f"{tabulate(lines[1:], lines[0], form, disable_numparse=True, colalign=align)}\n"

    def _text(self, name: str, cell: Cell) -> str:
        if isinstance(cell, Estimate):
            value, low, high = (self._text(name, number) for number in cell[:3])
            return value if NOT_DEFINED in (value, low, high) else f"{value} [{low}, {high}]"
        scalar = _scalar(cell)
        if scalar is None:
            return ""
        if not isinstance(scalar, float):
            return str(scalar)
        return NOT_DEFINED if math.isnan(scalar) else rounded(scalar, self.digits.get(name, 3))


def write_tables(tables: Iterable[Table], directory: Path, stem: str | None = None) -> list[Path]:
    """Write .csv, .md and .tex of each table (``name``, or ``stem``) into a folder; their paths.

    Raises:
        InputError: the folder cannot be written.
        MidnetBenchError: there is no room.
    """
    texts = {
        directory / f"{stem or table.name}{ending}": text
        for table in tables
        for ending, text in (
            (".csv", table.to_csv()),
            (".md", table.to_markdown()),
            (".tex", table.to_latex()),
        )
    }
    for path, text in texts.items():
        write_atomically(path, text)
    return list(texts)


def csv_text(rows: Iterable[Row]) -> str:
    """``rows`` as CSV under the columns in order of first appearance; NaN and None are empty cells.

    Floats are written as ``repr`` does, the shortest text that reads back as the same number.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(column for row in rows for column in row))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    # the writer leaves None empty, and writes floats as repr does
    for row in rows:
        cells = map(row.get, columns)
        writer.writerow([None if value != value else value for value in cells])
    return text.getvalue()


def rounded(value: float, digits: int, sign: str = "") -> str:
    """A number with so many digits after the point; zero has no sign. ``sign``: "+" before those above it."""
    text = f"{value:{sign}.{digits}f}"
    return text if text.strip("+-0.") else text.lstrip("+-")


def signed(one: Estimate, digits: int = 3) -> str:
    """A difference with its interval, each number with its sign; without an interval, the number alone."""
    if math.isnan(one.value):
        return NOT_DEFINED
    value, low, high = (rounded(part, digits, "+") for part in one[:3])
    return value if math.isnan(one.low) or math.isnan(one.high) else f"{value} [{low}, {high}]"


def to_json(experiment: str | None, tables: Iterable[Table], **more: Any) -> dict[str, Any]:
    """What ``--json`` prints: the schema, the experiment, the tables by name; ``more`` beside them."""
    by_name = {table.name: table.to_json() for table in tables}
    return {"schema": JSON_SCHEMA, "experiment": experiment, "tables": by_name, **more}


def _scalar(cell: Scalar | np.generic) -> Scalar:
    """A cell of a data frame as Python's own type, which ``repr`` writes as plain digits."""
    return cell.item() if isinstance(cell, np.generic) else cell


def _json(cell: Cell) -> Any:
    if isinstance(cell, Estimate):
        return {name: _json(value) for name, value in cell._asdict().items()}
    value = _scalar(cell)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def in_words(name: str) -> str:
    """A measure with its unit, such as ``GOSPA per frame, m`` for ``gospa_per_frame_m``."""
    if name in _NAMES:
        return _NAMES[name]
    for ending, unit in _UNITS.items():
        if name.endswith(ending):
            return f"{in_words(name.removesuffix(ending))}, {unit}"
    return name.replace("gospa", "GOSPA").replace("_", " ")


def team_in_words(name: str) -> str:
    """``5 robots`` for ``5-robot``; what follows a comma stays."""
    team, comma, others = name.partition(",")
    if not team.endswith("-robot"):
        return name
    size = team.removesuffix("-robot")
    return f"{size} robot{'' if size == '1' else 's'}{comma}{others}"
