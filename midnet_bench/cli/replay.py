"""The commands about recordings: ``replay`` of one, ``export`` of a trial as one, and ROS's ``node``."""

import contextlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.messages import show
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.recording.setup import RecordingSetup


def key_of(option: str) -> str | None:
    """The key of setup.yaml that an option names, whole or by its beginning; None of any other option."""
    from midnet_bench.recording.setup import RecordingSetup

    start = option[2:].replace("-", "_")
    keys = (key for key in RecordingSetup.model_fields if len(start) > 3 and key.startswith(start))
    return next(keys, None)


@dataclass(frozen=True)
class ReplayOptions:
    """Options of ``replay``; those that are keys of setup.yaml too count more than the file."""

    setup: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Topics, mount, clock, delay, allies and labels: a setup.yaml, as --check writes it.",
        ),
    ] = None
    map: Annotated[
        str | None,
        typer.Option("--map", metavar="FILE|TOPIC", help="Prior map: a map_server YAML, or a topic."),
    ] = None
    pose: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]TOPIC",
            help="Robot's pose: a topic, tf, a CSV or TUM file, or at:X,Y,YAW_DEG for one at rest.",
        ),
    ] = None
    start: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]PLACE",
            help="Where odometry begins on the map: X,Y,YAW_DEG, or found: the map is searched.",
        ),
    ] = None
    truth: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE|NAME=TOPIC",
            help="Labels: a CSV (t or scan_index, id, x, y), or the pose of an intruder.",
        ),
    ] = None
    preset: Annotated[
        Literal["real", "paper", "both"] | None,
        typer.Option(help="Detector options for real robots, the paper's, or both (default)."),
    ] = None
    settings: options.Settings = None
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Only check that scans, poses and map fit; write a corrected setup.yaml."
        ),
    ] = False
    film: Annotated[
        bool, typer.Option("--film", help="Draw the recording: trial.mp4 and storyboard.png.")
    ] = False
    bag: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write boxes, tracks, foreground, scans and tf to a bag: .mcap, .bag, or a ROS 2 folder.",
        ),
    ] = None
    steps: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Only walk frame N, counted from 0, through the paper's equations: steps.html."
        ),
    ] = None
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the results (default results/replay-FILE)."
        ),
    ] = None
    as_json: options.Json = False
    wide: options.Wide = False

    def chosen(self) -> "RecordingSetup":
        """The setup of the file, changed by the options. Raises InputError: file, key and what is wrong."""
        from midnet_bench.campaign.definition import parse_settings
        from midnet_bench.recording.setup import FOUND, RecordingSetup, by_name, mount_of

        chosen = RecordingSetup() if self.setup is None else RecordingSetup.load(self.setup)
        named = {key: by_name(getattr(self, key), f"--{key}") for key in ("pose", "truth", "start")}

        def place_of(text: str) -> str | list[float]:
            at = None if text == FOUND else mount_of(text, "--start")
            return FOUND if at is None else [at.x, at.y, math.degrees(at.yaw)]

        given: dict[str, Any] = {
            "map": self.map,
            "preset": self.preset,
            **named,
            "start": {name: place_of(text) for name, text in named["start"].items()},
            "settings": {**chosen.settings, **parse_settings(self.settings or [], None)},
        }
        changes = {key: value for key, value in given.items() if value}
        return chosen.changed(changes if self.map is None else {**changes, "background": None})

    @contextmanager
    def naming_options(self) -> Iterator[None]:
        """Errors in the block that begin with a key name where its value was typed: an option or the file."""
        from midnet_bench.recording.setup import RecordingSetup

        typed = {key: f"{self.setup}: {key}" for key in RecordingSetup.model_fields if self.setup}
        typed |= {key: f"--{key}" for key in ("map", "pose", "start", "truth") if getattr(self, key)}
        try:
            yield
        except InputError as error:
            key, colon, rest = str(error).removeprefix("replay: ").partition(": ")
            option = rest.partition(":")[0]
            if key == "settings" and any(one.startswith(f"{option}=") for one in self.settings or []):
                raise InputError(f"--set {rest}") from error
            if key not in typed:
                raise
            raise InputError(f"{typed[key]}{colon}{rest}") from error


@command(example="midnet-bench replay robot.bag --map map.yaml --pose /amcl_pose")
def replay(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="A ROS 1 bag, a ROS 2 bag's folder, an MCAP file, a CSV table or a CARMEN log; several are "
            "played together."
        ),
    ],
    given: ReplayOptions,
) -> None:
    """Run MIDNet on a recording: its boxes, the cause of each error, and whether the inputs fit together.

    FILE alone lists its topics and proposes a command. What else a recording needs is a key of setup.yaml.
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.recording.inputs import list_topics
    from midnet_bench.workflows import replay as workflow

    if given.map is None and given.setup is None and given.bag is None:
        tables, lines, faults = list_topics(files)
        show(None, tables, given.as_json, given.wide)
        for line in lines:
            messages.note(line)
        if faults:
            raise InputError("; ".join(faults)[:600])
        return
    if given.bag is not None and (given.check or given.steps is not None):
        way = "--check" if given.check else "--steps"
        raise InputError(f"--bag: {way} makes no boxes that a bag could hold; leave one of the two out")
    with given.naming_options():
        setup = given.chosen()
        if given.check:
            made = workflow.check(files, setup, messages.note, given.output)
            show(None, made.tables, given.as_json, given.wide)
            messages.note(f"written: {made.files[0]}; use it by --setup {made.files[0]}")
            return
        if given.steps is not None:
            from midnet_bench.workflows.steps import steps_of_recording

            folder = given.output or options.RESULTS / f"steps-{files[0].stem}"
            for file in steps_of_recording(files, setup, given.steps, folder):
                typer.echo(file)
            return
        with meter() as shown:
            made = workflow.replay(
                *(files, setup, messages.note),
                lambda share: shown.show(share, 1.0, f"{share:.0%} of the recording"),
                *(given.film, given.output, given.bag),
            )
    show(None, made.tables, given.as_json, given.wide)
    if not given.as_json:
        messages.log_folder(made.files[0].parent)
    if made.faults:
        where = f"what came of it is in {made.files[0].parent}"
        raise InputError(f"{'; '.join(made.faults)[:400]}; {where}")


@command(example="midnet-bench export detection --robots 5 --frames 400 --format mcap")
def export(
    trial: Annotated[
        str,
        typer.Argument(
            autocompletion=options.offer_exported,
            help="detection, labyrinth, or the folder of a campaign of one of them.",
        ),
    ],
    bag_format: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="NAME",
            help="mcap (one file), ros2 (a bag's folder, SQLite) or ros1 (a .bag file); default by the name "
            "of -o, else mcap.",
        ),
    ] = None,
    robots: Annotated[int | None, typer.Option(metavar="N", help="Security robots (default 5).")] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="The trial's seed (default 1).")
    ] = None,
    where: options.Where = None,
    frames: options.Number = None,
    engine: options.Plugin = None,
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
    trust: options.Trust = False,
) -> None:
    """Run one trial and write every sensor and detector message to a ROS bag.

    Foxglove, RViz, 'ros2 bag play' and 'rosbag play' open it without midnet-bench; docs/ros.md lists the
    topics. Of a campaign's folder --seed, --robots and --where name the trial.
    """
    from midnet_bench.cli.progress import meter
    from midnet_bench.experiments import registry
    from midnet_bench.io.files import plain_name
    from midnet_bench.recording.files.writer import ending_of, format_of
    from midnet_bench.workflows.export import export_trial, setup_beside, trial_of

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
        name, experiment = registry.experiment(trial).name, trial
        seed = options.SEED if seed is None else seed
        options.check_values(trial, chosen, "--{key}")
        parameters = {"robots": options.ROBOTS, **options.joined(chosen, settings, map_file)}
    path = output or options.RESULTS / plain_name(f"export-{name}-{seed}{ending}")
    with meter() as bar:
        export_trial(
            *(experiment, parameters, seed, path, bag_format),
            progress=lambda done, most: bar.show(done, most, f"frame {done} of at most {most}"),
        )
    typer.echo(path)
    messages.note(f"to detect on it again: midnet-bench replay {path} --setup {setup_beside(path)}")


@command(example="midnet-bench node guard_1 guard_2 --ros 2 --set local_size_m=6")
def node(
    robots: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...", help="The robots; also ROS's remappings, such as /guard_1/scan:=/tb3_0/scan."
        ),
    ],
    ros: Annotated[Literal["1", "2"], typer.Option(help="The version of ROS.")] = "2",
    map_file: Annotated[
        Path | None,
        typer.Option("--map", metavar="FILE", help="The prior map: a map_server YAML (default topic /map)."),
    ] = None,
    pose: Annotated[
        Literal["topic", "tf"], typer.Option(help="Poses are from the topics /NAME/pose, or from tf.")
    ] = "topic",
    mount: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,YAW_DEG", help="Where each laser sits on its robot (default from /tf_static)."
        ),
    ] = None,
    no_return: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODE=MEANING",
            help="What inf, nan, zero, below or above means: clears (inf, above) or nothing.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(metavar="HZ", help="Frames a second, by the stamps.")] = 5.0,
    patience: Annotated[
        float,
        typer.Option(metavar="S", help="Make a frame so long after its time even if a robot is silent."),
    ] = 1.0,
    preset: Annotated[
        Literal["real", "paper"], typer.Option(help="Which values: for real robots, or the paper's.")
    ] = "real",
    settings: options.Settings = None,
) -> None:
    """Run MIDNet as a node of ROS: /map, /NAME/scan and poses in, /midnet/detections (MarkerArray) out.

    ROS 2: rclpy, or without it midnet-bench[ros2]. ROS 1: rospy (docs/ros.md). Each frame uses exactly the
    messages stamped before it, whatever the playback speed.
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
