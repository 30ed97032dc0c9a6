"""Files that are there in full or not at all, and one rule for a full disk."""

import contextlib
import csv
import errno
import glob
import gzip
import hashlib
import io
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import midnet_bench
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.settings import Scalar

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PACKAGE = Path(midnet_bench.__file__).parent
NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0)
LONGEST_NAME = 150
"""bytes of a file's name that is made of values: room for an ending, and for the name of a draft"""
DISK_IS_FULL = (errno.ENOSPC, errno.EDQUOT)
"""error numbers of a disk, or of a user's share of it, that has no room left"""

DRAFT_KEPT_S = 3600.0
"""after so long without a change a draft is of a process that was killed, also where files have no locks"""
LOCKED_WITHIN_S = 1.0  # a draft, after it is made


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """What is in an ordinary file, unpacked if it is gzipped; at most so many bytes.

    Raises:
        OSError: it cannot be read; ``strerror`` says why, also of a device and of one that is too large.
        ValueError: no file can have this name.
    """
    # not blocking: opening a pipe that nobody writes to would wait for ever
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | NOT_BLOCKING)) as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "it is a folder, a device or a pipe; give an ordinary file")
        too_large = OSError(errno.EFBIG, f"it holds more than {most_bytes // 1_000_000} MB")
        if found.st_size > most_bytes:
            raise too_large
        content = file.read(most_bytes + 1)
    if not content.startswith(b"\x1f\x8b"):
        return content
    with gzip.open(io.BytesIO(content)) as packed:
        unpacked = packed.read(most_bytes + 1)
    if len(unpacked) > most_bytes:
        raise too_large
    return unpacked


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file in full or not at all, a str as UTF-8: see :func:`temporary_path`, with its errors."""
    with temporary_path(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def temporary_path(path: Path) -> Iterator[Path]:
    """The path of a draft beside ``path``, which takes its place when the block ends without an error.

    No reader sees half of a file, and an older file stays as it was if anything fails. The draft is removed
    then; that of a process that was killed, when the same file is written again. It has a random name and is
    there, empty, as a new file: no link that lies in the folder leads it elsewhere. The folder is made if it
    is not there.

    Raises:
        InputError: the place cannot be written (exit code 2: another place helps).
        MidnetBenchError: the disk is full (exit code 1: the command was right).
    """
    try:
        with _draft(path, lambda draft: os.close(os.open(draft, os.O_CREAT | os.O_EXCL, 0o666))) as draft:
            yield draft
            _sync(draft, os.O_RDWR)
            os.replace(draft, path)
            if os.name == "posix":  # elsewhere a folder cannot be opened
                with contextlib.suppress(OSError):  # some file systems cannot; the file itself is safe
                    _sync(path.parent, os.O_RDONLY)
    except OSError as error:
        raise cannot_be_written(path, error) from error


@contextlib.contextmanager
def temporary_folder(path: Path) -> Iterator[Path]:
    """An empty folder beside ``path`` for drafts of it, removed after the block as a draft is.

    Raises:
        OSError: it cannot be made.
    """
    with _draft(path, lambda draft: draft.mkdir(mode=0o700)) as draft:
        yield draft


@contextlib.contextmanager
def _draft(path: Path, make: Callable[[Path], None]) -> Iterator[Path]:
    """What ``make`` makes beside ``path`` under a random name; locked, so that others see it is in use."""
    draft = path.with_name(f".{path.name}.{secrets.token_hex(8)}.{os.getpid()}.new")
    if not path.parent.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
    _forget_drafts(path)
    make(draft)
    held: int | None = None
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            held = _locked(draft)
        yield draft
    finally:
        if held is not None:
            os.close(held)
        with contextlib.suppress(OSError):
            _remove(draft)
        _forget_drafts(path)  # again: the encoder of a process that was killed may have ended only now


def _locked(draft: Path) -> int:
    """The open file of a draft, locked. Raises OSError if another process has it or there are no locks."""
    if fcntl is None:
        raise OSError(errno.ENOLCK, "no locks")
    opened = os.open(draft, os.O_RDONLY | NOT_BLOCKING | getattr(os, "O_NOFOLLOW", 0))
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(opened)
        raise
    return opened


def _remove(draft: Path) -> None:
    if draft.is_dir() and not draft.is_symlink():
        shutil.rmtree(draft)
    else:
        draft.unlink(missing_ok=True)


def _sync(path: Path, flags: int) -> None:
    """Waits until what was written is on the disk: a name may get there before what it names."""
    opened = os.open(path, flags)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def plain_name(name: str) -> str:
    """``name`` if a file can be called so; else what can be shown of it, and a digest that tells it apart."""
    plain = "".join(letter if letter.isprintable() and letter not in '/\\:*?"<>|' else "-" for letter in name)
    if plain == name and len(name.encode()) <= LONGEST_NAME:
        return name
    digest = hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:8]
    return f"{plain.encode(errors='replace')[:LONGEST_NAME].decode(errors='ignore')}-{digest}"


def _forget_drafts(path: Path) -> None:
    """Removes drafts that processes left which were killed, also drafts of such drafts."""
    ours = re.compile(rf"\.+{re.escape(path.name)}(\.[0-9a-f]{{16}}\.\d+\.new)+")
    for draft in path.parent.glob(f".*{glob.escape(path.name)}.*.new"):
        if not ours.fullmatch(draft.name):
            continue
        with contextlib.suppress(OSError):  # it is in use, or another process has just removed it
            age_s = time.time() - draft.lstat().st_mtime
            if age_s <= LOCKED_WITHIN_S:
                continue
            try:
                os.close(_locked(draft))
            except BlockingIOError:
                continue
            except OSError:
                if age_s <= DRAFT_KEPT_S:
                    continue
            _remove(draft)


def cannot_be_written(path: Path, error: OSError) -> MidnetBenchError:
    """What to raise when ``path`` cannot be written: one line, and whether it was the user's input."""
    if error.errno in DISK_IS_FULL:
        return MidnetBenchError(f"{path}: cannot be written: {error.strerror}; make room")
    is_taken = error.errno in (errno.EEXIST, errno.ENOTDIR)
    hint = "give another place" if is_taken else "its folder must be one that you may write to"
    return InputError(f"{path}: cannot be written: {error.strerror}; {hint}")


def installed() -> bool:
    """Whether this is an installed package, not a checkout."""
    return (PACKAGE / "campaigns").is_dir()


def shipped_folder(name: str, in_repository: str) -> Path:
    """A folder that comes with the package, such as ``campaigns``; ``setup.py`` names them all.

    ``in_repository``: its path in a checkout, where it has its home.
    """
    installed = PACKAGE / name
    return installed if installed.is_dir() else PACKAGE.parent / in_repository


class CsvFile:
    """A CSV file that is written row by row; a context manager. Its columns may become more on the way."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._columns: dict[str, None] = {}
        self._header: tuple[str, ...] | None = None

    def add(self, key: Mapping[str, Scalar], rows: Iterable[Mapping[str, Scalar]]) -> None:
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
