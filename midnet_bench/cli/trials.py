"""The commands that make one trial's pictures or its bag, ``render`` and ``export``, and ROS's ``node``."""

import contextlib
from pathlib import Path
from typing import Annotated, Literal

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command
from midnet_bench.errors import InputError

SEED, ROBOTS = 1, 5  # of a trial that is no campaign's, unless the user says otherwise


@command(example="midnet-bench render labyrinth --robots 3 --intruders 2 --seed 4")
def render(
    experiment: Annotated[
        str, options.argument(None, "detection or labyrinth.", completion.experiments)
    ] = "detection",
    robots: int | None = None,
    intruders: options.Number = None,
    frames: options.Number = None,
    seed: options.Seed = SEED,
    frame: int | None = None,
    clip: bool = True,
    speed: float = 4.0,
    scans: bool = False,
    arena: options.Arena = None,
    engine: options.Part = None,
    robot_model: options.Part = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Path | None = None,
) -> None:
    """Draw one trial: the arena from above, each robot's grids A to D, the detections, and a film.

    Options:
        robots N: Security robots (default 5).
        frame N: Which frame the pictures show, counted from 1 (default 100 or the last).
        clip --clip/--no-clip: Make a film (MP4) and a storyboard of the whole trial.
        speed FACTOR: How much faster than real time the film runs.
        scans --scans/--no-scans: Show the returns of the robots' LiDARs.
        output DIR: Folder for the pictures (default results/render-...).
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments import registry
    from midnet_bench.workflows.render import render_trial

    chosen = {"robots": robots, "intruders": intruders, "frames": frames, "arena": arena}
    chosen |= {"engine": engine, "robot": robot_model}
    parameters = options.joined(chosen, settings, map_file)
    found = registry.experiment(experiment)
    options.check_values(experiment, chosen, "--{key}")
    if "robots" in found.parameters.defaults():
        parameters = {"robots": ROBOTS, **parameters}
    directory = output or options.RESULTS / f"render-{found.name}-{seed}"
    with meter() as bar:
        files = render_trial(
            *(experiment, parameters, seed, directory, frame, clip),
            progress=lambda done, most: bar.show(done, most, f"frame {done} of at most {most}"),
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
    bag_format: str | None = None,
    robots: int | None = None,
    seed: int | None = None,
    where: options.Where = None,
    frames: options.Number = None,
    engine: options.Part = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: Path | None = None,
    trust: options.Trust = False,
) -> None:
    """Run one trial and write every sensor and detector message to a ROS bag.

    Foxglove, RViz, 'ros2 bag play' and 'rosbag play' open it without midnet-bench; docs/ros.md lists the
    topics. Of a campaign's folder --seed, --robots and --where name the trial.

    Options:
        bag_format --format NAME: mcap (one file), ros2 (a bag's folder, SQLite) or ros1 (a .bag file);
            default by the name of -o, else mcap.
        robots N: Security robots (default 5).
        seed N>=0: The trial's seed (default 1).
        output PATH: The file, or the folder of ros2 (default results/export-...).
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments import registry
    from midnet_bench.io.files import plain_name
    from midnet_bench.recording.files.writer import ending_of, format_of
    from midnet_bench.workflows.export import export_trial, trial_of

    ending = ending_of(bag_format or "mcap")
    bag_format = format_of(output or Path(f"trial{ending}"), bag_format)
    if Path(trial).is_dir():
        if frames is not None or engine or map_file or settings:
            raise InputError(
                "export: a campaign's trial is as it was; leave out --frames, --engine, --map, --set"
            )
        name, cells = Path(trial).resolve().name, [] if robots is None else [f"robots={robots}"]
        experiment, parameters, seed = trial_of(trial, seed, [*(where or ()), *cells])
    else:
        if where:
            raise InputError("export: --where goes with a campaign's folder; set parameters by --set")
        chosen = {"robots": robots, "frames": frames, "engine": engine}
        name, experiment, seed = registry.experiment(trial).name, trial, SEED if seed is None else seed
        options.check_values(trial, chosen, "--{key}")
        parameters = {"robots": ROBOTS, **options.joined(chosen, settings, map_file)}
    path = output or options.RESULTS / plain_name(f"export-{name}-{seed}{ending}")
    with meter() as bar:
        export_trial(
            *(experiment, parameters, seed, path, bag_format),
            progress=lambda done, most: bar.show(done, most, f"frame {done} of at most {most}"),
        )
    typer.echo(path)


@command(example="midnet-bench node guard_1 guard_2 --ros 2 --set local_size_m=6")
def node(
    robots: Annotated[
        list[str],
        options.argument("NAME...", "The robots; also ROS's remappings, such as /guard_1/scan:=/tb3_0/scan."),
    ],
    ros: Literal["1", "2"] = "2",
    map_file: Path | None = None,
    pose: Literal["topic", "tf"] = "topic",
    mount: str | None = None,
    no_return: list[str] | None = None,
    rate: float = 5.0,
    patience: float = 1.0,
    preset: Literal["real", "paper"] = "real",
    settings: options.Settings = None,
) -> None:
    """Run MIDNet as a node of ROS: /map, /NAME/scan and poses in, /midnet/detections (MarkerArray) out.

    ROS 2: rclpy, or without it midnet-bench[ros2]. ROS 1: rospy (docs/ros.md). Each frame uses exactly the
    messages stamped before it, whatever the playback speed.

    Options:
        ros: The version of ROS.
        map_file FILE: The prior map: a map_server YAML (default topic /map).
        pose: Poses are from the topics /NAME/pose, or from tf.
        mount X,Y,YAW_DEG: Where each laser sits on its robot (default from /tf_static).
        no_return CODE=MEANING: What inf, nan, zero, below or above means: clears (inf, above) or nothing.
        rate HZ: Frames a second, by the stamps.
        patience S: Make a frame so long after its time even if a robot is silent.
        preset: Which values: for real robots, or the paper's.
    """
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.io.map_server import load_map
    from midnet_bench.recording import ros_node
    from midnet_bench.recording.live import LiveOptions
    from midnet_bench.recording.setup import RecordingSetup, ReplaySettings, by_name, mount_of

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
        middleware = ros_node.node_of(ros, renamed)
        ros_node.spin(middleware, chosen, prior_map)
