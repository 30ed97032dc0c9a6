"""Files that are there in full or not at all, and one rule for a full disk."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from midnet_bench.errors import InputError, MidnetBenchError

DISK_IS_FULL = (errno.ENOSPC, errno.EDQUOT)
"""error numbers of a disk, or of a user's share of it, that has no room left"""


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write a file in full or not at all: see :func:`draft_of`, with its errors.

    Args:
        path: the file; its folder is made if it is not there.
        content: a str is written as UTF-8.
    """
    with draft_of(path) as draft, draft.open("wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        file.flush()
        os.fsync(file.fileno())


@contextlib.contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """The path of a draft beside ``path``, which takes its place when the block ends without an error.

    No reader sees half of a file, and an older file stays as it was if anything fails. The draft is removed
    then. The folder is made if it is not there.

    Raises:
        InputError: the place cannot be written (exit code 2: another place helps).
        MidnetBenchError: the disk is full (exit code 1: the command was right).
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        if not path.parent.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        os.replace(draft, path)
    except OSError as error:
        raise cannot_be_written(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)


def cannot_be_written(path: Path, error: OSError) -> MidnetBenchError:
    """What to raise when ``path`` cannot be written: one line, and whether it was the user's input."""
    if error.errno in DISK_IS_FULL:
        return MidnetBenchError(f"{path}: cannot be written: {error.strerror}; make room")
    return InputError(
        f"{path}: cannot be written: {error.strerror}; its folder must be one that you may write to"
    )
