"""The command that makes maps: ``map``."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command, print_json

if TYPE_CHECKING:
    from midnet_bench.campaign.trial import Scalar
    from midnet_bench.workflows.maps import MadeMap

PARTICLES, SEED = 30, 1
CLIP = "--clip/--no-clip"
TAKEN = {
    "--from-log": ("--slam", "--particles", "--seed", CLIP),
    "--from-map": ("--set",),
    "--exact": ("--set",),
}
"""what makes a map other than an exploration -> the options that go with it"""
_ENDINGS = re.compile(r"(\.(yaml|yml|log|clf|carmen|txt|dat))?(\.gz)?$")


@command("map", example="midnet-bench map map2 --robots 3")
def make_map(
    arena: Annotated[
        str | None,
        options.argument(None, "The arena to explore: map1, map2, empty, or a YAML file.", completion.arenas),
    ] = None,
    robots: options.Number = None,
    exact: Annotated[bool, options.flag("Draw the arena's walls without exploring.", "--exact")] = False,
    from_log: Annotated[
        Path | None, options.option("FILE", "Run SLAM over a recording: a bag, a CARMEN log, a table.")
    ] = None,
    from_map: Annotated[
        Path | None,
        options.option(
            "FILE", "Resample a map_server map to resolution_m (default 0.05 m): no wall gets lost."
        ),
    ] = None,
    slam: Annotated[
        Literal["graph", "gmapping"] | None,
        options.option(
            None,
            "What maps a log: graph SLAM, which survives slips of the wheels (default), or GMapping "
            "(default with --particles).",
        ),
    ] = None,
    particles: Annotated[
        int | None, options.option("N", "Number of GMapping particles (default 30).", min=1)
    ] = None,
    seed: Annotated[int | None, options.option("N", "Random seed (default 1).", min=0)] = None,
    clip: Annotated[
        bool | None, options.flag("Make a film (MP4) of the growing map (default clip).", CLIP)
    ] = None,
    engine: options.Engine = None,
    robot_model: options.RobotModel = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        options.output_option(
            "PATH", "Folder, or the map's YAML file; all else goes beside it (default results/map-NAME)."
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make a map: explore an arena, run SLAM over a log, draw an arena exactly, or resample a map.

    Writes a map for ROS map_server and the binary grid that MIDNet subtracts. An exploration and a log also
    give pictures and a film of the growing map; an exploration gives scores.
    """
    from midnet_bench.errors import InputError

    if [arena, from_log, from_map].count(None) != 2:
        raise InputError("map: give either an arena, such as map1, or --from-log FILE, or --from-map FILE")
    given = {
        "--exact": exact or None,
        "--robots": robots,
        "--slam": slam,
        "--particles": particles,
        "--seed": seed,
        CLIP: clip,
        "--engine": engine,
        "--robot-model": robot_model,
        "--set": settings,
    }
    way = "--from-log" if from_log else "--from-map" if from_map else "--exact" if exact else None
    if way is not None:
        _refuse(way, {name: value for name, value in given.items() if name not in (*TAKEN[way], way)})
    seed, with_clip = SEED if seed is None else seed, clip is not False
    if from_log is not None:
        if slam == "graph":
            _refuse("--slam graph", {"--particles": particles})
        elif slam == "gmapping":
            particles = particles or PARTICLES
        made = _map_log(from_log, slam, particles, seed, with_clip, output or _folder(from_log.name))
    elif from_map is not None:
        from midnet_bench.workflows.maps import resample

        target = output or _folder(from_map.name, "-resampled")
        made = resample(from_map, options.joined({}, settings), target)
    elif arena is not None and exact:
        from midnet_bench.workflows.maps import draw

        made = draw(options.joined({"arena": arena}, settings), output or _folder(arena, "-exact"))
    else:
        assert arena is not None
        if slam == "graph":
            raise InputError(
                "map: --slam graph maps recorded logs only; leave it out, or give --from-log FILE"
            )
        named = {"arena": arena, "robots": robots, "particles": particles}
        named |= {"engine": engine, "robot": robot_model}
        made = _explore(options.joined(named, settings), seed, with_clip, output or _folder(arena), as_json)
    _print(made, as_json)


def _refuse(option: str, given: Mapping[str, object]) -> None:
    from midnet_bench.errors import InputError

    for name, value in given.items():
        if value is not None:
            raise InputError(f"map: {name} has no meaning with {option}; leave it out")


def _map_log(
    path: Path, slam: str | None, particles: int | None, seed: int, clip: bool, output: Path
) -> "MadeMap":
    from midnet_bench.cli.progress import meter
    from midnet_bench.workflows.read_log import read_log

    log = read_log(path, messages.note)  # a bad one ends it before what is slow
    from midnet_bench.mapping.graph_slam.slam import FEWEST_BEAMS
    from midnet_bench.mapping.log_mapping import held_in_memory
    from midnet_bench.workflows.maps import map_log

    if slam is None and particles is None and log.geometry.beams < FEWEST_BEAMS:
        beams = log.geometry.beams
        messages.note(f"{path}: {beams} beams are too few for graph SLAM: GMapping maps it")
        particles = PARTICLES
    with meter() as bar, held_in_memory(log):
        return map_log(
            *(log, particles, seed, output, clip),
            progress=lambda done, scans: bar.show(done, scans, f"scan {done} of {scans}"),
        )


def _explore(values: "dict[str, Scalar]", seed: int, clip: bool, output: Path, as_json: bool) -> "MadeMap":
    from midnet_bench.analysis.tables import Table
    from midnet_bench.cli.progress import meter
    from midnet_bench.cli.reports import show
    from midnet_bench.experiments.mapping.parameters import MappingParameters
    from midnet_bench.workflows.maps import explore

    parameters = MappingParameters.parse(values, "command line")
    with meter(estimates=False) as bar:
        made = explore(
            *(parameters, seed, output, clip),
            progress=lambda time_s, known: bar.show(
                known, 1.0, f"{time_s:.0f} s simulated, {known:.1%} explored"
            ),
        )
    if made.scores is not None and not as_json:  # a line for each score: a terminal has no room for the row
        (row,), (cells,) = made.scores.rows, made.scores.cells()
        lines = [{"": name, "value": cell} for name, cell in zip(row, cells, strict=True)]
        show(None, [Table(made.scores.name, made.scores.title, lines)], as_json=False)
    return made


def _folder(source: str, ending: str = "") -> Path:
    """Where a map goes unless ``-o`` says otherwise."""
    return options.RESULTS / f"map-{_ENDINGS.sub('', Path(source).name)}{ending}"


def _print(made: "MadeMap", as_json: bool) -> None:
    """Print warnings and lines for people, or one JSON document."""
    grid = made.grid
    for warning in made.warnings:
        messages.log.warning("warning: %s", warning)
    if as_json:
        from midnet_bench.analysis.tables import to_json

        document = to_json(
            "mapping" if made.scores else None,
            [made.scores] if made.scores else [],
            cells=[grid.width, grid.height],
            resolution_m=grid.resolution,
            files=[str(file) for file in made.files],
            warnings=made.warnings,
        )
        print_json(document)
        return
    typer.echo(f"{grid.width} x {grid.height} cells of {grid.resolution:g} m")
    for file in made.files:
        typer.echo(file)
