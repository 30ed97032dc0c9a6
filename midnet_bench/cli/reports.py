"""The commands that read a campaign's results: ``report``, ``plot``, ``verify``, ``power``, ``compare``."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table


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


@command(example="midnet-bench report results/labyrinth")
def report(directory: Directory, as_json: options.Json = False, wide: options.Wide = False) -> None:
    """Rebuild all tables and figures from the stored trials, without simulating."""
    from midnet_bench.errors import InputError

    if not present(directory, as_json, wide=wide):
        hint = "; see failures.csv there" if (directory / "failures.csv").exists() else ""
        raise InputError(f"{directory}: no finished trial yet{hint}")
    if not as_json:
        tell_page(directory)


@command(example="midnet-bench plot results/labyrinth -o figures")
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
) -> None:
    """Draw a campaign's figures as PNG and SVG from the stored trials, without simulating."""
    from midnet_bench.workflows.report import plot as draw

    for file in draw(directory, output, x, y):
        typer.echo(file)


@command(example="midnet-bench verify results/labyrinth")
def verify(
    directory: Directory,
    everything: Annotated[
        bool, typer.Option("--all", help="List the claims that are reproduced, too.")
    ] = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Check each claim of the paper against your results.

    Exit code: 0 all claims are reproduced, 3 some are inconclusive, 4 some are not reproduced.
    """
    from midnet_bench.workflows.verify import verify as check_claims

    name, table, code = check_claims(directory)
    if as_json or wide:
        show(name, [table], as_json, wide)
    else:
        _show_claims(directory, table, everything)
    raise typer.Exit(code)


@command(example="midnet-bench power results/labyrinth --difference 5 --robots 4 5")
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


@command(example="midnet-bench compare results/one results/other -o results/comparison")
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
    wide: options.Wide = False,
) -> None:
    """Compare campaigns on the seeds they share: each score's difference, and the settings that differ."""
    from midnet_bench.workflows.compare import comparison, worse

    found = comparison(directories, output, by, baseline)
    regressions = [] if fail_if_worse is None else worse(found.experiment, found.tables, fail_if_worse)
    if as_json or wide:
        show(found.experiment.name, found.tables, as_json, wide)
    else:
        say([*found.lines, ""])
        show(None, found.shown, as_json=False)
    if output is not None and not as_json:
        messages.tell_where(output)
    for line in regressions:
        messages.log.error("%s", line)
    if regressions:
        raise typer.Exit(1)


def present(directory: Path, as_json: bool, drawn_from: int = 1, wide: bool = False) -> bool:
    """Write a campaign's CSV files, tables and figures, and print the result; whether any trial finished.

    Figures are drawn from ``drawn_from`` finished trials on. ``wide``: print the main tables whole.
    """
    from midnet_bench.workflows.report import headline, printed, write_report

    results, tables = write_report(directory, drawn_from)
    first = None if as_json or wide else headline(results)
    if as_json:
        show(results.definition.experiment, tables, as_json)
    elif first is not None:
        show(None, first.tables, as_json=False)
        say([*first.sentences, "", first.following])
    elif results.finished:
        show(None, printed(results, tables), as_json, wide)
    return results.finished > 0


def _show_claims(directory: Path, table: "Table", everything: bool) -> None:
    """The counts first, then what is not reproduced and what is open."""
    from midnet_bench.analysis.claims import shown_claims

    summary, tables = shown_claims(table, everything)
    say([summary, ""])
    show(None, tables, as_json=False)
    reproduced = sum(row["verdict"] == "reproduced" for row in table.rows)
    if reproduced and not everything:
        say([f"reproduced: {_counted(reproduced, 'claim')}; --all lists them."])
    if (file := directory / "claims.csv").exists():
        say([f"Each in {file}"])


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def tell_page(directory: Path) -> None:
    """The last line of a command that wrote a campaign's page: what to open."""
    page = directory / "report.html"
    if page.exists():
        messages.log.info("Open %s", page)
    else:
        messages.tell_where(directory)


def show(experiment: str | None, tables: "Sequence[Table]", as_json: bool, wide: bool = False) -> None:
    """Print tables for people, or as one JSON document; ``wide``: all columns, however long the lines."""
    if as_json:
        from midnet_bench.analysis.tables import to_json

        typer.echo(json.dumps(to_json(experiment, tables), indent=1, allow_nan=False))
        return
    from midnet_bench.cli.terminal import drawn, width

    for table in tables:
        typer.echo(drawn(table, None if wide else width()) + "\n")


def say(sentences: "Iterable[str]") -> None:
    """Print sentences, each from the beginning of a line; an empty one is an empty line."""
    from midnet_bench.cli.terminal import filled, width

    typer.echo("\n".join(line for sentence in sentences for line in filled(sentence, width()) or [""]))
