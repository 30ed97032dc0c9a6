"""The command that says why detections were lost: ``errors``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.reports import Directory, print_lines, show

Where = Annotated[
    list[str] | None,
    options.option(
        "FACTOR=VALUE", "Only trials with this value of the grid, such as oracle=none; may be given again."
    ),
]


Robots = Annotated[int | None, options.option("N", "Only trials with this team size.")]


def places(where: list[str] | None, robots: int | None) -> list[str]:
    """All that names a campaign's cells, as ``FACTOR=VALUE``."""
    return [*(where or ()), *([] if robots is None else [f"robots={robots}"])]


@command(example="midnet-bench errors results/detection --robots 5 --seed 3 --frame 60")
def errors(
    directory: Directory,
    robots: Robots = None,
    where: Where = None,
    seed: Annotated[int | None, options.option(None, "Only this seed's trials.")] = None,
    frame: Annotated[
        int | None, options.option(None, "Explain each error of this frame, counted from 1, in a line.")
    ] = None,
    grids: Annotated[
        Path | None,
        options.option(
            "DIR", "With --frame: draw each guard's grids A to D into this folder; the trial runs again."
        ),
    ] = None,
    steps: Annotated[
        Path | None,
        options.option(
            "DIR",
            "With --frame: walk the frame through the paper's equations, a page in this folder; the "
            "trial runs again, recorded or not.",
        ),
    ] = None,
    guard: Annotated[int | None, options.option("N", "With --steps: whose grids are shown, from 1.")] = None,
    versus: Annotated[
        Path | None,
        options.option(
            "OTHER_DIR", "Another recorded campaign: count errors of both, and of one alone, by cause."
        ),
    ] = None,
    versus_where: Annotated[
        list[str] | None, options.option("FACTOR=VALUE", "As --where, of the other campaign.")
    ] = None,
    trust: options.Trust = False,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """List the causes of missed intruders and false boxes in a recorded campaign.

    Trials are recorded with '--record'. --frame explains one frame; --versus compares two campaigns.
    """
    from midnet_bench.errors import InputError
    from midnet_bench.workflows import errors as workflow

    own = places(where, robots)
    if versus is not None:
        if seed is not None or frame is not None or grids is not None:
            raise InputError("errors: --versus compares campaigns; leave out --seed, --frame and --grids")
        show(None, [workflow.versus(directory, versus, own, versus_where or own)], as_json, wide)
        return
    if frame is None:
        if grids is not None or steps is not None:
            option = "--grids draws" if steps is None else "--steps walks through"
            raise InputError(f"errors: {option} one frame; give --frame, such as --frame 60")
        show(None, workflow.errors(directory, own, seed), as_json, wide)
        return
    if steps is not None:
        from midnet_bench.workflows.steps import steps_of_trial

        for file in steps_of_trial(directory, seed, frame, own, steps, guard):
            typer.echo(file)
        return
    seed = workflow.only_seed(directory, own) if seed is None else seed
    table = workflow.explain(directory, seed, frame, own)
    if as_json:
        show(None, [table], as_json)
    else:
        print_lines([table.title, *(str(row["line"]) for row in table.rows)])
        if grids is None:
            player = directory / "report.html"
            print_lines([f"To draw this frame add --grids DIR. The player in {player} shows all frames."])
    if grids is not None:
        workflow.grids(directory, seed, frame, own, grids)
        if not as_json:
            messages.log_folder(grids)
