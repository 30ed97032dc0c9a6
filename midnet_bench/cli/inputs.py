"""The command about what a campaign stands on: ``parameters``."""

from typing import Annotated

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command


@command("Inputs", example="midnet-bench parameters labyrinth")
def parameters(
    experiment: Annotated[
        str,
        typer.Argument(
            help="detection, labyrinth, mapping, readings, or one of your own.",
            autocompletion=completion.experiments,
        ),
    ] = "detection",
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
