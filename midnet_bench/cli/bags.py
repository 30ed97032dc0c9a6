"""The commands that speak ROS: ``export`` and ``ros1-node``."""

from pathlib import Path
from typing import Annotated

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command
from midnet_bench.cli.errors import Where, places
from midnet_bench.cli.pictures import ROBOTS

SEED = 1
"""of a trial that is no campaign's"""


@command("Recordings", example="midnet-bench export detection --robots 5 --frames 400 --format mcap")
def export(
    trial: Annotated[
        str,
        typer.Argument(
            help="detection, labyrinth, or the folder of a campaign of one of them.",
            autocompletion=completion.exported,
        ),
    ],
    bag_format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help="mcap (one file), ros2 (a bag's folder, SQLite) or ros1 (a .bag file).",
        ),
    ] = "mcap",
    robots: Annotated[int | None, typer.Option(metavar="N", help="Security robots (default 5).")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="The trial's seed (default 1).")
    ] = None,
    where: Where = None,
    frames: Annotated[
        int | None, typer.Option(metavar="N", help="Frames of a detection trial, 5 a second.")
    ] = None,
    engine: options.Engine = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH",
            help="The file, or the folder of ros2 (default results/export-...).",
        ),
    ] = None,
) -> None:
    """Run one trial and write all that its robots and its detector say as a ROS bag.

    Foxglove, RViz, 'ros2 bag play' and 'rosbag play' open it without midnet-bench; docs/export.md lists the
    topics. Of a campaign's folder --seed, --robots and --where name the trial.
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.errors import InputError
    from midnet_bench.experiments import registry
    from midnet_bench.io.files import plain_name
    from midnet_bench.recording.writer import ending_of
    from midnet_bench.workflows.export import export_trial, trial_of

    ending = ending_of(bag_format)
    if Path(trial).is_dir():
        if frames is not None or engine or map_file or settings:
            raise InputError(
                "export: a campaign's trial is as it was; leave out --frames, --engine, --map, --set"
            )
        if seed is None:
            raise InputError("export: name the campaign's trial by --seed, and by --robots or --where")
        name = Path(trial).resolve().name
        experiment, parameters = trial_of(trial, seed, places(where, robots))
    else:
        if where:
            raise InputError("export: --where goes with a campaign's folder; set parameters by --set")
        found = registry.experiment(trial)
        chosen = {"robots": robots, "frames": frames, "engine": engine}
        given = {key: value for key, value in chosen.items() if value is not None}
        if "frames" in given and "frames" not in found.model.defaults():
            raise InputError(f"export: --frames does not go with '{trial}', which has no such parameter")
        name, experiment, seed = found.name, trial, SEED if seed is None else seed
        parameters = {"robots": ROBOTS, **given, **options.settings_with(chosen, settings, map_file)}
    path = output or options.RESULTS / plain_name(f"export-{name}-{seed}{ending}")
    with meter() as shown:
        export_trial(
            experiment,
            parameters,
            seed,
            path,
            bag_format,
            progress=lambda done, most: shown.show(done, most, f"frame {done} of at most {most}"),
        )
    typer.echo(path)
