"""The command that makes maps: ``map``."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.messages import show
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.io.scan_logs import ScanLog
    from midnet_bench.workflows.maps import MadeMap

PARTICLES = 30
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
        typer.Argument(
            autocompletion=options.offer_arenas,
            help="The arena to explore: a packaged one or a YAML file.",
        ),
    ] = None,
    robots: options.Number = None,
    exact: Annotated[bool, typer.Option("--exact", help="Draw the arena's walls without exploring.")] = False,
    from_log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Run SLAM over a recording: a bag, a CARMEN log, a table."),
    ] = None,
    from_map: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Resample a map_server map to resolution_m (default 0.05 m): no wall gets lost.",
        ),
    ] = None,
    slam: Annotated[
        Literal["graph", "gmapping"] | None,
        typer.Option(
            help="What maps a log: graph SLAM, which survives slips of the wheels (default), or GMapping "
            "(default with --particles).",
        ),
    ] = None,
    particles: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Number of GMapping particles (default 30).")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", min=0, help="Random seed (default 1).")] = None,
    clip: Annotated[
        bool | None,
        typer.Option(
            "--clip/--no-clip", help="Make a film (MP4) of the map's picture as it grows (default clip)."
        ),
    ] = None,
    engine: options.Plugin = None,
    robot_model: options.Plugin = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="Folder, or the map's YAML file; all else goes beside it (default results/map-NAME).",
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make a map: explore an arena, run SLAM over a log, draw an arena exactly, or resample a map.

    Writes a map for ROS map_server and the binary grid that MIDNet subtracts. An exploration and a log also
    give a picture and a film of the growing map; an exploration gives scores.
    """
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
    if slam == "graph" and from_log is not None:
        _refuse("--slam graph", {"--particles": particles})
    elif slam == "graph":
        raise InputError("map: --slam graph maps recorded logs only; leave it out, or give --from-log FILE")
    source = str(from_log or from_map or arena)
    ending = "-exact" if exact else "-resampled" if from_map else ""
    target = output or options.RESULTS / f"map-{_ENDINGS.sub('', Path(source).name)}{ending}"
    how: dict[str, Any] = {"seed": options.SEED if seed is None else seed, "clip": clip is not False}
    if from_log is not None:
        made = _map_log(from_log, slam, particles, target, how)
    elif from_map is not None:
        from midnet_bench.workflows.maps import resample

        made = resample(from_map, options.joined({}, settings), target)
    elif exact:
        from midnet_bench.workflows.maps import draw

        made = draw(options.joined({"arena": arena}, settings), target)
    else:
        named = {"arena": arena, "robots": robots, "particles": particles}
        named |= {"engine": engine, "robot": robot_model}
        made = _explore(options.joined(named, settings), target, how)
        if made.scores is not None and not as_json:
            _show_scores(made)
    _print(made, as_json)


def _refuse(option: str, given: Mapping[str, object]) -> None:
    for name, value in given.items():
        if value is not None:
            raise InputError(f"map: {name} has no meaning with {option}; leave it out")


def _map_log(
    path: Path, slam: str | None, particles: int | None, output: Path, how: dict[str, Any]
) -> "MadeMap":
    from midnet_bench.cli.progress import meter

    log = _read_log(path)  # a bad one ends it before what is slow
    from midnet_bench.mapping.graph_slam import FEWEST_BEAMS
    from midnet_bench.mapping.log_mapping import held_in_memory
    from midnet_bench.workflows.maps import map_log

    if slam == "gmapping":
        particles = particles or PARTICLES
    elif slam is None and particles is None and log.geometry.beams < FEWEST_BEAMS:
        beams = log.geometry.beams
        messages.note(f"{path}: {beams} beams are too few for graph SLAM: GMapping maps it")
        particles = PARTICLES
    with meter() as bar, held_in_memory(log):
        return map_log(
            log,
            particles,
            output=output,
            progress=lambda done, scans: bar.show(done, scans, f"scan {done} of {scans}"),
            **how,
        )


def _read_log(path: Path) -> "ScanLog":
    """A CARMEN log, a table of scans, or any recording of ``replay``. Raises InputError: it is none."""
    from midnet_bench.recording.files.bags import is_bag

    if path.suffix == ".csv" or path.is_dir() or (path.exists() and is_bag(path)):
        from midnet_bench.recording.inputs import scan_log_of  # which takes a compiler

        return scan_log_of(path, messages.note)
    from midnet_bench.io.scan_logs import read_scan_log

    return read_scan_log(path)


def _explore(values: "dict[str, Any]", output: Path, how: dict[str, Any]) -> "MadeMap":
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments.mapping.parameters import MappingParameters
    from midnet_bench.workflows.maps import explore

    parameters = MappingParameters.parse(values, "command line")
    with meter(estimates=False) as bar:
        return explore(
            parameters,
            output=output,
            progress=lambda time_s, known: bar.show(
                known, 1.0, f"{time_s:.0f} s simulated, {known:.1%} explored"
            ),
            **how,
        )


def _show_scores(made: "MadeMap") -> None:
    """A line for each score: a terminal has no room for the row."""
    from midnet_bench.analysis.tables import Table

    assert made.scores is not None
    (row,), (cells,) = made.scores.rows, made.scores.cells()
    lines = [{"": name, "value": cell} for name, cell in zip(row, cells, strict=True)]
    show(None, [Table(made.scores.name, made.scores.title, lines)])


def _print(made: "MadeMap", as_json: bool) -> None:
    """Print warnings and lines for people, or one JSON document."""
    grid = made.grid
    for warning in made.warnings:
        messages.log.warning("warning: %s", warning)
    if not as_json:
        typer.echo(f"{grid.width} x {grid.height} cells of {grid.resolution:g} m")
        for file in made.files:
            typer.echo(file)
        return
    show(
        "mapping" if made.scores else None,
        [made.scores] if made.scores else [],
        as_json,
        cells=[grid.width, grid.height],
        resolution_m=grid.resolution,
        files=[str(file) for file in made.files],
        warnings=made.warnings,
    )
