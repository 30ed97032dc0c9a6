"""The commands that read a campaign's results: ``report``, ``plot``, ``verify``, ``power``, ``compare``."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from midnet_bench.analysis.tables import Table

PIPE_WIDTH = 400


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


@command("Results", example="midnet-bench plot results/labyrinth -o figures")
def plot(
    directory: Directory,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the figures [default: the campaign's]."
        ),
    ] = None,
    x: Annotated[
        str | None,
        typer.Option("--x", metavar="FACTOR", help="Draw scores over this numeric factor of the grid."),
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            "--y",
            metavar="COLUMN",
            help="Which score, such as f1, or another column (default the main scores).",
        ),
    ] = None,
    formats: Annotated[
        str, typer.Option(metavar="NAME,NAME", help="Formats of the files: png, svg, pdf.")
    ] = "png,svg",
) -> None:
    """Draw a campaign's figures as PNG, SVG or PDF from the stored trials, without simulating."""
    from midnet_bench.workflows.report import plot as draw

    for file in draw(directory, output, x, y, [name.strip() for name in formats.split(",")]):
        typer.echo(file)


@command("Results", example="midnet-bench verify results/labyrinth")
def verify(directory: Directory, as_json: options.Json = False) -> None:
    """Check each claim of the paper against your results.

    Exit code: 0 all claims are reproduced, 3 some are inconclusive, 4 some are not reproduced.
    """
    from midnet_bench.workflows.verify import verify as check_claims

    name, table, code = check_claims(directory)
    show(name, [table], as_json)
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
    from midnet_bench.workflows.verify import power_report

    name, table = power_report(directory, difference, robots, probability)
    show(name, [table], as_json)


@command("Results", example="midnet-bench compare results/one results/other -o results/comparison")
def compare(
    directories: Annotated[
        list[Path],
        typer.Argument(
            help="Two or more folders of campaigns of one experiment, or one with --by.",
            callback=_campaigns_folders,
            autocompletion=completion.results,
        ),
    ],
    by: Annotated[
        str | None,
        typer.Option(
            metavar="FACTOR",
            help="A factor of the only campaign's grid, such as engine: compare its values.",
            show_default=False,
        ),
    ] = None,
    baseline: Annotated[
        str | None,
        typer.Option(
            metavar="VALUE",
            help="The factor's value that the others are compared with (default the first).",
            show_default=False,
        ),
    ] = None,
    fail_if_worse: Annotated[
        str | None,
        typer.Option(
            metavar="MEASURE",
            help="Exit code 1 if this score, such as f1, is significantly worse than the first's.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Also write tables and figures into this folder."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Compare campaigns on the seeds they share: each score's difference, and the settings that differ."""
    from midnet_bench.workflows.compare import compare as compare_campaigns
    from midnet_bench.workflows.compare import worse

    experiment, tables = compare_campaigns(directories, output, by, baseline)
    found = [] if fail_if_worse is None else worse(experiment, tables, fail_if_worse)
    show(experiment.name, tables, as_json)
    if output is not None and not as_json:
        messages.tell_where(output)
    for line in found:
        messages.log.error("%s", line)
    if found:
        raise typer.Exit(1)


def present(directory: Path, as_json: bool, drawn_from: int = 1) -> bool:
    """Write a campaign's CSV files, tables and figures, and print the tables; whether any trial finished.

    Figures are drawn from ``drawn_from`` finished trials on.
    """
    from midnet_bench.workflows.report import printed, write_report

    results, tables = write_report(directory, drawn_from)
    name = results.definition.experiment
    if results.finished or as_json:
        show(name, tables if as_json else printed(results, tables), as_json)
    return results.finished > 0


def show(experiment: str | None, tables: "list[Table]", as_json: bool) -> None:
    """Print tables for people, or as one JSON document."""
    if as_json:
        from midnet_bench.analysis.tables import to_json

        typer.echo(json.dumps(to_json(experiment, tables), indent=1, allow_nan=False))
        return
    for table in tables:
        _print(table)


def _print(table: "Table") -> None:
    from rich.console import Console

    # a pipe has no width; what reads it wants whole rows
    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    shown = _drawn(table, narrow=False)
    if Console(width=PIPE_WIDTH).measure(shown).maximum > console.width:
        shown = _drawn(table, narrow=True)
    console.print(shown)
    for note in table.notes:
        console.print(note, highlight=False)


def _drawn(table: "Table", narrow: bool) -> "RichTable":
    """The table for a terminal; where that is ``narrow``, names and intervals take several lines."""
    from rich import box
    from rich.table import Table as RichTable

    shown = RichTable(
        title=table.title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD if narrow else box.HEAVY_HEAD,
        pad_edge=not narrow,
        padding=(0, 1, 0, 0) if narrow else (0, 1),
    )
    for name in table.columns:
        justify: Literal["left", "right"] = "left" if name == table.columns[0] else "right"
        shown.add_column(name.replace("_", " ") if narrow else name, no_wrap=not narrow, justify=justify)
    for cells in table.cells():
        shown.add_row(*cells)
    return shown
