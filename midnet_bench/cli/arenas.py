"""The commands about arenas: ``arena show``, ``from-image``, ``from-map`` and ``check``."""

import math
from pathlib import Path
from typing import Annotated, Literal

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import add_group, command
from midnet_bench.cli.inputs import BROKEN
from midnet_bench.errors import InputError

arena = add_group("arena", "Show, make and check arenas: floor plans with start poses.")

MOST_AREAS = 5  # that a line lists
Output = Annotated[
    Path | None, options.option("FILE", "The arena's file (default: print it).", "-o", "--output")
]


@command(example="midnet-bench arena show map1 > mine.yaml", group=arena)
def show(
    name: Annotated[
        str | None, options.argument(None, "A packaged arena or a YAML file.", completion.arenas)
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
    "from-image", example="midnet-bench arena from-image plan.png --resolution 0.02 -o mine.yaml", group=arena
)
def from_image(
    image: Annotated[Path, options.argument("IMAGE", "The plan, a PNG, JPEG or PGM: dark is wall.")],
    resolution: float,
    drop_specks: float = 0.0,
    output: Output = None,
) -> None:
    """Make an arena of a drawn plan.

    Dark pixels become walls: rectangles that cover them exactly. A blank margin is cut off. Where the guards
    start and how many robots intrude gets values that you may edit.

    Options:
        resolution METRES: Side of a pixel in metres.
        drop_specks METRES: Pieces of wall that touch no other and are no longer than this are floor: dirt,
            lettering.
    """
    if not 0.0 < resolution <= 1.0:
        raise InputError(f"--resolution: {resolution:g} is out of range; allowed: above 0 and at most 1")
    if not 0.0 <= drop_specks < math.inf:
        raise InputError(f"--drop-specks: {drop_specks:g} is out of range; allowed: 0 or more")
    from midnet_bench.workflows.arenas import from_image as made_from

    text, notes = made_from(image, resolution, drop_specks)
    for note in notes:
        messages.note(f"note: {note}")
    _give(text, output, image)


@command("from-map", example="midnet-bench arena from-map map.yaml -o mine.yaml", group=arena)
def from_map(
    map_file: Annotated[Path, options.argument("MAP", "The YAML file of a ROS map_server map.")],
    unknown: Literal["wall", "free"] = "wall",
    output: Output = None,
) -> None:
    """Make an arena of a map_server map: its known part, moved to the middle of the plane.

    Occupied cells become walls: rectangles that cover them exactly.

    Options:
        unknown: What the cells are that the map knows nothing of.
    """
    from midnet_bench.workflows.arenas import from_map as made_from

    _give(made_from(map_file, unknown), output, map_file)


@command(example="midnet-bench arena check mine.yaml -o mine.png", group=arena)
def check(name: options.ArenaFile, output: Path | None = None, as_json: options.Json = False) -> None:
    """Say what is wrong with an arena, a line for each fault with its place in metres, or 'ok'.

    Starts that collide, rooms that no guard can reach, intruders that no guard can ever see, and layouts of
    five seeds for which there is no room. A picture numbers the faults. The exit code is 1 if there are any.
    Floor that no robot can enter is named with its area: no fault around a building, but look at it inside.

    Options:
        output FILE: Draw it: a PNG.
    """
    from midnet_bench.workflows.arenas import check as checked
    from midnet_bench.workflows.arenas import write_picture

    if output is not None and output.suffix.lower() != ".png":
        raise InputError(f"-o {output}: the picture is a PNG; give a name that ends in .png")
    found, faults, closed = checked(name)
    if output is not None:
        write_picture(found, faults, output)
    if as_json:
        listed = [{"fault": text, "at_m": at and [round(part, 3) for part in at]} for text, at in faults]
        areas = [{"m2": round(m2, 2), "at_m": [round(part, 3) for part in at]} for m2, at, _ in closed]
        messages.print_json({"arena": found.name, "faults": listed, "no_entry": areas})
    elif not faults:
        (width_m, height_m), walls = found.enclosure_m, len(found.wall_solids())
        typer.echo(f"ok ({messages.shown(found.name)}: {width_m:g} x {height_m:g} m, {walls} pieces of wall)")
    else:
        for number, fault in enumerate(faults, 1):
            typer.echo(f"{number}: {messages.shown(fault.text)}")
    if closed and not as_json:
        pieces = ", ".join(f"{m2:.1f} m2 at ({x:.2f}, {y:.2f})" for m2, (x, y), _ in closed[:MOST_AREAS])
        more = ", ..." if len(closed) > MOST_AREAS else ""
        closed_m2 = math.fsum(piece.area_m2 for piece in closed)
        typer.echo(f"no robot can enter {closed_m2:.1f} m2 of floor: {pieces}{more}")
        if not faults and output is None:
            typer.echo("If it is inside the building, draw it by -o check.png; --drop-specks drops lettering")
    if faults:
        raise typer.Exit(BROKEN)


def _give(text: str, output: Path | None, source: Path) -> None:
    """Print the file that was made of another one, or write it. Raises InputError: it would replace that."""
    if output is None:
        typer.echo(text, nl=False)
        return
    if output.exists() and output.samefile(source):
        raise InputError(f"-o {output}: the arena is made of this file; give another name")
    from midnet_bench.io.files import write_atomically

    write_atomically(output, text)
    typer.echo(output)
