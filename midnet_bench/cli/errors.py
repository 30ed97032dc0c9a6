"""The commands that say why detections were lost: ``errors`` and ``explain``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.reports import Directory, show

Where = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FACTOR=VALUE",
        help="Only trials with this value of the grid, such as oracle=none; may be given again.",
        show_default=False,
    ),
]


Robots = Annotated[
    int | None, typer.Option(metavar="N", help="Only trials with this team size.", show_default=False)
]


def places(where: list[str] | None, robots: int | None) -> list[str]:
    """All that names a campaign's cells, as ``FACTOR=VALUE``."""
    return [*(where or ()), *([] if robots is None else [f"robots={robots}"])]


@command(example="midnet-bench errors results/detection --robots 5")
def errors(
    directory: Directory,
    robots: Robots = None,
    where: Where = None,
    seed: Annotated[int | None, typer.Option(help="Only this seed's trials.", show_default=False)] = None,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Say why a recorded campaign missed intruders and found what is none: causes, shares, worst frames.

    Trials are recorded with '--record'. docs/errors.md says what each cause means.
    """
    from midnet_bench.workflows.errors import errors as of_campaign

    show(None, of_campaign(directory, places(where, robots), seed), as_json, wide)


@command(example="midnet-bench explain results/detection --robots 5 --seed 3 --frame 60")
def explain(
    directory: Directory,
    robots: Robots = None,
    seed: Annotated[int | None, typer.Option(help="The trial's seed.", show_default=False)] = None,
    frame: Annotated[
        int | None, typer.Option(help="Which frame, counted from 1.", show_default=False)
    ] = None,
    where: Where = None,
    versus: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER_DIR",
            help="Another recorded campaign: count errors of both, and of one alone, by cause.",
            show_default=False,
        ),
    ] = None,
    versus_where: Annotated[
        list[str] | None,
        typer.Option(metavar="FACTOR=VALUE", help="As --where, of the other campaign.", show_default=False),
    ] = None,
    grids: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Draw each guard's grids A to D at that frame into this folder; the trial runs again.",
            show_default=False,
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Explain each error of one frame in a line; or, with --versus, compare the errors of two campaigns."""
    from midnet_bench.errors import InputError
    from midnet_bench.workflows import errors as workflow

    own = places(where, robots)
    if versus is not None:
        if seed is not None or frame is not None or grids is not None:
            raise InputError("explain: --versus compares campaigns; leave out --seed, --frame and --grids")
        show(None, [workflow.versus(directory, versus, own, versus_where or own)], as_json)
        return
    if seed is None or frame is None:
        raise InputError("explain: --seed and --frame are needed, such as --seed 3 --frame 60; or --versus")
    table = workflow.explain(directory, seed, frame, own)
    if as_json:
        show(None, [table], as_json)
    else:
        typer.echo("\n".join([table.title, *(str(row["line"]) for row in table.rows)]))
    if grids is not None:
        workflow.grids(directory, seed, frame, own, grids)
        if not as_json:
            messages.tell_where(grids)
