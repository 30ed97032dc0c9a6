"""A recording played into the detector: each scan gets its pose, frames follow, one after the other.

Nothing here grows with the length of the recording: readings stream by, and wait only until the poses after
them have come.
"""

import heapq
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal, NamedTuple, Protocol

import numpy as np

from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Ally, Frame, Observation
from midnet_bench.recording.files.readings import (
    NS,
    ExactReading,
    Floats,
    PoseReading,
    Reading,
    ScanReading,
    Source,
)
from midnet_bench.recording.files.survey import EVER_NS
from midnet_bench.recording.plan import AllyPlan, Link, PoseChain, RobotPlan
from midnet_bench.recording.poses import InterpolatedPose, PoseInterpolator, PoseTrack, stamp_ns
from midnet_bench.recording.recording_settings import ReplaySettings
from midnet_bench.recording.setup import RecordingSetup

PATIENCE_NS = NS
"""a scan waits so long for the pose after it"""
HOLD_NS = NS // 3
"""with several robots a scan waits so long for others that were taken before it and come after it"""
EXACT_ENDING = "_exact"
"""of the topic that ``export`` writes beside a scan's: the same numbers with 64 bits"""
LEAST_BEAM_ANGLE_RAD = 1e-5
LARGEST_JUMP_NS = 3600 * NS
"""a stamp that lies farther from where the one before leaves it is no time"""


class RobotObservation(NamedTuple):
    """One robot at a frame."""

    robot: int
    """counted as the lasers are"""
    carrier: int
    """the robot with this laser: lasers of one robot have the same"""
    estimate: InterpolatedPose
    """its pose, map frame"""
    scan: Scan | None
    """its last one"""
    returns: Floats
    """(n, 2) where that scan's beams ended, map frame"""


class DetectorOutput(NamedTuple):
    """Boxes that one of several detectors made of a frame, and its inputs."""

    frame: Frame
    observations: list[Observation]
    """one of each robot of ``observed``"""


class Corrector(Protocol):
    """Corrects poses scan by scan; see ``localize.py``."""

    def corrected(self, scan: Scan) -> Pose2D:
        """The robot's pose at the scan, map frame; scans come in order of time."""


@dataclass
class ReplayFrame:
    """One frame of a recording."""

    number: int
    """counted from 0"""
    time_ns: int
    """by the chosen clock"""
    record_ns: int
    """when the last scan before it was recorded, or as long after as it lies behind that scan's time"""
    scan_index: int | None
    """which scan of its topic made it, counted from 0; None for a frame at a rate"""
    scanned: int | None
    """the robot that made that scan"""
    observed: list[RobotObservation]
    allies: list[tuple[AllyPlan, InterpolatedPose | None]]
    fresh_allies: list[Ally]
    """those whose poses are not too old"""
    followed: list[tuple[AllyPlan, InterpolatedPose | None]]
    outputs: dict[str, DetectorOutput]
    """by preset"""


@dataclass
class Tally:
    """Counts of scans, frames and ages of a replay, for its report."""

    scans: Counter[str] = field(default_factory=Counter)
    """robot -> scans that were taken"""
    skipped: Counter[str] = field(default_factory=Counter)
    """why -> scans that were not"""
    first: dict[str, str] = field(default_factory=dict)
    """why -> where it happened first"""
    without_pose: int = 0
    """of those that were not, how many had no pose near enough"""
    oldest_pose_s: float = 0.0
    """the farthest that a scan which was taken lies from a reading that its pose is made of"""
    late_allies: Counter[str] = field(default_factory=Counter)
    """ally -> frames in which its pose was too old, or there was none yet"""
    oldest_ally_s: dict[str, float] = field(default_factory=dict)
    """ally -> the age of its oldest pose at a frame"""
    frames: int = 0
    first_ns: int = 0
    """time of the first frame"""
    last_ns: int = 0

    def skip(self, why: str, where: str) -> None:
        """Count a scan that was not taken."""
        self.skipped[why] += 1
        self.first.setdefault(why, where)


class _Pending(NamedTuple):
    time_ns: int
    order: int
    robot: int | None
    """None: a frame is due"""
    scan: ScanReading | None
    exact: Floats | None
    number: int
    """of the scan among those of its topic"""


class Replay:
    """One pass over the recordings."""

    def __init__(
        self,
        sources: Sequence[Source],
        robots: Sequence[RobotPlan],
        allies: Sequence[AllyPlan],
        prior_map: OccupancyGrid,
        settings: Mapping[str, ReplaySettings],
        setup: RecordingSetup,
        offsets_ns: Sequence[int] = (),
        correctors: Sequence[Corrector] = (),
        followed: Sequence[AllyPlan] = (),
    ) -> None:
        """Nothing is read yet.

        Args:
            sources: the recordings.
            robots: each with its scans.
            allies: known to the detectors, with their poses.
            prior_map: int8, 100 occupied, map frame.
            settings: by preset; each gets its detector.
            setup: clock, rate, largest ages of poses, and whether motion during a scan is corrected.
            offsets_ns: added to the times of each source; none if empty.
            correctors: one for each robot, or none.
            followed: intruders with recorded poses, which serve as labels; no detector knows them.
        """
        self.nodes = {name: DetectorNode(one, prior_map, len(robots)) for name, one in settings.items()}
        self._correctors = correctors
        self._corrections: list[Pose2D | None] = [None] * len(robots)
        self.robots, self.allies, self.tally = list(robots), list(allies), Tally()
        self._sources, self._setup, self._offsets_ns = sources, setup, offsets_ns
        self._part_ns = part_of(sources, setup, offsets_ns)
        self._tracks: dict[Link, PoseTrack] = {}
        self._where = [self._interpolator(robot.pose) for robot in robots]
        self._where_allies = [self._interpolator(ally.pose) for ally in allies]
        self._followed = [(plan, self._interpolator(plan.pose)) for plan in followed]
        self._others = [*self._where_allies, *(where for _, where in self._followed)]
        self._by_scan = {(robot.source, robot.topic, robot.frame): k for k, robot in enumerate(robots)}
        self._by_exact = {(robot.source, robot.topic + EXACT_ENDING): k for k, robot in enumerate(robots)}
        names = list(dict.fromkeys(robot.carrier for robot in robots))
        self._carriers = [names.index(robot.carrier) for robot in robots]
        self._last: list[Scan | None] = [None] * len(robots)
        self._returns: list[Floats] = [np.empty((0, 2))] * len(robots)
        self._numbers = itertools.count()
        self._lags: dict[tuple[int, str, str, str], int] = {}
        self._period_ns = None if setup.rate_hz is None else NS / setup.rate_hz
        self._lag_ns = 0
        """record time minus time of the last scan"""
        self._pending: list[_Pending] = []
        self._exact: dict[int, Floats] = {}
        self._indices, self._order = Counter[int](), itertools.count()
        self._now_ns: int | None = None
        self._passed_ns: int | None = None
        self._due: int | None = None
        """number of the next frame at a rate"""
        self.done = 0.0
        """share of the recordings that was read"""

    def _interpolator(self, chain: PoseChain) -> PoseInterpolator:
        return PoseInterpolator(
            [
                link if isinstance(link, Pose2D) else self._tracks.setdefault(link, PoseTrack())
                for link in chain.links
            ]
        )

    def frames(self) -> Iterator[ReplayFrame]:
        """Each frame in order of time.

        Raises:
            InputError: a file is damaged; the frames before were given.
        """
        damage: InputError | None = None
        readings = self._readings()
        while True:
            try:
                source, reading = next(readings)
            except StopIteration:
                break
            except InputError as error:  # what came before it is good
                damage = error
                break
            if self._take(source, reading):
                while self._pending and self._is_ready(self._pending[0]):
                    item = heapq.heappop(self._pending)
                    self._passed_ns = item.time_ns
                    yield from self._passed(item)
        self._queue_last_frame()
        while self._pending:
            yield from self._passed(heapq.heappop(self._pending))
        if damage is not None:
            raise damage

    def _take(self, source: int, reading: Reading) -> bool:
        """Take a pose, or queue a scan and the frames due by then; whether time may have moved on."""
        if isinstance(reading, ExactReading):
            self._exact[self._by_exact[source, reading.topic]] = reading.numbers
            return False
        if not isinstance(reading, ScanReading | PoseReading) or self._jumps(source, reading):
            return False
        if isinstance(reading, PoseReading):
            time_ns = self._take_pose(source, reading)
        else:
            robot = self._by_scan.get((source, reading.topic, ""), -1)
            robot = self._by_scan.get((source, reading.topic, reading.frame), robot)
            if robot < 0:
                return False
            delay_ns = self.robots[robot].delay_ns
            time_ns = stamp_ns(reading, self._setup.clock) + self._offset(source) - delay_ns
            order, number = next(self._order), self._indices[robot]
            item = _Pending(time_ns, order, robot, reading, self._exact.pop(robot, None), number)
            self._indices[robot] += 1
            if not self._part_ns[0] <= reading.record_ns + self._offset(source) <= self._part_ns[1]:
                self._where[robot].forget(time_ns)
                return False
            if self._passed_ns is not None and time_ns < self._passed_ns:
                return self._skip(item, "came after later ones were taken")
            heapq.heappush(self._pending, item)
            if self._period_ns is not None and self._due is None:
                self._due = math.ceil(time_ns / self._period_ns)
        self._now_ns = time_ns if self._now_ns is None else max(self._now_ns, time_ns)
        if self._period_ns is not None and self._due is not None:
            if self._now_ns - self._due * self._period_ns > LARGEST_JUMP_NS:
                self._due = math.ceil(self._now_ns / self._period_ns)
            while round(self._due * self._period_ns) <= self._now_ns:
                self._queue_frame(self._due * self._period_ns)
                self._due += 1
        return True

    def _queue_frame(self, time_ns: float) -> None:
        heapq.heappush(self._pending, _Pending(round(time_ns), 1 << 62, None, None, None, -1))

    def _queue_last_frame(self) -> None:
        """A frame that is due after the last reading, before the recording ends."""
        if self._period_ns is not None and self._due is not None and self._now_ns is not None:
            end_ns = max(source.end_ns + self._offset(number) for number, source in enumerate(self._sources))
            due_ns = self._due * self._period_ns
            if round(due_ns) <= min(end_ns, self._now_ns + round(self._period_ns)):
                self._queue_frame(due_ns)

    def _jumps(self, source: int, reading: ScanReading | PoseReading) -> bool:
        """Whether a stamp lies hours off where the last one of its topic leaves it; that is counted."""
        if self._setup.clock == "record":
            return False
        lag_ns = reading.record_ns - reading.stamp_ns
        pair = reading.frame, reading.child if isinstance(reading, PoseReading) else ""
        before_ns = self._lags.get((source, reading.topic, *pair), lag_ns)
        self._lags[source, reading.topic, *pair] = lag_ns
        if abs(lag_ns - before_ns) <= LARGEST_JUMP_NS:
            return False
        if isinstance(reading, ScanReading):
            why = "has a stamp that jumps by more than an hour against its record time (see clock: record)"
            self.tally.skip(why, f"{reading.topic}, recorded at {reading.record_ns / NS:.3f} s")
        return True

    def _is_ready(self, item: _Pending) -> bool:
        """Whether the poses of its instant are there, or waiting for them has lasted long enough."""
        now_ns, is_alone = self._now_ns or 0, len(self.robots) == 1 and self._period_ns is None
        if now_ns >= item.time_ns + PATIENCE_NS:
            return True
        if now_ns < item.time_ns + (0 if is_alone else HOLD_NS):
            return False
        wanted = self._where if item.robot is None or len(self._where) > 1 else [self._where[item.robot]]
        until_ns = item.time_ns
        if self._setup.deskew and item.robot is not None and item.scan is not None:
            until_ns += round(self.robots[item.robot].beam_s * NS * len(item.scan.ranges_m))
        return all(where.is_known_at(until_ns) for where in (*wanted, *self._others))

    def _offset(self, source: int) -> int:
        return self._offsets_ns[source] if self._offsets_ns else 0

    def _take_pose(self, source: int, reading: PoseReading) -> int:
        link = Link(source, reading.topic)
        if link not in self._tracks:
            link = Link(source, "", reading.frame, reading.child)
        time_ns = stamp_ns(reading, self._setup.clock) + self._offset(source)
        track = self._tracks.get(link)
        if track is None:
            return time_ns - PATIENCE_NS  # no track uses it, and it does not move the time on
        track.take(time_ns, reading)
        return time_ns

    def _readings(self) -> Iterator[tuple[int, Reading]]:
        """What is needed of all sources, in the order in which it was recorded, with its source."""
        streams = []
        for number, source in enumerate(self._sources):
            topics = {topic for at, topic, _ in self._by_scan if at == number}
            topics |= {topic for at, topic in self._by_exact if at == number and topic in source.topics}
            for link in self._tracks:
                if link.source != number:
                    continue
                if link.topic:
                    topics.add(link.topic)
                else:
                    topics |= {name for name, topic in source.topics.items() if topic.kind == "tf"}
            if topics:
                streams.append(self._of(number, source, topics))
        if len(streams) == 1:
            yield from streams[0]
            return
        yield from heapq.merge(*streams, key=lambda one: one[1].record_ns + self._offset(one[0]))

    def _of(self, number: int, source: Source, topics: set[str]) -> Iterator[tuple[int, Reading]]:
        length_ns = max(source.end_ns - source.start_ns, 1)
        stop_ns = None
        if self._setup.to_s is not None:
            stop_ns = self._part_ns[1] - self._offset(number) + PATIENCE_NS
        for reading in source.readings(topics, None, stop_ns):
            self.done = (reading.record_ns - source.start_ns) / length_ns
            yield number, reading

    def _passed(self, item: _Pending) -> Iterator[ReplayFrame]:
        if item.robot is None or (self._observe(item) and self._setup.rate_hz is None):
            frame = self._frame(item, item.robot)
            if frame is not None:
                yield frame
        for where in (*self._where, *self._others):
            where.forget(item.time_ns)

    def _seconds(self, time_ns: int) -> float:
        tick_hz = self._setup.tick_hz
        return time_ns / NS if tick_hz is None else round(time_ns * tick_hz / NS) / tick_hz

    def _skip(self, item: _Pending, why: str) -> Literal[False]:
        """Count a scan that is not taken."""
        name = self.robots[item.robot or 0].name
        self.tally.skip(why, f"robot '{name}', scan {item.number} at {item.time_ns / NS:.3f} s")
        return False

    def _called(self, robot: int, track: int) -> str:
        links = [link for link in self.robots[robot].pose.links if isinstance(link, Link)]
        return links[track].in_words

    def _observe(self, item: _Pending) -> bool:
        """Take a scan into its robot's costmap; whether that was done."""
        assert item.robot is not None
        assert item.scan is not None
        robot, plan, scan = item.robot, self.robots[item.robot], item.scan
        if not len(scan.ranges_m):
            return self._skip(item, "has no range at all")
        where, max_age_s = self._where[robot], self._setup.max_pose_age_s
        estimate = where.at(item.time_ns)
        if estimate is None or estimate.age_s > max_age_s:
            self.tally.without_pose += 1
            if estimate is None:
                return self._skip(
                    item, f"has no pose of {self._called(robot, where.missing(item.time_ns)[0])} before it"
                )
            link = self._called(robot, where.oldest(item.time_ns))
            return self._skip(item, f"lies more than {max_age_s:g} s from a pose of {link}")
        if item.exact is None:
            geometry, ranges_m = scan.geometry(plan.no_return.range_max_m), plan.no_return.cleaned(scan)
        else:
            geometry, ranges_m = tuple(item.exact[:4].tolist()), item.exact[4:]
        try:
            lidar = geometry_of(geometry, len(ranges_m), plan.mount, plan.is_mirrored)
        except InputError as error:
            return self._skip(item, str(error))
        if self._setup.deskew:
            ranges_m = self._deskewed(robot, item, ranges_m, lidar)
        scan_taken = Scan(ranges_m, lidar, estimate.pose, self._seconds(item.time_ns))
        if self._correctors:
            pose = self._correctors[robot].corrected(scan_taken)
            for laser, carrier in enumerate(self._carriers):
                if carrier == self._carriers[robot]:
                    self._corrections[laser] = pose.compose(estimate.pose.inverse())
            scan_taken = scan_taken._replace(pose=pose)
        for node in self.nodes.values():
            node.observe(robot, scan_taken.pose, ranges_m, lidar, scan_taken.stamp_s)
        self._lag_ns = scan.record_ns + self._offset(plan.source) - item.time_ns
        self._last[robot], self._returns[robot] = scan_taken, scan_taken.returns(math.inf)[1]
        self.tally.scans[plan.name] += 1
        if estimate.age_s < math.inf:  # of a laser at rest
            self.tally.oldest_pose_s = max(self.tally.oldest_pose_s, estimate.age_s)
        return True

    def _deskewed(self, robot: int, item: _Pending, ranges_m: Floats, lidar: LidarGeometry) -> Floats:
        """The ranges that all beams had met at the scan's own instant, each put to the nearest beam."""
        where, plan = self._where[robot], self.robots[robot]
        last = where.at(item.time_ns + round(plan.beam_s * NS * lidar.beams))
        first = where.at(item.time_ns)
        if first is None or last is None or last.age_s > self._setup.max_pose_age_s:
            return ranges_m
        share = np.arange(lidar.beams) / lidar.beams
        step = last.pose.relative_to(first.pose)
        base = np.stack((step.x * share, step.y * share, step.yaw * share), axis=1)
        heading = base[:, 2] + plan.mount.yaw + lidar.angles_rad
        cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
        x = base[:, 0] + cos * plan.mount.x - sin * plan.mount.y + ranges_m * np.cos(heading)
        y = base[:, 1] + sin * plan.mount.x + cos * plan.mount.y + ranges_m * np.sin(heading)
        dx, dy = x - plan.mount.x, y - plan.mount.y
        angles = np.arctan2(dy, dx) - plan.mount.yaw - lidar.angle_min_rad
        period = math.tau / abs(lidar.angle_increment_rad)
        beams = np.rint(angles / lidar.angle_increment_rad) % round(period)
        met = np.isfinite(ranges_m) & (beams < lidar.beams)
        straight = np.where(np.isfinite(ranges_m), np.nan, ranges_m)
        places, distances = beams[met].astype(int), np.hypot(dx, dy)[met]
        far_first = np.argsort(-distances)
        straight[places[far_first]] = distances[far_first]
        return np.asarray(straight)

    def _frame(self, item: _Pending, scanned: int | None) -> ReplayFrame | None:
        """The team's boxes at an instant, from its last scans and poses; None without a pose."""
        setup, tally = self._setup, self.tally
        observed: list[RobotObservation] = []
        for robot, where in enumerate(self._where):
            estimate = where.at(item.time_ns) if scanned is not None else where.latest(item.time_ns)
            heard = self._last[robot]
            if estimate is None or (scanned is not None and heard is None):
                continue
            if scanned is not None and estimate.age_s > setup.max_pose_age_s:
                continue
            correction = self._corrections[robot]
            if correction is not None:
                estimate = estimate._replace(pose=correction.compose(estimate.pose))
            observed.append(
                RobotObservation(robot, self._carriers[robot], estimate, heard, self._returns[robot])
            )
        if not observed:
            return None
        allies, fresh_allies = [], []
        for plan, where in zip(self.allies, self._where_allies, strict=True):
            estimate = where.at(item.time_ns)
            allies.append((plan, estimate))
            age_s = math.inf if estimate is None else estimate.age_s
            tally.oldest_ally_s[plan.name] = max(tally.oldest_ally_s.get(plan.name, 0.0), age_s)
            if estimate is not None and age_s <= setup.max_ally_age_s:
                fresh_allies.append(Ally(estimate.pose, plan.diameter_m))
            else:
                tally.late_allies[plan.name] += 1
        followed = [(plan, where.at(item.time_ns)) for plan, where in self._followed]
        time_s = self._seconds(item.time_ns)
        outputs = {}
        for name, node in self.nodes.items():
            observations = [
                Observation(one.estimate.pose, node.costmaps[one.robot].published(), one.scan)
                for one in observed
            ]
            boxes = node.detect(observations, time_s, allies=fresh_allies)
            outputs[name] = DetectorOutput(boxes, observations)
        tally.first_ns = tally.first_ns if tally.frames else item.time_ns
        tally.last_ns = item.time_ns
        tally.frames += 1
        index, number = None if scanned is None else item.number, next(self._numbers)
        return ReplayFrame(
            *(
                number,
                item.time_ns,
                item.time_ns + self._lag_ns,
                index,
                scanned,
                observed,
                allies,
                fresh_allies,
                followed,
                outputs,
            )
        )

    def void_poses(self) -> list[str]:
        """A line for each track with readings that were no pose."""
        return [
            f"{link.in_words}: {track.void} poses are not finite, too far off or no rotation, "
            f"the first at {(track.first_void_ns or 0) / NS:.3f} s; they were left out"
            for link, track in self._tracks.items()
            if track.void
        ]

    def pose_times(self) -> list[tuple[str, int]]:
        """Name of each track, and how many poses it had."""
        return [(link.in_words, track.taken) for link, track in self._tracks.items()]


def part_of(
    sources: Sequence[Source], setup: RecordingSetup, offsets_ns: Sequence[int] = ()
) -> tuple[int, int]:
    """First and last record time of the scans that are used, nanoseconds, by the sources' common clock.

    Raises InputError: the recordings have no such part.
    """
    offsets_ns = offsets_ns or [0] * len(sources)
    begin_ns = min(source.start_ns + own_ns for source, own_ns in zip(sources, offsets_ns, strict=True))
    end_ns = max(source.end_ns + own_ns for source, own_ns in zip(sources, offsets_ns, strict=True))
    from_ns = begin_ns + round(setup.from_s * NS)
    if from_ns > end_ns:
        length_s = (end_ns - begin_ns) / NS
        raise InputError(f"from_s: {setup.from_s:g} s is after the recording's end, {length_s:.1f} s")
    if setup.to_s is not None and setup.to_s <= setup.from_s:
        raise InputError(f"to_s: {setup.to_s:g} s is not after from_s, {setup.from_s:g} s")
    to_ns = EVER_NS if setup.to_s is None else begin_ns + round(setup.to_s * NS)
    return (from_ns if setup.from_s else -EVER_NS), to_ns


@lru_cache(maxsize=256)
def geometry_of(numbers: tuple[float, ...], beams: int, mount: Pose2D, is_mirrored: bool) -> LidarGeometry:
    """A LiDAR by :meth:`ScanReading.geometry`, the same one each time. Raises InputError: it cannot be."""
    first, step, least_m, most_m = numbers
    if not (math.isfinite(first) and math.isfinite(step) and abs(step) > LEAST_BEAM_ANGLE_RAD):
        raise InputError(f"has angle_min {first:g} and angle_increment {step:g}, which no LiDAR has")
    if abs(step) * (beams - 1) > 2.0 * math.tau or abs(first) > 2.0 * math.tau:
        raise InputError(f"has {beams} beams {step:g} rad apart, which go round more than once; in degrees?")
    if math.isnan(least_m) or math.isnan(most_m):
        raise InputError("has a range limit that is not a number")
    side = -1.0 if is_mirrored else 1.0
    return LidarGeometry(beams, side * first, side * step, max(least_m, 0.0), most_m, mount)
