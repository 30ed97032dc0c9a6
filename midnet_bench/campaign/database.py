"""SQLite as campaigns need it: ownership of a file, schema, and errors with their remedy.

The rollback journal with full synchronisation, SQLite's defaults, is what makes a store survive: a
process that is killed or a disk that is full leaves the last committed transaction and nothing
half-written, in one file that can be copied as it is.

A file from elsewhere is read as SQLite must not read it: a journal beside it makes SQLite write the file, and
delete any other that the journal names. So readers leave both as they are, and writers look at them first.
"""

import contextlib
import shutil
import sqlite3
import stat
import tempfile
import textwrap
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

from midnet_bench.campaign.rows import SCHEMA
from midnet_bench.errors import InputError, MidnetBenchError

APPLICATION_ID = 0x4D49444E
"""``MIDN``: SQLite's mark of the program that a file belongs to"""

FORMAT = 4
"""of stores; it changes with their tables and with the columns of any experiment, and none reads another's"""

JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
"""SQLite's; a journal that ends in it names a file that SQLite deletes when it takes the journal back"""
ROLLBACK_HEADER = b"SQLite format 3\0", b"\1\1"
"""what a store begins with, and what stands two bytes behind; of one with a write-ahead log it is 2 and 2"""


class StoreFull(MidnetBenchError):
    """The disk has no room left. The store holds every trial that was committed before."""


def create(path: Path, definition: str) -> sqlite3.Connection | None:
    """A connection to a new store at ``path`` that holds ``definition``; None if the file is not empty.

    Raises:
        InputError: as :func:`refuse_traps`.
    """
    refuse_traps(path)
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


def open_existing(path: Path, is_writer: bool = False) -> sqlite3.Connection:
    """A connection to the store at ``path``. A reader changes no file, and may read while another one writes.

    Raises:
        InputError: the file is another program's, damaged, or another version's; or as :func:`refuse_traps`.
    """
    refuse_traps(path if is_writer else path.resolve())
    with explained(path):
        _refuse_write_ahead_log(path)
        try:
            return _connection(path, "rw" if is_writer else "ro")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_READONLY_ROLLBACK:
                raise
        with contextlib.suppress(FileNotFoundError):  # a campaign goes on and has just taken it back
            return _rolled_back_copy(path)
        return _connection(path, "ro")


def _connection(path: Path, mode: str) -> sqlite3.Connection:
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", 30, isolation_level=None, uri=True)
    # invalid UTF-8 is reported by the reader of the text, which knows the trial's id
    connection.text_factory = lambda text: text.decode(errors="replace")
    with _closed_on_error(connection):
        _check(connection, path)
    return connection


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


def _refuse_write_ahead_log(path: Path) -> None:
    """Raises InputError if the file is SQLite's with a log beside it, which even a reader would write to."""
    with path.open("rb") as file:
        begins, _, versions = file.read(16), file.read(2), file.read(2)
    if begins == ROLLBACK_HEADER[0] and versions != ROLLBACK_HEADER[1]:
        raise InputError(f"{path}: another program's SQLite file, not a campaign store; left as it is")


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
    alien = connection.execute("SELECT type, name FROM sqlite_master WHERE type IN ('view', 'trigger')")
    if found := alien.fetchone():
        raise InputError(f"{path}: no store of midnet-bench: it has a {found[0]}; move it away")
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
