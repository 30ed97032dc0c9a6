"""What one trial is, and what comes out of it: tables, what their columns hold, their bytes in a store."""

import hashlib
import json
import math
import re
import zlib
from collections.abc import Callable, Container, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import NoneType
from typing import NamedTuple

from midnet_bench.settings import Scalar as Scalar

Row = dict[str, Scalar]
VARIANT = "variant"
"""the factor whose values are the names of a campaign's variants; it is no parameter of an experiment"""
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


def beside(column: str) -> str:
    """What a table's own column is called in files where a factor of the grid has its name."""
    return f"trial_{column}"


def factor_text(name: str, value: object) -> str:
    """``oracle=window``; of a variant its name alone."""
    return str(value) if name == VARIANT else f"{name}={value}"


@dataclass(frozen=True)
class Cell:
    """What the trials of one cell have in common. Their ids are quick to find from here."""

    experiment: str  # its name
    parameters: Mapping[str, Scalar]  # every parameter of the experiment, resolved (defaults filled in)

    @cached_property
    def _canonical(self) -> str:
        common = {"experiment": self.experiment, "parameters": dict(self.parameters)}
        return json.dumps(common, sort_keys=True, separators=(",", ":"))

    @cached_property
    def number(self) -> int:
        """A hash of the cell, from 0 up to 2**63."""
        return int.from_bytes(hashlib.sha256(self._canonical.encode()).digest()[:8]) >> 1

    @cached_property
    def _before_seed(self) -> "hashlib._Hash":
        return hashlib.sha256(f'{self._canonical[:-1]},"seed":'.encode())

    def trial_id(self, seed: int) -> str:
        """16 hex digits: a hash of what defines the trial and of nothing else."""
        whole = self._before_seed.copy()
        whole.update(f"{seed}}}".encode())
        return whole.hexdigest()[:16]


@dataclass(frozen=True)
class TrialSpec:
    """Everything that decides a trial's outcome. Two equal specs give the same bytes anywhere."""

    experiment: str  # its name
    parameters: Mapping[str, Scalar]
    """every parameter of the experiment, resolved (defaults filled in), and the name of the variant if any"""
    seed: int

    @property
    def settings(self) -> dict[str, Scalar]:
        """The parameters of the experiment alone."""
        return {name: value for name, value in self.parameters.items() if name != VARIANT}

    @property
    def trial_id(self) -> str:
        """See :meth:`Cell.trial_id`."""
        return Cell(self.experiment, self.parameters).trial_id(self.seed)


@dataclass(frozen=True)
class TrialResult:
    """The tables of one trial by name, rows in a fixed order; no clock time, no host, no path.

    ``simulated_s`` is how long the trial lasted in its world.
    """

    tables: Mapping[str, list[Row]]
    simulated_s: float


@dataclass(frozen=True)
class Outcome:
    """What a worker hands back of a trial; exactly one of ``payload`` and ``failure`` is there."""

    trial_id: str
    wall_s: float
    simulated_s: float | None = None
    payload: bytes | None = None
    failure: str | None = None


RunTrials = Callable[[Sequence[TrialSpec]], Sequence[TrialResult | Exception]]
"""What runs trials of one seed that may share a simulation: each gives what it gives alone, or why it failed.

A pure function of the specs; what it raises has nothing to do with one trial more than with another.
"""


class Sharing(NamedTuple):
    """What tells which trials of one seed have work in common."""

    simulation_key: Hashable  # trials that agree in it share one simulation
    result_key: Hashable
    """trials that agree in it give the same numbers; they agree in ``simulation_key`` too"""


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
    may_be_missing: bool = False
    """whether results may lack the column: those of releases from before it; what is run has it"""
    at_most: str | None = None  # a column of the same row, or a parameter of the trial, that no cell is above
    is_parameter: bool = False  # whether it repeats the parameter of its name, and so the factor of a grid
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

    def beside_factors(self, factors: Container[str]) -> "Columns":
        """The same in a file that begins with some factors of a grid."""
        named = {
            beside(name) if name in factors and not one.is_parameter else name: one
            for name, one in self.columns.items()
        }
        return replace(self, columns=named)


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


def check_tables(
    expected: Tables, tables: Mapping[str, Sequence[Row]], trial: Mapping[str, Scalar], is_new: bool = False
) -> None:
    """Whether one trial's tables are those that its experiment has; any do if ``expected`` is empty.

    ``trial``: its parameters and its seed. ``is_new``: it was run just now, and no column may be missing.

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
            if fault := _fault(known.columns, row, trial, is_new):
                raise ValueError(f"table '{name}', {fault}")


def _fault(columns: Mapping[str, Column], row: Row, trial: Mapping[str, Scalar], is_new: bool) -> str | None:
    """What is wrong with a row, beginning with the column; None if nothing is."""
    for name, column in columns.items():
        if name not in row:
            if column.may_be_missing and not is_new:
                continue
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


def cell_text(value: Scalar) -> str:
    """A value as CSV files have it, without quotes."""
    if value is None or value != value:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
