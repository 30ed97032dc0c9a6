"""The command that tries code for a seam: ``check``."""

import json
from typing import Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import command

BROKEN = 1
"""exit code where something is wrong"""


@command(example="midnet-bench check my_detector.py:Mine")
def check(
    thing: Annotated[
        str,
        options.argument(
            "THING",
            "A detector, fusion, patrol, pursuit, metric, engine or robot: NAME, package.module:NAME or"
            " file.py:NAME.",
        ),
    ],
    as_json: options.Json = False,
) -> None:
    """Check that your plug-in follows the interface: a line for each fault, or 'ok'.

    Runs your code with 0, 1 and 20 robots, in two processes, and checks units, shapes, unchanged inputs and
    repeatable results. The exit code is 1 if anything is wrong.
    """
    from midnet_bench.workflows.check import check as checked_thing

    found = checked_thing(thing)
    if as_json:
        typer.echo(
            json.dumps(
                {
                    "seam": found.seam,
                    "name": found.name,
                    "faults": found.faults,
                    "frame_ms": None if found.frame_ms is None else round(found.frame_ms, 3),
                }
            )
        )
    elif not found.faults:
        plugin = f"{found.seam} {found.name}"
        if found.frame_ms is None:
            typer.echo(f"ok ({plugin})")
        else:
            typer.echo(f"ok, {found.frame_ms:.1f} ms a frame ({plugin}, four robots)")
    else:
        for fault in found.faults:
            typer.echo(fault)
    if found.faults:
        raise typer.Exit(BROKEN)
