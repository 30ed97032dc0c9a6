"""A detector over messages as they come in: scans, poses, transforms and a map, of ROS 1 or ROS 2.

A ROS node subscribes, hands each message to a ``LiveNode`` and publishes what comes back. Messages are known
by their fields, which have the same names in rosbags and in rclpy.
"""

import bisect
import math
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median_high
from typing import Any, NamedTuple

import numpy as np

from midnet_bench.detectors.detector_node import DetectorNode, DetectorSettings
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.plugins import PluginError
from midnet_bench.recording.files.bags import in_words
from midnet_bench.recording.files.readings import (
    CODES,
    NO_MOTION,
    NS,
    GridReading,
    Meaning,
    NoReturn,
    PoseReading,
    ScanReading,
    Transform,
    decoded,
)
from midnet_bench.recording.files.ros_messages import MAP, ros_name
from midnet_bench.recording.plan import AT_ORIGIN, geometry_of
from midnet_bench.recording.poses import PoseInterpolator, PoseTrack
from midnet_bench.recording.replay import LARGEST_JUMP_NS

MAP_TOPIC, TF, TF_STATIC = "/map", "/tf", "/tf_static"
KEPT = 1000  # scans of a robot that wait for what they need, at most
WARN_EVERY_S = 60.0  # of one kind of fault at most a line in so long
STAMPS_KEPT, STAMPS_NEEDED = 9, 3
"""messages of a topic whose stamps tell its clock: the newest, and how many it takes"""
AHEAD_NS = 10 * NS  # a stamp that lies farther ahead of its topic's clock is no time
WAITED_NS = 60 * NS
"""a pose that is so much older than its topic's newest is forgotten, also if no frame was made of it"""
MOST_FRAMES = 5000  # of tf: no team has as many, and whatever is published takes memory
SLOWEST_HZ, FASTEST_HZ = 0.01, 1000.0  # frames a second
SWEEP_CHANGE, SWEEPS_NEEDED = 0.03, 5
"""a scan whose angle differs by a larger part is left out, unless that many in a row do"""
USUAL_CELL_M = 0.05
_NO_TIME = "stamps lie far from those of most other messages"
PLAIN: dict[str, Meaning] = {code: "clears" if code in ("inf", "above") else "nothing" for code in CODES}
"""meaning of readings without a return, unless set"""


@dataclass(frozen=True)
class LiveOptions:
    """Options of a node."""

    robots: Sequence[str]  # their names, in the order of the team
    settings_of: Callable[[float], DetectorSettings]  # what to detect by, on a map of so many metres per cell
    pose_by_tf: bool = False  # whether poses are taken from tf, not from ``/NAME/pose``
    mount: Pose2D | None = None  # of every LiDAR on its robot; None: as tf says
    no_return: Mapping[str, Meaning] = field(default_factory=dict)
    """what a code of ``no_return.CODES`` says, where that is not as in :data:`PLAIN`"""
    rate_hz: float = 5.0  # frames a second
    patience_s: float = 1.0
    """how long a frame waits for the others once a scan of its instant or later has come"""

    def __post_init__(self) -> None:
        """Raises InputError: one line that names the option."""
        if not self.robots:
            raise InputError("robots: NAME of one at least is needed, such as guard_1")
        for name in self.robots:
            if self.robots.count(name) > 1:
                raise InputError(f"robots: '{name}' is named twice")
            if ros_name(name) != name:
                raise InputError(f"robots: '{name}' is no name in ROS; take letters, digits and underscores")
        if not SLOWEST_HZ <= self.rate_hz <= FASTEST_HZ:
            allowed = f"{SLOWEST_HZ:g} to {FASTEST_HZ:g}"
            raise InputError(f"--rate: {self.rate_hz:g} is out of range; allowed: {allowed}")
        if not 0.0 < self.patience_s < math.inf:
            raise InputError(f"--patience: {self.patience_s:g} is out of range; allowed: above 0")

    def topics(self, needs_map: bool) -> dict[str, str]:
        """Each topic to listen to, and its type."""
        found = {TF_STATIC: "tf2_msgs/msg/TFMessage"}
        if needs_map:
            found[MAP_TOPIC] = "nav_msgs/msg/OccupancyGrid"
        if self.pose_by_tf:
            found[TF] = "tf2_msgs/msg/TFMessage"
        for name in self.robots:
            found[f"/{name}/scan"] = "sensor_msgs/msg/LaserScan"
            if not self.pose_by_tf:
                found[f"/{name}/pose"] = "geometry_msgs/msg/PoseStamped"
        return found


class Detected(NamedTuple):
    """The team's boxes at an instant."""

    stamp_ns: int
    boxes: list[Box]  # map frame, metres
    found_by: list[str]  # the robot that found each box


class _Placed(NamedTuple):
    """Where a robot's LiDAR is."""

    where: PoseInterpolator  # of the robot
    mount: Pose2D
    is_upside_down: bool


@dataclass
class _Heard:
    """Of one robot."""

    poses: PoseTrack = field(default_factory=PoseTrack)  # of its own topic
    scans: list[ScanReading] = field(default_factory=list)  # those that are in no costmap yet, by stamp
    first_ns: int | None = None  # stamp of the first scan
    newest_ns: int = -1  # stamp of the last one
    frame: str = ""  # of its scans
    placed: _Placed | None = None
    sweep_rad: float = 0.0  # from the first to the last beam of the scans that were taken; 0 before the first
    odd: int = 0  # scans in a row of another angle

    def has_odd_sweep(self, scan: ScanReading, said_rad: float) -> bool:
        """Whether a scan goes round farther or less far than those before, or the first than ``said_rad``."""
        sweep_rad = abs(scan.angle_increment_rad) * (len(scan.ranges_m) - 1)
        usual_rad = self.sweep_rad or said_rad
        slack_rad = SWEEP_CHANGE * usual_rad + 2.0 * abs(scan.angle_increment_rad)
        self.odd = 0 if abs(sweep_rad - usual_rad) <= slack_rad else self.odd + 1
        if 0 < self.odd < SWEEPS_NEEDED:
            return True
        self.sweep_rad, self.odd = sweep_rad, 0
        return False

    def forget_after(self, limit_ns: int) -> None:
        """Leave out the scans whose stamps turned out to be no times: those after ``limit_ns``."""
        self.scans = [scan for scan in self.scans if scan.stamp_ns <= limit_ns]
        stamps = [scan.stamp_ns for scan in self.scans]
        self.newest_ns, self.first_ns = max(stamps, default=-1), min(stamps, default=None)


class _Clocks:
    """By topic, how far the stamps of its messages lie from when they came: the middle of the newest ones.

    A clock that was set goes on, a stamp that lies alone is none: ROS has no other word on what time it is.
    """

    def __init__(self) -> None:
        self._offsets: dict[str, deque[int]] = {}
        self.counted: list[str] = []
        """the topics by which others are judged"""

    def take(self, topic: str, stamp_ns: int, arrived_s: float) -> tuple[bool, float]:
        """Take one more stamp; whether it is a time, and the latest that one of the topic can be now, ns.

        The topic's own stamps decide; where they lie an hour off, those of most counted topics do. The limit
        is inf while fewer than ``STAMPS_NEEDED`` have come.
        """
        seen = self._offsets.setdefault(topic, deque(maxlen=STAMPS_KEPT))
        seen.append(stamp_ns - round(arrived_s * NS))
        if len(seen) < STAMPS_NEEDED:
            return True, math.inf
        own_ns = median_high(seen)
        each = (self._offsets.get(name, ()) for name in self.counted)
        usual_ns = median_high([median_high(one) for one in each if len(one) >= STAMPS_NEEDED] or [own_ns])
        if abs(own_ns - usual_ns) <= LARGEST_JUMP_NS:
            usual_ns = own_ns
        is_time = -LARGEST_JUMP_NS <= seen[-1] - usual_ns <= AHEAD_NS
        return is_time, usual_ns + round(arrived_s * NS) + AHEAD_NS


class LiveNode:
    """Frames at the multiples of a period of the stamps' clock.

    When messages arrive does not matter, within the patience: a frame is made once each robot has sent a scan
    and a pose of that instant or later. It has the scans up to then, each taken with the pose of its own
    stamp, and each robot's latest pose. There is none without a scan since the last one.
    """

    def __init__(self, options: LiveOptions, prior_map: OccupancyGrid | None) -> None:
        """``prior_map``: int8; None: the first good message on ``/map``, which all others wait for.

        Raises InputError: the detector's options cannot be.
        """
        self._options = options
        self._heard = {name: _Heard() for name in options.robots}
        self._kinds = options.topics(needs_map=True)
        self._links: dict[str, tuple[str, Transform | PoseTrack]] = {}
        """frame -> its parent frame, and its place there: fixed, or over time"""
        self._arrived: deque[tuple[int, float]] = deque(maxlen=10 * KEPT)
        """each scan that was newer than all before: its stamp, and when it came"""
        self._next: int | None = None
        self._made_until_ns = -1
        self._clocks = _Clocks()
        self._prior_map = prior_map
        options.settings_of(USUAL_CELL_M)  # what is wrong with them is said before a map has come
        self._node = None if prior_map is None else self._made(prior_map)
        self._now_s = 0.0
        self._warned_s: dict[str, float] = {}
        self.dropped = Counter[str]()
        """why -> scans, poses, maps and other messages that were not taken"""
        self.warnings: list[str] = []
        """what is to be said of them; the reader empties it"""

    def hear(self, topic: str, message: Any, arrived_s: float) -> list[Detected]:
        """The frames that can be made after one more message, in order.

        Args:
            topic: of ``LiveOptions.topics``.
            message: of the type that is named there.
            arrived_s: when it came, by a clock that never goes back.

        What cannot be is left out, as is a scan or a pose whose stamp is no time; ``dropped`` counts it.

        Raises:
            PluginError: a detector or a fusion of the user's own fails.
        """
        self._now_s = arrived_s
        try:
            self._clocks.counted = self._counted()
            self._take(topic, message)
        except PluginError:
            raise
        except Exception as error:  # whatever a malformed message brings about: it costs itself
            self.leave_out("messages cannot be used", f"{topic}: {in_words(error)}")
        return list(self._frames(arrived_s))

    def _take(self, topic: str, message: Any) -> None:
        kind, name = self._kinds[topic], topic.split("/")[1]
        for reading in decoded(topic, kind, 0, message):
            if isinstance(reading, GridReading) and self._node is None:
                self._prior_map = reading.as_map()
                self._node = self._made(self._prior_map)
            elif isinstance(reading, ScanReading):
                self._take_scan(self._heard[name], reading, abs(message.angle_max - message.angle_min))
            elif isinstance(reading, PoseReading):
                self._take_pose(reading, name)

    def leave_out(self, why: str, details: str = "", arrived_s: float | None = None) -> None:
        """Count what cannot be taken; once a minute there is a line of it in ``warnings``."""
        self._now_s = self._now_s if arrived_s is None else arrived_s
        self.dropped[why] += 1
        if self._now_s - self._warned_s.get(why, -math.inf) >= WARN_EVERY_S:
            self._warned_s[why] = self._now_s
            said = f"{why}: {details}" if details else why
            self.warnings.append(f"{in_words(said)} ({self.dropped[why]} left out so far)")

    @property
    def waits_for(self) -> str:
        """What has to come before there is a frame, in words; empty if that is nothing but time."""
        if self._node is None:
            return f"a map on {MAP_TOPIC}"
        for name, heard in self._heard.items():
            if heard.first_ns is None:
                return f"scans on /{name}/scan"
            if self._place(heard) is None:
                frame = in_words(heard.scans[0].frame) if heard.scans else f"the laser of {name}"
                if self._options.pose_by_tf:
                    return f"transforms from {MAP} to {frame}, on {TF} and {TF_STATIC}"
                return f"where {frame} sits on its robot, on {TF_STATIC}; or give --mount"
        return ""

    def _made(self, prior_map: OccupancyGrid) -> DetectorNode:
        settings = self._options.settings_of(prior_map.resolution)
        return DetectorNode(settings, prior_map, len(self._heard))

    def _take_scan(self, heard: _Heard, scan: ScanReading, said_rad: float) -> None:
        """``said_rad``: from its first to its last beam, as the message has it."""
        if not len(scan.ranges_m):
            self.leave_out("scans have no range at all")
            return
        try:
            geometry_of(scan.geometry(), len(scan.ranges_m), AT_ORIGIN, False)
        except InputError as error:
            self.leave_out("scans of a LiDAR that cannot be", f"{scan.topic} {error}")
            return
        if not scan.range_min_m < scan.range_max_m:
            self.leave_out("scans have no range between range_min and range_max", scan.topic)
        elif heard.has_odd_sweep(scan, said_rad):
            self.leave_out("scans have another number of beams than those before", scan.topic)
        else:
            is_time, latest_ns = self._clocks.take(scan.topic, scan.stamp_ns, self._now_s)
            self._forget_future(heard, latest_ns)
            if is_time:
                self._queue(heard, scan)
            else:
                self.leave_out(_NO_TIME, f"{scan.topic}, {scan.stamp_ns / NS:.3f} s")

    def _queue(self, heard: _Heard, scan: ScanReading) -> None:
        stamps = [one.stamp_ns for one in heard.scans]
        place = bisect.bisect_left(stamps, scan.stamp_ns)
        is_there = scan.stamp_ns in stamps[place : place + 1]
        if is_there and np.isnan(heard.scans[place].ranges_m).all():
            del heard.scans[place]  # it says nothing
        elif is_there or scan.stamp_ns <= self._made_until_ns:
            self.leave_out("scans came late, or their stamps go back", scan.topic)
            return
        heard.first_ns = scan.stamp_ns if heard.first_ns is None else min(heard.first_ns, scan.stamp_ns)
        heard.newest_ns = max(heard.newest_ns, scan.stamp_ns)
        heard.frame = heard.frame if heard.placed else scan.frame
        heard.scans.insert(place, scan)
        del heard.scans[:-KEPT]
        if not self._arrived or scan.stamp_ns > self._arrived[-1][0]:
            self._arrived.append((scan.stamp_ns, self._now_s))

    def _forget_future(self, heard: _Heard, limit_ns: float) -> None:
        """Take back scans that came before it was clear that their stamps were no times, and their frames."""
        if heard.newest_ns <= limit_ns:
            return
        heard.forget_after(round(limit_ns))
        self._arrived = deque([one for one in self._arrived if one[0] <= limit_ns], self._arrived.maxlen)
        if self._made_until_ns > limit_ns:  # the clock was set back: what was detected is of no time
            self._made_until_ns = -1
            self._node = self._made(self._prior_map) if self._prior_map is not None else None
        until_ns = self._made_until_ns
        self._next = None if until_ns < 0 else math.floor(until_ns * self._options.rate_hz / NS) + 1

    def _take_pose(self, reading: PoseReading, name: str) -> None:
        """Take a pose of a topic, or a link of tf."""
        topic, is_tf = reading.topic, reading.topic in (TF, TF_STATIC)
        if not reading.transform.is_pose:
            self.leave_out("poses are no poses", f"{topic}: not finite, too far off, or no rotation")
            return
        if is_tf and reading.child not in self._links and len(self._links) == MOST_FRAMES:
            self.leave_out(f"transforms of more than {MOST_FRAMES} frames")
            return
        if topic == TF_STATIC:
            self._links[reading.child] = (reading.frame, reading.transform.normalized())
            return
        track: Transform | PoseTrack = PoseTrack()
        if is_tf:
            _, track = self._links.setdefault(reading.child, (reading.frame, track))
        else:
            track = self._heard[name].poses
        if isinstance(track, Transform):
            return
        clock = f"{TF} {reading.child}" if is_tf else topic
        is_time, latest_ns = self._clocks.take(clock, reading.stamp_ns, self._now_s)
        track.forget_after(latest_ns)
        if is_time:
            track.take(reading.stamp_ns, reading)
            track.forget(reading.stamp_ns - WAITED_NS)
        else:
            self.leave_out(_NO_TIME, f"{topic}, {reading.stamp_ns / NS:.3f} s")

    def _counted(self) -> list[str]:
        """Clocks of the robots: of tf those of frames that lead to a LiDAR, as anyone may add more."""
        if not self._options.pose_by_tf:
            return [f"/{name}/{each}" for name in self._heard for each in ("scan", "pose")]
        found = [f"/{name}/scan" for name in self._heard]
        for frame in dict.fromkeys(heard.frame for heard in self._heard.values()):
            found += [f"{TF} {below}" for below, _, _ in self._above(frame)]
        return found

    def _above(self, frame: str) -> Iterator[tuple[str, str, Transform | PoseTrack]]:
        """The frames below and above each link and the link, from a frame upwards; of a circle some twice."""
        for _ in range(len(self._links)):
            if frame not in self._links:
                return
            below, (frame, link) = frame, self._links[frame]
            yield below, frame, link

    def _place(self, heard: _Heard) -> _Placed | None:
        """Where the LiDAR of a robot is mounted and moves; None before its first scan and its transforms."""
        for frame in dict.fromkeys(scan.frame for scan in heard.scans):
            if heard.placed is None:
                heard.placed, heard.frame = self._placed(heard, frame), frame
        return heard.placed

    def _placed(self, heard: _Heard, frame: str) -> _Placed | None:
        options, fixed, base = self._options, NO_MOTION, frame
        for _, above, link in self._above(frame):
            if not isinstance(link, Transform):
                break
            base, fixed = above, link.then(fixed)
        tracks = self._chain(base) if options.pose_by_tf else [heard.poses]
        if not tracks or (base == frame and options.mount is None and not options.pose_by_tf):
            return None
        mount = options.mount or Pose2D(fixed.x, fixed.y, fixed.yaw)
        return _Placed(PoseInterpolator(tracks), mount, fixed.is_upside_down)

    def _chain(self, frame: str) -> list[PoseTrack | Pose2D]:
        """The links from the map down to a frame; empty until all are known."""
        links: list[PoseTrack | Pose2D] = []
        for _, above, link in self._above(frame):
            links.append(link if isinstance(link, PoseTrack) else Pose2D(link.x, link.y, link.yaw))
            if above == MAP:
                return links[::-1]
        return []

    def _frames(self, now_s: float) -> Iterator[Detected]:
        team = list(self._heard.values())
        if self._node is None or not self._arrived:
            return
        if self._next is None:
            first = [heard.first_ns for heard in team if heard.first_ns is not None]
            is_early = now_s - self._arrived[0][1] < self._options.patience_s
            if not first or (is_early and len(first) < len(team)):
                return
            self._next = self._after(max(first))
        while (due_ns := round(self._next * NS / self._options.rate_hz)) <= self._arrived[-1][0]:
            while self._arrived[0][0] < due_ns:
                self._arrived.popleft()
            is_over = now_s - self._arrived[0][1] >= self._options.patience_s
            if not is_over and not all(self._is_complete(heard, due_ns) for heard in team):
                return
            pending = [heard.scans[0].stamp_ns for heard in team if heard.scans]
            if pending and min(pending) > due_ns:
                self._next = max(self._next + 1, self._after(min(pending)))
                continue
            yield self._frame(self._node, due_ns)
            self._made_until_ns = due_ns
            self._next += 1

    def _after(self, stamp_ns: int) -> int:
        """The number of the first frame that is not before an instant."""
        return math.ceil(stamp_ns * self._options.rate_hz / NS)

    def _is_complete(self, heard: _Heard, due_ns: int) -> bool:
        """Whether all that a robot says up to an instant has come."""
        placed = self._place(heard)
        return placed is not None and heard.newest_ns >= due_ns and placed.where.is_known_at(due_ns)

    def _frame(self, node: DetectorNode, due_ns: int) -> Detected:
        names, observations = [], []
        for robot, (name, heard) in enumerate(self._heard.items()):
            placed = self._place(heard)
            while heard.scans and heard.scans[0].stamp_ns <= due_ns:
                self._observe(node, robot, placed, heard.scans.pop(0))
            estimate = None if placed is None else placed.where.latest(due_ns)
            if placed is not None:
                placed.where.forget(due_ns)
            if estimate is not None:  # a robot without a pose could not be removed as an ally
                names.append(name)
                observations.append(
                    Observation(estimate.pose, node.costmaps[robot].published(), node.scans[robot])
                )
        frame = node.detect(observations, due_ns / NS)
        return Detected(due_ns, frame.detections, [names[robot] for robot in frame.robots])

    def _observe(self, node: DetectorNode, robot: int, placed: _Placed | None, scan: ScanReading) -> None:
        estimate = None if placed is None else placed.where.at(scan.stamp_ns)
        if placed is None or estimate is None or estimate.age_s > self._options.patience_s:
            self.leave_out("scans have no pose near their time", scan.topic)
            return
        said = NoReturn({}, {**PLAIN, **self._options.no_return}, math.inf)
        ranges_m = said.cleaned(scan)
        if np.isnan(ranges_m).all():
            self.leave_out("scans say nothing: each range is nan, or as good as that", scan.topic)
            return
        try:
            lidar = geometry_of(scan.geometry(), len(ranges_m), placed.mount, placed.is_upside_down)
            node.observe(robot, estimate.pose, ranges_m, lidar, scan.stamp_ns / NS)
        except InputError as error:
            self.leave_out("scans cannot be taken", f"{scan.topic}: {error}")
