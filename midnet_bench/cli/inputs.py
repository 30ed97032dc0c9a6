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
    arena: Annotated[str, typer.Argument(help="Packaged arena or YAML file.")],
    exact: Annotated[bool, typer.Option("--exact", help="Draw the walls straight from the arena.")] = False,
    settings: options.Settings = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The map's YAML file; its image lies beside it.")
    ] = Path("map.yaml"),
) -> None:
    """Write a prior map as ROS map_server reads it, and the binary grid that MIDNet subtracts."""
    from midnet_bench.campaign.spec import parse_settings
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.inputs import EXACT, arena_from, prior_map_from
    from midnet_bench.experiments.parameters import DetectionParameters
    from midnet_bench.experiments.watch import binary_prior
    from midnet_bench.map_server import save_binary_map, save_map
    from midnet_bench.spec import parse

    if not exact:
        raise InputError("map: only maps drawn from the arena can be made; add --exact")
    values = {"arena": arena, **parse_settings(settings or [])}
    chosen = parse(DetectionParameters, values, "command line")
    grid = prior_map_from(EXACT, arena_from(chosen.arena), chosen.resolution_m)
    binary = binary_prior(grid, chosen)
    binary_file = output.with_stem(f"{output.stem}_binary")
    save_map(grid, output)
    save_binary_map(binary, binary_file)
    typer.echo(
        f"{output}: {grid.width} x {grid.height} cells of {grid.resolution:g} m; binary: {binary_file}"
    )
