"""The Typer application that every command file adds to, and the standard output that they print on."""

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator

import typer

from midnet_bench import __version__
from midnet_bench.errors import MidnetBenchError

READER_GONE = 141
"""exit code of a program whose reader has closed the pipe, as a shell reports it"""
CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)

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


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Standard output for one command, written out to its last line.

    Raises:
        MidnetBenchError: it is closed, or cannot be written.
        SystemExit: 141; whoever read it has gone.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lasts
    if sys.stdout is None:
        # the next file to be opened would take its number, and what a library in C prints would land there
        raise MidnetBenchError("standard output is closed; direct it somewhere, such as to /dev/null")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a letter that the terminal lacks costs that letter alone
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        # rich and typer make the one into the other; an exit for any other reason stays as it is
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        _drop_the_rest()
        raise SystemExit(READER_GONE) from None
    except OSError as error:
        if error.errno not in CANNOT_WRITE:
            raise
        _drop_the_rest()
        raise MidnetBenchError(f"the output cannot be written: {error.strerror}") from error


def _drop_the_rest() -> None:
    """What is still to be written goes nowhere, so that Python does not try once more when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


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
