"""Lines and numbers of a text log, with errors that name file and line."""

import gzip
import math
import zlib
from pathlib import Path

from midnet_bench.errors import InputError

_LONGEST_SHOWN = 30


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, gzipped or plain. Raises InputError if it cannot be read or holds no text."""
    try:
        data = path.read_bytes()
        if data.startswith(b"\x1f\x8b"):
            data = gzip.decompress(data)
        lines = data.decode("utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (EOFError, UnicodeDecodeError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read as a text file, gzipped or plain: {error}") from error
    if not any(line.strip() for line in lines):
        raise InputError(f"{path}: the file is empty; give a log with laser scans and odometry")
    return lines


def count_of(word: str) -> int | None:
    """The whole number that a word is, or None: no sign, no digits but 0 to 9 and nine of them at most."""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 9 else None


def shown(word: str) -> str:
    """A word for a message: in quotes, and no longer than a line has room for."""
    return repr(word if len(word) <= _LONGEST_SHOWN else f"{word[:_LONGEST_SHOWN]}...")


def numbers(words: list[str], where: str, what: str) -> list[float]:
    """``words`` as floats. Raises InputError ``where: what: ...`` naming the first that is none."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            raise InputError(f"{where}: {what}: {shown(word)} is not a number") from None
    return values


def finite(words: list[str], where: str, what: str) -> list[float]:
    """``words`` as finite floats. Raises InputError as ``numbers`` does, also for nan and inf."""
    values = numbers(words, where, what)
    for word, value in zip(words, values, strict=True):
        if not math.isfinite(value):
            raise InputError(f"{where}: {what}: {shown(word)} is not a finite number")
    return values
