"""Files that are there in full or not at all."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from midnet_bench.errors import InputError, MidnetBenchError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Writes ``content`` beside ``path``, then puts it in its place, so that no reader sees half of it.

    An older file is left as it was if that fails.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room.
    """
    with draft_of(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A path beside ``path`` to write to; the file takes its place when the context ends without an error.

    The folder is made. After an error the draft is gone and an older file is as it was.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room.
    """
    draft = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield draft
            os.replace(draft, path)
        except BaseException:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)
            raise
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise MidnetBenchError(f"{path}: cannot be written: {error.strerror}; make room") from error
        raise InputError(
            f"{path}: cannot be written: {error.strerror}; its folder must be one that you may write to"
        ) from error
