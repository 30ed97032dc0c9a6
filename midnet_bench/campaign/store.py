"""The store: one SQLite file per campaign, one transaction per finished trial, one process that writes."""

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any

from midnet_bench.campaign import database, rows
from midnet_bench.campaign.columns import Tables, check_tables
from midnet_bench.campaign.database import explained, transaction
from midnet_bench.campaign.definition import Definition, differences, shown_cell
from midnet_bench.campaign.payload import decode_tables
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.campaign.trial import Cell, Row, Scalar, TrialSpec
from midnet_bench.campaign.worker import Outcome
from midnet_bench.errors import InputError, MidnetBenchError

FILE_NAME = "campaign.sqlite"
ROWS_AT_ONCE = 500
"""that are read by one statement"""


@dataclass(frozen=True)
class StoredTrial:
    """One trial as the store keeps it."""

    store: Path
    cell: Cell
    seed: int
    simulated_s: float | None
    wall_s: float
    finished_utc: str
    traceback: str | None
    payload: bytes | None

    @property
    def trial_id(self) -> str:
        """See :meth:`Cell.trial_id`."""
        return self.cell.trial_id(self.seed)

    @property
    def parameters(self) -> Mapping[str, Scalar]:
        """Every parameter of the experiment."""
        return self.cell.parameters

    @property
    def status(self) -> str:
        """``finished`` or ``failed``."""
        return "finished" if self.traceback is None else "failed"

    @property
    def reason(self) -> str:
        """Of a failed trial the last line of its traceback: the exception and its message."""
        return _last_line(self.traceback or "")

    def tables(
        self, expected: Tables = MappingProxyType({}), factors: Iterable[str] = ()
    ) -> dict[str, list[Row]]:
        """The tables of a finished trial.

        Args:
            expected: the experiment's tables; see :func:`columns.check_tables`.
            factors: of the campaign's grid, to name the trial by.

        Raises:
            InputError: they are none that a trial has, or none of the experiment's.
        """
        if self.payload is None:
            raise ValueError(f"trial {self.trial_id} has failed and has no tables")
        try:
            tables = decode_tables(self.payload)
            check_tables(expected, tables, {**self.parameters, "seed": self.seed})
        except ValueError as error:
            raise self.fault(str(error), factors) from error
        return tables

    def fault(self, what: str, factors: Iterable[str] = ()) -> InputError:
        """What to raise if something is wrong with the trial that no disk does to it."""
        key = {**{factor: self.parameters[factor] for factor in factors}, "seed": self.seed}
        return InputError(
            f"{self.store}: trial {self.trial_id} ({shown_cell(key)}): {what}; midnet-bench writes no such"
            " trials: ask where this file comes from"
        )


@dataclass(frozen=True)
class Inventory:
    """Which trials a store has: the seeds that finished and those that failed, by the number of the cell."""

    finished: Mapping[int, set[int]]
    failed: Mapping[int, set[int]]
    damaged: Mapping[int, str]
    """row of a trial that cannot be read -> what to call it, for :meth:`Store.forget`"""

    def count(self) -> tuple[int, int]:
        """How many have finished, and how many have failed."""
        finished, failed = (sum(map(len, one.values())) for one in (self.finished, self.failed))
        return finished, failed


class Store:
    """An open campaign store; a context manager. Made by :func:`open_store` and :func:`open_or_create`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._identity = _identity(path)
        self._definition: Definition | None = None
        self._written: set[int] = set()
        """numbers of cells whose parameters are there"""

    def __enter__(self) -> "Store":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        self._connection.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self.refuse_if_gone()
        try:
            with explained(self.path), transaction(self._connection):
                yield
        except MidnetBenchError:
            self.refuse_if_gone()  # that explains it better
            raise

    def refuse_if_gone(self) -> None:
        """Raises MidnetBenchError if the file was deleted or replaced: SQLite goes on writing to it."""
        if _identity(self.path) != self._identity:
            raise MidnetBenchError(
                f"{self.path}: it was deleted or replaced while in use; the trials in it are lost"
                " unless you put it back; run the same command again to go on with what is there"
            )

    @property
    def definition(self) -> Definition:
        """The campaign of the store. Raises InputError if that is damaged."""
        if self._definition is None:
            with explained(self.path):
                row = self._connection.execute("SELECT definition FROM campaign").fetchone()
            try:
                self._definition = Definition.from_json(row[0] if row else "")
            except ValueError as error:
                raise InputError(
                    f"{self.path}: damaged (which campaign it holds cannot be read); move it away, or"
                    " --fresh to start over"
                ) from error
        return self._definition

    def refuse_unless_extended_by(self, definition: Definition) -> None:
        """Raises InputError, naming what differs, unless ``definition`` only adds trials or grid values."""
        found = differences(self.definition, definition)
        if found:
            raise InputError(
                f"{self.path}: made by another campaign ({'; '.join(found)});"
                " give another folder with -o, or --fresh to start over"
            )

    def extend(self, definition: Definition) -> None:
        """Takes ``definition`` as the store's own. Raises as :meth:`refuse_unless_extended_by`."""
        self.refuse_unless_extended_by(definition)
        with self._transaction():
            self._connection.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))
        self._definition = definition

    def write_cells(self, cells: Iterable[Cell]) -> None:
        """Writes the parameters of these cells down where they are not, or are damaged."""
        there = self._cells()
        missing = [
            (cell.number, json.dumps(dict(cell.parameters))) for cell in cells if cell.number not in there
        ]
        if missing:
            with self._transaction():
                self._connection.executemany("INSERT OR REPLACE INTO cells VALUES (?, ?)", missing)
        self._written = there.keys() | {number for number, _ in missing}

    def statuses(self) -> dict[str, str]:
        """Trial id -> ``finished`` or ``failed``. Raises InputError if a cell is damaged."""
        return {trial.trial_id: trial.status for trial in self.trials()}

    def counts(self) -> tuple[int, int]:
        """How many trials have finished, and how many have failed."""
        with explained(self.path):
            finished, total = self._connection.execute(
                "SELECT count(*) - count(traceback), count(*) FROM trials NOT INDEXED"
            ).fetchone()
        return finished, total - finished

    def failures(self) -> list[str]:
        """Of each failed trial the last line of its traceback: the exception and its message."""
        with explained(self.path):
            found = self._connection.execute(
                "SELECT traceback FROM trials WHERE traceback IS NOT NULL"
            ).fetchall()
        return [_last_line(text) for (text,) in found]

    def begin_run(self, provenance: Provenance) -> int:
        """Notes that a process begins to add trials; the run's id."""
        with self._transaction():
            text = json.dumps(provenance)
            cursor = self._connection.execute("INSERT INTO runs (provenance) VALUES (?)", (text,))
        assert cursor.lastrowid is not None
        return cursor.lastrowid

    def end_run(self, run_id: int) -> None:
        """Notes that the run came to its end by itself."""
        with self._transaction():
            self._connection.execute("UPDATE runs SET ended_utc = ? WHERE run_id = ?", (now_utc(), run_id))

    def runs(self) -> list[Provenance]:
        """The provenance of every run that added trials, in order, each with its ``ended_utc``.

        One that is damaged comes as its text under the key ``damaged``: it is no reason to lose the trials.
        """
        with explained(self.path):
            found = self._connection.execute(
                "SELECT provenance, ended_utc FROM runs WHERE run_id IN (SELECT run_id FROM trials)"
                " ORDER BY run_id"
            ).fetchall()
        return [{**_provenance(text), "ended_utc": ended_utc} for text, ended_utc in found]

    def record(self, run_id: int, spec: TrialSpec, outcome: Outcome) -> None:
        """Commits one trial, in place of an earlier failure of it."""
        self.record_all(run_id, [(spec, outcome)])

    def record_all(self, run_id: int, trials: Iterable[tuple[TrialSpec, Outcome]]) -> None:
        """Commits several trials, all or none of them, each in place of an earlier failure of it."""
        cells: dict[int, Cell] = {}
        written = []
        for spec, outcome in trials:
            cell = cells.setdefault(id(spec.parameters), Cell(spec.experiment, spec.parameters))
            written.append(
                rows.TrialRow(
                    cell.number,
                    spec.seed,
                    run_id,
                    outcome.simulated_s,
                    outcome.wall_s,
                    now_utc(),
                    outcome.failure,
                    outcome.payload,
                )
            )
        if any(cell.number not in self._written for cell in cells.values()):
            self.write_cells(cells.values())
        with self._transaction():
            self._connection.executemany(rows.INSERT, ((*row, row.checksum) for row in written))

    def trials(self) -> Iterator[StoredTrial]:
        """Every trial of the present definition, cell by cell in the grid's order, then by seed.

        Raises:
            InputError: a trial is damaged.
        """
        cells = self._cells_in_order()
        positions = {number: position for position, number in enumerate(cells)}
        with explained(self.path):
            order = []
            for row_id, number, seed in self._connection.execute(
                "SELECT rowid, cell, seed FROM trials NOT INDEXED"
            ):
                if number not in positions or not isinstance(seed, int):
                    raise _damaged(self.path, f"row {row_id}")
                order.append((positions[number], seed, row_id))
            order.sort()
            for first in range(0, len(order), ROWS_AT_ONCE):
                wanted = [row_id for _, _, row_id in order[first : first + ROWS_AT_ONCE]]
                # all of them at once: a statement that is left open would keep a campaign from storing
                found = {
                    row_id: row
                    for row_id, *row in self._connection.execute(
                        f"SELECT rowid, {rows.COLUMNS} FROM trials"
                        f" WHERE rowid IN ({','.join('?' * len(wanted))})",
                        wanted,
                    ).fetchall()
                }
                for row_id in wanted:
                    if row_id in found:  # else a campaign has just repeated it
                        yield self._trial(row_id, found[row_id], cells)

    def _trial(self, row_id: int, values: Sequence[Any], cells: Mapping[int, Cell]) -> StoredTrial:
        """The trial in a row. Raises InputError if it is damaged."""
        *columns, checksum = values
        row = rows.TrialRow(*columns)
        if not row.is_sound(checksum):
            raise _damaged(self.path, _called(row_id, row, cells))
        cell, seed, _, simulated_s, wall_s, finished_utc, traceback, result = row
        return StoredTrial(self.path, cells[cell], seed, simulated_s, wall_s, finished_utc, traceback, result)

    def _cells(self) -> dict[int, Cell]:
        """Number -> cell, without those that are damaged."""
        experiment, cells = self.definition.experiment, {}
        with explained(self.path):
            for number, text in self._connection.execute("SELECT cell, parameters FROM cells"):
                with contextlib.suppress(TypeError, ValueError):
                    cell = Cell(experiment, dict(json.loads(text)))
                    if cell.number == number:
                        cells[number] = cell
        return cells

    def _cells_in_order(self) -> dict[int, Cell]:
        """The sound cells in the grid's order."""
        grid, cells = self.definition.grid, self._cells()
        positions = {}
        for number, cell in cells.items():
            with contextlib.suppress(KeyError, ValueError):
                positions[number] = [values.index(cell.parameters[factor]) for factor, values in grid.items()]
        return {number: cells[number] for number in sorted(positions, key=positions.__getitem__)}

    def inventory(self, known: Iterable[Cell] = ()) -> Inventory:
        """Which trials are there and as they were written; their results are not unpacked.

        Args:
            known: cells of the campaign, whose parameters may be damaged in the store.
        """
        cells = self._cells() | {cell.number: cell for cell in known}
        finished: dict[int, set[int]] = {number: set() for number in cells}
        failed: dict[int, set[int]] = {number: set() for number in cells}
        damaged = {}
        with explained(self.path):
            for values in self._connection.execute(f"SELECT rowid, {rows.COLUMNS} FROM trials NOT INDEXED"):
                row_id, *columns, checksum = values
                row = rows.TrialRow(*columns)
                if row.cell in cells and row.is_sound(checksum):
                    (failed if row.result is None else finished)[row.cell].add(row.seed)
                else:
                    damaged[row_id] = _called(row_id, row, cells)
        return Inventory(finished, failed, damaged)

    def forget(self, row_ids: Iterable[int]) -> None:
        """Drops trials, so that they count as not done."""
        with self._transaction():
            # made anew, for the damage may be in the index, or in what it is made of
            self._connection.execute("DROP INDEX one_row_each")
            self._connection.executemany("DELETE FROM trials WHERE rowid = ?", [(one,) for one in row_ids])
            self._connection.execute(rows.ONE_ROW_EACH)

    def sizes(self) -> tuple[int, float, float]:
        """Of the finished trials: how many, their mean wall time in seconds, their mean size in bytes."""
        with explained(self.path):
            count, wall_s, size = self._connection.execute(
                "SELECT count(*), avg(wall_s), avg(length(result)) FROM trials WHERE traceback IS NULL"
            ).fetchone()
        return count, wall_s or 0.0, size or 0.0


def _identity(path: Path) -> tuple[int, int] | None:
    """What tells a file from another one of the same name; None if there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _last_line(text: str) -> str:
    return (text.splitlines() or [""])[-1]


def _called(row_id: int, row: rows.TrialRow, cells: Mapping[int, Cell]) -> str:
    """What messages call the trial in a row that may be damaged."""
    if row.cell in cells and isinstance(row.seed, int):
        return f"trial {cells[row.cell].trial_id(row.seed)} (seed {row.seed})"
    return f"row {row_id}"


def _damaged(path: Path, what: str) -> InputError:
    return InputError(
        f"{path}: {what} cannot be read, the file is damaged there;"
        " run the campaign's command again to mend it; the other trials are kept"
    )


def _provenance(text: str) -> Provenance:
    try:
        return dict(json.loads(text))
    except (TypeError, ValueError):
        return {"damaged": text}


def open_or_create(path: Path, definition: Definition) -> Store:
    """The store of ``definition`` at ``path``: a new one, or the one there if ``definition`` extends it.

    Raises:
        InputError: as :func:`open_store`, or the store there is another campaign's.
    """
    connection = database.create(path, definition.to_json())
    if connection is not None:
        return Store(path, connection)
    store = open_store(path, is_writer=True)
    try:
        store.extend(definition)
    except BaseException:
        store.close()
        raise
    return store


def open_store(path: Path, is_writer: bool = False) -> Store:
    """The store at ``path``; a reader changes no file.

    Raises:
        InputError: there is none; the file is another program's, damaged, or another version's.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no campaign store here")
    return Store(path, database.open_existing(path, is_writer))


def back_up(path: Path) -> Path | None:
    """Renames the store at ``path``, whatever it is, to the first free ``campaign.old-N.sqlite``."""
    if not path.exists():
        return None
    number = 1
    while (aside := path.with_name(f"{path.stem}.old-{number}{path.suffix}")).exists():
        number += 1
    journal = Path(f"{path}-journal")  # of a process that was killed: the old store needs it to open
    if journal.exists():
        journal.rename(f"{aside}-journal")
    return path.rename(aside)
