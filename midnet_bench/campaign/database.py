"""SQLite as campaigns need it: ownership of a file, schema, and errors with their remedy.

The rollback journal with full synchronisation, SQLite's defaults, is what makes a store survive: a
process that is killed or a disk that is full leaves the last committed transaction and nothing
half-written, in one file that can be copied as it is.
"""

import contextlib
import sqlite3
import textwrap
from collections.abc import Iterator
from pathlib import Path

from midnet_bench.campaign.rows import SCHEMA
from midnet_bench.errors import InputError, MidnetBenchError

APPLICATION_ID = 0x4D49444E
"""``MIDN``: SQLite's mark of the program that a file belongs to"""

FORMAT = 4
"""of stores; it changes with their tables and with the columns of any experiment, and none reads another's"""


class StoreFull(MidnetBenchError):
    """The disk has no room left. The store holds every trial that was committed before."""


def create(path: Path, definition: str) -> sqlite3.Connection | None:
    """A connection to a new store at ``path`` that holds ``definition``; None if the file is not empty."""
    with explained(path):
        connection = sqlite3.connect(path, timeout=30, isolation_level=None)
        with _closed_on_error(connection):
            _pragma(connection, "schema_version")  # reading takes back what a killed process left half-made
            if path.stat().st_size == 0:
                with transaction(connection):
                    for statement in SCHEMA:
                        connection.execute(statement)
                    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                    connection.execute(f"PRAGMA user_version = {FORMAT}")
                    connection.execute("INSERT INTO campaign VALUES (?)", (definition,))
                return connection
    connection.close()
    return None


def open_existing(path: Path) -> sqlite3.Connection:
    """A connection to the store at ``path``.

    Raises:
        InputError: the file is another program's, damaged, or another version's.
    """
    with explained(path):
        connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", 30, isolation_level=None, uri=True)
        # invalid UTF-8 is reported by the reader of the text, which knows the trial's id
        connection.text_factory = lambda text: text.decode(errors="replace")
        with _closed_on_error(connection):
            _check(connection, path)
    return connection


def unknown_campaign(path: Path) -> InputError:
    """What to raise when the definition in the store at ``path`` is damaged."""
    return InputError(
        f"{path}: damaged (which campaign it holds cannot be read); move it away, or --fresh to start over"
    )


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Raises InputError unless the file is a sound store of this version."""
    if _pragma(connection, "application_id") != APPLICATION_ID:
        raise InputError(f"{path}: another program's SQLite file, not a campaign store; left as it is")
    version = _pragma(connection, "user_version")
    if version != FORMAT:
        raise InputError(
            f"{path}: another version of midnet-bench wrote it (format {version}, this one reads {FORMAT});"
            " use that version, or --fresh to start over"
        )
    state = " ".join(str(_pragma(connection, "quick_check(1)")).split())
    if state != "ok":
        raise InputError(f"{path}: damaged ({state}); move it away, or --fresh to start over")


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
        connection = sqlite3.connect(directory / ".campaign.lock", timeout=0, isolation_level=None)
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


@contextlib.contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """All of what is done inside, or nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:  # a full disk makes SQLite roll back by itself
            connection.execute("ROLLBACK")
        raise


@contextlib.contextmanager
def _closed_on_error(connection: sqlite3.Connection) -> Iterator[None]:
    try:
        yield
    except BaseException:
        connection.close()
        raise


@contextlib.contextmanager
def explained(path: Path) -> Iterator[None]:
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
