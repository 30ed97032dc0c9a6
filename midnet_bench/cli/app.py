"""The Typer application that every command file adds to."""

import typer

from midnet_bench import __version__

app = typer.Typer(
    name="midnet-bench",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="""How well does a team of LiDAR robots guard a building?

    [bold]midnet-bench detection[/bold]  prints the paper's table, in about a minute.

    [bold]midnet-bench labyrinth --trials 20[/bold]  runs the paper's 500-trial sweep, resumable.

    [bold]midnet-bench render --seed 1[/bold]  draws one trial: pictures and a clip.
    """,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"midnet-bench {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version."
    ),
) -> None:
    pass
