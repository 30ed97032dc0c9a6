"""Standard output: sentences, JSON, and tables, of which no digit, verdict or name is ever cut."""

import json
import re
import shutil
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import typer

from midnet_bench.cli.messages import shown

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table

MOST_COLUMNS = 7
PIPE_WIDTH = 80  # where standard output is no terminal
READABLE = 20  # characters: a column of sentences is not made narrower, if it can be helped
GAP = "  "
_NUMBER = re.compile(r"[-+±.,\d\s\[\]]*|n/a")
_INTERVAL = re.compile(r" (?=\[)")


class _Column(NamedTuple):
    header: str
    cells: list[str]
    is_text: bool  # whether it may take several lines

    def pieces(self, cell: str, splits: bool) -> list[str]:
        """Where a cell may be broken: a text between words; if ``splits``, a number before its interval."""
        if self.is_text:
            return cell.split()
        return _INTERVAL.split(cell) if splits else [cell]

    def widths(self, splits: bool) -> tuple[int, int, int]:
        """The narrowest, the one with the header on several lines, and the one on one line."""
        header = max(map(len, self.header.split()), default=0)
        whole = max(map(len, self.cells), default=0)
        least = max((len(piece) for cell in self.cells for piece in self.pieces(cell, splits)), default=0)
        if self.is_text:
            least = max(least, min(whole, READABLE))
        return max(header, least), max(header, whole), max(len(self.header), whole)


def width() -> int:
    """Characters in a line of standard output."""
    return shutil.get_terminal_size((PIPE_WIDTH, 24)).columns


def filled(text: str, most: int) -> list[str]:
    """A sentence in lines of at most ``most`` characters; a longer word stays whole."""
    return textwrap.wrap(shown(text), most, break_long_words=False, break_on_hyphens=False)


def print_json(document: Any) -> None:
    """Print one JSON document."""
    typer.echo(json.dumps(document, indent=1, allow_nan=False))


def show(
    experiment: str | None, tables: "Sequence[Table]", as_json: bool = False, wide: bool = False
) -> None:
    """Print tables for people, or as one JSON document; ``wide``: all columns, however long the lines."""
    if as_json:
        from midnet_bench.analysis.tables import to_json

        print_json(to_json(experiment, tables))
        return
    for table in tables:
        typer.echo(drawn(table, None if wide else width()) + "\n")


def print_lines(sentences: Iterable[str]) -> None:
    """Print sentences, each from the beginning of a line; an empty one is an empty line."""
    for sentence in sentences:
        typer.echo("\n".join(filled(sentence, width()) or [""]))


def drawn(table: "Table", most: int | None) -> str:
    """A table as lines of text.

    What is too wide, or has more than ``MOST_COLUMNS``, loses the columns that ``table.beside`` lists, the
    last first; then numbers go above their intervals; then each row becomes lines of its own.

    Args:
        table: any.
        most: characters in a line; None: all columns, however wide.
    """
    from midnet_bench.analysis.tables import in_words

    heads = [table.labels[name] if name in table.labels else in_words(name) for name in table.columns]
    cells = [[shown(cell) for cell in row] for row in table.cells()]
    columns = {
        name: _Column(
            shown(heads[index]),
            [row[index] for row in cells],
            any(
                isinstance(row.get(name), str) and not _NUMBER.fullmatch(str(row[name])) for row in table.rows
            ),
        )
        for index, name in enumerate(table.columns)
    }
    if not columns:
        return "\n".join([*filled(table.title, most or width()), "nothing", *table.notes])
    if most is None:
        widths = [column.widths(False)[2] for column in columns.values()]
        lines = [shown(table.title), *_laid_out(list(columns.values()), widths), *map(shown, table.notes)]
        return "\n".join(lines)
    left_out: list[str] = []
    beside = [name for name in table.beside if name in columns]
    while len(columns) - len(left_out) > MOST_COLUMNS and beside:
        left_out.append(beside.pop())
    while True:
        kept = [column for name, column in columns.items() if name not in left_out]
        splits = not beside
        found = _widths(kept, most, False) or (_widths(kept, most, True) if splits else None)
        if found is not None and len(kept) <= MOST_COLUMNS:
            lines = _laid_out(kept, found)
            break
        if not beside:
            lines = _as_rows(kept, most)
            break
        left_out.append(beside.pop())
    if left_out:
        names = ", ".join(columns[name].header for name in columns if name in left_out)
        lines += filled(f"Left out: {names}; --wide prints all columns.", most)
    notes = [line for note in table.notes for line in filled(note, most)]
    return "\n".join([*filled(table.title, most), *lines, *notes])


def _widths(columns: Sequence[_Column], most: int, splits: bool) -> list[int] | None:
    """How wide each column is; None if they do not fit."""
    room = most - len(GAP) * (len(columns) - 1)
    least, middle, whole = ([*each] for each in zip(*(one.widths(splits) for one in columns), strict=True))
    if sum(whole) <= room:
        return whole
    if sum(least) > room:
        return None
    while sum(middle) > room:
        widest = max(range(len(columns)), key=lambda k: (middle[k] > least[k], middle[k]))
        middle[widest] -= 1
    return middle


def _laid_out(columns: Sequence[_Column], widths: Sequence[int]) -> list[str]:
    heads = [column.header for column in columns]
    lines = _row(heads, columns, widths, header=True) if any(heads) else []
    for row in zip(*(column.cells for column in columns), strict=True):
        lines += _row(row, columns, widths)
    return lines


def _row(
    cells: Sequence[str], columns: Sequence[_Column], widths: Sequence[int], header: bool = False
) -> list[str]:
    """One row, as many lines as its highest cell takes."""
    blocks = []
    for cell, column, size in zip(cells, columns, widths, strict=True):
        if len(cell) <= size:
            blocks.append([cell])
        elif column.is_text or header:
            blocks.append(textwrap.wrap(cell, size, break_long_words=False, break_on_hyphens=False))
        else:
            blocks.append(column.pieces(cell, splits=True))
    height = max(map(len, blocks))
    lines = []
    for number in range(height):
        parts = []
        for block, column, size in zip(blocks, columns, widths, strict=True):
            # headers of several lines end where the numbers begin
            at = number - (height - len(block)) if header else number
            part = block[at] if 0 <= at < len(block) else ""
            parts.append(part.ljust(size) if column.is_text else part.rjust(size))
        lines.append(GAP.join(parts).rstrip())
    return lines


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
                    break_long_words=False,
                    break_on_hyphens=False,
                ) or [first.rstrip()]
    return lines
