"""The command that ranks what a campaign compares: ``leaderboard``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.reports import show


@command(example="midnet-bench leaderboard results/rivals")
def leaderboard(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="A campaign's folder.", show_default=False)
    ],
    of: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FACTOR",
            help="A factor of the grid whose values are ranked; may be given again (default: those that name "
            "code, such as detector and fusion).",
            show_default=False,
        ),
    ] = None,
    rank_by: Annotated[
        str | None,
        typer.Option(metavar="SCORE", help="Rank by this score, such as f1.", show_default=False),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Where the Markdown page goes (default DIR/leaderboard.md).",
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Rank what a campaign compares, and write the table as a Markdown page.

    Each row has the mean over seeds with its interval, and the difference from the first of the grid on the
    same seeds.
    """
    from midnet_bench.workflows.leaderboard import leaderboard as ranked

    page = output or directory / "leaderboard.md"
    show(None, ranked(directory, of or (), rank_by, page), as_json)
    if not as_json:
        messages.tell_file(page)
