"""The store: one SQLite file per campaign, one transaction per finished trial, one process that writes.

The rollback journal with full synchronisation, SQLite's defaults, is what makes a store survive: a
process that is killed or a disk that is full leaves the last committed transaction and nothing
half-written, in one file that can be copied as it is.

A file from elsewhere is read as SQLite must not read it: a journal beside it makes SQLite write the file, and
delete any other that the journal names. So readers leave both as they are, and writers look at them first.
"""

import contextlib
import json
import math
import shutil
import sqlite3
import stat
import struct
import tempfile
import textwrap
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, get_type_hints

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from midnet_bench.campaign.definition import FILE_NAME as FILE_NAME
from midnet_bench.campaign.definition import Definition, differences, shown_cell
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.campaign.trial import (
    FAILURES,
    TIMING,
    TIMING_TABLE,
    Cell,
    Columns,
    Outcome,
    Row,
    Scalar,
    Tables,
    TrialSpec,
    beside,
    check_tables,
    decode_tables,
    shown,
)
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.io.files import CsvFile, temporary_path

APPLICATION_ID = 0x4D49444E  # ``MIDN``: SQLite's mark of the program that a file belongs to
FORMAT = 4
"""of stores; it changes with their tables and with the columns of any experiment, but for new ones that
may be missing (``Column.may_be_missing``), and none reads another's"""
JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
"""SQLite's; a journal that ends in it names a file that SQLite deletes when it takes the journal back"""
ROLLBACK_HEADER = b"SQLite format 3\0", b"\1\1"
"""what a store begins with, and what stands two bytes behind; of one with a write-ahead log it is 2 and 2"""
ROWS_AT_ONCE = 500  # that are read by one statement


class StoreFull(MidnetBenchError):
    """The disk has no room left. The store holds every trial that was committed before."""


class TrialRow(NamedTuple):
    """What the table ``trials`` has of a trial: failed if it has a traceback, finished if it has a result."""

    cell: int
    seed: int
    run_id: int
    simulated_s: float | None
    wall_s: float
    finished_utc: str
    traceback: str | None
    result: bytes | None

    @property
    def checksum(self) -> int:
        """The CRC-32 of all of it; it is found a million times where a million trials go on."""
        cell, seed, run_id, simulated_s, wall_s, finished_utc, traceback, result = self
        times = math.nan if simulated_s is None else simulated_s, wall_s
        numbers = _NUMBERS.pack(cell, seed, run_id, *times, traceback is None, result is None)
        text = finished_utc if traceback is None else finished_utc + traceback
        return zlib.crc32(
            result or b"", zlib.crc32(text.encode("utf-8", "surrogatepass"), zlib.crc32(numbers))
        )

    def is_sound(self, checksum: object) -> bool:
        """Whether the values are those that were written with this checksum."""
        try:
            return checksum == self.checksum
        except (AttributeError, TypeError, struct.error):  # values of other types
            return False

    def named(self, row_id: int, cells: Mapping[int, Cell]) -> str:
        """What messages call the trial, whose values may be damaged."""
        if self.cell in cells and isinstance(self.seed, int):
            return f"trial {cells[self.cell].trial_id(self.seed)} (seed {self.seed})"
        return f"row {row_id}"


_NUMBERS = struct.Struct("<qqqdd??")
_SQL_TYPES = {
    int: "INTEGER NOT NULL",
    float: "REAL NOT NULL",
    str: "TEXT NOT NULL",
    float | None: "REAL",
    str | None: "TEXT",
    bytes | None: "BLOB",
}
ONE_ROW_EACH = "CREATE UNIQUE INDEX one_row_each ON trials (cell, seed)"
SCHEMA = (
    "CREATE TABLE campaign (definition TEXT NOT NULL)",
    "CREATE TABLE runs (run_id INTEGER PRIMARY KEY, provenance TEXT NOT NULL, ended_utc TEXT)",
    "CREATE TABLE cells (cell INTEGER PRIMARY KEY, parameters TEXT NOT NULL)",
    "CREATE TABLE trials ("
    + "".join(f"{name} {_SQL_TYPES[kind]}, " for name, kind in get_type_hints(TrialRow).items())
    + "checksum INTEGER NOT NULL)",
    ONE_ROW_EACH,
)
COLUMNS = f"{', '.join(TrialRow._fields)}, checksum"
"""of the table ``trials``: a :class:`TrialRow` and its checksum"""
INSERT = f"INSERT OR REPLACE INTO trials ({COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"


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
        """The tables of a finished trial, which messages name by the grid's ``factors``.

        Raises:
            InputError: they are none that a trial has, or none of the ``expected`` ones (``check_tables``).
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
        finished, failed = (sum(map(len, each.values())) for each in (self.finished, self.failed))
        return finished, failed


class Store:
    """An open campaign store; a context manager. Made by :func:`open_store` and :func:`open_or_create`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        self._identity = _identity(path)
        self._written: set[int] = set()  # numbers of cells whose parameters are there

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        self._connection.close()

    def _read(self, statement: str, values: Sequence[Any] = ()) -> list[Any]:
        """Rows, all at once: a statement that is left open would keep a campaign from storing."""
        with _explained(self.path):
            return self._connection.execute(statement, values).fetchall()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self.refuse_if_gone()
        try:
            with _explained(self.path):
                self._connection.execute("BEGIN IMMEDIATE")
                with self._connection:  # all of what is done inside, or nothing
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

    @cached_property
    def definition(self) -> Definition:
        """The campaign of the store. Raises InputError if that is damaged."""
        rows = self._read("SELECT definition FROM campaign")
        try:
            return Definition.from_json(rows[0][0] if rows else "")
        except ValueError as error:
            raise InputError(
                f"{self.path}: damaged (which campaign it holds cannot be read); move it away, or"
                " --fresh to start over"
            ) from error

    def refuse_unless_extended_by(self, definition: Definition) -> None:
        """Raises InputError, naming what differs, unless ``definition`` only adds trials or grid values."""
        if found := differences(self.definition, definition):
            raise InputError(
                f"{self.path}: made by another campaign ({'; '.join(found)});"
                " give another folder with -o, or --fresh to start over"
            )

    def extend(self, definition: Definition) -> None:
        """Takes ``definition`` as the store's own. Raises as :meth:`refuse_unless_extended_by`."""
        self.refuse_unless_extended_by(definition)
        with self._transaction():
            self._connection.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))
        self.definition = definition

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

    def counts(self) -> tuple[int, int]:
        """How many trials have finished, and how many have failed."""
        ((finished, total),) = self._read(
            "SELECT count(*) - count(traceback), count(*) FROM trials NOT INDEXED"
        )
        return finished, total - finished

    def failures(self) -> list[str]:
        """Of each failed trial the last line of its traceback: the exception and its message."""
        found = self._read("SELECT traceback FROM trials WHERE traceback IS NOT NULL")
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
        runs = []
        for text, ended_utc in self._read(
            "SELECT provenance, ended_utc FROM runs WHERE run_id IN (SELECT run_id FROM trials)"
            " ORDER BY run_id"
        ):
            try:
                provenance = dict(json.loads(text))
            except (TypeError, ValueError):
                provenance = {"damaged": text}
            runs.append({**provenance, "ended_utc": ended_utc})
        return runs

    def record(self, run_id: int, spec: TrialSpec, outcome: Outcome) -> None:
        """Commits one trial, in place of an earlier failure of it."""
        self.record_all(run_id, [(spec, outcome)])

    def record_all(self, run_id: int, trials: Iterable[tuple[TrialSpec, Outcome]]) -> None:
        """Commits several trials, all or none of them, each in place of an earlier failure of it."""
        cells: dict[int, Cell] = {}
        written = []
        for spec, outcome in trials:
            cell = cells.setdefault(id(spec.parameters), Cell(spec.experiment, spec.parameters))
            times = outcome.simulated_s, outcome.wall_s, now_utc()
            row = TrialRow(cell.number, spec.seed, run_id, *times, outcome.failure, outcome.payload)
            written.append((*row, row.checksum))
        if any(cell.number not in self._written for cell in cells.values()):
            self.write_cells(cells.values())
        with self._transaction():
            self._connection.executemany(INSERT, written)

    def trials(self) -> Iterator[StoredTrial]:
        """Every trial of the present definition, cell by cell in the grid's order, then by seed.

        Raises:
            InputError: a trial is damaged.
        """
        cells = self._cells_in_order()
        positions = {number: position for position, number in enumerate(cells)}
        order = []
        for row_id, number, seed in self._read("SELECT rowid, cell, seed FROM trials NOT INDEXED"):
            if number not in positions or not isinstance(seed, int):
                raise self._damaged(f"row {row_id}")
            order.append((positions[number], seed, row_id))
        order.sort()
        for first in range(0, len(order), ROWS_AT_ONCE):
            wanted = [row_id for _, _, row_id in order[first : first + ROWS_AT_ONCE]]
            marks = ",".join("?" * len(wanted))
            statement = f"SELECT rowid, {COLUMNS} FROM trials WHERE rowid IN ({marks})"
            found = {row_id: values for row_id, *values in self._read(statement, wanted)}
            for row_id in filter(found.__contains__, wanted):  # else a campaign has just repeated it
                *values, checksum = found[row_id]
                row = TrialRow(*values)
                if not row.is_sound(checksum):
                    raise self._damaged(row.named(row_id, cells))
                cell, seed, _, simulated_s, wall_s, finished, failure, result = row
                yield StoredTrial(
                    self.path, cells[cell], seed, simulated_s, wall_s, finished, failure, result
                )

    def _damaged(self, what: str) -> InputError:
        return InputError(
            f"{self.path}: {what} cannot be read, the file is damaged there;"
            " run the campaign's command again to mend it; the other trials are kept"
        )

    def _cells(self) -> dict[int, Cell]:
        """Number -> cell, without those that are damaged."""
        experiment, cells = self.definition.experiment, {}
        for number, text in self._read("SELECT cell, parameters FROM cells"):
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

        ``known``: cells of the campaign, whose parameters may be damaged in the store.
        """
        cells = self._cells() | {cell.number: cell for cell in known}
        finished: dict[int, set[int]] = {number: set() for number in cells}
        failed: dict[int, set[int]] = {number: set() for number in cells}
        damaged = {}
        with _explained(self.path):  # row by row: results may be larger than the memory
            for values in self._connection.execute(f"SELECT rowid, {COLUMNS} FROM trials NOT INDEXED"):
                row_id, *columns, checksum = values
                row = TrialRow(*columns)
                if row.cell in cells and row.is_sound(checksum):
                    (failed if row.result is None else finished)[row.cell].add(row.seed)
                else:
                    damaged[row_id] = row.named(row_id, cells)
        return Inventory(finished, failed, damaged)

    def forget(self, row_ids: Iterable[int]) -> None:
        """Drops trials, so that they count as not done."""
        with self._transaction():
            # made anew, for the damage may be in the index, or in what it is made of
            self._connection.execute("DROP INDEX one_row_each")
            self._connection.executemany("DELETE FROM trials WHERE rowid = ?", [(one,) for one in row_ids])
            self._connection.execute(ONE_ROW_EACH)

    def sizes(self) -> tuple[int, float, float]:
        """Of the finished trials: how many, their mean wall time in seconds, their mean size in bytes."""
        ((count, wall_s, size),) = self._read(
            "SELECT count(*), avg(wall_s), avg(length(result)) FROM trials WHERE traceback IS NULL"
        )
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


def export_csv(store: Store, directory: Path, expected: Tables = MappingProxyType({})) -> list[Path]:
    """Writes one CSV per table of the trials; the files written.

    Rows stand in the campaign's order (cells, then seeds, then the trial's own rows), led by the
    factors of the grid and the seed. ``timing.csv`` keeps wall times apart, because no two runs agree
    on them. ``failures.csv`` names the trials that failed; it is there only if some did. One trial is in
    memory at a time, however many there are. The same trials give the same bytes, wherever they ran.

    Raises:
        InputError: a trial is damaged or its tables are others, or the folder cannot be written. No file is
            written then.
        MidnetBenchError: there is no room.
    """
    definition = store.definition
    with contextlib.ExitStack() as drafts:
        files: dict[str, CsvFile] = {}

        def add(name: str, key: Row, rows: Sequence[Row]) -> None:
            if name not in files:
                draft = drafts.enter_context(temporary_path(directory / f"{name}.csv"))
                files[name] = drafts.enter_context(CsvFile(draft))
            files[name].add(key, rows)

        add(TIMING, {}, [])
        for trial in store.trials():
            key: Row = {
                **{factor: trial.parameters[factor] for factor in definition.grid},
                "seed": trial.seed,
            }
            timing: Row = {name: getattr(trial, name) for name in TIMING_TABLE[TIMING].columns}
            try:
                check_tables(TIMING_TABLE, {TIMING: [timing]}, key)
            except ValueError as error:
                raise trial.fault(str(error), definition.grid) from error
            add(TIMING, key, [timing])
            if trial.traceback is not None:
                add(FAILURES, key, [{"trial_id": trial.trial_id, "reason": trial.reason}])
                continue
            for name, rows in trial.tables(expected, definition.grid).items():
                renamed = _beside_factors(rows, key, expected.get(name))
                for row in rows:
                    for column in row.keys() & key.keys() - renamed.keys():
                        if row[column] != key[column]:
                            what = f"table '{name}', column '{column}': {shown(row[column])} is another's"
                            raise trial.fault(what, definition.grid)
                if renamed:
                    rows = [{renamed.get(column, column): row[column] for column in row} for row in rows]
                add(name, key, rows)
    if FAILURES not in files:
        (directory / f"{FAILURES}.csv").unlink(missing_ok=True)
    return [directory / f"{name}.csv" for name in files]


def _beside_factors(rows: Sequence[Row], key: Row, known: Columns | None) -> dict[str, str]:
    """What those columns of a table are called that have the name of a factor and hold something else."""
    own = set(rows[0] if rows else ()) & key.keys() - {"seed"}
    if known is not None:
        return {name: beside(name) for name in own if not known.columns[name].is_parameter}
    return {name: beside(name) for name in own if any(row[name] != key[name] for row in rows)}


def open_or_create(path: Path, definition: Definition) -> Store:
    """The store of ``definition`` at ``path``: a new one, or the one there if ``definition`` extends it.

    Raises:
        InputError: as :func:`open_store`, or the store there is another campaign's.
    """
    refuse_traps(path)
    with _explained(path):
        connection = sqlite3.connect(path, timeout=30, isolation_level=None)
        with _closed_on_error(connection):
            _pragma(connection, "schema_version")  # reading takes back what a killed process left half-made
            if path.stat().st_size == 0:
                connection.execute("BEGIN IMMEDIATE")
                with connection:  # all of it, or nothing
                    for statement in SCHEMA:
                        connection.execute(statement)
                    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                    connection.execute(f"PRAGMA user_version = {FORMAT}")
                    connection.execute("INSERT INTO campaign VALUES (?)", (definition.to_json(),))
                return Store(path, connection)
    connection.close()
    store = open_store(path, is_writer=True)
    with _closed_on_error(store._connection):
        store.extend(definition)
    return store


def open_store(path: Path, is_writer: bool = False) -> Store:
    """The store at ``path``. A reader changes no file, and may read while another process writes.

    Raises:
        InputError: there is none; the file is another program's, damaged, or another version's; or as
            :func:`refuse_traps`.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no campaign store here")
    refuse_traps(path if is_writer else path.resolve())
    with _explained(path):
        with path.open("rb") as file:
            begins, _, versions = file.read(16), file.read(2), file.read(2)
        if begins == ROLLBACK_HEADER[0] and versions != ROLLBACK_HEADER[1]:  # even a reader would write a log
            raise InputError(f"{path}: another program's SQLite file, not a campaign store; left as it is")
        try:
            return Store(path, _connection(path, "rw" if is_writer else "ro"))
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_READONLY_ROLLBACK:
                raise
        with contextlib.suppress(FileNotFoundError):  # a campaign goes on and has just taken it back
            return Store(path, _rolled_back_copy(path))
        return Store(path, _connection(path, "ro"))


def _connection(path: Path, mode: str) -> sqlite3.Connection:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", 30, isolation_level=None, uri=True)
    # invalid UTF-8 is reported by the reader of the text, which knows the trial's id
    connection.text_factory = lambda text: text.decode(errors="replace")
    with _closed_on_error(connection):
        _refuse_unless_sound(connection, path)
    return connection


def _refuse_unless_sound(connection: sqlite3.Connection, path: Path) -> None:
    """Raises InputError unless the file is a sound store of this version."""
    if _pragma(connection, "application_id") != APPLICATION_ID:
        raise InputError(f"{path}: another program's SQLite file, not a campaign store; left as it is")
    version = _pragma(connection, "user_version")
    if version != FORMAT:
        raise InputError(
            f"{path}: another version of midnet-bench wrote it (format {version}, this one reads {FORMAT});"
            " use that version, or --fresh to start over"
        )
    alien = connection.execute("SELECT type, name FROM sqlite_master WHERE type IN ('view', 'trigger')")
    if found := alien.fetchone():
        raise InputError(f"{path}: no store of midnet-bench: it has a {found[0]}; move it away")
    state = " ".join(str(_pragma(connection, "quick_check(1)")).split())
    if state != "ok":
        raise InputError(f"{path}: damaged ({state}); move it away, or --fresh to start over")


def _rolled_back_copy(path: Path) -> sqlite3.Connection:
    """A connection to what a store was before the transaction in which a process was killed; in memory."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, path.name)
        for ending in ("", "-journal"):
            shutil.copyfile(f"{path.resolve()}{ending}", f"{copy}{ending}", follow_symlinks=False)
        refuse_traps(copy)
        with contextlib.closing(_connection(copy, "rw")) as copied:
            memory = sqlite3.connect(":memory:", isolation_level=None)
            memory.text_factory = copied.text_factory
            copied.backup(memory)
    return memory


def refuse_traps(path: Path) -> None:
    """Raises InputError unless SQLite would write to ``path``, if it is there, and to its journal alone."""
    journal = Path(f"{path}-journal")
    for file in (path, journal):
        with contextlib.suppress(FileNotFoundError):
            if not stat.S_ISREG(file.lstat().st_mode):
                raise InputError(f"{file}: a link, or no ordinary file; move it away, or give another -o")
            if file == journal and journal.read_bytes().endswith(JOURNAL_MAGIC):
                raise InputError(f"{journal}: names another file, as ours never do; remove it")


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


@contextlib.contextmanager
def only_writer(directory: Path) -> Iterator[None]:
    """Keeps other processes from writing to the campaign in ``directory``; a dead process holds nothing.

    The lock is SQLite's own on an empty file, so it works wherever the store does, and readers of the
    store are left alone.

    Raises:
        InputError: another process is at it, or the folder cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = directory / ".campaign.lock"
        refuse_traps(lock)
        if lock.exists() and lock.stat().st_size:
            raise InputError(f"{lock}: not the empty file that midnet-bench makes; remove it")
        connection = sqlite3.connect(lock, timeout=0, isolation_level=None)
        with _closed_on_error(connection):
            connection.execute("PRAGMA journal_mode = MEMORY")  # nothing to write, even on a full disk
            connection.execute("BEGIN EXCLUSIVE")
    except OSError as error:
        raise InputError(f"{directory}: cannot be used as a folder for results: {error.strerror}") from error
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            _refuse_without_locks(directory)
            raise InputError(
                f"{directory}: another midnet-bench is running this campaign; wait for it or give another -o"
            ) from error
        raise InputError(f"{directory}: cannot be written ({error})") from error
    with contextlib.closing(connection):
        yield


def _refuse_without_locks(directory: Path) -> None:
    """Raises InputError if the file system cannot lock files, which SQLite takes for a lock that is held."""
    if fcntl is not None:
        with tempfile.TemporaryFile(dir=directory) as file:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise InputError(
                    f"{directory}: files cannot be locked there: {error.strerror}; give another -o"
                ) from error


def _pragma(connection: sqlite3.Connection, name: str) -> int | str:
    (value,) = connection.execute(f"PRAGMA {name}").fetchone()
    return value


@contextlib.contextmanager
def _closed_on_error(connection: sqlite3.Connection) -> Iterator[None]:
    try:
        yield
    except BaseException:
        connection.close()
        raise


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """SQLite's errors as this package's, in one line."""
    try:
        yield
    except UnicodeDecodeError as error:  # SQLite quotes a damaged table's name in its complaint
        raise InputError(f"{path}: damaged; move it away, or --fresh to start over") from error
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        what = textwrap.shorten(str(error), 200, placeholder="...")  # a damaged schema is quoted line by line
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise StoreFull(
                f"{path}: cannot be written ({what}); what was stored is intact:"
                " make room and run the same command again to continue"
            ) from error
        if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR):
            raise InputError(
                f"{path}: not a campaign store, or a damaged one ({what}); nothing was changed:"
                " move it away, or --fresh to start over"
            ) from error
        if code in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM, sqlite3.SQLITE_READONLY):
            raise InputError(
                f"{path}: {what}; it must be a file that you may write: move it away, or give another -o"
            ) from error
        raise MidnetBenchError(f"{path}: {what}") from error
