"""``replay``: MIDNet on a recording."""

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
    """The key of setup.yaml that an option of an earlier version became; None of any other option."""
    from midnet_bench.recording.setup import RecordingSetup

    named = {"--scan-delay": "delay_s", "--ally": "allies", "--to": "to_s"}
    start = named.get(option, option[2:].replace("-", "_"))
    keys = (key for key in RecordingSetup.model_fields if len(start) > 3 and key.startswith(start))
    return next(keys, None)


@dataclass(frozen=True)
class ReplayOptions:
    """Options of ``replay``; those that are keys of setup.yaml too count more than the file.

    Options:
        setup FILE: Topics, mount, clock, delay, allies and labels: a setup.yaml, as --check writes it.
        map --map FILE|TOPIC: Prior map: a map_server YAML, or a topic.
        pose [NAME=]TOPIC: Robot's pose: a topic, tf, a CSV or TUM file, or at:X,Y,YAW_DEG for one at rest.
        start [NAME=]PLACE: Where odometry begins on the map: X,Y,YAW_DEG, or found: the map is searched.
        truth FILE|NAME=TOPIC: Labels: a CSV (t or scan_index, id, x, y), or the pose of an intruder.
        preset: Detector options for real robots, the paper's, or both (default).
        check --check: Only check that scans, poses and map fit; write a corrected setup.yaml.
        film --film: Draw the recording: trial.mp4 and storyboard.png.
        bag FILE: Write boxes, tracks, foreground, scans and tf to a bag: .mcap, .bag, or a ROS 2 folder.
        steps N: Only walk frame N, counted from 0, through the paper's equations: steps.html.
        output DIR: Folder for the results (default results/replay-FILE).
    """

    setup: Path | None = None
    map: str | None = None
    pose: list[str] | None = None
    start: list[str] | None = None
    truth: list[str] | None = None
    preset: Literal["real", "paper", "both"] | None = None
    settings: options.Settings = None
    check: bool = False
    film: bool = False
    bag: Path | None = None
    steps: int | None = None
    output: Path | None = None
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
        options.argument(
            None,
            "A ROS 1 bag, a ROS 2 bag's folder, an MCAP file, a CSV table or a CARMEN log; several are "
            "played together.",
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
