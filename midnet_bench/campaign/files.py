"""Files that are there in full or not at all."""

import contextlib
import os
from pathlib import Path

from midnet_bench.errors import MidnetBenchError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Writes ``content`` beside ``path``, then puts it in its place, so that no reader sees half of it.

    Raises:
        MidnetBenchError: the folder cannot be written, or there is no room; an older file is left as it was.
    """
    draft = path.with_name(f".{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.write_bytes(content.encode() if isinstance(content, str) else content)
        os.replace(draft, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise MidnetBenchError(f"{path}: cannot be written: {error.strerror}") from error
