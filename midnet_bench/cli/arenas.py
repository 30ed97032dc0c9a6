"""The commands about arenas: ``arena show``, ``from-image``, ``from-map`` and ``check``."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import add_group, command
from midnet_bench.cli.check import BROKEN

arena = add_group("arena", "Show, make and check arenas: floor plans with who starts where.")

Output = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="The arena's file (default: print it)."),
]


@command(example="midnet-bench arena show map1 > mine.yaml", group=arena)
def show(
    name: Annotated[
        str | None,
        typer.Argument(
            help="A packaged arena or a YAML file.", autocompletion=completion.arenas, show_default=False
        ),
    ] = None,
) -> None:
    """Print an arena's file, comments and all; without a name, the names of those that there are."""
    if name is None:
        from midnet_bench.arena.arena import arena_names

        typer.echo("\n".join(arena_names()))
        return
    from midnet_bench.workflows.arenas import shown

    typer.echo(shown(name), nl=False)


@command(
    "from-image",
    example="midnet-bench arena from-image plan.png --resolution 0.02 -o mine.yaml",
    group=arena,
)
def from_image(
    image: Annotated[
        Path,
        typer.Argument(metavar="IMAGE", help="The plan, a PNG or PGM: dark is wall.", show_default=False),
    ],
    resolution: Annotated[
        float, typer.Option(metavar="METRES", help="Side of a pixel in metres.", show_default=False)
    ],
    output: Output = None,
) -> None:
    """Make an arena of a drawn plan.

    Dark pixels become walls: rectangles that cover them exactly. The image's edges are the enclosure's. Where
    the guards start and who intrudes gets values that you may edit.
    """
    from midnet_bench.errors import InputError

    if not 0.0 < resolution <= 1.0:
        raise InputError(f"--resolution: {resolution:g} is out of range; allowed: above 0 and at most 1")
    from midnet_bench.workflows.arenas import from_image as made_from

    _give(made_from(image, resolution), output)


@command("from-map", example="midnet-bench arena from-map map.yaml -o mine.yaml", group=arena)
def from_map(
    map_file: Annotated[
        Path,
        typer.Argument(metavar="MAP", help="The YAML file of a ROS map_server map.", show_default=False),
    ],
    unknown: Annotated[
        Literal["wall", "free"], typer.Option(help="What the cells are that the map knows nothing of.")
    ] = "wall",
    output: Output = None,
) -> None:
    """Make an arena of a map_server map: its known part, moved to the middle of the plane.

    Occupied cells become walls: rectangles that cover them exactly.
    """
    from midnet_bench.workflows.arenas import from_map as made_from

    _give(made_from(map_file, unknown), output)


@command("check", example="midnet-bench arena check mine.yaml -o mine.png", group=arena)
def check(
    name: Annotated[
        str,
        typer.Argument(
            metavar="ARENA",
            help="A packaged arena or a YAML file.",
            autocompletion=completion.arenas,
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Draw it: a PNG.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Say what is wrong with an arena, a line for each fault with its place in metres, or 'ok'.

    Starts that collide, rooms that no guard can reach, intruders that no guard can ever see, and layouts of
    five seeds for which there is no room. A picture numbers the faults. The exit code is 1 if there are any.
    """
    from midnet_bench.workflows.arenas import check as checked
    from midnet_bench.workflows.arenas import write_picture

    found, faults = checked(name)
    if output is not None:
        write_picture(found, faults, output)
    if as_json:
        told = [{"fault": text, "at_m": at and [round(part, 3) for part in at]} for text, at in faults]
        typer.echo(json.dumps({"arena": found.name, "faults": told}))
    elif not faults:
        width_m, height_m = found.enclosure_m
        walls = len(found.wall_solids())
        typer.echo(f"ok ({messages.shown(found.name)}: {width_m:g} x {height_m:g} m, {walls} pieces of wall)")
    else:
        for number, fault in enumerate(faults, 1):
            typer.echo(f"{number}: {messages.shown(fault.text)}")
    if faults:
        raise typer.Exit(BROKEN)


def _give(text: str, output: Path | None) -> None:
    """Print a file, or write it."""
    if output is None:
        typer.echo(text, nl=False)
        return
    from midnet_bench.io.files import write_atomically

    write_atomically(output, text)
    typer.echo(output)
