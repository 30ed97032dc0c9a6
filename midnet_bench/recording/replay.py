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
from typing import Literal, NamedTuple

import numpy as np

from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, LidarGeometry, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Ally, Frame, Observation
from midnet_bench.recording.files.readings import NS, PoseReading, Reading, ScanReading
from midnet_bench.recording.files.survey import EVER_NS
from midnet_bench.recording.fitting.fit import Localizer
from midnet_bench.recording.plan import AllyPlan, Link, PoseChain, Recorded, RobotPlan, geometry_of
from midnet_bench.recording.poses import InterpolatedPose, PoseInterpolator, PoseTrack, stamp_ns
from midnet_bench.recording.setup import RecordingSetup, ReplaySettings

PATIENCE_NS = NS  # a scan waits so long for the pose after it
HOLD_NS = NS // 3
"""with several robots a scan waits so long for others that were taken before it and come after it"""
LARGEST_JUMP_NS = 3600 * NS  # a stamp that lies farther from where the one before leaves it is no time


class RobotObservation(NamedTuple):
    """One robot at a frame."""

    robot: int  # counted as the lasers are
    carrier: int  # the robot with this laser: lasers of one robot have the same
    estimate: InterpolatedPose  # its pose, map frame
    scan: Scan | None  # its last one
    returns: Floats  # (n, 2) where that scan's beams ended, map frame


class DetectorOutput(NamedTuple):
    """Boxes that one of several detectors made of a frame, and its inputs, one for each robot observed."""

    frame: Frame
    observations: list[Observation]


class ReplayFrame(NamedTuple):
    """One frame of a recording."""

    number: int  # counted from 0
    time_ns: int  # by the chosen clock
    record_ns: int
    """when the last scan before it was recorded, or as long after as it lies behind that scan's time"""
    scan_index: int | None  # which scan of its topic made it, counted from 0; None for a frame at a rate
    scanned: int | None  # the robot that made that scan
    observed: list[RobotObservation]
    allies: list[tuple[AllyPlan, InterpolatedPose | None]]
    fresh_allies: list[Ally]  # those whose poses are not too old
    followed: list[tuple[AllyPlan, InterpolatedPose | None]]
    outputs: dict[str, DetectorOutput]  # by preset


@dataclass
class Tally:
    """Counts of scans, frames and ages of a replay, for its report."""

    scans: Counter[str] = field(default_factory=Counter)  # robot -> scans that were taken
    skipped: Counter[str] = field(default_factory=Counter)  # why -> scans that were not
    first: dict[str, str] = field(default_factory=dict)  # why -> where it happened first
    without_pose: int = 0  # of those that were not, how many had no pose near enough
    oldest_pose_s: float = 0.0
    """the farthest that a scan which was taken lies from a reading that its pose is made of"""
    late_allies: Counter[str] = field(default_factory=Counter)
    """ally -> frames in which its pose was too old, or there was none yet"""
    oldest_ally_s: dict[str, float] = field(default_factory=dict)
    """ally -> the age of its oldest pose at a frame"""
    frames: int = 0
    first_ns: int = 0  # time of the first frame
    last_ns: int = 0

    def skip(self, why: str, where: str) -> Literal[False]:
        """Count a scan that was not taken."""
        self.skipped[why] += 1
        self.first.setdefault(why, where)
        return False


@dataclass
class _Laser:
    """A laser, and what came of it last."""

    number: int
    plan: RobotPlan
    carrier: int
    where: PoseInterpolator
    scan: Scan | None = None
    returns: Floats = field(default_factory=lambda: np.empty((0, 2)))
    correction: Pose2D | None = None
    heard: int = 0


class _Pending(NamedTuple):
    """A scan that waits for its pose; a frame that is due, without a laser."""

    time_ns: int
    order: int
    laser: _Laser | None = None
    scan: ScanReading | None = None
    number: int = -1  # of the scan among those of its topic

    @property
    def place(self) -> str:
        """Which scan it is, in words."""
        name = self.laser.plan.name if self.laser else ""
        return f"robot '{name}', scan {self.number} at {self.time_ns / NS:.3f} s"


class Replay:
    """One pass over the recordings."""

    def __init__(
        self,
        recorded: Recorded,
        robots: Sequence[RobotPlan],
        prior_map: OccupancyGrid,
        settings: Mapping[str, ReplaySettings],
        setup: RecordingSetup,
        allies: Sequence[AllyPlan] = (),
        correctors: Sequence[Localizer] = (),
        followed: Sequence[AllyPlan] = (),
    ) -> None:
        """Nothing is read yet; each preset of ``settings`` gets its detector.

        Poses are corrected by ``correctors``, one for each laser, or none. The detectors know the allies, and
        not those that are followed, intruders with recorded poses that serve as labels.
        """
        self.nodes = {name: DetectorNode(one, prior_map, len(robots)) for name, one in settings.items()}
        self.robots, self.prior_map, self.tally = list(robots), prior_map, Tally()
        self.done = 0.0  # share of the recordings that was read
        self.settings, self.setup = settings, setup
        self._recorded, self._correctors = recorded, correctors
        self.tracks: dict[Link, PoseTrack] = {}
        """the tracks that poses are made of"""
        names = list(dict.fromkeys(robot.carrier for robot in robots))
        self._lasers = [
            _Laser(number, robot, names.index(robot.carrier), self._interpolator(robot.pose))
            for number, robot in enumerate(robots)
        ]
        self._allies = [(plan, self._interpolator(plan.pose)) for plan in allies]
        self._followed = [(plan, self._interpolator(plan.pose)) for plan in followed]
        others = [where for _, where in (*self._allies, *self._followed)]
        self._interpolators = [*(one.where for one in self._lasers), *others]
        self._by_scan = {(one.plan.source, one.plan.topic, one.plan.frame): one for one in self._lasers}
        self._lags: dict[tuple[int, str, str, str], int] = {}
        self._period_ns = None if setup.rate_hz is None else NS / setup.rate_hz
        self._pending: list[_Pending] = []
        self._order = itertools.count()
        self._lag_ns = 0  # record time minus time of the last scan
        self._now_ns: int | None = None
        self._passed_ns: int | None = None
        self._due: int | None = None  # number of the next frame at a rate
        self._damage: InputError | None = None

    def _interpolator(self, chain: PoseChain) -> PoseInterpolator:
        return PoseInterpolator(
            [
                link if isinstance(link, Pose2D) else self.tracks.setdefault(link, PoseTrack(link.in_words))
                for link in chain.links
            ]
        )

    def frames(self) -> Iterator[ReplayFrame]:
        """Each frame in order of time.

        Raises:
            InputError: a file is damaged; the frames before were given.
        """
        for source, reading in self._readings():
            if self._take(source, reading):
                while self._pending and self._is_ready(self._pending[0]):
                    self._passed_ns = self._pending[0].time_ns
                    yield from self._passed(heapq.heappop(self._pending))
        if self._period_ns is not None and self._now_ns is not None:  # one more, if it is in the recording
            self._queue_frames(min(self._recorded.end_ns, self._now_ns + round(self._period_ns)))
        while self._pending:
            yield from self._passed(heapq.heappop(self._pending))
        if self._damage is not None:
            raise self._damage

    def _readings(self) -> Iterator[tuple[int, Reading]]:
        """What is needed of all sources, in the order in which it was recorded, up to any damage."""
        streams = []
        for number, source in enumerate(one.source for one in self._recorded.surveys):
            topics = {topic for at, topic, _ in self._by_scan if at == number}
            links = [link for link in self.tracks if link.source == number]
            topics |= {link.topic for link in links if link.topic}
            if not all(link.topic for link in links):
                topics |= {name for name, topic in source.topics.items() if topic.kind == "tf"}
            if topics:
                streams.append(self._readings_of(number, topics))
        offsets_ns = self._recorded.offsets_ns
        try:
            yield from heapq.merge(*streams, key=lambda one: one[1].record_ns + offsets_ns[one[0]])
        except InputError as error:  # what came before it is good
            self._damage = error

    def _readings_of(self, number: int, topics: set[str]) -> Iterator[tuple[int, Reading]]:
        source, to_ns = self._recorded.surveys[number].source, self._recorded.part_ns[1]
        length_ns = max(source.end_ns - source.start_ns, 1)
        stop_ns = None if to_ns == EVER_NS else to_ns - self._recorded.offsets_ns[number] + PATIENCE_NS
        for reading in source.readings(topics, None, stop_ns):
            self.done = (reading.record_ns - source.start_ns) / length_ns
            yield number, reading

    def _take(self, source: int, reading: Reading) -> bool:
        """Take a pose, or queue a scan and the frames due by then; whether time may have moved on."""
        if not isinstance(reading, ScanReading | PoseReading) or self._jumps(source, reading):
            return False
        time_ns = stamp_ns(reading, self.setup.clock) + self._recorded.offsets_ns[source]
        if isinstance(reading, PoseReading):
            by_topic = self.tracks.get(Link(source, reading.topic))
            track = by_topic or self.tracks.get(Link(source, "", reading.frame, reading.child))
            if track is None:
                time_ns -= PATIENCE_NS  # it does not move the time on
            else:
                track.take(time_ns, reading)
        else:
            laser = self._by_scan.get((source, reading.topic, ""))
            laser = self._by_scan.get((source, reading.topic, reading.frame), laser)
            if laser is None:
                return False
            time_ns -= laser.plan.delay_ns
            if not self._queue_scan(laser, reading, time_ns):
                return False
        self._now_ns = time_ns if self._now_ns is None else max(self._now_ns, time_ns)
        if self._period_ns is not None and self._due is not None:
            if self._now_ns - self._due * self._period_ns > LARGEST_JUMP_NS:
                self._due = math.ceil(self._now_ns / self._period_ns)
            self._queue_frames(self._now_ns)
        return True

    def _queue_scan(self, laser: _Laser, reading: ScanReading, time_ns: int) -> bool:
        item = _Pending(time_ns, next(self._order), laser, reading, laser.heard)
        laser.heard += 1
        first_ns, last_ns = self._recorded.part_ns
        if not first_ns <= reading.record_ns + self._recorded.offsets_ns[laser.plan.source] <= last_ns:
            laser.where.forget(time_ns)
            return False
        if self._passed_ns is not None and time_ns < self._passed_ns:
            return self.tally.skip("came after later ones were taken", item.place)
        heapq.heappush(self._pending, item)
        if self._period_ns is not None and self._due is None:
            self._due = math.ceil(time_ns / self._period_ns)
        return True

    def _queue_frames(self, until_ns: int) -> None:
        """The frames at a rate that are due by an instant."""
        while self._period_ns and self._due is not None:
            due_ns = round(self._due * self._period_ns)
            if due_ns > until_ns:
                return
            heapq.heappush(self._pending, _Pending(due_ns, 1 << 62))
            self._due += 1

    def _jumps(self, source: int, reading: ScanReading | PoseReading) -> bool:
        """Whether a stamp lies hours off where the last one of its topic leaves it; that is counted."""
        if self.setup.clock == "record":
            return False
        lag_ns = reading.record_ns - reading.stamp_ns
        child = reading.child if isinstance(reading, PoseReading) else ""
        key = source, reading.topic, reading.frame, child
        before_ns, self._lags[key] = self._lags.get(key, lag_ns), lag_ns
        if abs(lag_ns - before_ns) <= LARGEST_JUMP_NS:
            return False
        if isinstance(reading, ScanReading):
            why = "has a stamp that jumps by more than an hour against its record time (see clock: record)"
            self.tally.skip(why, f"{reading.topic}, recorded at {reading.record_ns / NS:.3f} s")
        return True

    def _is_ready(self, item: _Pending) -> bool:
        """Whether the poses of its instant are there, or waiting for them has lasted long enough."""
        now_ns, is_alone = self._now_ns or 0, len(self._lasers) == 1 and self._period_ns is None
        if now_ns >= item.time_ns + PATIENCE_NS:
            return True
        if now_ns < item.time_ns + (0 if is_alone else HOLD_NS):
            return False
        until_ns = item.time_ns
        if self.setup.deskew and item.laser is not None and item.scan is not None:
            until_ns += round(item.laser.plan.beam_s * NS * len(item.scan.ranges_m))
        return all(where.is_known_at(until_ns) for where in self._interpolators)

    def _passed(self, item: _Pending) -> Iterator[ReplayFrame]:
        if item.laser is None or (self._observe(item, item.laser) and self.setup.rate_hz is None):
            frame = self._frame(item)
            if frame is not None:
                yield frame
        for where in self._interpolators:
            where.forget(item.time_ns)

    def _observe(self, item: _Pending, laser: _Laser) -> bool:
        """Take a scan into its robot's costmap; whether that was done."""
        assert item.scan is not None
        plan, scan, max_age_s = laser.plan, item.scan, self.setup.max_pose_age_s
        if not len(scan.ranges_m):
            return self.tally.skip("has no range at all", item.place)
        estimate = laser.where.at(item.time_ns)
        if estimate is None or estimate.age_s > max_age_s:
            self.tally.without_pose += 1
            return self.tally.skip(laser.where.fault(item.time_ns, max_age_s), item.place)
        geometry, ranges_m = scan.geometry(plan.no_return.range_max_m), plan.no_return.cleaned(scan)
        try:
            lidar = geometry_of(geometry, len(ranges_m), plan.mount, plan.is_mirrored)
        except InputError as error:
            return self.tally.skip(str(error), item.place)
        if self.setup.deskew:
            last = laser.where.at(item.time_ns + round(plan.beam_s * NS * lidar.beams))
            if last is not None and last.age_s <= max_age_s:
                ranges_m = deskewed(ranges_m, lidar, last.pose.relative_to(estimate.pose))
        taken = Scan(ranges_m, lidar, estimate.pose, item.time_ns / NS)
        if self._correctors:
            pose = self._correctors[laser.number].corrected(taken)
            for other in self._lasers:
                if other.carrier == laser.carrier:
                    other.correction = pose.compose(estimate.pose.inverse())
            taken = taken._replace(pose=pose)
        for node in self.nodes.values():
            node.observe(laser.number, taken.pose, ranges_m, lidar, taken.stamp_s)
        self._lag_ns = scan.record_ns + self._recorded.offsets_ns[plan.source] - item.time_ns
        laser.scan, laser.returns = taken, taken.returns(math.inf)[1]
        self.tally.scans[plan.name] += 1
        if estimate.age_s < math.inf:  # of a laser at rest
            self.tally.oldest_pose_s = max(self.tally.oldest_pose_s, estimate.age_s)
        return True

    def _frame(self, item: _Pending) -> ReplayFrame | None:
        """The team's boxes at an instant, from its last scans and poses; None without a pose."""
        time_ns, tally, is_scan = item.time_ns, self.tally, item.laser is not None
        observed: list[RobotObservation] = []
        for one in self._lasers:
            estimate = one.where.at(time_ns) if is_scan else one.where.latest(time_ns)
            if estimate is None:
                continue
            if is_scan and (one.scan is None or estimate.age_s > self.setup.max_pose_age_s):
                continue
            if one.correction is not None:
                estimate = estimate._replace(pose=one.correction.compose(estimate.pose))
            observed.append(RobotObservation(one.number, one.carrier, estimate, one.scan, one.returns))
        if not observed:
            return None
        allies = [(plan, where.at(time_ns)) for plan, where in self._allies]
        fresh_allies = []
        for plan, ally in allies:
            age_s = math.inf if ally is None else ally.age_s
            tally.oldest_ally_s[plan.name] = max(tally.oldest_ally_s.get(plan.name, 0.0), age_s)
            if ally is not None and age_s <= self.setup.max_ally_age_s:
                fresh_allies.append(Ally(ally.pose, plan.diameter_m))
            else:
                tally.late_allies[plan.name] += 1
        outputs = {}
        for name, node in self.nodes.items():
            observations = [
                Observation(one.estimate.pose, node.costmaps[one.robot].published(), one.scan)
                for one in observed
            ]
            boxes = node.detect(observations, time_ns / NS, allies=fresh_allies)
            outputs[name] = DetectorOutput(boxes, observations)
        tally.first_ns, tally.last_ns = tally.first_ns if tally.frames else time_ns, time_ns
        tally.frames += 1
        return ReplayFrame(
            number=tally.frames - 1,
            time_ns=time_ns,
            record_ns=time_ns + self._lag_ns,
            scan_index=item.number if is_scan else None,
            scanned=item.laser.number if item.laser else None,
            observed=observed,
            allies=allies,
            fresh_allies=fresh_allies,
            followed=[(plan, where.at(time_ns)) for plan, where in self._followed],
            outputs=outputs,
        )


def deskewed(ranges_m: Floats, lidar: LidarGeometry, step: Pose2D) -> Floats:
    """(beams,) the ranges that all beams had met at the scan's own instant, each put to the nearest beam.

    ``step``: of the robot from the first beam to the last, robot frame at the first.
    """
    share, mount = np.arange(lidar.beams) / lidar.beams, lidar.mount
    base = np.stack((step.x * share, step.y * share, step.yaw * share), axis=1)
    heading = base[:, 2] + mount.yaw + lidar.angles_rad
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    x = base[:, 0] + cos * mount.x - sin * mount.y + ranges_m * np.cos(heading)
    y = base[:, 1] + sin * mount.x + cos * mount.y + ranges_m * np.sin(heading)
    dx, dy = x - mount.x, y - mount.y
    angles = np.arctan2(dy, dx) - mount.yaw - lidar.angle_min_rad
    period = math.tau / abs(lidar.angle_increment_rad)
    beams = np.rint(angles / lidar.angle_increment_rad) % round(period)
    met = np.isfinite(ranges_m) & (beams < lidar.beams)
    straight = np.where(np.isfinite(ranges_m), np.nan, ranges_m)
    places, distances = beams[met].astype(int), np.hypot(dx, dy)[met]
    far_first = np.argsort(-distances)
    straight[places[far_first]] = distances[far_first]
    return np.asarray(straight)
