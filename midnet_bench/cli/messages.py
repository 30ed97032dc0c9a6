"""What commands say: results on standard output, and lines on stderr and in the file of ``--log-file``.

Every module speaks through ``logging.getLogger("midnet_bench")``: ``debug`` what ``-v`` shows, ``info`` what
``-q`` silences, ``warning`` and ``error`` always. Of a table on standard output no digit, verdict or name is
ever cut.
"""

import contextlib
import errno
import io
import itertools
import json
import logging
import os
import re
import select
import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from midnet_bench import __version__, compiled
from midnet_bench.errors import InputError, MidnetBenchError

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table

log = logging.getLogger("midnet_bench")

FEW_LOOPS = 3  # compiled without a word: they take a second
LONGEST = 300  # letters of a line that says what is wrong
READER_GONE = 141  # exit code of a program whose reader has closed the pipe, as a shell reports it
CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)
MOST_COLUMNS = 7
PIPE_WIDTH = 80  # where standard output is no terminal
READABLE = 20  # characters: a column of sentences is not made narrower, if it can be helped
GAP = 2  # blanks that tabulate puts between columns
UNLIMITED = sys.maxsize  # characters in a line
NO_BREAK = "\N{NO-BREAK SPACE}"
WHOLE: Any = {"break_long_words": False, "break_on_hyphens": False}  # words, in lines that are filled
_NUMBER = re.compile(r"[-+±.,\d\s\[\]]*|n/a")


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


class _Column(NamedTuple):
    header: str
    cells: list[str]
    is_text: bool  # whether it may take several lines

    def unbroken(self, splits: bool) -> "_Column":
        """The same; of numbers no line ends but, if ``splits``, before an interval."""
        if self.is_text:
            return self
        ends = f"{NO_BREAK}[", f"{' ' if splits else NO_BREAK}["
        return self._replace(cells=[cell.replace(" ", NO_BREAK).replace(*ends) for cell in self.cells])

    def widths(self) -> tuple[int, int, int]:
        """The narrowest, the one with the header on several lines, and the one on one line."""
        header = max(map(len, self.header.split(" ")))
        whole = max(map(len, self.cells))
        least = max(len(word) for cell in self.cells for word in cell.split(" "))
        if self.is_text:
            least = max(least, min(whole, READABLE))
        return max(header, least), max(header, whole), max(len(self.header), whole)


def width() -> int:
    """Characters in a line of standard output."""
    return shutil.get_terminal_size((PIPE_WIDTH, 24)).columns


def filled(text: str, most: int, indent: str = "") -> list[str]:
    """A sentence in lines of at most ``most`` characters; a longer word stays whole."""
    return textwrap.wrap(shown(text), most, initial_indent=indent, subsequent_indent=indent, **WHOLE)


def print_json(document: Any) -> None:
    """Print one JSON document."""
    typer.echo(json.dumps(document, indent=1, allow_nan=False))


def show(
    experiment: str | None,
    tables: "Sequence[Table]",
    as_json: bool = False,
    wide: bool = False,
    **more: Any,
) -> None:
    """Print tables for people, or as one JSON document that says ``more`` beside them.

    ``wide``: all columns, however long the lines.
    """
    if as_json:
        from midnet_bench.analysis.tables import to_json

        print_json(to_json(experiment, tables, **more))
        return
    for table in tables:
        typer.echo(drawn(table, None if wide else width()) + "\n")


def print_lines(sentences: Iterable[str], indent: str = "") -> None:
    """Print sentences, each from the beginning of a line; an empty one is an empty line."""
    for sentence in sentences:
        typer.echo("\n".join(filled(sentence, width(), indent) or [""]))


def drawn(table: "Table", most: int | None) -> str:
    """A table as lines of text.

    What is too wide, or has more than ``MOST_COLUMNS``, loses the columns that ``table.beside`` lists, the
    last first; then numbers go above their intervals; then each row becomes lines of its own.

    Args:
        table: any.
        most: characters in a line; None: all columns, however wide.
    """
    from midnet_bench.analysis.tables import in_words

    columns: dict[str, _Column] = {}
    for name, cells in zip(table.columns, zip(*table.cells(), strict=True), strict=True):
        values = (row.get(name) for row in table.rows)
        is_text = any(isinstance(value, str) and not _NUMBER.fullmatch(value) for value in values)
        header = table.labels[name] if name in table.labels else in_words(name)
        columns[name] = _Column(shown(header), [*map(shown, cells)], is_text)
    if not columns:
        return "\n".join([*filled(table.title, most or width()), "nothing", *table.notes])
    most = most or UNLIMITED
    kept, beside = dict(columns), [name for name in table.beside if name in columns]
    while (lines := _grid([*kept.values()], most)) is None and beside:
        del kept[beside.pop()]
    remaining = [*kept.values()]
    lines = lines or _grid(remaining, most, splits=True) or _as_rows(remaining, most)
    if len(kept) < len(columns):
        names = ", ".join(column.header for name, column in columns.items() if name not in kept)
        lines += filled(f"Left out: {names}; --wide prints all columns.", most)
    notes = [line for note in table.notes for line in filled(note, most)]
    return "\n".join([*filled(table.title, most), *lines, *notes])


def _grid(columns: Sequence[_Column], most: int, splits: bool = False) -> list[str] | None:
    """Headers above, a row for each; None if that does not fit. ``splits``: intervals may go below."""
    from tabulate import tabulate  # type: ignore[import-untyped]

    columns = [column.unbroken(splits) for column in columns]
    widths = _widths(columns, most)
    if widths is None:
        return None
    blocks = [
        (textwrap.wrap(column.header, size or 1, **WHOLE), [_folded(cell, size) for cell in column.cells])
        for column, size in zip(columns, widths, strict=True)
    ]
    height = max(len(header) for header, _ in blocks)  # headers end where the numbers begin
    rows = zip(*([""] * (height - len(header)) + header + cells for header, cells in blocks), strict=True)
    aligned = ["left" if column.is_text else "right" for column in columns]
    text = tabulate(rows, (), "plain", colalign=aligned, disable_numparse=True, preserve_whitespace=True)
    return [line.rstrip() for line in text.replace(NO_BREAK, " ").split("\n")]


def _folded(text: str, size: int) -> str:
    return text if len(text) <= size else textwrap.fill(text, size, **WHOLE)


def _widths(columns: Sequence[_Column], most: int) -> list[int] | None:
    """How wide each column is; None if they do not fit, or are more than a terminal's ``MOST_COLUMNS``."""
    if len(columns) > MOST_COLUMNS and most < UNLIMITED:
        return None
    room = most - GAP * (len(columns) - 1)
    least, widths, whole = ([*sizes] for sizes in zip(*(column.widths() for column in columns), strict=True))
    if sum(whole) <= room:
        return whole
    if sum(least) > room:
        return None
    while sum(widths) > room:
        widest = max(range(len(columns)), key=lambda index: (widths[index] > least[index], widths[index]))
        widths[widest] -= 1
    return widths


def _as_rows(columns: Sequence[_Column], most: int) -> list[str]:
    """Each row of the table as a line with what it is of, and a line for each number."""
    texts = 0
    while texts < 2 and texts < len(columns) - 1 and columns[texts].is_text:
        texts += 1
    of, others = columns[: max(texts, 1)], columns[max(texts, 1) :]
    label = max((len(column.header) for column in others), default=0)
    lines = []
    for number in range(len(columns[0].cells)):
        names = [
            f"{column.header} {cell}".strip() if _NUMBER.fullmatch(cell) else cell
            for column in of
            for cell in (column.cells[number],)
        ]
        lines += filled(", ".join(filter(None, names)), most)
        for column in others:
            if column.cells[number]:
                first = f"  {column.header:{label}}  "
                lines += textwrap.wrap(
                    column.cells[number],
                    max(most, len(first) + 1),
                    initial_indent=first,
                    subsequent_indent=" " * len(first),
                    **WHOLE,
                )
    return lines
