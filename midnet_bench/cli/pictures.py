"""The command that draws a trial: ``render``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command

ROBOTS = 5
"""of a trial that is drawn, unless the user says otherwise"""


@command(example="midnet-bench render labyrinth --robots 3 --intruders 2 --seed 4")
def render(
    experiment: Annotated[
        str, options.argument(None, "detection or labyrinth.", completion.experiments)
    ] = "detection",
    robots: Annotated[int | None, options.option("N", "Security robots (default 5).")] = None,
    intruders: options.Number = None,
    frames: options.Number = None,
    seed: options.Seed = 1,
    frame: Annotated[
        int | None,
        options.option("N", "Which frame the pictures show, counted from 1 (default 100 or the last)."),
    ] = None,
    clip: Annotated[bool, options.flag("Make a film (MP4) and a storyboard of the whole trial.")] = True,
    speed: Annotated[float, options.option("FACTOR", "How much faster than real time the film runs.")] = 4.0,
    scans: Annotated[bool, options.flag("Show the returns of the robots' LiDARs.")] = False,
    arena: options.Arena = None,
    engine: options.Engine = None,
    robot_model: options.RobotModel = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None, options.output_option("DIR", "Folder for the pictures (default results/render-...).")
    ] = None,
) -> None:
    """Draw one trial: the arena from above, each robot's grids A to D, the detections, and a film."""
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments import registry
    from midnet_bench.workflows.render import render_trial

    chosen = {"robots": robots, "intruders": intruders, "frames": frames, "arena": arena}
    chosen |= {"engine": engine, "robot": robot_model}
    given = options.settings_with(chosen, settings, map_file)
    parameters = {key: value for key, value in chosen.items() if value is not None}
    found = registry.experiment(experiment)
    known = found.model.defaults()
    options.check_values(experiment, parameters, "--{key}")
    directory = output or options.RESULTS / f"render-{found.name}-{seed}"
    with meter() as shown:
        files = render_trial(
            experiment,
            {**({"robots": ROBOTS} if "robots" in known else {}), **parameters, **given},
            seed,
            directory,
            frame,
            clip,
            progress=lambda done, most: shown.show(done, most, f"frame {done} of at most {most}"),
            speed=speed,
            scans=scans,
        )
    for file in files:
        typer.echo(file)
