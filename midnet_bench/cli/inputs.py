"""The commands about what a campaign stands on: ``map``, ``parameters``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app


@app.command(rich_help_panel="Inputs")
def parameters(
    experiment: Annotated[str, typer.Argument(help="detection or labyrinth")] = "detection",
    as_json: options.Json = False,
) -> None:
    """List every parameter of an experiment: default, range, meaning."""
    import json

    from midnet_bench.experiments.registry import parameters_model

    model = parameters_model(experiment)
    if as_json:
        typer.echo(json.dumps(model.model_json_schema(), indent=1))
        return
    from rich.console import Console
    from rich.table import Table

    shown = Table("parameter", "default", "allowed", "meaning", title=experiment, title_justify="left")
    for name, schema in model.model_json_schema()["properties"].items():
        shown.add_row(name, str(schema.get("default")), _allowed(schema), schema.get("description", ""))
    Console().print(shown)


def _allowed(schema: dict[str, object]) -> str:
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))  # type: ignore[call-overload]
    low = f">= {schema['minimum']}" if "minimum" in schema else ""
    low = f"> {schema['exclusiveMinimum']}" if "exclusiveMinimum" in schema else low
    high = f"<= {schema['maximum']}" if "maximum" in schema else ""
    return ", ".join(part for part in (low, high) if part) or str(schema.get("type", ""))


@app.command("map", rich_help_panel="Inputs")
def make_map(
    arena: Annotated[str | None, typer.Argument(help="Packaged arena or YAML file.")] = None,
    exact: Annotated[bool, typer.Option("--exact", help="Draw the walls straight from the arena.")] = False,
    from_log: Annotated[
        Path | None, typer.Option(help="Run GMapping over a recorded log: CARMEN, or a table of scans.")
    ] = None,
    particles: Annotated[int, typer.Option(min=1, help="Particles of GMapping.")] = 30,
    seed: options.Seed = 1,
    settings: options.Settings = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The map's YAML file; the rest lies beside it.")
    ] = Path("map.yaml"),
) -> None:
    """Write a prior map as ROS map_server reads it, and the binary grid that MIDNet subtracts."""
    from midnet_bench.campaign.spec import parse_settings
    from midnet_bench.errors import InputError

    if from_log is not None and arena is None and not exact:
        _map_from_log(from_log, particles, seed, output)
    elif arena is not None and exact and from_log is None:
        _map_exactly({"arena": arena, **parse_settings(settings or [])}, output)
    else:
        raise InputError("map: give either an arena and --exact, or --from-log FILE")


def _map_exactly(values: dict[str, object], output: Path) -> None:
    from midnet_bench.experiments.inputs import EXACT, arena_from, prior_map_from
    from midnet_bench.experiments.parameters import DetectionParameters
    from midnet_bench.experiments.watch import binary_prior
    from midnet_bench.map_server import save_binary_map, save_map
    from midnet_bench.spec import parse

    chosen = parse(DetectionParameters, values, "command line")
    grid = prior_map_from(EXACT, arena_from(chosen.arena), chosen.resolution_m)
    binary_file = output.with_stem(f"{output.stem}_binary")
    save_map(grid, output)
    save_binary_map(binary_prior(grid, chosen), binary_file)
    typer.echo(
        f"{output}: {grid.width} x {grid.height} cells of {grid.resolution:g} m; binary: {binary_file}"
    )


def _map_from_log(log: Path, particles: int, seed: int, output: Path) -> None:
    from midnet_bench.map_server import save_map
    from midnet_bench.mapping.log_mapping import map_log
    from midnet_bench.mapping.trajectory import write_tum

    result = map_log(log, particles, seed, progress=_tell)
    trajectory_file = output.with_suffix(".tum")
    save_map(result.grid, output)
    write_tum(result.trajectory, trajectory_file)
    for warning in result.warnings:
        typer.echo(f"warning: {warning}", err=True)
    grid = result.grid
    typer.echo(
        f"{output}: {grid.width} x {grid.height} cells of {grid.resolution:g} m from {result.scans} scans; "
        f"trajectory: {trajectory_file}"
    )


def _tell(done: int, scans: int) -> None:
    if done % 100 == 0 or done == scans:
        typer.echo(f"scan {done} of {scans}", err=True)
