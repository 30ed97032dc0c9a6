"""The command that draws a trial: ``render``."""

import sys
from typing import Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app


@app.command(rich_help_panel="Results")
def render(
    experiment: Annotated[str, typer.Argument(help="detection or labyrinth")] = "detection",
    robots: Annotated[int, typer.Option(help="Security robots.")] = 5,
    intruders: Annotated[int | None, typer.Option(help="Mobile intruders, in the labyrinth.")] = None,
    frames: Annotated[int | None, typer.Option(help="Frames of a detection trial, at 5 Hz.")] = None,
    seed: options.Seed = 1,
    frame: Annotated[
        int | None,
        typer.Option(help="The frame that the pictures show, counted from 1; 100 or the last unless given."),
    ] = None,
    clip: Annotated[bool, typer.Option(help="Make an MP4 and a storyboard of the whole trial.")] = True,
    speed: Annotated[float, typer.Option(help="How much faster than real time the clip runs.")] = 4.0,
    arena: Annotated[str | None, typer.Option(help="Packaged arena or YAML file.")] = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: options.Output = None,
) -> None:
    """Draw one trial: the arena from above, each guard's grids A to D, the detections, and a clip."""
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.registry import parameters_model
    from midnet_bench.workflows.render import render_trial

    chosen = {"robots": robots, "intruders": intruders, "frames": frames, "arena": arena}
    parameters = {key: value for key, value in chosen.items() if value is not None}
    for key in parameters:
        if key not in parameters_model(experiment).model_fields:
            raise InputError(f"render: --{key} does not go with '{experiment}', which has no such parameter")
    directory = output or options.RESULTS / f"render-{experiment}-{seed}"
    files = render_trial(
        experiment,
        {**parameters, **parse_settings(settings or [], map_file)},
        seed,
        directory,
        frame,
        clip,
        progress=_tell,
        speed=speed,
    )
    for file in files:
        typer.echo(file)


def _tell(done: int, most: int) -> None:
    if done % 250 == 0:
        print(f"frame {done} of at most {most}", file=sys.stderr, flush=True)
