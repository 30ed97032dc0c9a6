"""What the columns of the trials' tables hold, and in which words a cell is refused that holds none of it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from midnet_bench.campaign.trial import Row, Scalar

LARGEST = 1e12
"""no count, time or length of a trial is beyond it, and a million of them can be added up and squared"""
LONGEST_TEXT = 2000
SHOWN = 40
"""characters of a cell in a message"""
MOST_CHOICES = 3
"""of a column, that a page lists beside it"""
_WORDS = {bool: "True or False", int: "a whole number", float: "a number", str: "a text of one line"}


class Drift(NamedTuple):
    """How far another platform's number may lie off: absolutely, plus as a share of ours."""

    absolute: float
    share: float = 0.0


ANY_DRIFT = Drift(math.inf)
"""of single events and their times, which differ between platforms"""


@dataclass(frozen=True)
class Column:
    """What each cell of a column holds."""

    kind: type[bool] | type[int] | type[float] | type[str]
    about: str = ""
    """what it means, for ``docs/results.md``"""
    unit: str = ""
    """of a number: ``m``, ``s``, ``%``; none of counts and shares"""
    least: float = 0.0
    """of a number; none is NaN or infinite"""
    most: float = LARGEST
    choices: tuple[str, ...] = ()
    """of a text; any unless given"""
    may_be_empty: bool = False
    """whether it may be undefined: NaN or None, an empty cell in CSV"""
    at_most: str | None = None
    """a column of the same row, or a parameter of the trial, that no cell is above"""
    longest: int = LONGEST_TEXT
    """characters of a text"""
    drift: Drift | None = None
    """what ``compare --exact`` allows on another platform; nothing unless given"""

    @property
    def wanted(self) -> str:
        """What is needed, in words."""
        if self.choices:
            return " or ".join(self.choices)
        if self.kind not in (int, float):
            return _WORDS[self.kind]
        return f"{_WORDS[self.kind]} from {self.least:g} to {self.most:g}"

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
        if self.kind is bool:
            return isinstance(value, bool)
        if isinstance(value, str):
            return (
                self.kind is str
                and (not self.choices or value in self.choices)
                and len(value) <= self.longest
                and value.isprintable()
            )
        numbers = int if self.kind is int else int | float
        is_number = isinstance(value, numbers) and not isinstance(value, bool) and self.kind is not str
        return is_number and self.least <= value <= self.most  # type: ignore[operator]

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
    about: str = ""
    """what a row is, for ``docs/results.md``"""
    one_row: bool = False
    """whether each trial has one row; else it has at least one"""
    optional: bool = False
    """whether a trial may lack it"""


Tables = Mapping[str, Columns]
"""the tables of one trial by name; nothing is known of them where there are none"""


def check_tables(expected: Tables, tables: Mapping[str, Sequence[Row]], trial: Mapping[str, Scalar]) -> None:
    """Whether one trial's tables are those that its experiment has.

    Args:
        expected: if it is empty, only columns that every table begins with are looked at.
        tables: rows of plain values by name.
        trial: its parameters and its seed.

    Raises:
        ValueError: which table and column are missing, odd or of another kind, in one line.
    """
    for name, known in expected.items():
        if name not in tables and not known.optional:
            raise ValueError(f"the table '{name}' is missing")
    for name, rows in tables.items():
        if expected and name not in expected:
            raise ValueError(f"no trial has a table '{name}'")
        if not expected:
            continue
        known = expected[name]
        if not rows or (known.one_row and len(rows) > 1):
            needed = "one is" if known.one_row else "some are"
            raise ValueError(f"table '{name}' has {len(rows)} rows; {needed} needed")
        for row in rows:
            fault = _fault(known.columns, row, trial)
            if fault:
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
        if column.at_most is not None and name in row:
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
