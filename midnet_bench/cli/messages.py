"""What commands say: results on standard output, and lines on stderr and in the file of ``--log-file``.

Every module speaks through ``logging.getLogger("midnet_bench")``: ``debug`` what ``-v`` shows, ``info`` what
``-q`` silences, ``warning`` and ``error`` always.
"""

import contextlib
import errno
import io
import itertools
import logging
import os
import select
import sys
from collections.abc import Iterator
from pathlib import Path

from midnet_bench import __version__, compiled
from midnet_bench.errors import InputError, MidnetBenchError

log = logging.getLogger("midnet_bench")

FEW_LOOPS = 3  # compiled without a word: they take a second
LONGEST = 300  # letters of a line that says what is wrong
READER_GONE = 141  # exit code of a program whose reader has closed the pipe, as a shell reports it
CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


class _Stderr(logging.Handler):
    """Bare lines on whatever stderr is when the line comes."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            print(shown(record.getMessage()), file=sys.stderr, flush=True)
        except OSError:  # its reader has gone: no reason to stop
            sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lasts


_handlers: list[logging.Handler] = []


def set_up(*, quiet: bool = False, verbose: bool = False, log_file: Path | None = None) -> None:
    """Direct the messages of one command, in place of what an earlier call set up.

    Raises:
        InputError: ``quiet`` and ``verbose`` at once, or the log file cannot be written.
    """
    if quiet and verbose:
        raise InputError("--quiet and --verbose: give one of the two")
    shut_down()
    _add(_Stderr(), logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)
    log.setLevel(logging.DEBUG)
    log.propagate = False
    if log_file is not None:
        try:
            log_file.parent.mkdir(parents=True, exist_ok=True)
            to_file = logging.FileHandler(log_file, encoding="utf-8")
        except OSError as error:
            raise InputError(f"--log-file {log_file}: cannot be written: {error.strerror}") from error
        to_file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        _add(to_file, logging.DEBUG)
    log.debug("midnet-bench %s: %s", __version__, " ".join(sys.argv[1:]))


def _add(handler: logging.Handler, least: int) -> None:
    handler.setLevel(least)
    _handlers.append(handler)
    log.addHandler(handler)


def shut_down() -> None:
    """Close what :func:`set_up` opened."""
    while _handlers:
        handler = _handlers.pop()
        log.removeHandler(handler)
        handler.close()


def announce_compiling() -> None:
    """Say so once when this process compiles several loops, as after an installation."""
    done = itertools.count(1)

    def count() -> None:
        if next(done) == FEW_LOOPS:
            log.info("compiling loops, once: up to a minute")

    compiled.after_compiling[:] = [count]


def level() -> int:
    """From which level on messages reach stderr."""
    return min((one.level for one in log.handlers if isinstance(one, _Stderr)), default=logging.INFO)


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


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Standard output for one command, written out to its last line.

    Raises:
        MidnetBenchError: it is closed, or cannot be written.
        SystemExit: 141; the reader of the pipe has gone.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lasts
        os.set_inheritable(sys.stderr.fileno(), True)  # as number 2: workers need one
    if sys.stdout is None:
        # the next file to be opened would take its number, and what a library in C prints would land there
        raise MidnetBenchError("standard output is closed; direct it somewhere, such as to /dev/null")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # for characters that the terminal lacks
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        # rich and typer make the one into the other; an exit for any other reason stays as it is
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        if not _reader_has_gone():
            raise MidnetBenchError(
                "a connection to another program broke: it has ended, or was ended; run the command again"
            ) from error
        _drop_the_rest()
        raise SystemExit(READER_GONE) from None
    except OSError as error:
        if error.errno not in CANNOT_WRITE:
            raise
        _drop_the_rest()
        raise MidnetBenchError(f"the output cannot be written: {error.strerror}") from error


def _reader_has_gone() -> bool:
    """Whether standard output is a pipe without a reader."""
    if not hasattr(select, "poll"):  # Windows tells no more
        return True
    poll = select.poll()
    try:
        output = sys.stdout.fileno()
        if os.path.samestat(os.fstat(output), os.stat(os.devnull)):
            return True  # rich has put it in the place of the broken output
        poll.register(output, 0)
    except OSError:  # it is no file
        return False
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def _drop_the_rest() -> None:
    """Send what is still buffered to /dev/null: Python would try to write it again when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
