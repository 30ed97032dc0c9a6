"""``replay``: what the detector makes of a recording, whether its inputs fit, and why it errs."""

import csv
import json
import math
from collections import Counter
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
from midnet_bench.io.files import cannot_be_written, write_atomically
from midnet_bench.io.map_server import load_map, save_map
from midnet_bench.recording import causes
from midnet_bench.recording.bags import Bag, is_bag
from midnet_bench.recording.clock import Clock
from midnet_bench.recording.localize import Localizer
from midnet_bench.recording.plan import (
    AllyPlan,
    Link,
    RobotPlan,
    Wishes,
    allies_of,
    beam_time,
    named,
    number_of,
    robots_of,
)
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.readings import NS, GridReading, Source
from midnet_bench.recording.replay import Replay, ReplayFrame, ReplayOptions
from midnet_bench.recording.samples import samples_of
from midnet_bench.recording.scores import ScoreOptions, Scorer, sector_of
from midnet_bench.recording.settings import Preset, ReplaySettings
from midnet_bench.recording.setup_check import Proposal, SetBy, find_setup, line_of, verdict
from midnet_bench.recording.survey import Survey, listing, survey
from midnet_bench.recording.tables import read_text
from midnet_bench.recording.truth import Label, Labels, LabelTable
from midnet_bench.recording.unmapped import csv_of, unmapped
from midnet_bench.workflows.replay_film import film

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


@dataclass
class Replayed:
    """What came of it."""

    tables: list[Table]
    lines: list[str]
    """in words, for people"""
    files: list[Path]
    faults: list[str]
    """what does not fit or could not be read; results are there all the same"""


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
            lines += getattr(one.source, "remarks", [])
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
    options = _options(wishes, None)
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
                counts.take(one.scan)
                taken += 1
    return taken, until_ns


def _options(wishes: ReplayWishes, offsets: Sequence[int] | None) -> ReplayOptions:
    return ReplayOptions(
        clock=wishes.clock,
        rate_hz=None if offsets is None else wishes.rate_hz,
        max_pose_age_s=wishes.max_pose_age_s,
        max_ally_age_s=wishes.max_ally_age_s,
        deskew=wishes.deskew,
        offsets_ns=offsets or (),
    )


def labels_of(
    wishes: ReplayWishes, surveys: Sequence[Survey], robots: Sequence[RobotPlan]
) -> tuple[LabelTable | None, list[AllyPlan]]:
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


def replay(wishes: ReplayWishes, note: Note, progress: Callable[[float], None]) -> Replayed:
    """Play recordings into the detectors of the presets; score and explain, and write the tables.

    Args:
        wishes: what is asked for.
        note: gets each line that a user is to see before the scores, as soon as it is known.
        progress: gets the share that is done, 0 to 1.

    Raises:
        InputError: the recordings, the map or an option cannot be used.
    """
    with prepared(wishes) as (filled, sources):
        return _replay(filled, sources, note, progress)


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


def _replay(
    wishes: ReplayWishes, sources: Sequence[Source], note: Note, progress: Callable[[float], None]
) -> Replayed:
    surveys = [survey(source) for source in sources]
    for source in sources:
        for remark in getattr(source, "remarks", []):
            note(remark)
    wishes = with_exported(wishes, surveys)
    names = file_names([Path(source.path) for source in sources])
    robots = robots_of(surveys, wishes.recording, names)
    prior_map, until_ns = prior_map_of(wishes, surveys, robots, note)
    values = dict(wishes.settings)
    resolution_m = values.pop("resolution_m", prior_map.resolution)
    if not isinstance(resolution_m, float | int) or abs(resolution_m - prior_map.resolution) > 1e-5:
        raise InputError(
            f"--set resolution_m={resolution_m}: cells are as large as the map's, "
            f"{prior_map.resolution:g} m; 'midnet-bench map --from-map' makes a map of others"
        )
    settings: dict[str, ReplaySettings] = {
        preset: ReplaySettings.of(preset, values, prior_map.resolution) for preset in wishes.presets
    }
    main = settings[wishes.presets[0]]
    allies = allies_of(surveys, wishes.recording.ally, main.midnet.ally_diameter_m)
    table, label_topics = labels_of(wishes, surveys, robots)
    if table is not None and table.by_index and len(robots) > 1:
        raise InputError(
            f"--truth {wishes.truth[0]}: scan_index does not say of which of {len(robots)} robots; label by t"
        )
    offsets = [
        round(number_of(text, f"--offset {text}") * NS)
        for text in (named(wishes.offsets, names, "--offset").get(name, "0") for name in names)
    ]
    options = replace(_options(wishes, offsets), start_ns=until_ns)
    score_options = ScoreOptions(
        wishes.distance_m, None if wishes.sector is None else sector_of(wishes.sector), wishes.window_m
    )
    lines = told_before(surveys, robots, settings, wishes)
    for line in lines:
        note(line)
    faults: list[str] = []
    for robot in robots:
        faults += told_of_fit(surveys, robot, prior_map, options, note)
    correctors = [Localizer(prior_map) for _ in robots] if wishes.localize else []
    played = Replay(
        sources,
        robots,
        allies,
        prior_map,
        settings,
        options,
        followed=label_topics,
        correctors=correctors,
    )
    counts = RayCounts(prior_map.resolution, prior_map.origin, (prior_map.height, prior_map.width))
    explainers = {
        name: causes.Explainer(name, prior_map, played.nodes[name], one, counts)
        for name, one in settings.items()
    }
    scorers = {
        name: Scorer(name, explainers[name], one.range_m, score_options) for name, one in settings.items()
    }
    reach_m = 2.0 * max(one.range_m for one in settings.values())
    folder = wishes.output or Path("results") / f"replay-{names[0]}"
    first = wishes.presets[0]
    with _boxes_file(folder) as boxes, ExitStack() as stack:
        append = None
        if wishes.film:
            append = stack.enter_context(
                film(
                    f"{names[0]}, preset {first}",
                    first,
                    played,
                    prior_map,
                    main,
                    frames_hz(surveys, robots, options),
                    labelled_at_once(table, label_topics),
                    folder,
                )
            )
        try:
            for frame in played.frames():
                if until_ns is not None and frame.time_ns < until_ns:
                    continue
                for one in frame.seen:
                    if one.scan is not None and (frame.scanned is None or one.robot == frame.scanned):
                        counts.take(one.scan, min(reach_m, one.scan.lidar.range_max_m))
                labels = _labels(frame, table, wishes.max_pose_age_s)
                for name, scorer in scorers.items():
                    judged = scorer.take(frame, labels)
                    _write_boxes(boxes, frame, name)
                    if append is not None and name == first:
                        append(frame, judged, scorer.score)
                progress(played.done)
        except InputError as error:
            faults.append(str(error))
    progress(1.0)
    faults += told_after(played, wishes, note)
    if not played.tally.frames:
        raise InputError("; ".join(faults) or f"{wishes.files[0]}: no frame came of it")
    faults += unlabelled(wishes, table, scorers, played)
    rows = {name: explainer.settled() for name, explainer in explainers.items()}
    tables = [
        *score_tables(scorers, bool(wishes.truth)),
        cause_table(rows),
    ]
    files = [folder / "boxes.csv"]
    for made in tables:
        files += made.write(folder)
    files.append(_write_errors(folder, rows))
    if wishes.film:
        files += [folder / "trial.mp4", folder / "storyboard.png"]
    if wishes.unmapped:
        files += write_unmapped(folder, counts, prior_map, played.nodes[first].prior, note)
    return Replayed(tables, lines, files, faults)


def _labels(frame: ReplayFrame, table: LabelTable | None, max_age_s: float) -> Labels | None:
    if table is not None:
        return table.at(frame.time_ns, frame.scan_index)
    there = [
        Label(plan.name, told.pose.x, told.pose.y)
        for plan, told in frame.followed
        if told is not None and told.age_s <= max_age_s
    ]
    return Labels(there, []) if there else None


def frames_hz(surveys: Sequence[Survey], robots: Sequence[RobotPlan], options: ReplayOptions) -> float:
    """How many frames a second the recording gives."""
    if options.rate_hz is not None:
        return options.rate_hz
    scans = sum(surveys[one.source].streams[one.scan_topic].topic.messages for one in robots)
    return max(scans / max(max(one.duration_s for one in surveys), 0.1), 0.5)


def labelled_at_once(table: LabelTable | None, topics: Sequence[AllyPlan]) -> int:
    """How many objects there are labels of."""
    if table is None:
        return len(topics)
    names = {one.name for there in table.by_index.values() for one in there}
    return len(names | table.by_time.keys())


def write_unmapped(
    folder: Path, counts: RayCounts, prior_map: OccupancyGrid, prior: OccupancyGrid, note: Note
) -> list[Path]:
    """Write what stays put and is not on the map: ``unmapped.csv``, and the map with it."""
    things, patched = unmapped(counts, prior_map, prior)
    write_atomically(folder / "unmapped.csv", csv_of(things))
    save_map(patched, folder / "map_with_unmapped.yaml", comment="with what stays put and was not on it")
    note(f"{len(things)} things stay put and are not on the map; map_with_unmapped.yaml has them")
    return [folder / "unmapped.csv", folder / "map_with_unmapped.yaml"]


def told_before(
    surveys: Sequence[Survey],
    robots: Sequence[RobotPlan],
    settings: Mapping[str, ReplaySettings],
    wishes: ReplayWishes,
) -> list[str]:
    """What a user has to know before any score: how each robot is read, and what thresholds mean."""
    lines = []
    for robot in robots:
        stream = surveys[robot.source].streams[robot.scan_topic]
        x, y, yaw = robot.mount
        mirrored = ", mirrored" if robot.is_mirrored else ""
        lines.append(
            f"{robot.name}: scans {robot.scan_topic}, pose {robot.pose.in_words}, mount {x:.3f},{y:.3f},"
            f"{math.degrees(yaw):.2f}{mirrored}; no return: {robot.no_return.in_words}"
        )
        lines += lag_lines(surveys, robot, wishes.clock)
        if wishes.deskew and (said := beam_time(stream)[1]):
            lines.append(f"{robot.name}: --deskew: {said}")
        beams = {len(scan.ranges_m) for scan in stream.scans}
        if len(beams) > 1:
            lines.append(
                f"{robot.name}: scans have {min(beams)} to {max(beams)} beams; each is read as it is"
            )
    for name, one in settings.items():
        increment = surveys[robots[0].source].streams[robots[0].scan_topic].scans[0].angle_increment_rad
        lines += [f"{name}: {line}" for line in one.in_words(increment)]
    return lines


def told_of_fit(
    surveys: Sequence[Survey],
    robot: RobotPlan,
    prior_map: OccupancyGrid,
    options: ReplayOptions,
    note: Note,
) -> list[str]:
    """Note whether a robot's scans lie on the map; what does not fit."""
    samples = samples_of(surveys, robot, options.clock, options.max_pose_age_s, options.offsets_ns)
    if not samples or not (prior_map.data == 100).any():
        note(f"{robot.name}: nothing can be said of how scans and map fit: no scan with a pose, or no wall")
        return []
    found = verdict(samples, prior_map, SetBy(robot.is_mirrored, robot.delay_ns / NS))
    lines = [f"{robot.name}: {line}" for line in found.lines]
    for line in lines:
        note(line if found.fits else f"does not fit: {line}")
    return [] if found.fits or found.kinds == ("few returns",) else lines


def check(wishes: ReplayWishes, note: Note) -> list[Table]:
    """Search for the setup by which scans lie best on the map; a table of its parameters for each robot.

    Raises:
        InputError: the recordings, the map or an option cannot be used.
    """
    tables = []
    with prepared(wishes) as (filled, sources):
        surveys = [survey(source) for source in sources]
        filled = with_exported(filled, surveys)
        robots = robots_of(surveys, filled.recording, file_names([Path(source.path) for source in sources]))
        prior_map, _ = prior_map_of(filled, surveys, robots, note)
        for robot in robots:
            for line in lag_lines(surveys, robot, filled.clock):
                note(line)
            samples = samples_of(surveys, robot, filled.clock, filled.max_pose_age_s, ())
            if not samples:
                raise InputError(f"{robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
            found = find_setup(samples, prior_map)
            set_by = SetBy(robot.is_mirrored, robot.delay_ns / NS)
            note(f"{robot.name}: {line_of(found, prior_map, set_by)}")
            for line in found.cannot_tell:
                note(f"{robot.name}: {line}")
            tables.append(setup_table(robot.name, found))
    return tables


def setup_table(name: str, found: Proposal) -> Table:
    """The setup that was found: each parameter with how far it can be changed within noise."""
    setup = found.setup
    values = {
        "mount x": (setup.mount.x, "m"),
        "mount y": (setup.mount.y, "m"),
        "mount yaw": (math.degrees(setup.mount.yaw), "deg"),
        "scan delay": (setup.delay_s, "s"),
        "map x": (setup.map_moved.x, "m"),
        "map y": (setup.map_moved.y, "m"),
        "map yaw": (math.degrees(setup.map_moved.yaw), "deg"),
    }
    rows: list[dict[str, Scalar]] = []
    for parameter, (value, unit) in values.items():
        span = found.ranges.get(parameter)
        factor = math.degrees(1.0) if unit == "deg" else 1.0
        rows.append(
            {
                "parameter": parameter,
                "value": value,
                "unit": unit,
                "less_by": None if span is None else span.below * factor,
                "more_by": None if span is None else span.above * factor,
                "sure": None if span is None else ("no" if span.is_open else "yes"),
            }
        )
    rows.append({"parameter": "mirrored", "value": "yes" if setup.is_mirrored else "no"})
    rows.append({"parameter": "share before", "value": found.share_before})
    rows.append({"parameter": "share after", "value": found.share_after})
    return Table(f"setup_{name}", f"{name}: the setup by which most returns lie on mapped walls", rows)


LAG_S = 0.02
"""by which the stamps of scans and poses may differ before somebody is told"""


def lag_lines(surveys: Sequence[Survey], robot: RobotPlan, clock: Clock) -> list[str]:
    """Whether scans and poses were stamped alike. Raises InputError: the stamps stand still."""
    from midnet_bench.recording.survey import lag_in_words

    scans = surveys[robot.source].streams[robot.scan_topic]
    links = [link for link in robot.pose.links if isinstance(link, Link)]
    poses = []
    for link in links:
        poses += [(one.record_ns - one.stamp_ns) / NS for one in link.seen(surveys)]
    path = surveys[robot.source].source.path
    if clock == "header" and scans.stamps_stand_still:
        raise InputError(
            f"{path}: {robot.scan_topic}: the stamps of the scans stand still at "
            f"{scans.scans[0].stamp_ns / NS:g} s; use --clock record"
        )
    for link in links if clock == "header" else ():
        seen = link.seen(surveys)
        if len(seen) > 1 and len({one.stamp_ns for one in seen}) == 1:
            raise InputError(
                f"{path}: {link.in_words}: the stamps of the poses stand still at "
                f"{seen[0].stamp_ns / NS:g} s; use --clock record"
            )
    lags_s = scans.lags_s
    if not len(lags_s) or not poses:
        return []
    lines = []
    pose_lag_s = float(np.median(poses))
    apart_s = float(np.median(lags_s)) - pose_lag_s
    if abs(apart_s) > LAG_S:
        lines.append(
            f"{robot.name}: each scan is {lag_in_words(lags_s)}, a pose {1000.0 * pose_lag_s:.3g} ms: "
            f"--clock header puts a scan {1000.0 * apart_s:.0f} ms earlier by the poses than --clock record "
            f"(now: {clock})"
        )
    half = len(lags_s) // 2
    drift_s = float(np.median(lags_s[half:]) - np.median(lags_s[:half])) if half else 0.0
    if abs(drift_s) > LAG_S:
        lines.append(
            f"{robot.name}: the clocks run apart: stamps and record times of the scans drift by "
            f"{drift_s:.3f} s between the two halves of the recording"
        )
    return lines


AT_THE_START, AT_THE_START_SHARE = 3, 0.02
"""so many scans that no pose comes before are told, and are no fault"""


def told_after(played: Replay, wishes: ReplayWishes, note: Note) -> list[str]:
    """What went wrong on the way, a line each; what is no fault is noted."""
    lines = []
    tally = played.tally
    taken, left = sum(tally.scans.values()), sum(tally.skipped.values())
    # poses begin a little after the scans, or end before them
    few = tally.without_pose == left and left <= max(AT_THE_START, AT_THE_START_SHARE * taken)
    for why, count in tally.skipped.items():
        line = f"{count} of {count + taken} scans were left out: each {why}; the first: {tally.first[why]}"
        if few:
            note(line)
        else:
            lines.append(line)
    lines += played.void_poses()
    for name, count in played.pose_times():
        if not count:
            lines.append(f"{name}: no pose of it came")
    if not tally.frames and tally.skipped:
        lines.append(
            "scans and poses never meet in time: compare their stamps with 'midnet-bench replay FILE', "
            "and try --clock record or --offset"
        )
    for name, age_s in tally.oldest_ally_s.items():
        oldest = "none yet" if math.isinf(age_s) else f"{age_s:.3f} s"
        late = tally.late_allies[name]
        note(
            f"ally {name}: oldest pose at a frame: {oldest}"
            + (
                f"; in {late} of {tally.frames} frames over {wishes.max_ally_age_s:g} s: not taken out there"
                if late
                else ""
            )
        )
    return lines


def unlabelled(
    wishes: ReplayWishes, table: LabelTable | None, scorers: Mapping[str, Scorer], played: Replay
) -> list[str]:
    """A line if no label lies at any frame, and nothing is scored."""
    if not wishes.truth or any(scorer.score.labelled for scorer in scorers.values()):
        return []
    first_s, last_s = played.tally.first_ns / NS, played.tally.last_ns / NS
    held = "no pose of it lies at a frame" if table is None else f"its labels have {table.span}"
    return [
        f"--truth {wishes.truth[0]}: nothing is scored: {held}, {played.tally.frames} frames "
        f"t {first_s:.3f} to {last_s:.3f} (--clock {wishes.clock})"
    ]


def score_tables(scorers: Mapping[str, Scorer], has_truth: bool) -> list[Table]:
    """A row for each preset: what was looked at; with labels, the paper's scores and one-to-one scores."""
    scores = {name: scorer.score for name, scorer in scorers.items()}
    frames = [one.looked_at(name) for name, one in scores.items()]
    tables = [Table("recording_frames", "Frames and boxes", frames)]
    if has_truth:
        paper = [one.scored(name) for name, one in scores.items()]
        own = [one.paired(name) for name, one in scores.items()]
        title = "One-to-one matching: further boxes on one label are false"
        tables.append(Table("recording_scores", "Detection scores, as the paper counts", paper))
        tables.append(Table("recording_matching", title, own))
    return tables


def cause_table(rows: Mapping[str, Sequence[causes.ErrorRow]]) -> Table:
    """How many errors of each cause, by preset."""
    found: list[dict[str, Scalar]] = []
    for name, errors in rows.items():
        counted = Counter((one.kind, one.cause) for one in errors)
        for (kind, cause), count in counted.most_common():
            meaning = causes.MISSES.get(cause) if kind == "miss" else causes.BOXES.get(cause)
            found.append(
                {
                    "preset": name,
                    "kind": kind,
                    "cause": cause,
                    "count": count,
                    "share": count / len(errors),
                    "meaning": meaning or "",
                }
            )
    return Table("recording_causes", "What boxes are made of, and why labels were missed", found)


@contextmanager
def _boxes_file(folder: Path) -> Iterator["csv._writer"]:  # type: ignore[name-defined]
    """``boxes.csv``, row by row; what was written stays, whatever ends the replay."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / "boxes.csv", "w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(
                ["preset", "frame", "t", "scan_index", "robot", "x_min_m", "y_min_m", "x_max_m", "y_max_m"]
            )
            yield writer
    except OSError as error:
        raise cannot_be_written(folder / "boxes.csv", error) from error


def _write_boxes(writer: "csv._writer", frame: ReplayFrame, name: str) -> None:  # type: ignore[name-defined]
    look = frame.looks[name].frame
    for box, robot in zip(look.detections, look.robots, strict=True):
        index = "" if frame.scan_index is None else frame.scan_index
        who = frame.seen[robot].robot
        sides = [f"{side:.4f}" for side in box]
        writer.writerow([name, frame.number, f"{frame.time_ns / NS:.6f}", index, who, *sides])


def _write_errors(folder: Path, rows: Mapping[str, Sequence[causes.ErrorRow]]) -> Path:
    lines = [",".join(["preset", *causes.ErrorRow._fields])]
    for name, errors in rows.items():
        for one in errors:
            cells = [f"{cell:.4f}" if isinstance(cell, float) else str(cell) for cell in one]
            lines.append(",".join([name, *cells]))
    path = folder / "errors.csv"
    write_atomically(path, "\n".join(lines) + "\n")
    return path
