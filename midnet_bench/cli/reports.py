"""The commands that read a campaign's store: ``report``; and what a campaign prints when it ends."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

if TYPE_CHECKING:
    from midnet_bench.report.tables import Table

PIPE_WIDTH = 200

Directory = Annotated[Path, typer.Argument(help="A campaign's folder, such as results/labyrinth.")]


@app.command(rich_help_panel="Results")
def report(directory: Directory, as_json: options.Json = False) -> None:
    """Make all tables and figures of a campaign again, from its store alone."""
    present(directory, as_json)


def present(directory: Path, as_json: bool) -> None:
    """Write a campaign's CSV files, tables and figures, and print the tables."""
    from midnet_bench.report.report import write_report

    tables = write_report(directory)
    if as_json:
        typer.echo(json.dumps({table.title: table.rows for table in tables}, indent=1).replace("NaN", "null"))
        return
    for table in tables:
        _print(table)


def _print(table: "Table") -> None:
    from rich.console import Console
    from rich.table import Table as RichTable

    shown = RichTable(title=table.title, title_justify="left", title_style="bold")
    for name in table.columns:
        shown.add_column(name, no_wrap=True, justify="left" if name == table.columns[0] else "right")
    for cells in table.cells():
        shown.add_row(*cells)
    # a pipe has no width; what reads it wants whole rows
    Console(width=None if sys.stdout.isatty() else PIPE_WIDTH).print(shown)
