"""``replay``: MIDNet on a recording."""

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.reports import show


def _text(metavar: str, help: str) -> typer.models.OptionInfo:
    return typer.Option(metavar=metavar, help=help, show_default=False)


@command(example="midnet-bench replay robot.bag --map map.yaml --pose /amcl_pose")
def replay(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="A ROS 1 bag, a ROS 2 bag's folder, an MCAP file, a CSV table or a CARMEN log; several are "
            "played together.",
            show_default=False,
        ),
    ],
    setup: Annotated[
        Path | None,
        _text("FILE", "Topics, mount, clock, delay, allies and labels: a setup.yaml, as --check writes it."),
    ] = None,
    map: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="FILE|TOPIC",
            help="Prior map: a map_server YAML, or a topic.",
            show_default=False,
        ),
    ] = None,
    pose: Annotated[
        list[str] | None,
        _text(
            "[NAME=]TOPIC", "Robot's pose: a topic, tf, a CSV or TUM file, or at:X,Y,YAW_DEG for one at rest."
        ),
    ] = None,
    truth: Annotated[
        list[str] | None,
        _text("FILE|NAME=TOPIC", "Labels: a CSV (t or scan_index, id, x, y), or the pose of an intruder."),
    ] = None,
    preset: Annotated[
        Literal["real", "paper", "both"] | None,
        typer.Option(
            help="Detector options for real robots, the paper's, or both (default).", show_default=False
        ),
    ] = None,
    settings: options.Settings = None,
    localize: Annotated[
        bool, typer.Option("--localize", help="Correct the poses by matching scans to the map.")
    ] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="Only check that scans, poses and map fit; write a corrected setup.yaml."
        ),
    ] = False,
    film: Annotated[
        bool, typer.Option("--film", help="Draw the recording: trial.mp4 and storyboard.png.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the results (default results/replay-FILE)."
        ),
    ] = None,
    as_json: options.Json = False,
    wide: options.Wide = False,
) -> None:
    """Run MIDNet on a recording: its boxes, the cause of each error, and whether the inputs fit together.

    FILE alone lists its topics and proposes a command. What else a recording needs is a key of setup.yaml.
    """
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.cli.progress import meter
    from midnet_bench.errors import InputError
    from midnet_bench.recording.inputs import list_topics
    from midnet_bench.recording.setup import RecordingSetup, by_name
    from midnet_bench.workflows import replay as workflow

    def note(line: str) -> None:
        messages.log.info("%s", line)

    if map is None and setup is None:
        tables, lines, faults = list_topics(files)
        show(None, tables, as_json, wide)
        for line in lines:
            note(line)
        if faults:
            raise InputError("; ".join(faults)[:600])
        return
    chosen = RecordingSetup() if setup is None else RecordingSetup.load(setup)
    given: dict[str, Any] = {
        "map": map,
        "pose": by_name(pose, "--pose"),
        "truth": by_name(truth, "--truth"),
        "preset": preset,
        "settings": {**chosen.settings, **parse_settings(settings or [], None)},
        "localize": localize or None,
    }
    changes = {key: value for key, value in given.items() if value}
    if map is not None:
        changes["background"] = None
    chosen = chosen.changed(changes)
    if check:
        found = workflow.check(files, chosen, note, output)
        show(None, found.tables, as_json, wide)
        note(f"written: {found.files[0]}; use it by --setup {found.files[0]}")
        return
    with meter() as shown:
        made = workflow.replay(
            files,
            chosen,
            note,
            lambda share: shown.show(share, 1.0, f"{share:.0%} of the recording"),
            film,
            output,
        )
    show(None, made.tables, as_json, wide)
    if not as_json:
        messages.log_folder(made.files[0].parent)
    if made.faults:
        where = f"what came of it is in {made.files[0].parent}"
        raise InputError(f"{'; '.join(made.faults)[:400]}; {where}")
