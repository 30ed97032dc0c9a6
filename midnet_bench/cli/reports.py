"""The commands that read a campaign's results: ``report``, ``compare``, ``verify``."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command, print_json

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
    options.argument(
        "DIR",
        "A campaign's folder, such as results/labyrinth.",
        completion.results,
        callback=_campaigns_folder,
    ),
]


@command(example="midnet-bench report results/detection --x thresh_local --y f1 --format pdf")
def report(
    directory: Directory,
    x: Annotated[
        str | None, options.option("FACTOR", "Draw scores over this numeric factor of the grid.", "--x")
    ] = None,
    y: Annotated[
        str | None,
        options.option(
            "COLUMN", "Which score, such as f1, or another column (default the main scores).", "--y"
        ),
    ] = None,
    formats: Annotated[
        str | None,
        options.option("NAME,NAME", "Formats of the figures: pdf, png, svg (default png,svg).", "--format"),
    ] = None,
    output: Annotated[
        Path | None,
        options.output_option(
            "PATH",
            "Draw the figures only, into this folder, or one figure into this .pdf, .png or .svg file.",
        ),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Rebuild all tables, figures and the page from the stored trials, without simulating.

    With --x, --y, --format or -o only figures are drawn.
    """
    from midnet_bench.errors import InputError

    if x or y or formats or output:
        for file in _draw(directory, output, x, y, formats):
            typer.echo(file)
        return
    if not present(directory, as_json, wide=wide):
        hint = "; see failures.csv there" if (directory / "failures.csv").exists() else ""
        raise InputError(f"{directory}: no finished trial yet{hint}")
    if not as_json:
        log_page(directory)


def _draw(
    directory: Path, output: Path | None, x: str | None, y: str | None, formats: str | None
) -> list[Path]:
    """Draw figures; the files written."""
    import tempfile

    from midnet_bench.errors import InputError
    from midnet_bench.io.files import write_atomically
    from midnet_bench.workflows.report import FORMATS, plot

    wanted = FORMATS if formats is None else tuple(part.strip() for part in formats.split(","))
    if output is None or output.suffix not in (".pdf", ".png", ".svg"):
        return plot(directory, output, x, y, wanted)
    ending = output.suffix.removeprefix(".")
    if wanted not in (FORMATS, (ending,)):
        raise InputError(f"-o {output}: --format {formats} is another format; leave it out")
    with tempfile.TemporaryDirectory() as folder:
        figures = [one for one in plot(directory, folder, x, y, (ending,)) if one.suffix == output.suffix]
        if len(figures) > 1:
            raise InputError(f"-o {output}: {len(figures)} figures do not go into one file; give a folder")
        write_atomically(output, figures[0].read_bytes())
    return [output]


@command(example="midnet-bench compare results/one results/other -o results/comparison")
def compare(
    directories: Annotated[
        list[Path],
        options.argument(
            "DIR...",
            "Two or more folders of campaigns of one experiment; one with --by, --rank or --exact.",
            completion.results,
            callback=_campaigns_folders,
        ),
    ],
    by: Annotated[
        str | None,
        options.option("FACTOR", "A factor of the only campaign's grid, such as engine: compare its values."),
    ] = None,
    baseline: Annotated[
        str | None,
        options.option("VALUE", "The factor's value that the others are compared with (default the first)."),
    ] = None,
    fail_if_worse: Annotated[
        str | None,
        options.option(
            "MEASURE", "Exit code 1 if this score, such as f1, is significantly worse than the first's."
        ),
    ] = None,
    rank: Annotated[
        bool,
        options.flag(
            "Rank what the only campaign compares, the best first, and write leaderboard.md.", "--rank"
        ),
    ] = False,
    of: Annotated[
        list[str] | None,
        options.option(
            "FACTOR",
            "With --rank: a factor whose values are ranked; may be repeated (default: those that name "
            "code, such as detector and fusion).",
        ),
    ] = None,
    rank_by: Annotated[str | None, options.option("SCORE", "With --rank: the score, such as f1.")] = None,
    exact: Annotated[
        bool,
        options.flag(
            "Compare each number with those that are committed: of the packaged campaign of the "
            "folder's name, or in a second folder. Exit code 1 if any is off.",
            "--exact",
        ),
    ] = False,
    update: Annotated[
        bool, options.flag("With --exact: commit this run's numbers instead; in a checkout.", "--update")
    ] = False,
    output: Annotated[
        Path | None,
        options.output_option(
            "PATH", "Also write tables and figures into this folder; with --rank, the page into this file."
        ),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Compare campaigns on the seeds they share: each score's difference, and the settings that differ.

    Numbers that are compared exactly have to agree in every byte on the platform that made them; elsewhere
    they have to be near.
    """
    from midnet_bench.errors import InputError
    from midnet_bench.workflows import compare as workflow

    if exact or update:
        _compare_exactly(directories, update)
        return
    if rank or of or rank_by:
        if len(directories) != 1:
            raise InputError("compare: --rank ranks one campaign; give one folder")
        _rank(directories[0], of or [], rank_by, output, as_json, wide)
        return
    found = workflow.compare(directories, by, baseline)
    if output is not None:
        from midnet_bench.workflows.report import write_comparison

        write_comparison(found, output)
    regressions = [] if fail_if_worse is None else workflow.worse(found, fail_if_worse)
    if as_json or wide:
        show(found.experiment.name, found.tables, as_json, wide)
    else:
        lines, tables = workflow.shown(found)
        print_lines([*lines, ""])
        show(None, tables, as_json=False)
    if output is not None and not as_json:
        messages.log_folder(output)
    for line in regressions:
        messages.log.error("%s", line)
    if regressions:
        raise typer.Exit(1)


def _rank(
    directory: Path, of: list[str], rank_by: str | None, output: Path | None, as_json: bool, wide: bool
) -> None:
    from midnet_bench.workflows.compare import rank, write_ranking

    page, tables = output or directory / "leaderboard.md", rank(directory, of, rank_by)
    write_ranking(directory, tables, page)
    show(None, tables, as_json, wide)
    if not as_json:
        messages.note(f"written to {page}")


def _compare_exactly(directories: list[Path], update: bool) -> None:
    from midnet_bench.errors import InputError
    from midnet_bench.workflows.compare import compare_exactly

    if len(directories) > 2:
        raise InputError("compare: --exact compares one folder with the committed numbers, or two folders")
    lines, how = compare_exactly(*directories, update=update)
    for line in lines:
        typer.echo(line)
    typer.echo(
        "expected numbers updated" if update else f"{messages.counted(len(lines), 'difference')}, {how}"
    )
    if lines:
        raise typer.Exit(1)


@command(example="midnet-bench verify results/labyrinth")
def verify(
    directory: Directory,
    everything: Annotated[bool, options.flag("List the claims that are reproduced, too.", "--all")] = False,
    difference: Annotated[
        float | None,
        options.option(
            "POINTS",
            "Instead, say how many trials show a change of the labyrinth's success rate by so many "
            "percentage points.",
        ),
    ] = None,
    robots: Annotated[
        str | None, options.option("N,N", "With --difference: the two team sizes (default 4,5).")
    ] = None,
    probability: Annotated[
        float | None,
        options.option("P", "With --difference: probability of detecting it (default 0.8).", "--power"),
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Check each claim of the paper against your results.

    Exit code: 0 all claims are reproduced, 3 some are inconclusive, 4 some are not reproduced.
    """
    from midnet_bench.errors import InputError
    from midnet_bench.workflows.verify import power_report
    from midnet_bench.workflows.verify import verify as check_claims

    if difference is not None:
        sizes = options.whole_numbers(robots or "4,5", "--robots")
        if not isinstance(sizes, list) or len(sizes) != 2:
            raise InputError(f"--robots {robots}: give two team sizes, such as 4,5")
        power = 0.8 if probability is None else probability
        name, table = power_report(directory, difference, (sizes[0], sizes[1]), power)  # type: ignore[arg-type]
        show(name, [table], as_json, wide)
        return
    if robots is not None or probability is not None:
        raise InputError("verify: --robots and --power go with --difference; give it, such as --difference 5")
    name, table, code = check_claims(directory)
    if as_json or wide:
        show(name, [table], as_json, wide)
    else:
        _show_claims(directory, table, everything)
    raise typer.Exit(code)


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
        print_lines([*first.conclusion, *first.notes, "", first.following])
    elif results.finished:
        show(None, printed(results, tables), as_json, wide)
    return results.finished > 0


def _show_claims(directory: Path, table: "Table", everything: bool) -> None:
    """The counts first, then what is not reproduced and what is open."""
    from midnet_bench.analysis.claims import shown_claims

    summary, tables = shown_claims(table, everything)
    print_lines([summary, ""])
    show(None, tables, as_json=False)
    reproduced = sum(row["verdict"] == "reproduced" for row in table.rows)
    if reproduced and not everything:
        print_lines([f"reproduced: {messages.counted(reproduced, 'claim')}; --all lists them."])
    if (file := directory / "claims.csv").exists():
        print_lines([f"Each in {file}"])


def log_page(directory: Path) -> None:
    """The last line of a command that wrote a campaign's page: what to open."""
    page = directory / "report.html"
    if page.exists():
        messages.note(f"Open {page}")
    else:
        messages.log_folder(directory)


def show(experiment: str | None, tables: "Sequence[Table]", as_json: bool, wide: bool = False) -> None:
    """Print tables for people, or as one JSON document; ``wide``: all columns, however long the lines."""
    if as_json:
        from midnet_bench.analysis.tables import to_json

        print_json(to_json(experiment, tables))
        return
    from midnet_bench.cli.terminal import drawn, width

    for table in tables:
        typer.echo(drawn(table, None if wide else width()) + "\n")


def print_lines(sentences: "Iterable[str]") -> None:
    """Print sentences, each from the beginning of a line; an empty one is an empty line."""
    from midnet_bench.cli.terminal import filled, width

    typer.echo("\n".join(line for sentence in sentences for line in filled(sentence, width()) or [""]))
