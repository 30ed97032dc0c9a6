"""The ``midnet-bench`` command: parse, call, print. Heavy rooms are imported inside the commands."""

import os
import sys

import click
import typer

from midnet_bench import __version__
from midnet_bench.errors import MidnetBenchError

app = typer.Typer(
    name="midnet-bench",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help="""How well does a team of LiDAR robots guard a building?

    [bold]midnet-bench detection[/bold]               the paper's table, in about a minute
    \n\n
    [bold]midnet-bench labyrinth --trials 20[/bold]   the paper's 500-trial sweep, resumable
    \n\n
    [bold]midnet-bench render --seed 1[/bold]         pictures and a clip of one trial
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


def main() -> None:
    """Run the command line; exit 0, 2 for unusable input, 130 when interrupted, else as the command says.

    A known error is one line on stderr; with MIDNET_BENCH_DEBUG set it keeps its traceback.
    """
    try:
        code = app(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except MidnetBenchError as error:
        if os.environ.get("MIDNET_BENCH_DEBUG"):
            raise
        print(f"error: {error}", file=sys.stderr)
        code = error.exit_code
    except (KeyboardInterrupt, click.Abort):
        code = 130
    sys.exit(code)
