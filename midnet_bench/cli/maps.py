"""The command that makes maps: ``map``."""

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from midnet_bench.cli import completion, messages, options
from midnet_bench.cli.app import command

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.trial import Scalar
    from midnet_bench.grid import OccupancyGrid

PARTICLES, SEED = 30, 1
CLIP = "--clip/--no-clip"

_ENDINGS = re.compile(r"(\.(yaml|yml|log|clf|carmen|txt|dat))?(\.gz)?$")


@command("map", example="midnet-bench map map2 --robots 3")
def make_map(
    arena: Annotated[
        str | None,
        typer.Argument(
            help="The arena to explore: map1, map2, empty, or a YAML file.", autocompletion=completion.arenas
        ),
    ] = None,
    robots: Annotated[int | None, typer.Option(metavar="N", help="Robots that explore (default 1).")] = None,
    exact: Annotated[bool, typer.Option("--exact", help="Draw the arena's walls without exploring.")] = False,
    from_log: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Run SLAM over a recorded log: a CARMEN log or a table of scans."),
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
            "(default with --particles)."
        ),
    ] = None,
    particles: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Number of GMapping particles (default 30).")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, metavar="N", help="Random seed (default 1).")] = None,
    clip: Annotated[
        bool | None, typer.Option(CLIP, help="Make a film (MP4) of the growing map (default clip).")
    ] = None,
    engine: options.Engine = None,
    robot_model: options.RobotModel = None,
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
    give pictures and a film of the growing map; an exploration gives scores.
    """
    from midnet_bench.errors import InputError

    if [arena, from_log, from_map].count(None) != 2:
        raise InputError("map: give either an arena, such as map1, or --from-log FILE, or --from-map FILE")
    given = {
        "--robots": robots,
        "--slam": slam,
        "--particles": particles,
        "--seed": seed,
        CLIP: clip,
        "--engine": engine,
        "--robot-model": robot_model,
        "--set": settings,
    }
    chosen_seed, with_clip = SEED if seed is None else seed, clip is not False
    if from_log is not None:
        unused = ("--exact", "--robots", "--engine", "--robot-model", "--set")
        _refuse("--from-log", {"--exact": exact or None, **given}, unused)
        place = output or _folder(from_log.name)
        if slam == "graph":
            _refuse("--slam graph", given, ("--particles",))
        if slam == "gmapping":
            particles = particles or PARTICLES
        _map_log(from_log, particles, chosen_seed, with_clip, place, as_json)
        return
    if from_map is not None:
        others = {"--exact": exact or None, **given}
        _refuse(
            "--from-map", others, ("--exact", "--robots", "--slam", "--particles", "--seed", CLIP, "--engine")
        )
        _resample(from_map, settings or [], output or _folder(from_map.name, "-resampled"), as_json)
        return
    assert arena is not None
    if exact:
        _refuse("--exact", given, [name for name in given if name != "--set"])
        _draw_exactly(arena, settings or [], output or _folder(arena, "-exact"), as_json)
        return
    if slam == "graph":
        raise InputError("map: --slam graph maps recorded logs only; leave it out, or give --from-log FILE")
    wishes = {"arena": arena, "robots": robots, "particles": particles}
    wishes |= {"engine": engine, "robot": robot_model}
    values: dict[str, Scalar] = {name: value for name, value in wishes.items() if value is not None}
    _explore(_joined(values, settings or []), chosen_seed, with_clip, output or _folder(arena), as_json)


def _refuse(option: str, given: Mapping[str, object], names: Iterable[str]) -> None:
    from midnet_bench.errors import InputError

    for name in names:
        if given[name] is not None:
            raise InputError(f"map: {name} has no meaning with {option}; leave it out")


def _joined(values: "dict[str, Scalar]", settings: list[str]) -> "dict[str, Scalar]":
    """What arguments and ``--set`` ask for. Raises InputError if both name one thing."""
    return {**values, **options.settings_with(values, settings)}


def _draw_exactly(arena: str, settings: list[str], output: Path, as_json: bool) -> None:
    from midnet_bench.workflows.map_files import write_exact_map

    grid, files = write_exact_map(_joined({"arena": arena}, settings), output)
    _tell(grid, files, [], as_json)


def _resample(path: Path, settings: list[str], output: Path, as_json: bool) -> None:
    from midnet_bench.workflows.map_files import write_resampled_map

    grid, files = write_resampled_map(path, _joined({}, settings), output)
    _tell(grid, files, [], as_json)


def _map_log(path: Path, particles: int | None, seed: int, clip: bool, output: Path, as_json: bool) -> None:
    from midnet_bench.cli.progress import meter
    from midnet_bench.io.scan_logs import read_scan_log

    log = read_scan_log(path)
    # after the log is read: these take seconds, and a bad log is told at once
    from midnet_bench.mapping.log_mapping import held_in_memory
    from midnet_bench.workflows.log_map import write_log_map

    with meter() as shown, held_in_memory(log):
        made = write_log_map(
            log,
            particles,
            seed,
            output,
            clip,
            progress=lambda done, scans: shown.show(done, scans, f"scan {done} of {scans}"),
        )
    _tell(made.grid, made.files, made.warnings, as_json)


def _explore(values: "dict[str, Scalar]", seed: int, clip: bool, output: Path, as_json: bool) -> None:
    from midnet_bench.cli.progress import meter
    from midnet_bench.cli.reports import show
    from midnet_bench.experiments.mapping.parameters import MappingParameters
    from midnet_bench.workflows.exploration import write_exploration

    parameters = MappingParameters.parse(values, "command line")
    with meter(estimates=False) as shown:
        made = write_exploration(
            parameters,
            seed,
            output,
            clip,
            progress=lambda simulated_s, known: shown.show(
                known, 1.0, f"{simulated_s:.0f} s simulated, {known:.1%} explored"
            ),
        )
    if not as_json:
        show(None, [made.in_words()], as_json=False)
    _tell(made.exploration.grid, made.files, made.exploration.warnings, as_json, [made.scores])


def _folder(source: str, ending: str = "") -> Path:
    """Where a map goes unless ``-o`` says otherwise."""
    return options.RESULTS / f"map-{_ENDINGS.sub('', Path(source).name)}{ending}"


def _tell(
    grid: "OccupancyGrid",
    files: list[Path],
    warnings: list[str],
    as_json: bool,
    tables: "Iterable[Table]" = (),
) -> None:
    """Print what was made: warnings and lines for people, or one JSON document."""
    for warning in warnings:
        messages.log.warning("warning: %s", warning)
    if as_json:
        from midnet_bench.analysis.tables import to_json

        made = to_json(
            "mapping" if tables else None,
            tables,
            cells=[grid.width, grid.height],
            resolution_m=grid.resolution,
            files=[str(file) for file in files],
            warnings=warnings,
        )
        typer.echo(json.dumps(made, indent=1, allow_nan=False))
        return
    typer.echo(f"{grid.width} x {grid.height} cells of {grid.resolution:g} m")
    for file in files:
        typer.echo(file)
