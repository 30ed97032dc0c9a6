"""Inputs of ``replay``: recordings opened, robots, map and labels found by a setup; scans alone for SLAM."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from midnet_bench.analysis.tables import Table
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.grid import OccupancyGrid, same_resolution
from midnet_bench.io.map_server import load_map
from midnet_bench.io.scan_logs import LoggedScan, ScanLog, usual_beams
from midnet_bench.recording.files.bags import Bag, is_bag
from midnet_bench.recording.files.readings import NS, GridReading, Source
from midnet_bench.recording.files.survey import listing
from midnet_bench.recording.files.tables import read_text
from midnet_bench.recording.fitting.fit import Localizer
from midnet_bench.recording.fitting.setup_check import placed
from midnet_bench.recording.plan import AllyPlan, Recorded, RobotPlan, followed_topic, robots_of
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import Replay
from midnet_bench.recording.setup import EVERY, FOUND, RecordingSetup, ReplaySettings, number_of
from midnet_bench.recording.truth import LabelTable, Truth

FIRST = "first-"
Note = Callable[[str], None]


@dataclass(frozen=True)
class ReplayInputs:
    """Open recordings, and what a setup makes of them."""

    setup: RecordingSetup
    recorded: Recorded
    robots: list[RobotPlan]
    prior_map: OccupancyGrid  # int8, 100 occupied, 0 free, -1 unknown, map frame
    scored_from_ns: int | None
    """end of the seconds that the background was made from, record time; None if it is of no such seconds"""

    def settings(self) -> dict[str, ReplaySettings]:
        """The detector options by preset.

        Raises:
            InputError: ``settings: key: what is wrong``; it is unknown, or its value is out of range.
        """
        values, cell_m = dict(self.setup.settings), self.prior_map.resolution
        given_m = values.pop("resolution_m", cell_m)
        if not isinstance(given_m, float | int) or not same_resolution(given_m, cell_m):
            raise InputError(
                f"settings: resolution_m: {given_m}: cells are as large as the map's, {cell_m:g} m; "
                "'midnet-bench map --from-map' makes a map of others"
            )
        try:
            return {preset: ReplaySettings.of(preset, values, cell_m) for preset in self.setup.presets}
        except InputError as error:
            raise InputError(f"settings: {error}") from error

    def replay(self, settings: Mapping[str, ReplaySettings], followed: Sequence[AllyPlan] = ()) -> Replay:
        """A pass over them with detectors, and allies as large as the first of these says.

        ``followed``: see :class:`Replay`. Raises InputError: no topic of an ally.
        """
        usual_m = next(iter(settings.values())).midnet.ally_diameter_m
        plans = [
            followed_topic(self.recorded, "allies", name, ally.topic, ally.diameter_m or usual_m)
            for name, ally in self.setup.allies.items()
        ]
        each = {robot.carrier: Localizer(self.prior_map) for robot in self.robots if self.setup.localize}
        correctors = [each[robot.carrier] for robot in self.robots if each]
        return Replay(
            self.recorded, self.robots, self.prior_map, settings, self.setup, plans, correctors, followed
        )

    def labels(self) -> Truth:
        """The labels of the setup. Raises InputError: there are none where it says so."""
        truth, table, followed = self.setup.truth, None, list[AllyPlan]()
        if EVERY not in truth:
            followed = [
                followed_topic(self.recorded, "truth", name, topic, 1.0) for name, topic in truth.items()
            ]
        elif len(truth) > 1:
            raise InputError("truth: give either a table or topics")
        else:
            table = LabelTable(Path(truth[EVERY]))
            if table.by_index and len(self.robots) > 1:
                raise InputError(
                    f"truth: {truth[EVERY]}: scan_index does not say of which of {len(self.robots)} robots; "
                    "label by t"
                )
        return Truth(table, followed, self.setup.max_pose_age_s)


@contextmanager
def prepared(files: Sequence[Path], setup: RecordingSetup, note: Note) -> Iterator[ReplayInputs]:
    """The inputs of a replay, closed in the end; ``note`` gets remarks on the files and the map.

    Raises:
        InputError: the recordings or the map cannot be used.
    """
    with opened(files) as sources:
        for text in setup.pose.values():
            if Path(text).suffix in (".csv", ".tum", ".txt"):
                sources.append(read_text(Path(text)).called(text))
        recorded = Recorded.of(sources, setup)
        remarks = [one.remarks for one in sources] + [one.remarks for one in recorded.surveys]
        for remark in itertools.chain(*remarks):
            note(remark)
        if setup.localize is None:  # odometry drifts wherever it began
            setup = setup.changed({"localize": bool(setup.start)})
        robots = robots_of(recorded, setup)
        if setup.start and setup.background is not None:
            raise InputError("start: a place on a map is needed; give --map in place of the background")
        prior_map, scored_from_ns = prior_map_of(setup, recorded, robots, note)
        carriers = {robot.carrier: robot for robot in reversed(robots)}  # the first laser of each
        setup.of_each("start", list(carriers))
        moved = {
            name: placed(carriers[name], recorded, setup, prior_map, note)
            for name in dict.fromkeys(robot.carrier for robot in robots)
        }
        robots = [robot.moved(moved[robot.carrier]) for robot in robots]
        yield ReplayInputs(setup, recorded, robots, prior_map, scored_from_ns)


@contextmanager
def opened(paths: Sequence[Path]) -> Iterator[list[Source]]:
    """The bags, tables or logs, closed in the end. Raises InputError: no such file, or none of these."""
    with ExitStack() as stack:
        sources: list[Source] = []
        for number, path in enumerate(paths):
            if path in paths[:number]:
                raise InputError(f"{path}: is given twice; name each recording once")
            if not path.exists():
                raise InputError(f"{path}: there is no such recording")
            if not is_bag(path) and path.is_dir():
                raise InputError(
                    f"{path}: a folder without metadata.yaml is no ROS 2 bag; give a bag, an .mcap, a .csv "
                    "or a log"
                )
            sources.append(Bag(path) if is_bag(path) else read_text(path))
            stack.callback(sources[-1].close)
        yield sources


def list_topics(files: Sequence[Path]) -> tuple[list[Table], list[str], list[str]]:
    """What recordings hold: a table of topics for each, the command that is proposed, and what is damaged.

    Raises:
        InputError: a recording cannot be read.
    """
    with opened(files) as sources:
        recorded = Recorded.of(sources, RecordingSetup())
        tables, lines = [], []
        for path, one in zip(files, recorded.surveys, strict=True):
            tables.append(Table("topics", f"{path}: {one.duration_s:.1f} s", listing(one)))
            lines += [*one.source.remarks, *one.remarks]
        lines += proposal(files, recorded)
        return tables, lines, [one.fault for one in recorded.surveys if one.fault]


def proposal(files: Sequence[Path], recorded: Recorded) -> list[str]:
    """The command that would replay these, and what has to be added to it."""
    words = ["midnet-bench replay", *map(str, files)]
    try:
        carriers = {robot.carrier: robot for robot in robots_of(recorded, RecordingSetup())}
    except InputError as error:
        return [f"to replay it: {error}"]
    lines = []
    for robot in carriers.values():
        words.append(f"--pose {f'{robot.carrier}=' if len(carriers) > 1 else ''}{robot.pose_key}")
        stream = recorded.surveys[robot.source].streams.get(robot.pose_key)
        if stream is None or not robot.pose_key.startswith("/"):
            continue
        lines.append(f"{robot.pose_key} is taken for the pose of {robot.name}; is it, on the map?")
        if stream.topic.type == "nav_msgs/msg/Odometry" and stream.poses[0].frame != "map":
            words += ["--start found"] * ("--start found" not in words)
    grids = _grids(recorded)
    if not grids:
        made = f"results/map-{recorded.names[0]}"
        lines.append(f"no map: midnet-bench map --from-log {files[0]} -o {made}; then --map {made}/map.yaml")
    words.append(f"--map {'/map' if '/map' in grids else 'MAP.yaml'}")
    return [f"proposed: {' '.join(words)}", *lines, "--check besides finds the mount and writes a setup.yaml"]


def _grids(recorded: Recorded) -> list[str]:
    return [name for one in recorded.surveys for name, at in one.streams.items() if at.topic.kind == "grid"]


def prior_map_of(
    setup: RecordingSetup, recorded: Recorded, robots: Sequence[RobotPlan], note: Note
) -> tuple[OccupancyGrid, int | None]:
    """The map that is subtracted, and until when its background was taken, ns of the record time.

    Raises:
        InputError: no map, or none that can be used.
    """
    if setup.map is not None and setup.background is not None:
        raise InputError("replay: map and background both give the map; leave one out")
    if setup.background is not None:
        return _background(setup, setup.background, recorded, robots, note)
    if setup.map is None:
        raise InputError("replay: a map is needed: --map MAP.yaml, --map TOPIC, or background in setup.yaml")
    sources = [one.source for one in recorded.surveys if setup.map in one.source.topics]
    for source in sources:
        reading = next(iter(source.readings({setup.map})), None)
        if isinstance(reading, GridReading):
            return reading.as_map(), None
    if sources:
        raise InputError(f"map: {setup.map}: holds no map (nav_msgs/OccupancyGrid)")
    grids = _grids(recorded)
    if grids and setup.map.startswith("/") and not Path(setup.map).exists():
        raise InputError(f"map: {setup.map}: no such topic{nearest_name(setup.map, grids)}")
    return load_map(Path(setup.map)), None


def _background(
    setup: RecordingSetup, background: str, recorded: Recorded, robots: Sequence[RobotPlan], note: Note
) -> tuple[OccupancyGrid, int | None]:
    """A map by ray counting over another recording, or over the first seconds of this one."""
    counts, setup = RayCounts(setup.resolution_m), setup.model_copy(update={"rate_hz": None})
    path, until_ns = Path(background), None
    with ExitStack() as stack:
        if background.startswith(FIRST) and not path.exists():
            lasts_s = number_of(background.removeprefix(FIRST), f"background: {background}")
            if lasts_s <= 0.0:
                raise InputError(f"background: {background}: {lasts_s:g} s is no time; give such as first-10")
        elif any(path.exists() and path.samefile(one.source.path) for one in recorded.surveys):
            raise InputError(
                f"background: {background}: is the recording itself, whose people would be walls; "
                "give another recording, or its beginning as first-10"
            )
        else:
            lasts_s = math.inf
            setup = setup.model_copy(update={"from_s": 0.0, "to_s": None, "offset_s": {}})
            recorded = Recorded.of(stack.enter_context(opened([path])), setup)
            robots = robots_of(recorded, setup)
        empty, taken = OccupancyGrid(np.zeros((1, 1), np.int8), counts.resolution_m, (0.0, 0.0)), 0
        for frame in Replay(recorded, robots, empty, {}, setup).frames():
            if until_ns is None and lasts_s < math.inf:
                until_ns = frame.time_ns + round(lasts_s * NS)
            if until_ns is not None and frame.time_ns >= until_ns:
                break
            for one in frame.observed:
                if one.robot == frame.scanned and one.scan is not None:
                    counts.take(one.scan, one.returns)
                    taken += 1
    if not taken:
        raise InputError(f"background: {background}: no scan of it has a pose; the map would be empty")
    grid = counts.map(setup.hit_threshold)
    note(
        f"map: {grid.width} x {grid.height} cells of {grid.resolution:g} m by counting the rays of {taken} "
        f"scans, occupied from {setup.hit_threshold:g} of the beams on"
    )
    return grid, until_ns


def scan_log_of(path: Path, note: Callable[[str], None]) -> ScanLog:
    """The scans of a recording's robot, each with its pose by the wheels, or by tf as far up as it goes.

    Ranges without a return are the sensor's largest, NaN says nothing. ``note`` gets remarks on the file.

    Raises:
        InputError: the file is no recording, has several robots or lasers, no pose, or scans of several
            LiDARs, of which none has more than half.
    """
    setup = RecordingSetup().changed({"start": {EVERY: FOUND}, "map": None})
    with opened([path]) as sources:
        recorded = Recorded.of(sources, setup)
        for remark in (*sources[0].remarks, *recorded.surveys[0].remarks):
            note(remark)
        robots = robots_of(recorded, setup)
        if len(robots) > 1:
            names = ", ".join(robot.name for robot in robots)[:100]
            raise InputError(f"{path}: has {len(robots)} lasers ({names}); SLAM takes a recording of one")
        note(f"{path}: scans {robots[0].topic}, poses {robots[0].pose.in_words}")
        nothing = OccupancyGrid(np.zeros((1, 1), np.int8), 0.05, (0.0, 0.0))
        frames = Replay(recorded, robots, nothing, {}, setup).frames()
        scans = [(one.scan, one.estimate.pose) for frame in frames for one in frame.observed if one.scan]
    if not scans:
        raise InputError(f"{path}: no scan of it has a pose; give a recording with odometry")
    beams, left_out = usual_beams(path, [scan.lidar.beams for scan, _ in scans])
    scans = [(scan, pose) for scan, pose in scans if scan.lidar.beams == beams]
    lidar, logged = scans[0][0].lidar, []
    for scan, pose in scans:
        ranges_m = np.where(np.isinf(scan.ranges_m), lidar.range_max_m, scan.ranges_m)
        logged.append(LoggedScan(scan.stamp_s, pose, ranges_m))
    return ScanLog(path, lidar, logged, left_out)
