"""Messages of commands: lines on stderr, and in the log file of ``--log-file``.

Every module speaks through ``logging.getLogger("midnet_bench")``: ``debug`` what ``-v`` shows, ``info`` what
``-q`` silences, ``warning`` and ``error`` always.
"""

import itertools
import logging
import os
import sys
from pathlib import Path

from midnet_bench import __version__, compiled
from midnet_bench.errors import InputError

log = logging.getLogger("midnet_bench")


FEW_LOOPS = 3
"""compiled without a word: they take a second"""
LONGEST = 300
"""letters of a line that says what is wrong"""
_handlers: list[logging.Handler] = []


class _Stderr(logging.Handler):
    """Bare lines on whatever stderr is when the line comes."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            print(shown(record.getMessage()), file=sys.stderr, flush=True)
        except OSError:  # its reader has gone: no reason to stop
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lasts


def set_up(*, quiet: bool = False, verbose: bool = False, log_file: Path | None = None) -> None:
    """Direct the messages of one command, in place of what an earlier call set up.

    Raises:
        InputError: ``quiet`` and ``verbose`` at once, or the log file cannot be written.
    """
    if quiet and verbose:
        raise InputError("--quiet and --verbose: give one of the two")
    shut_down()
    console = _Stderr()
    console.setLevel(logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)
    _add(console)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    if log_file is not None:
        try:
            log_file.parent.mkdir(parents=True, exist_ok=True)
            to_file = logging.FileHandler(log_file, encoding="utf-8")
        except OSError as error:
            raise InputError(f"--log-file {log_file}: cannot be written: {error.strerror}") from error
        to_file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        to_file.setLevel(logging.DEBUG)
        _add(to_file)
    log.debug("midnet-bench %s: %s", __version__, " ".join(sys.argv[1:]))


def announce_compiling() -> None:
    """Say so once when this process compiles several loops, as after an installation."""
    done = itertools.count(1)

    def count() -> None:
        if next(done) == FEW_LOOPS:
            log.info("compiling loops, once: up to a minute")

    compiled.after_compiling[:] = [count]


def shut_down() -> None:
    """Close what :func:`set_up` opened."""
    while _handlers:
        handler = _handlers.pop()
        log.removeHandler(handler)
        handler.close()


def _add(handler: logging.Handler) -> None:
    _handlers.append(handler)
    log.addHandler(handler)


def level() -> int:
    """From which level on messages reach stderr."""
    return min(
        (handler.level for handler in log.handlers if isinstance(handler, _Stderr)), default=logging.INFO
    )


def one_line(text: str) -> str:
    """``text`` as :func:`shown`, and at most ``LONGEST`` letters.

    First the longest words lose their middle, then the whole: a message begins with what it is about and ends
    with what is wrong.
    """
    line = shown(text)
    for most in (120, 60, 30):
        if len(line) > LONGEST:
            line = " ".join(_shortened(word, most) for word in line.split(" "))
    return _shortened(line, LONGEST)


def _shortened(text: str, most: int) -> str:
    """Both ends of a text, together ``most`` letters at most."""
    half = (most - 1) // 2
    return text if len(text) <= most else f"{text[:half]}\N{HORIZONTAL ELLIPSIS}{text[-half:]}"


def shown(text: str) -> str:
    """``text`` as a terminal can show it in one line: control characters as escapes."""
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text
    )


def counted(count: int, noun: str) -> str:
    """``1 trial``, ``2 trials``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def note(line: str) -> None:
    """A line that ``-q`` silences."""
    log.info("%s", line)


def refuse(text: object) -> None:
    """The one line that ends a command which could not do its work."""
    log.error("%s", one_line(f"error: {text}"))


def log_folder(directory: Path) -> None:
    """The line that a command with results ends with."""
    files = sum(path.is_file() for path in directory.rglob("*"))
    note(f"results in {directory} ({counted(files, 'file')})")
