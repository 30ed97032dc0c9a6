"""The command that makes maps: ``map``."""

import json
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

if TYPE_CHECKING:
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.trial import Scalar
    from midnet_bench.grid import OccupancyGrid

PARTICLES, SEED = 30, 1
CLIP = "--clip/--no-clip"
SET_BY_EXACT = (
    "resolution_m",
    "thresh_global",
    "cost_scaling",
    "inscribed_radius_m",
    "inflation_radius_m",
    "unknown_in_prior",
)
"""what an exact map and its binary grid depend on"""

_ENDINGS = re.compile(r"(\.(yaml|yml|log|clf|carmen|txt|dat))?(\.gz)?$")


@app.command("map", rich_help_panel="Inputs")
def make_map(
    arena: Annotated[str | None, typer.Argument(help="Packaged arena or YAML file, to be explored.")] = None,
    robots: Annotated[int | None, typer.Option(help="Burgers that explore it; 1 unless given.")] = None,
    exact: Annotated[bool, typer.Option("--exact", help="Draw the arena's walls, explore nothing.")] = False,
    from_log: Annotated[
        Path | None, typer.Option(help="Run GMapping over a recorded log: CARMEN, or a table of scans.")
    ] = None,
    particles: Annotated[int | None, typer.Option(min=1, help="Of GMapping; 30 unless given.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of everything random; 1 unless given.")] = None,
    clip: Annotated[bool | None, typer.Option(CLIP, help="Make an MP4 of the growing map, or none.")] = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder, or the map's YAML file with all else beside it."),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Make a map: explore an arena, run GMapping over a recorded log, or draw an arena exactly.

    Writes what ROS map_server reads and the binary grid that MIDNet subtracts; pictures and a film of the
    growing map, unless it is exact; and, of an exploration, scores.
    """
    from midnet_bench.errors import InputError

    if (arena is None) == (from_log is None):
        raise InputError("map: give either an arena, such as map1, or --from-log FILE")
    given = {"--robots": robots, "--particles": particles, "--seed": seed, CLIP: clip, "--set": settings}
    chosen_seed, with_clip = SEED if seed is None else seed, clip is not False
    if from_log is not None:
        _refuse("--from-log", {"--exact": exact or None, **given}, ("--exact", "--robots", "--set"))
        place = output or _folder(from_log.name)
        _map_log(from_log, particles or PARTICLES, chosen_seed, with_clip, place, as_json)
        return
    assert arena is not None
    if exact:
        _refuse("--exact", given, ("--robots", "--particles", "--seed", CLIP))
        _draw_exactly(arena, settings or [], output or _folder(arena, "-exact"), as_json)
        return
    wishes = {"arena": arena, "robots": robots, "particles": particles}
    values: dict[str, Scalar] = {name: value for name, value in wishes.items() if value is not None}
    _explore(_joined(values, settings or []), chosen_seed, with_clip, output or _folder(arena), as_json)


def _refuse(option: str, given: Mapping[str, object], names: Iterable[str]) -> None:
    from midnet_bench.errors import InputError

    for name in names:
        if given[name] is not None:
            raise InputError(f"map: {name} has no meaning with {option}; leave it out")


def _joined(values: "dict[str, Scalar]", settings: list[str]) -> "dict[str, Scalar]":
    """What arguments and ``--set`` ask for. Raises InputError if both name one thing."""
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.errors import InputError

    parsed = parse_settings(settings)
    for name in values.keys() & parsed.keys():
        raise InputError(f"--set {name}: the command line names it without --set too; give it once")
    return {**values, **parsed}


def _draw_exactly(arena: str, settings: list[str], output: Path, as_json: bool) -> None:
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.guarded.inputs import EXACT, arena_from, prior_map_from
    from midnet_bench.experiments.guarded.parameters import DetectionParameters
    from midnet_bench.io.checked_yaml import parse
    from midnet_bench.workflows.map_files import MapFiles, write_configuration, write_map

    values = _joined({"arena": arena}, settings)
    for name in values.keys() & DetectionParameters.model_fields.keys() - {"arena", *SET_BY_EXACT}:
        raise InputError(
            f"--set {name}: changes nothing of an exact map; --set takes {', '.join(SET_BY_EXACT)}"
        )
    chosen = parse(DetectionParameters, {"prior_map": EXACT, **values}, "command line")
    place = arena_from(chosen.arena)
    files = MapFiles.at(output)
    configuration = {"map": EXACT, **chosen.model_dump(mode="json", include={"arena", *SET_BY_EXACT})}
    files.refuse_another(configuration)
    grid = prior_map_from(EXACT, place, chosen.resolution_m)
    configured = write_configuration(files, configuration)
    written = write_map(files, grid, f"{place.name}, drawn exactly", chosen)
    _tell(grid, [*written, configured], [], as_json)


def _map_log(path: Path, particles: int, seed: int, clip: bool, output: Path, as_json: bool) -> None:
    from midnet_bench.errors import InputError
    from midnet_bench.io.scan_logs import read_scan_log

    log = read_scan_log(path)
    # after the log is read: these take seconds, and a bad log is told at once
    from midnet_bench.workflows.log_map import write_log_map

    try:
        made = write_log_map(log, particles, seed, output, clip, progress=_tell_scans)
    except MemoryError as error:
        raise InputError(
            f"{path}: a map of that size does not fit into memory; are odometry and ranges in metres?"
        ) from error
    _tell(made.grid, made.files, made.warnings, as_json)


def _explore(values: "dict[str, Scalar]", seed: int, clip: bool, output: Path, as_json: bool) -> None:
    from midnet_bench.cli.progress import exploration_progress_on
    from midnet_bench.cli.reports import show
    from midnet_bench.experiments.mapping.parameters import MappingParameters
    from midnet_bench.io.checked_yaml import parse
    from midnet_bench.workflows.exploration import write_exploration

    parameters = parse(MappingParameters, values, "command line")
    with exploration_progress_on(sys.stderr) as progress:
        made = write_exploration(parameters, seed, output, clip, progress)
    if not as_json:
        show([made.in_words()], as_json=False)
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
        typer.echo(f"warning: {warning}", err=True)
    if as_json:
        from midnet_bench.cli.reports import json_of

        made = {
            "cells": [grid.width, grid.height],
            "resolution_m": grid.resolution,
            "files": [str(file) for file in files],
            "warnings": warnings,
        }
        typer.echo(json.dumps({**json_of(tables), **made}, indent=1, allow_nan=False))
        return
    typer.echo(f"{grid.width} x {grid.height} cells of {grid.resolution:g} m")
    for file in files:
        typer.echo(file)


def _tell_scans(done: int, scans: int) -> None:
    if done % 100 == 0 or done == scans:
        typer.echo(f"scan {done} of {scans}", err=True)
