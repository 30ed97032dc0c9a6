"""``replay``: MIDNet on a recording."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from midnet_bench.cli import messages, options
from midnet_bench.cli.app import command
from midnet_bench.cli.reports import show

Texts = list[str] | None


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
    map: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="FILE|TOPIC",
            help="The prior map: a map_server YAML, or a topic.",
            show_default=False,
        ),
    ] = None,
    background: Annotated[
        str | None,
        _text(
            "FILE|first-S", "Make the map from another recording, or from the first S seconds of this one."
        ),
    ] = None,
    hit_threshold: Annotated[
        float,
        typer.Option(min=0.0, max=1.0, help="Share of beams that end in a wall's cell, for --background."),
    ] = 0.1,
    resolution: Annotated[
        float, typer.Option(min=0.01, max=0.2, metavar="M", help="Side of a cell, for --background.")
    ] = 0.05,
    scan: Annotated[Texts, _text("[NAME=]TOPIC", "Whose scans; again for each robot (default all).")] = None,
    pose: Annotated[
        Texts,
        _text(
            "[NAME=]TOPIC", "Its pose: a topic, tf, a CSV or TUM file, or at:X,Y,YAW_DEG for a laser at rest."
        ),
    ] = None,
    mount: Annotated[
        Texts, _text("[NAME=]X,Y,YAW_DEG", "Where the laser sits on the robot (default from tf, else 0,0,0).")
    ] = None,
    mirror: Annotated[
        bool, typer.Option("--mirror", help="Turn the order of the beams round, as of a laser upside down.")
    ] = False,
    map_frame: Annotated[
        str, typer.Option(metavar="FRAME", help="The frame of tf that the map is in.")
    ] = "map",
    clock: Annotated[
        Literal["header", "record"],
        typer.Option(help="Use the stamps of the headers, or the record times."),
    ] = "header",
    scan_delay: Annotated[
        Texts, _text("[NAME=]S", "Seconds by which a robot's scans are stamped too late.")
    ] = None,
    offset: Annotated[
        Texts, _text("[FILE=]S", "Seconds to add to all times of one of several files.")
    ] = None,
    no_return: Annotated[
        Texts,
        _text("CODE=MEANING", "What inf, nan, zero, below or above means: clears, nothing or invalid."),
    ] = None,
    deskew: Annotated[bool, typer.Option("--deskew", help="Undo the robot's motion during a scan.")] = False,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=1000.0,
            metavar="HZ",
            help="Frames a second (default one at each scan).",
            show_default=False,
        ),
    ] = None,
    max_pose_age: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Leave out scans farther from a pose than this.")
    ] = 0.5,
    ally: Annotated[Texts, _text("NAME=TOPIC[,SIZE_M]", "The pose of an ally, which is no intruder.")] = None,
    max_ally_age: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="Take no ally out by an older pose.")
    ] = 0.5,
    truth: Annotated[
        Texts,
        _text("FILE|NAME=TOPIC", "Labels: a CSV (t or scan_index, id, x, y), or the pose of an intruder."),
    ] = None,
    match_distance: Annotated[
        float, typer.Option(min=0.0, metavar="M", help="A box is right that lies so near to its label.")
    ] = 0.35,
    sector: Annotated[
        str | None, _text("FROM_DEG,TO_DEG", "Score labels in this part of the robot's view alone.")
    ] = None,
    window: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            metavar="M",
            help="Score labels in this square about the robot alone.",
            show_default=False,
        ),
    ] = None,
    preset: Annotated[
        Literal["real", "paper", "both"],
        typer.Option(help="Which values: for real robots, the paper's, or both."),
    ] = "both",
    settings: options.Settings = None,
    localize: Annotated[
        bool, typer.Option("--localize", help="Correct the poses by matching scans to the map.")
    ] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Only check that scans, poses and map fit; propose corrections."),
    ] = False,
    film: Annotated[
        bool, typer.Option("--film", help="Draw the recording: trial.mp4 and storyboard.png.")
    ] = False,
    unmapped: Annotated[
        bool,
        typer.Option("--unmapped", help="Write what stays put and is not on the map, and a map with it."),
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
    """Say what MIDNet makes of a recording, why it errs, and whether the inputs fit together at all.

    FILE alone lists its topics and proposes the options.
    """
    from midnet_bench.campaign.definition import parse_settings
    from midnet_bench.cli.progress import meter
    from midnet_bench.errors import InputError
    from midnet_bench.recording.files.no_return import parsed
    from midnet_bench.recording.inputs import ReplayWishes, list_topics
    from midnet_bench.recording.plan import Wishes
    from midnet_bench.workflows import replay as workflow

    note = messages.log.info
    if map is None and background is None:
        tables, lines, faults = list_topics(files)
        show(None, tables, as_json, wide)
        for line in lines:
            note("%s", line)
        if faults:
            raise InputError("; ".join(faults)[:600])
        return
    wishes = ReplayWishes(
        files=files,
        recording=Wishes(
            scan=scan or (),
            pose=pose or (),
            mount=mount or (),
            is_mirrored=mirror,
            scan_delay=scan_delay or (),
            ally=ally or (),
            map_frame=map_frame,
            no_return=parsed(no_return or ()),
        ),
        map=map,
        background=background,
        hit_threshold=hit_threshold,
        resolution_m=resolution,
        presets=("real", "paper") if preset == "both" else (preset,),
        settings=parse_settings(settings or [], None),
        clock=clock,
        offsets=offset or (),
        rate_hz=rate,
        max_pose_age_s=max_pose_age,
        max_ally_age_s=max_ally_age,
        deskew=deskew,
        truth=truth or (),
        distance_m=match_distance,
        sector=sector,
        window_m=window,
        localize=localize,
        film=film,
        unmapped=unmapped,
        output=output,
    )
    if check:
        show(None, workflow.check(wishes, lambda line: note("%s", line)), as_json, wide)
        return
    with meter() as shown:
        made = workflow.replay(
            wishes,
            lambda line: note("%s", line),
            lambda share: shown.show(share, 1.0, f"{share:.0%} of the recording"),
        )
    show(None, made.tables, as_json, wide)
    if not as_json:
        messages.tell_where(made.files[0].parent)
    if made.faults:
        where = f"what came of it is in {made.files[0].parent}"
        raise InputError(f"{'; '.join(made.faults)[:400]}; {where}")
