"""The commands that read a campaign's results: ``report``, ``verify``, ``power``, ``compare``."""

import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.trial import Row

PIPE_WIDTH = 200


def _campaigns_folder(directory: Path) -> Path:
    """The folder itself. Raises InputError, with a hint, if it is none."""
    from midnet_bench.errors import InputError

    if directory.is_file():
        raise InputError(f"{directory}: this is a file; give the campaign's folder, {directory.parent}")
    if not directory.is_dir():
        raise InputError(
            f"{directory}: there is no such folder; give a campaign's, such as results/labyrinth"
        )
    return directory


def _campaigns_folders(directories: list[Path]) -> list[Path]:
    return [_campaigns_folder(directory) for directory in directories]


Directory = Annotated[
    Path,
    typer.Argument(
        help="A campaign's folder, such as results/labyrinth.",
        callback=_campaigns_folder,
        autocompletion=completion.results,
    ),
]


@command("Results", example="midnet-bench report results/labyrinth")
def report(directory: Directory, as_json: options.Json = False) -> None:
    """Rebuild all tables and figures from the stored trials, without simulating."""
    from midnet_bench.errors import InputError

    if not present(directory, as_json):
        hint = "; see failures.csv there" if (directory / "failures.csv").exists() else ""
        raise InputError(f"{directory}: no finished trial yet{hint}")
    if not as_json:
        messages.tell_where(directory)


@command("Results", example="midnet-bench verify results/labyrinth")
def verify(directory: Directory, as_json: options.Json = False) -> None:
    """Check each claim of the paper against your results.

    Exit code: 0 all claims are reproduced, 3 some are inconclusive, 4 some are contradicted.
    """
    from midnet_bench.workflows.verify import verify as hold_against_paper

    table, code = hold_against_paper(directory)
    show([table], as_json)
    raise typer.Exit(code)


@command("Results", example="midnet-bench power results/labyrinth --difference 5 --robots 4 5")
def power(
    directory: Directory,
    difference: Annotated[
        float, typer.Option(metavar="POINTS", help="Change of the success rate to detect, percentage points.")
    ] = 5.0,
    robots: Annotated[tuple[int, int], typer.Option(metavar="N N", help="The two team sizes to compare.")] = (
        4,
        5,
    ),
    probability: Annotated[
        float, typer.Option("--power", metavar="P", help="Probability of detecting the change.")
    ] = 0.8,
    as_json: options.Json = False,
) -> None:
    """Estimate how many trials you need to detect a given change of the labyrinth's success rate."""
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.labyrinth.power import power_report

    if robots[0] == robots[1]:
        raise InputError(f"--robots {robots[0]} {robots[1]}: give two different team sizes")
    show([power_report(directory, difference, robots, probability)], as_json)


@command("Results", example="midnet-bench compare results/one results/other -o results/comparison")
def compare(
    directories: Annotated[
        list[Path],
        typer.Argument(
            help="Two or more folders of detection or of labyrinth campaigns.",
            callback=_campaigns_folders,
            autocompletion=completion.results,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Also write tables and figures into this folder."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Compare campaigns on the seeds they share: difference and 95 % interval for each score."""
    from midnet_bench.workflows.compare import write_comparison

    show(write_comparison(directories, output or Path("results/comparison")), as_json)
    if output is not None and not as_json:
        messages.tell_where(output)


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
