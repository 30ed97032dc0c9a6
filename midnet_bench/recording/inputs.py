"""What ``replay`` is given: recordings opened, robots, maps and labels found, wishes filled in."""

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import load_map
from midnet_bench.recording.clock import Clock
from midnet_bench.recording.files.bags import Bag, is_bag
from midnet_bench.recording.files.readings import NS, GridReading, Source
from midnet_bench.recording.files.survey import Survey, listing, survey
from midnet_bench.recording.files.tables import read_text
from midnet_bench.recording.plan import (
    AllyPlan,
    RobotPlan,
    Wishes,
    allies_of,
    named,
    number_of,
    robots_of,
)
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import Replay, ReplayOptions
from midnet_bench.recording.settings import Preset, ReplaySettings
from midnet_bench.recording.truth import LabelTable

EXPORTED = "/midnet/replay"
"""the topic in which ``export`` says how a trial is replayed"""
HIT_THRESHOLD = 0.1
FIRST = "first-"
Note = Callable[[str], None]


@dataclass(frozen=True)
class ReplayWishes:
    """What a user asks for; see the options of the command."""

    files: Sequence[Path]
    recording: Wishes = field(default_factory=Wishes)
    map: str | None = None
    background: str | None = None
    hit_threshold: float = HIT_THRESHOLD
    resolution_m: float = 0.05
    presets: Sequence[Preset] = ("real", "paper")
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    clock: Clock = "header"
    offsets: Sequence[str] = ()
    rate_hz: float | None = None
    tick_hz: float | None = None
    max_pose_age_s: float = 0.5
    max_ally_age_s: float = 0.5
    deskew: bool = False
    truth: Sequence[str] = ()
    distance_m: float = 0.35
    sector: str | None = None
    window_m: float | None = None
    localize: bool = False
    film: bool = False
    unmapped: bool = False
    output: Path | None = None


def open_source(path: Path) -> Source:
    """A bag, a table or a log. Raises InputError: there is no such file, or it is none of these."""
    if not path.exists():
        raise InputError(f"{path}: there is no such recording")
    if is_bag(path):
        return Bag(path)
    if path.is_dir():
        raise InputError(
            f"{path}: a folder without metadata.yaml is no ROS 2 bag; give a bag, an .mcap, a .csv or a log"
        )
    return read_text(path)


@contextmanager
def opened(paths: Sequence[Path]) -> Iterator[list[Source]]:
    """The recordings, closed in the end."""
    with ExitStack() as stack:
        sources = []
        for path in paths:
            source = open_source(path)
            stack.callback(source.close)
            sources.append(source)
        yield sources


def list_topics(files: Sequence[Path]) -> tuple[list[Table], list[str], list[str]]:
    """What recordings hold: a table of topics for each, the flags that are proposed, and what is damaged.

    Raises:
        InputError: a recording cannot be read.
    """
    tables: list[Table] = []
    lines: list[str] = []
    with opened(files) as sources:
        surveys = [survey(source) for source in sources]
        for path, one in zip(files, surveys, strict=True):
            title = f"{path}: {one.duration_s:.1f} s"
            tables.append(Table("topics", title, listing(one)))
            lines += one.source.remarks
        lines += proposal(files, surveys)
        faults = [one.fault for one in surveys if one.fault]
    return tables, lines, faults


def proposal(files: Sequence[Path], surveys: Sequence[Survey]) -> list[str]:
    """The command that would replay these, and what has to be added to it."""
    words = ["midnet-bench replay", *map(str, files)]
    given = exported(surveys[0])
    if given is not None:
        return [f"proposed: {' '.join(words)} --map /map"]
    try:
        robots = robots_of(surveys, Wishes(), file_names(files))
    except InputError as error:
        return [f"to replay it: {error}"]
    for robot in robots:
        lead = f"{robot.name}=" if len(robots) > 1 else ""
        words.append(f"--scan {lead}{robot.scan_topic}")
        words.append(
            f"--pose {lead}{robot.pose.in_words if not robot.pose.in_words.startswith('tf') else 'tf'}"
        )
        if robot.mount != Pose2D(0.0, 0.0, 0.0):
            x, y, yaw = robot.mount
            words.append(f"--mount {lead}{x:.3f},{y:.3f},{math.degrees(yaw):.2f}")
    grids = [name for one in surveys for name, topic in one.source.topics.items() if topic.kind == "grid"]
    words.append(f"--map {grids[0] if '/map' in grids else 'MAP.yaml'}")
    return [f"proposed: {' '.join(words)}"]


def file_names(files: Sequence[Path]) -> list[str]:
    """A name for each recording: its own without the ending; numbered where two are alike."""
    stems = [path.name.split(".")[0] for path in files]
    return [stem if stems.count(stem) == 1 else f"{stem}_{number + 1}" for number, stem in enumerate(stems)]


def exported(one: Survey) -> dict[str, object] | None:
    """How ``export`` says that a trial is replayed; None for any other recording."""
    stream = one.streams.get(EXPORTED)
    if stream is None or not stream.texts:
        return None
    try:
        said = json.loads(stream.texts[0])
    except ValueError as error:
        raise InputError(f"{one.source.path}: {EXPORTED}: {error}; export the trial again") from error
    return said if isinstance(said, dict) else None


def with_exported(wishes: ReplayWishes, surveys: Sequence[Survey]) -> ReplayWishes:
    """The wishes, filled in with what the file itself says if ``export`` wrote it."""
    said = exported(surveys[0]) if len(surveys) == 1 else None
    if said is None or wishes.recording.scan:
        return wishes
    try:
        robots = said["robots"]
        assert isinstance(robots, list)
        settings = said["settings"]
        assert isinstance(settings, dict)
        mounts = [
            f"{one['name']}={one['mount'][0]},{one['mount'][1]},{math.degrees(one['mount'][2])!r}"
            for one in robots
        ]
        recording = replace(
            wishes.recording,
            scan=[f"{one['name']}={one['scan']}" for one in robots],
            pose=[f"{one['name']}={one['pose']}" for one in robots],
            mount=mounts,
        )
        rate_hz = wishes.rate_hz or float(str(said["rate_hz"]))
        tick_hz = float(str(said["tick_hz"]))
    except (AssertionError, KeyError, TypeError, IndexError, ValueError) as error:
        raise InputError(
            f"{surveys[0].source.path}: {EXPORTED}: {error!r}; export the trial again"
        ) from error
    return replace(
        wishes,
        recording=recording,
        settings={**settings, **wishes.settings},
        presets=("paper",),
        rate_hz=rate_hz,
        tick_hz=tick_hz,
        map=wishes.map or "/map",
    )


def prior_map_of(
    wishes: ReplayWishes, surveys: Sequence[Survey], robots: Sequence[RobotPlan], note: Note
) -> tuple[OccupancyGrid, int | None]:
    """The map that is subtracted, and until when its background was taken, ns of the record time.

    Raises:
        InputError: no map, or none that can be used.
    """
    if wishes.map is not None and wishes.background is not None:
        raise InputError("replay: --map and --background both give the map; leave one out")
    if wishes.background is not None:
        return _background(wishes, surveys, robots, note)
    if wishes.map is None:
        raise InputError(
            "replay: a map is needed: --map MAP.yaml, --map TOPIC, --background FILE or --background first-S"
        )
    if any(wishes.map in one.source.topics for one in surveys):
        return map_of_topic(surveys, wishes.map), None
    if wishes.map.startswith("/") and not Path(wishes.map).exists():
        grids = [name for one in surveys for name, topic in one.source.topics.items() if topic.kind == "grid"]
        if grids:
            raise InputError(f"--map {wishes.map}: no such topic{nearest_name(wishes.map, grids)}")
    return load_map(Path(wishes.map)), None


def map_of_topic(surveys: Sequence[Survey], topic: str) -> OccupancyGrid:
    """The first map of a topic, int8: 100 occupied, 0 free, -1 unknown. Raises InputError: it has none."""
    for one in surveys:
        if topic not in one.source.topics:
            continue
        for reading in one.source.readings({topic}):
            if not isinstance(reading, GridReading):
                break
            return reading.as_map()
    raise InputError(f"--map {topic}: holds no map (nav_msgs/OccupancyGrid)")


def _background(
    wishes: ReplayWishes, surveys: Sequence[Survey], robots: Sequence[RobotPlan], note: Note
) -> tuple[OccupancyGrid, int | None]:
    """A map by ray counting over another recording, or over the first seconds of this one."""
    assert wishes.background is not None
    said = f"--background {wishes.background}"
    counts = RayCounts(wishes.resolution_m)
    until_ns: int | None = None
    options = options_of(wishes, None)
    taken = 0
    if wishes.background.startswith(FIRST) and not Path(wishes.background).exists():
        seconds = number_of(wishes.background.removeprefix(FIRST), said)
        if seconds <= 0.0:
            raise InputError(f"{said}: {seconds:g} s is no time; give such as first-10")
        sources = [one.source for one in surveys]
        taken, until_ns = _count(counts, sources, robots, options, round(seconds * NS))
    else:
        path = Path(wishes.background)
        with opened([path]) as sources:
            own = [survey(sources[0])]
            recorded = robots_of(own, replace(wishes.recording, ally=()), file_names([path]))
            taken, _ = _count(counts, sources, recorded, replace(options, offsets_ns=()), None)
    if not taken:
        raise InputError(f"{said}: no scan of it has a pose; the map would be empty")
    grid = counts.map(wishes.hit_threshold)
    note(
        f"map: {grid.width} x {grid.height} cells of {grid.resolution:g} m by counting the rays of {taken} "
        f"scans, occupied from {wishes.hit_threshold:g} of the beams on"
    )
    return grid, until_ns


def _count(
    counts: RayCounts,
    sources: Sequence[Source],
    robots: Sequence[RobotPlan],
    options: ReplayOptions,
    lasts_ns: int | None,
) -> tuple[int, int | None]:
    """Count the rays of the scans, or of the first ``lasts_ns``; how many scans they were, and until when."""
    empty = OccupancyGrid(np.zeros((1, 1), np.int8), counts.resolution_m, (0.0, 0.0))
    replay = Replay(sources, robots, [], empty, {}, options)
    taken, until_ns = 0, None
    for frame in replay.frames():
        if until_ns is None and lasts_ns is not None:
            until_ns = frame.time_ns + lasts_ns
        if until_ns is not None and frame.time_ns >= until_ns:
            break
        for one in frame.seen:
            if one.robot == frame.scanned and one.scan is not None:
                counts.take(one.scan, one.returns)
                taken += 1
    return taken, until_ns


def options_of(wishes: ReplayWishes, offsets: Sequence[int] | None) -> ReplayOptions:
    """How time is gone by; without ``offsets`` (ns, of each source) frames come at each scan."""
    return ReplayOptions(
        clock=wishes.clock,
        rate_hz=None if offsets is None else wishes.rate_hz,
        tick_hz=wishes.tick_hz,
        max_pose_age_s=wishes.max_pose_age_s,
        max_ally_age_s=wishes.max_ally_age_s,
        deskew=wishes.deskew,
        offsets_ns=offsets or (),
    )


def settings_of(wishes: ReplayWishes, resolution_m: float) -> dict[str, ReplaySettings]:
    """The settings by preset, for a map of cells of this side, metres. Raises InputError: a wrong option."""
    values = dict(wishes.settings)
    asked_m = values.pop("resolution_m", resolution_m)
    if not isinstance(asked_m, float | int) or abs(asked_m - resolution_m) > 1e-5:
        raise InputError(
            f"--set resolution_m={asked_m}: cells are as large as the map's, {resolution_m:g} m; "
            "'midnet-bench map --from-map' makes a map of others"
        )
    return {preset: ReplaySettings.of(preset, values, resolution_m) for preset in wishes.presets}


def offsets_of(wishes: ReplayWishes, names: Sequence[str]) -> list[int]:
    """What is added to the times of each recording, by its name, ns. Raises InputError: no number or name."""
    given = named(wishes.offsets, names, "--offset")
    texts = [given.get(name, "0") for name in names]
    return [round(number_of(text, f"--offset {text}") * NS) for text in texts]


def labels_of(wishes: ReplayWishes, surveys: Sequence[Survey]) -> tuple[LabelTable | None, list[AllyPlan]]:
    """The labels: of a table, or topics with the poses of what is to be found, as ``NAME=TOPIC``.

    Raises:
        InputError: no such file or topic.
    """
    tables = [text for text in wishes.truth if "=" not in text]
    if len(tables) > 1:
        raise InputError(f"--truth {tables[1]}: one table of labels is taken; put all labels into it")
    topics = allies_of(surveys, [text for text in wishes.truth if "=" in text], 1.0)
    if tables and topics:
        raise InputError("--truth: give either a table or topics")
    return (LabelTable(Path(tables[0])) if tables else None), topics


@contextmanager
def prepared(wishes: ReplayWishes) -> Iterator[tuple[ReplayWishes, list[Source]]]:
    """The wishes and the recordings, files of poses among them."""
    with opened(wishes.files) as sources, ExitStack() as stack:
        poses = []
        for text in wishes.recording.pose:
            name, sign, value = text.rpartition("=")
            if Path(value).suffix in (".csv", ".tum", ".txt"):
                table = read_text(Path(value)).called(value)
                stack.callback(table.close)
                sources.append(table)
            poses.append(f"{name}{sign}{value}")
        recording = replace(wishes.recording, pose=poses)
        yield replace(wishes, recording=recording), sources
