"""The store: one SQLite file per campaign, one transaction per finished trial, one process that writes.

SQLite's rollback journal with full synchronisation is what makes it survive: a process that is killed
or a disk that is full leaves the last committed trial and nothing half-written, in one file that can be
copied as it is.
"""

import contextlib
import json
import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from midnet_bench.campaign.definition import Definition, differences
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.campaign.worker import Outcome, decode_tables
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.experiments.trial import Row, Scalar, TrialSpec

FILE_NAME = "campaign.sqlite"
APPLICATION_ID = 0x4D49444E
"""``MIDN``: how SQLite marks whose file it is"""

MIGRATIONS: list[tuple[str, ...]] = [
    (
        "CREATE TABLE campaign (definition TEXT NOT NULL)",
        """CREATE TABLE runs (
            run_id INTEGER PRIMARY KEY,
            provenance TEXT NOT NULL,
            ended_utc TEXT
        )""",
        """CREATE TABLE trials (
            trial_id TEXT PRIMARY KEY,
            run_id INTEGER NOT NULL REFERENCES runs,
            seed INTEGER NOT NULL,
            parameters TEXT NOT NULL,
            status TEXT NOT NULL CHECK (status IN ('finished', 'failed')),
            simulated_s REAL,
            wall_s REAL NOT NULL,
            traceback TEXT CHECK ((traceback IS NOT NULL) = (status = 'failed')),
            finished_utc TEXT NOT NULL,
            result BLOB CHECK ((result IS NOT NULL) = (status = 'finished'))
        )""",
    ),
]
"""Entry k turns schema version k into k + 1; version 0 is the empty file. Append, never edit."""


class StoreFull(MidnetBenchError):
    """The disk has no room left. The store holds every trial that was committed before."""


@dataclass(frozen=True)
class StoredTrial:
    """One trial as the store keeps it."""

    trial_id: str
    seed: int
    parameters: dict[str, Scalar]
    status: str
    simulated_s: float | None
    wall_s: float
    traceback: str | None
    finished_utc: str
    payload: bytes | None

    @property
    def tables(self) -> dict[str, list[Row]]:
        """The tables of a finished trial."""
        if self.payload is None:
            raise ValueError(f"trial {self.trial_id} has failed and has no tables")
        return decode_tables(self.payload)


class Store:
    """An open campaign store; a context manager. Made by :func:`open_store` and :func:`open_or_create`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

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
        with _explained(self.path), _transaction(self._connection):
            yield

    @property
    def definition(self) -> Definition:
        """What the store was made for."""
        with _explained(self.path):
            (text,) = self._connection.execute("SELECT definition FROM campaign").fetchone()
        return Definition.from_json(text)

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

    def statuses(self) -> dict[str, str]:
        """Trial id -> ``finished`` or ``failed``."""
        with _explained(self.path):
            return dict(self._connection.execute("SELECT trial_id, status FROM trials"))

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
        """The provenance of every run that added trials, in order, each with its ``ended_utc``."""
        with _explained(self.path):
            rows = self._connection.execute(
                "SELECT provenance, ended_utc FROM runs WHERE run_id IN (SELECT run_id FROM trials)"
                " ORDER BY run_id"
            ).fetchall()
        return [{**json.loads(provenance), "ended_utc": ended_utc} for provenance, ended_utc in rows]

    def record(self, run_id: int, spec: TrialSpec, outcome: Outcome) -> None:
        """Commits one trial, in place of an earlier failure of it."""
        with self._transaction():
            self._connection.execute(
                "INSERT OR REPLACE INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    spec.trial_id,
                    run_id,
                    spec.seed,
                    json.dumps(dict(spec.parameters)),
                    "finished" if outcome.payload is not None else "failed",
                    outcome.simulated_s,
                    outcome.wall_s,
                    outcome.failure,
                    now_utc(),
                    outcome.payload,
                ),
            )

    def trials(self) -> Iterator[StoredTrial]:
        """Every trial of the present definition, cell by cell in the grid's order, then by seed."""
        definition = self.definition
        order = {
            factor: {value: k for k, value in enumerate(values)} for factor, values in definition.grid.items()
        }
        places: list[tuple[tuple[int, ...], int, str]] = []
        with _explained(self.path):
            for trial_id, seed, text in self._connection.execute(
                "SELECT trial_id, seed, parameters FROM trials"
            ):
                cell = definition.cell_of(json.loads(text))
                places.append((tuple(order[factor][value] for factor, value in cell.items()), seed, trial_id))
            for _, _, trial_id in sorted(places):
                row = self._connection.execute(
                    "SELECT trial_id, seed, parameters, status, simulated_s, wall_s, traceback,"
                    " finished_utc, result"
                    " FROM trials WHERE trial_id = ?",
                    (trial_id,),
                ).fetchone()
                yield StoredTrial(row[0], row[1], json.loads(row[2]), *row[3:])

    def sizes(self) -> tuple[int, float, float]:
        """Of the finished trials: how many, their mean wall time in seconds, their mean size in bytes."""
        with _explained(self.path):
            count, wall_s, size = self._connection.execute(
                "SELECT count(*), avg(wall_s), avg(length(result)) FROM trials WHERE status = 'finished'"
            ).fetchone()
        return count, wall_s or 0.0, size or 0.0


def open_or_create(path: Path, definition: Definition) -> Store:
    """The store of ``definition`` at ``path``: a new one, or the one there if ``definition`` extends it.

    Raises:
        InputError: as :func:`open_store`, or the store there is another campaign's.
    """
    with _explained(path):
        connection = sqlite3.connect(path, timeout=30, isolation_level=None)
        with _closed_on_error(connection):
            _pragma(connection, "schema_version")  # reading takes back what a killed process left half-made
            if path.stat().st_size == 0:
                with _transaction(connection):
                    _migrate(connection, 0)
                    connection.execute("INSERT INTO campaign VALUES (?)", (definition.to_json(),))
                return Store(path, connection)
    connection.close()
    store = open_store(path)
    with _closed_on_error(store):
        store.extend(definition)
    return store


def open_store(path: Path) -> Store:
    """The store at ``path``, brought to the present schema.

    Raises:
        InputError: there is none; the file is another program's, damaged, or of a newer midnet-bench.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no campaign store here")
    with _explained(path):
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", 30, isolation_level=None, uri=True)
        with _closed_on_error(connection):
            if _pragma(connection, "application_id") != APPLICATION_ID:
                raise InputError(
                    f"{path}: another program's SQLite file, not a campaign store; left as it is"
                )
            version = int(_pragma(connection, "user_version"))
            if version > len(MIGRATIONS):
                raise InputError(
                    f"{path}: written by a newer midnet-bench (schema {version}, this one knows up to"
                    f" {len(MIGRATIONS)}); update midnet-bench"
                )
            state = _pragma(connection, "quick_check(1)")
            if state != "ok":
                raise InputError(f"{path}: damaged ({state}); move it away, or --fresh to start over")
            if version < len(MIGRATIONS):
                with _transaction(connection):
                    _migrate(connection, version)
    return Store(path, connection)


def keep_aside(path: Path) -> Path | None:
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
        connection = sqlite3.connect(directory / "campaign.lock", timeout=0, isolation_level=None)
        with _closed_on_error(connection):
            connection.execute("PRAGMA journal_mode = MEMORY")  # nothing to write, even on a full disk
            connection.execute("BEGIN EXCLUSIVE")
    except OSError as error:
        raise InputError(f"{directory}: cannot be used as a folder for results: {error.strerror}") from error
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise InputError(
                f"{directory}: another midnet-bench is running this campaign; wait for it or give another -o"
            ) from error
        raise InputError(f"{directory}: cannot be written ({error})") from error
    with contextlib.closing(connection):
        yield


def _pragma(connection: sqlite3.Connection, name: str) -> int | str:
    (value,) = connection.execute(f"PRAGMA {name}").fetchone()
    return value


def _migrate(connection: sqlite3.Connection, version: int) -> None:
    """Brings a schema of ``version`` to the present one; the caller holds the transaction."""
    for statements in MIGRATIONS[version:]:
        for statement in statements:
            connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute(f"PRAGMA user_version = {len(MIGRATIONS)}")


@contextlib.contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:  # a full disk makes SQLite roll back by itself
            connection.execute("ROLLBACK")
        raise


@contextlib.contextmanager
def _closed_on_error(resource: "sqlite3.Connection | Store") -> Iterator[None]:
    try:
        yield
    except BaseException:
        resource.close()
        raise


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """SQLite's errors as this package's, in one line."""
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
            raise StoreFull(
                f"{path}: cannot be written ({error}); what was stored is intact:"
                " make room and give the same command again"
            ) from error
        if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise InputError(
                f"{path}: not a campaign store, or a damaged one ({error}); nothing was changed:"
                " move it away, or --fresh to start over"
            ) from error
        raise MidnetBenchError(f"{path}: {error}") from error
