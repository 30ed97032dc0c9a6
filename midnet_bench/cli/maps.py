"""The command that makes maps: ``map``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

if TYPE_CHECKING:
    from midnet_bench.experiments.trial import Scalar
    from midnet_bench.grid import OccupancyGrid

PARTICLES = 30


@app.command("map", rich_help_panel="Inputs")
def make_map(
    arena: Annotated[str | None, typer.Argument(help="Packaged arena or YAML file, to be explored.")] = None,
    robots: Annotated[int | None, typer.Option(help="Burgers that explore it; 1 unless given.")] = None,
    exact: Annotated[bool, typer.Option("--exact", help="Draw the arena's walls, explore nothing.")] = False,
    from_log: Annotated[
        Path | None, typer.Option(help="Run GMapping over a recorded log: CARMEN, or a table of scans.")
    ] = None,
    particles: Annotated[int | None, typer.Option(min=1, help="Of GMapping; 30 unless given.")] = None,
    seed: options.Seed = 1,
    clip: Annotated[bool, typer.Option(help="Make an MP4 of the exploration.")] = True,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder, or the map's YAML file with all else beside it."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make a map: explore an arena, run GMapping over a recorded log, or draw an arena exactly.

    Writes what ROS map_server reads, the binary grid that MIDNet subtracts, pictures and, of an exploration,
    scores.
    """
    from midnet_bench.campaign.spec import parse_settings
    from midnet_bench.errors import InputError

    values = parse_settings(settings or [])
    if (arena is None) == (from_log is None):
        raise InputError("map: give either an arena, such as map1, or --from-log FILE")
    if from_log is not None:
        if exact or robots is not None or values:
            raise InputError("map: --from-log does not go with --exact, --robots or --set")
        _map_log(from_log, particles or PARTICLES, seed, clip, output or _folder(from_log.name))
        return
    assert arena is not None
    if exact:
        if robots is not None or particles is not None:
            raise InputError("map: --exact explores nothing; leave out --robots and --particles")
        _draw_exactly({"arena": arena, **values}, output or _folder(f"{arena}-exact"))
        return
    given = {"robots": robots, "particles": particles}
    chosen = {name: value for name, value in given.items() if value is not None}
    _explore({"arena": arena, **chosen, **values}, seed, clip, output or _folder(arena), as_json)


def _draw_exactly(values: "dict[str, Scalar]", output: Path) -> None:
    from midnet_bench.experiments.inputs import EXACT, arena_from, prior_map_from
    from midnet_bench.experiments.parameters import DetectionParameters
    from midnet_bench.report.map_files import MapFiles, write_map
    from midnet_bench.spec import parse

    chosen = parse(DetectionParameters, {"prior_map": EXACT, **values}, "command line")
    arena = arena_from(chosen.arena)
    grid = prior_map_from(EXACT, arena, chosen.resolution_m)
    _tell_of(grid, write_map(MapFiles.at(output), grid, f"{arena.name}, drawn exactly", chosen))


def _map_log(path: Path, particles: int, seed: int, clip: bool, output: Path) -> None:
    from midnet_bench.mapping.log_reading import read_scan_log

    log = read_scan_log(path)
    # after the log is read: these take seconds, and a bad log is told at once
    from midnet_bench.report.log_map import write_log_map

    made = write_log_map(log, particles, seed, output, clip, progress=_tell_scans)
    _warn(made.warnings)
    _tell_of(made.grid, made.files)


def _explore(values: "dict[str, Scalar]", seed: int, clip: bool, output: Path, as_json: bool) -> None:
    from midnet_bench.cli.exploration_progress import exploration_progress_on
    from midnet_bench.cli.reports import show
    from midnet_bench.experiments.mapping_parameters import MappingParameters
    from midnet_bench.report.exploration import write_exploration
    from midnet_bench.spec import parse

    parameters = parse(MappingParameters, values, "command line")
    with exploration_progress_on(sys.stderr) as progress:
        made = write_exploration(parameters, seed, output, clip, progress)
    _warn(made.exploration.warnings)
    show([made.scores if as_json else made.in_words()], as_json)
    if not as_json:
        _tell_of(made.exploration.grid, made.files)


def _folder(source: str) -> Path:
    """Where a map goes unless ``-o`` says otherwise."""
    return options.RESULTS / f"map-{Path(source).name.split('.')[0]}"


def _warn(warnings: list[str]) -> None:
    for warning in warnings:
        typer.echo(f"warning: {warning}", err=True)


def _tell_of(grid: "OccupancyGrid", files: list[Path]) -> None:
    typer.echo(f"{grid.width} x {grid.height} cells of {grid.resolution:g} m")
    for file in files:
        typer.echo(file)


def _tell_scans(done: int, scans: int) -> None:
    if done % 100 == 0 or done == scans:
        typer.echo(f"scan {done} of {scans}", err=True)
