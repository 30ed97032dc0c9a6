"""The commands that make one trial's pictures or its bag, ``render`` and ``export``, and ROS's ``node``."""

import contextlib
from pathlib import Path
from typing import Annotated, Literal

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command
from midnet_bench.cli.errors import Where, places

SEED, ROBOTS = 1, 5
"""of a trial that is no campaign's, unless the user says otherwise"""


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
    parameters = options.joined(chosen, settings, map_file)
    found = registry.experiment(experiment)
    known = found.model.defaults()
    options.check_values(experiment, chosen, "--{key}")
    directory = output or options.RESULTS / f"render-{found.name}-{seed}"
    with meter() as shown:
        files = render_trial(
            experiment,
            {**({"robots": ROBOTS} if "robots" in known else {}), **parameters},
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


@command(example="midnet-bench export detection --robots 5 --frames 400 --format mcap")
def export(
    trial: Annotated[
        str,
        options.argument(
            None, "detection, labyrinth, or the folder of a campaign of one of them.", completion.exported
        ),
    ],
    bag_format: Annotated[
        str,
        options.option(
            "NAME", "mcap (one file), ros2 (a bag's folder, SQLite) or ros1 (a .bag file).", "--format"
        ),
    ] = "mcap",
    robots: Annotated[int | None, options.option("N", "Security robots (default 5).")] = None,
    seed: Annotated[int | None, options.option("N", "The trial's seed (default 1).", min=0)] = None,
    where: Where = None,
    frames: options.Number = None,
    engine: options.Engine = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Annotated[
        Path | None,
        options.option(
            "PATH", "The file, or the folder of ros2 (default results/export-...).", "-o", "--output"
        ),
    ] = None,
    trust: options.Trust = False,
) -> None:
    """Run one trial and write every sensor and detector message to a ROS bag.

    Foxglove, RViz, 'ros2 bag play' and 'rosbag play' open it without midnet-bench; docs/ros.md lists the
    topics. Of a campaign's folder --seed, --robots and --where name the trial.
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.errors import InputError
    from midnet_bench.experiments import registry
    from midnet_bench.io.files import plain_name
    from midnet_bench.recording.files.writer import ending_of
    from midnet_bench.workflows.export import export_trial, trial_of

    ending = ending_of(bag_format)
    if Path(trial).is_dir():
        if frames is not None or engine or map_file or settings:
            raise InputError(
                "export: a campaign's trial is as it was; leave out --frames, --engine, --map, --set"
            )
        name = Path(trial).resolve().name
        experiment, parameters, seed = trial_of(trial, seed, places(where, robots))
    else:
        if where:
            raise InputError("export: --where goes with a campaign's folder; set parameters by --set")
        found = registry.experiment(trial)
        chosen = {"robots": robots, "frames": frames, "engine": engine}
        options.check_values(trial, chosen, "--{key}")
        name, experiment, seed = found.name, trial, SEED if seed is None else seed
        parameters = {"robots": ROBOTS, **options.joined(chosen, settings, map_file)}
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


@command(example="midnet-bench node guard_1 guard_2 --ros 2 --set local_size_m=6")
def node(
    robots: Annotated[
        list[str],
        options.argument("NAME...", "The robots; also ROS's remappings, such as /guard_1/scan:=/tb3_0/scan."),
    ],
    ros: Annotated[Literal["1", "2"], options.option(None, "The version of ROS.", "--ros")] = "2",
    map_file: Annotated[
        Path | None, options.option("FILE", "The prior map: a map_server YAML (default topic /map).", "--map")
    ] = None,
    pose: Annotated[
        Literal["topic", "tf"], options.option(None, "Poses are from the topics /NAME/pose, or from tf.")
    ] = "topic",
    mount: Annotated[
        str | None,
        options.option("X,Y,YAW_DEG", "Where each laser sits on its robot (default from /tf_static)."),
    ] = None,
    no_return: Annotated[
        list[str] | None,
        options.option(
            "CODE=MEANING", "What inf, nan, zero, below or above means: clears (inf, above) or nothing."
        ),
    ] = None,
    rate: Annotated[float, options.option("HZ", "Frames a second, by the stamps.")] = 5.0,
    patience: Annotated[
        float, options.option("S", "Make a frame so long after its time even if a robot is silent.")
    ] = 1.0,
    preset: Annotated[
        Literal["real", "paper"], options.option(None, "Which values: for real robots, or the paper's.")
    ] = "real",
    settings: options.Settings = None,
) -> None:
    """Run MIDNet as a node of ROS: /map, /NAME/scan and poses in, /midnet/detections (MarkerArray) out.

    ROS 2: rclpy, or without it midnet-bench[ros2]. ROS 1: rospy (docs/ros.md). Each frame uses exactly the
    messages stamped before it, whatever the playback speed.
    """
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.io.map_server import load_map
    from midnet_bench.recording import ros1_node, ros2_node
    from midnet_bench.recording.live import LiveOptions
    from midnet_bench.recording.plan import mount_of
    from midnet_bench.recording.recording_settings import ReplaySettings
    from midnet_bench.recording.ros_node import spin
    from midnet_bench.recording.setup import RecordingSetup, by_name

    values = parse_settings(settings or [], None)
    ReplaySettings.from_flat(values)  # wrong options end the command before it waits for a map
    chosen = LiveOptions(
        [name for name in robots if ":=" not in name],
        lambda resolution_m: ReplaySettings.of(preset, values, resolution_m),
        pose == "tf",
        None if mount is None else mount_of(mount, "--mount"),
        RecordingSetup().changed({"no_return": by_name(no_return, "--no-return")}, "node").no_return,
        rate,
        patience,
    )
    prior_map = None if map_file is None else load_map(map_file)
    renamed = [name for name in robots if ":=" in name]
    with contextlib.suppress(KeyboardInterrupt):  # the end that a node has
        spin(ros1_node.Rospy(renamed) if ros == "1" else ros2_node.node_of(renamed), chosen, prior_map)
