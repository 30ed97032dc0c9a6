"""The commands that say what can be given: ``parameters``, ``check`` of a plug-in, and those about arenas."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import add_group, command
from midnet_bench.cli.messages import filled, print_json, width
from midnet_bench.errors import InputError, nearest_name

if TYPE_CHECKING:
    from midnet_bench.settings import Leaf
    from midnet_bench.workflows.arenas import MadeArena

BROKEN = 1  # exit code where something is wrong
LISTED = "; 'midnet-bench parameters EXPERIMENT' lists an experiment's"
READINGS = Path(__file__).parent.parent / "docs" / "readings.md"
arena = add_group("arena", "Show, make and check arenas: floor plans with start poses.")
MOST_AREAS = 5  # that a line lists
MOST_GUARDS = 100
Output = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="FILE", help="The arena's file (default: print it).")
]
Guards = Annotated[
    int | None,
    typer.Option(
        metavar="N", min=1, help="So many guards have to fit at the start (default 5, or as many as do)."
    ),
]
Room = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y",
        help="A place in the room where guards start, in metres as the picture has it (default the largest "
        "room).",
    ),
]


@command(example="midnet-bench parameters localization")
def parameters(
    name: Annotated[
        str,
        typer.Argument(
            autocompletion=options.offer_parameters, help="An experiment, or a parameter of any experiment."
        ),
    ] = "detection",
    as_json: options.Json = False,
) -> None:
    """List an experiment's parameters: default, range, meaning, source. Of one parameter, say more."""
    from midnet_bench.experiments.registry import names, parameters_model
    from midnet_bench.settings import leaves

    of_all = {one: leaves(parameters_model(one)) for one in names()}
    if name in of_all or ":" in name:
        _list(name, list(leaves(parameters_model(name)).values()), as_json)
        return
    users = {one: known[name] for one, known in of_all.items() if name in known}
    if not users:
        known_names = {*of_all, *(key for known in of_all.values() for key in known)}
        raise InputError(
            f"parameters: no experiment or parameter '{name}'{nearest_name(name, known_names, LISTED)}"
        )
    _explain(name, users, as_json)


def _list(experiment: str, options: "list[Leaf]", as_json: bool) -> None:
    if as_json:
        rows = [_described(one) for one in options]
        print_json({"schema": 1, "experiment": experiment, "parameters": rows})
        return
    lines, group = [experiment], ""
    for one in options:
        if one.group != group:
            lines += ["", one.group]
            group = one.group
        allowed = f" ({one.allowed})" if one.allowed else ""
        texts = [(2, f"{one.key} = {_written(one.default)}{allowed}"), (6, one.help)]
        texts += [(6, f"source: {one.source}")] * bool(one.source)
        for indent, text in texts:
            first, *more = filled(text, width() - indent) or [""]
            lines += [" " * indent + first, *(" " * 6 + line for line in more)]
    typer.echo("\n".join(lines))


def _explain(name: str, users: "dict[str, Leaf]", as_json: bool) -> None:
    readings = readings_of(name)
    if as_json:
        rows = [{"experiment": experiment, **_described(leaf)} for experiment, leaf in users.items()]
        print_json({"schema": 1, "parameter": name, "experiments": rows, "readings": [*map(vars, readings)]})
        return
    typer.echo(name)
    users_of: dict[tuple[str, ...], list[str]] = {}
    for experiment, leaf in users.items():
        said = (leaf.help, _written(leaf.default), leaf.allowed, leaf.source)
        users_of.setdefault(said, []).append(experiment)
    for (help, default, allowed, source), experiments in users_of.items():
        _print_paragraph(help)
        typer.echo(f"  default: {default}\n  allowed: {allowed}\n  experiments: {', '.join(experiments)}")
        if source:
            typer.echo(f"  source: {source}")
    for one in readings:
        source = f" Source: {one.source}." if one.source else ""
        _print_paragraph(f"The paper leaves open (item {one.item}): {one.open}. Here: {one.reading}.{source}")


def _print_paragraph(text: str) -> None:
    """A paragraph, indented, as wide as the terminal."""
    typer.echo("\n" + "\n".join(f"  {line}" for line in filled(text, max(40, width()) - 2)))


def _described(leaf: "Leaf") -> dict[str, Any]:
    limits = leaf.limits
    return {
        "key": leaf.key,
        "default": leaf.default,
        "choices": list(leaf.choices) or None,
        "minimum": limits.get("ge"),
        "above": limits.get("gt"),
        "maximum": limits.get("le"),
        "multiple_of": limits.get("multiple_of"),
        "group": leaf.group or None,
        "help": leaf.help,
        "source": leaf.source or None,
    }


def _written(value: object) -> str:
    """A default as YAML writes it."""
    return str(value).lower() if isinstance(value, bool) else "null" if value is None else str(value)


@command(example="midnet-bench check my_detector.py:Mine")
def check(
    thing: Annotated[
        str,
        typer.Argument(
            metavar="THING",
            help="A detector, fusion, patrol, pursuit, metric, engine or robot: NAME, package.module:NAME or"
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
        frame_ms = None if found.frame_ms is None else round(found.frame_ms, 3)
        said = {"option": found.option, "name": found.name, "faults": found.faults, "frame_ms": frame_ms}
        print_json(said)
    elif found.faults:
        typer.echo("\n".join(found.faults))
    elif found.frame_ms is None:
        typer.echo(f"ok ({found.option} {found.name})")
    else:
        typer.echo(f"ok, {found.frame_ms:.1f} ms a frame ({found.option} {found.name}, four robots)")
    if found.faults:
        raise typer.Exit(BROKEN)


@dataclass(frozen=True)
class Reading:
    """One row of ``readings.md``."""

    item: str  # its number; two are joined by a comma
    open: str  # what the paper leaves open
    reading: str  # what midnet-bench does by default
    source: str  # where that is from


def readings_of(key: str) -> list[Reading]:
    """The rows of ``readings.md`` whose last column names the option ``key``, in their order."""
    found = []
    for line in READINGS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and key in re.findall(r"`([^`]+)`", cells[4]):
            found.append(Reading(*cells[:4]))
    return found


@command(example="midnet-bench arena show map1 > mine.yaml", group=arena)
def show(
    name: Annotated[
        str | None,
        typer.Argument(autocompletion=options.offer_arenas, help="A packaged arena or a YAML file."),
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
    image: Annotated[
        Path, typer.Argument(metavar="IMAGE", help="The plan, a PNG, JPEG or PGM: dark is wall.")
    ],
    resolution: Annotated[float, typer.Option(metavar="METRES", help="Side of a pixel in metres.")],
    threshold: Annotated[
        int, typer.Option(metavar="N", help="What is darker than this, of 255, is wall.")
    ] = 128,
    walls: Annotated[
        Literal["dark", "light"],
        typer.Option(help="How walls are drawn; light ones stand on a dark ground."),
    ] = "dark",
    drop_coloured: Annotated[
        bool,
        typer.Option("--drop-coloured", help="What is drawn in colour is floor: dimension lines, pipes."),
    ] = False,
    drop_thin: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            help="Lines thinner than this are floor: door arcs, dimension lines, furniture.",
        ),
    ] = 0.0,
    drop_specks: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            help="Pieces of wall that touch no other and are no longer than this are floor: dirt, lettering.",
        ),
    ] = 0.0,
    drop_beside: Annotated[
        bool,
        typer.Option(
            "--drop-beside", help="What lies wholly beside the building is floor: a title, a scale bar."
        ),
    ] = False,
    robots: Guards = None,
    room: Room = None,
    output: Output = None,
) -> None:
    """Make an arena of a drawn plan.

    Dark pixels become walls: rectangles that cover them exactly. A blank margin is cut off. Where the guards
    start and how many robots intrude gets values that you may edit. Beside the file go a picture of the arena
    and one, _plan.png, of what in the plan became wall; doors that are too narrow have their width there.
    """
    if not 0.0 < resolution <= 1.0:
        raise InputError(f"--resolution: {resolution:g} is out of range; allowed: above 0 and at most 1")
    if not 1 <= threshold <= 255:
        raise InputError(f"--threshold: {threshold} is out of range; allowed: 1 to 255")
    for name, value in (("--drop-thin", drop_thin), ("--drop-specks", drop_specks)):
        if not 0.0 <= value < math.inf:
            raise InputError(f"{name}: {value:g} is out of range; allowed: 0 or more")
    from midnet_bench.arena.drawn_plan import Drawing
    from midnet_bench.workflows.arenas import from_image as made_from

    drawing = Drawing(threshold, walls == "light", drop_coloured, drop_thin, drop_specks, drop_beside)
    _give(made_from(image, resolution, drawing, _team(robots), _place(room)), output)


@command("from-map", example="midnet-bench arena from-map map.yaml -o mine.yaml", group=arena)
def from_map(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="The YAML file of a ROS map_server map.")],
    unknown: Annotated[
        Literal["wall", "free"], typer.Option(help="What the cells are that the map knows nothing of.")
    ] = "wall",
    robots: Guards = None,
    room: Room = None,
    output: Output = None,
) -> None:
    """Make an arena of a map_server map: its known part, moved to the middle of the plane.

    Occupied cells become walls: rectangles that cover them exactly, in larger cells where they are too many.
    'arena check' finds no fault in it: the guards start where they fit, and floor that no robot reaches is
    listed. A picture goes beside the file.
    """
    from midnet_bench.workflows.arenas import from_map as made_from

    _give(made_from(map_file, unknown, _team(robots), _place(room)), output)


@command("check", example="midnet-bench arena check mine.yaml -o mine.png", group=arena)
def check_arena(
    name: options.ArenaFile,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE", help="Draw it: a PNG.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Say what is wrong with an arena, a line for each fault with its place in metres, or 'ok'.

    Starts that collide, rooms that no guard can reach, intruders that no guard can ever see, and layouts of
    five seeds for which there is no room. A picture numbers the faults. The exit code is 1 if there are any.
    Floor that no robot can enter is named with its area: no fault around a building, but look at it inside.
    """
    from midnet_bench.arena.arena import load_arena
    from midnet_bench.workflows.arena_faults import check as checked
    from midnet_bench.workflows.arenas import write_picture

    if output is not None and output.suffix.lower() != ".png":
        raise InputError(f"-o {output}: the picture is a PNG; give a name that ends in .png")
    found, faults, closed = checked(load_arena(name))
    if output is not None:
        write_picture(found, faults, output)
    if as_json:
        listed = [{"fault": text, "at_m": at and [round(part, 3) for part in at]} for text, at in faults]
        areas = [{"m2": round(m2, 2), "at_m": [round(part, 3) for part in at]} for m2, at, *_ in closed]
        messages.print_json({"arena": found.name, "faults": listed, "no_entry": areas})
    elif not faults:
        (width_m, height_m), walls = found.enclosure_m, len(found.wall_solids())
        typer.echo(f"ok ({messages.shown(found.name)}: {width_m:g} x {height_m:g} m, {walls} pieces of wall)")
    else:
        for number, fault in enumerate(faults, 1):
            typer.echo(f"{number}: {messages.shown(fault.text)}")
    if closed and not as_json:
        pieces = ", ".join(f"{m2:.1f} m2 at ({x:.2f}, {y:.2f})" for m2, (x, y), *_ in closed[:MOST_AREAS])
        more = ", ..." if len(closed) > MOST_AREAS else ""
        closed_m2 = math.fsum(piece.area_m2 for piece in closed)
        typer.echo(f"no robot can enter {closed_m2:.1f} m2 of floor: {pieces}{more}")
        if not faults and output is None:
            typer.echo("If it is inside the building, draw it by -o check.png; --drop-specks drops lettering")
    if faults:
        raise typer.Exit(BROKEN)


def _team(robots: int | None) -> int | None:
    """Raises InputError."""
    if robots is not None and robots > MOST_GUARDS:
        raise InputError(f"--robots: {robots} is out of range; allowed: 1 to {MOST_GUARDS}")
    return robots


def _place(room: str | None) -> tuple[float, float] | None:
    """Raises InputError."""
    if room is None:
        return None
    try:
        x, y = map(float, room.split(","))
    except ValueError:
        x = y = math.nan
    if not math.isfinite(x + y):
        raise InputError(f"--room {room}: two numbers are needed, such as --room=1.5,-2")
    return x, y


def _give(made: "MadeArena", output: Path | None) -> None:
    """Print an arena's file, or write it with its pictures. Raises InputError: it would replace a source."""
    files = made.write(output) if output is not None else []
    for note in made.notes:
        messages.note(f"note: {note}")
    typer.echo("\n".join(map(str, files)) if files else made.text, nl=bool(files))
