"""``Table``: typed rows, for programs as CSV and JSON, for people as Markdown, LaTeX, or on a terminal."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate  # type: ignore[import-untyped]

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.campaign.tables import csv_text
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import write_atomically

JSON_SCHEMA = 1  # of what ``--json`` prints; raised when a key changes its meaning or goes
NOT_DEFINED = "n/a"

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
        """Write ``stem``.csv, .md and .tex (``name`` unless given) into a folder; their paths.

        Raises:
            InputError: the folder cannot be written.
            MidnetBenchError: there is no room.
        """
        forms = {".csv": self.to_csv(), ".md": self.to_markdown(), ".tex": self.to_latex()}
        paths = [directory / f"{stem or self.name}{ending}" for ending in forms]
        for path, text in zip(paths, forms.values(), strict=True):
            write_atomically(path, text)
        return paths

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
