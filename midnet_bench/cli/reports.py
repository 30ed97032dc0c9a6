"""The commands that read a campaign's store: ``report``; and what a campaign prints when it ends."""

import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.trial import Row

PIPE_WIDTH = 200


def _campaigns_folder(directory: Path) -> Path:
    """The folder itself. Raises InputError, with a hint, if it is none."""
    from midnet_bench.errors import InputError

    if directory.is_file():
        raise InputError(f"{directory}: give the campaign's folder, {directory.parent}, and no file in it")
    if not directory.is_dir():
        raise InputError(
            f"{directory}: there is no such folder; give a campaign's, such as results/labyrinth"
        )
    return directory


def _campaigns_folders(directories: list[Path]) -> list[Path]:
    return [_campaigns_folder(directory) for directory in directories]


Directory = Annotated[
    Path,
    typer.Argument(help="A campaign's folder, such as results/labyrinth.", callback=_campaigns_folder),
]


@app.command(rich_help_panel="Results")
def report(directory: Directory, as_json: options.Json = False) -> None:
    """Make all tables and figures of a campaign again, from its store alone."""
    from midnet_bench.errors import InputError

    if not present(directory, as_json):
        hint = "; see failures.csv there" if (directory / "failures.csv").exists() else ""
        raise InputError(f"{directory}: no finished trial yet{hint}")


@app.command(rich_help_panel="Results")
def verify(directory: Directory, as_json: options.Json = False) -> None:
    """Hold a campaign against what the paper states; exit 0 reproduced, 3 cannot tell, 4 not reproduced."""
    from midnet_bench.workflows.verify import verify as hold_against_paper

    table, code = hold_against_paper(directory)
    show([table], as_json)
    raise typer.Exit(code)


@app.command(rich_help_panel="Results")
def power(
    directory: Directory,
    difference: Annotated[float, typer.Option(help="Change of the success rate, percentage points.")] = 5.0,
    robots: Annotated[tuple[int, int], typer.Option(help="The two team sizes to compare.")] = (4, 5),
    probability: Annotated[float, typer.Option("--power", help="Chance of finding the change.")] = 0.8,
    as_json: options.Json = False,
) -> None:
    """Tell how many trials a change of the success rate needs to be found, from the results at hand."""
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.labyrinth.power import power_report

    if robots[0] == robots[1]:
        raise InputError(f"--robots {robots[0]} {robots[1]}: give two different team sizes")
    show([power_report(directory, difference, robots, probability)], as_json)


@app.command(rich_help_panel="Results")
def compare(
    directories: Annotated[
        list[Path],
        typer.Argument(help="Folders of detection or labyrinth campaigns.", callback=_campaigns_folders),
    ],
    output: options.Output = None,
    as_json: options.Json = False,
) -> None:
    """Tell what differs between campaigns of one experiment, seed by seed; labyrinths in one figure too."""
    from midnet_bench.workflows.compare import write_comparison

    show(write_comparison(directories, output or Path("results/comparison")), as_json)


def present(directory: Path, as_json: bool) -> bool:
    """Write a campaign's CSV files, tables and figures, and print the tables; whether there was any row."""
    from midnet_bench.workflows.report import write_report

    tables = write_report(directory)
    has_rows = any(table.rows for table in tables)
    if has_rows or as_json:
        show(tables, as_json)
    return has_rows


def show(tables: "list[Table]", as_json: bool) -> None:
    """Print tables for people, or as JSON."""
    if as_json:
        typer.echo(json.dumps(json_of(tables), indent=1, allow_nan=False))
        return
    for table in tables:
        _print(table)


def json_of(tables: "Iterable[Table]") -> "dict[str, list[Row]]":
    """The tables' rows by title, ready for JSON, where a number that is not defined is null."""
    return {
        table.title: [
            {
                name: None if isinstance(value, float) and not math.isfinite(value) else value
                for name, value in row.items()
            }
            for row in table.rows
        ]
        for table in tables
    }


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
