"""A detector over messages as they come in: scans, poses, transforms and a map, of ROS 1 or ROS 2.

A ROS node subscribes, hands each message to a ``LiveNode`` and publishes what comes back. Messages are known
by their fields, which have the same names in rosbags and in rclpy.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from midnet_bench.assembly.detector_node import DetectorNode, DetectorSettings
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.recording.files.no_return import CODES, Meaning, NoReturn
from midnet_bench.recording.files.readings import (
    KINDS,
    NO_MOTION,
    NS,
    GridReading,
    PoseReading,
    ScanReading,
    Topic,
    Transform,
    decoded,
)
from midnet_bench.recording.files.ros_messages import MAP, Message, detections, ros_name
from midnet_bench.recording.poses import PoseInterpolator, PoseTrack
from midnet_bench.recording.replay import geometry_of

MAP_TOPIC, TF, TF_STATIC = "/map", "/tf", "/tf_static"
KEPT = 1000
"""scans of a robot that wait for what they need, at most"""
PLAIN: dict[str, Meaning] = {code: "clears" if code in ("inf", "above") else "nothing" for code in CODES}
"""meaning of readings without a return, unless set"""


@dataclass(frozen=True)
class LiveOptions:
    """Options of a node."""

    robots: Sequence[str]
    """their names, in the order of the team"""
    settings_of: Callable[[float], DetectorSettings]
    """what to detect by, on a map of so many metres per cell"""
    pose_by_tf: bool = False
    """whether poses are taken from tf, not from ``/NAME/pose``"""
    mount: Pose2D | None = None
    """of every LiDAR on its robot; None: as tf says"""
    no_return: Mapping[str, Meaning] = field(default_factory=dict)
    """what a code of ``no_return.CODES`` says, where that is not as in :data:`PLAIN`"""
    rate_hz: float = 5.0
    """frames a second"""
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
        for option, value in (("rate", self.rate_hz), ("patience", self.patience_s)):
            if not 0.0 < value < math.inf:
                raise InputError(f"--{option}: {value:g} is out of range; allowed: above 0")

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
    boxes: list[Box]
    """map frame, metres"""
    found_by: list[str]
    """the robot that found each box"""

    @property
    def message(self) -> Message:
        """As it is published."""
        return detections(self.stamp_ns, self.boxes, self.found_by)


class _Placed(NamedTuple):
    """Where a robot's LiDAR is."""

    where: PoseInterpolator
    """of the robot"""
    mount: Pose2D
    is_upside_down: bool


@dataclass
class _Heard:
    """Of one robot."""

    poses: PoseTrack = field(default_factory=PoseTrack)
    """of its own topic"""
    scans: deque[ScanReading] = field(default_factory=lambda: deque(maxlen=KEPT))
    """those that are in no costmap yet"""
    first_ns: int | None = None
    """stamp of the first scan"""
    newest_ns: int = -1
    """stamp of the last one"""
    placed: _Placed | None = None


class LiveNode:
    """Frames at the multiples of a period of the stamps' clock.

    When messages arrive does not matter, within the patience: a frame is made once each robot has sent a scan
    and a pose of that instant or later. It has the scans up to then, each taken with the pose of its own
    stamp, and each robot's latest pose. There is none without a scan since the last one.
    """

    def __init__(self, options: LiveOptions, prior_map: OccupancyGrid | None) -> None:
        """``prior_map``: int8; None: the first message on ``/map``, which all others wait for."""
        self._options = options
        self._heard = {name: _Heard() for name in options.robots}
        self._kinds = options.topics(needs_map=True)
        self._links: dict[str, tuple[str, Transform | PoseTrack]] = {}
        """frame -> its parent frame, and its place there: fixed, or over time"""
        self._arrived: deque[tuple[int, float]] = deque()
        """each scan that was newer than all before: its stamp, and when it came"""
        self._next: int | None = None
        self._made_until_ns = -1
        self._node = None if prior_map is None else self._made(prior_map)
        self.dropped: dict[str, int] = {}
        """why -> scans that were not taken"""

    def hear(self, topic: str, message: Any, arrived_s: float) -> list[Detected]:
        """The frames that can be made after one more message, in order.

        Args:
            topic: of ``LiveOptions.topics``.
            message: of the type that is named there.
            arrived_s: when it came, by a clock that never goes back.

        Raises:
            InputError: the map is turned or has no cells.
        """
        kind, name = self._kinds[topic], topic.split("/")[1]
        for reading in decoded(Topic(topic, kind, 0, KINDS[kind]), 0, message):
            if isinstance(reading, GridReading):
                self._node = self._node or self._made(reading.as_map())
            elif isinstance(reading, ScanReading):
                self._take_scan(self._heard[name], reading, arrived_s)
            elif isinstance(reading, PoseReading) and topic in (TF, TF_STATIC):
                self._take_link(reading, topic == TF_STATIC)
            elif isinstance(reading, PoseReading):
                self._heard[name].poses.take(reading.stamp_ns, reading)
        return list(self._frames(arrived_s))

    @property
    def waits_for(self) -> str:
        """What has to come before there is a frame, in words; empty if that is nothing but time."""
        if self._node is None:
            return f"a map on {MAP_TOPIC}"
        for name, heard in self._heard.items():
            if heard.first_ns is None:
                return f"scans on /{name}/scan"
            if self._place(heard) is None:
                frame = heard.scans[0].frame
                if self._options.pose_by_tf:
                    return f"transforms from {MAP} to {frame}, on {TF} and {TF_STATIC}"
                return f"where {frame} sits on its robot, on {TF_STATIC}; or give --mount"
        return ""

    def _made(self, prior_map: OccupancyGrid) -> DetectorNode:
        settings = self._options.settings_of(prior_map.resolution)
        return DetectorNode(settings, prior_map, len(self._heard))

    def _take_scan(self, heard: _Heard, scan: ScanReading, arrived_s: float) -> None:
        if not len(scan.ranges_m):
            self._drop("they have no range at all")
            return
        if scan.stamp_ns <= max(heard.newest_ns, self._made_until_ns):
            self._drop("they came late, or their stamps go back")
            return
        heard.first_ns = scan.stamp_ns if heard.first_ns is None else heard.first_ns
        heard.newest_ns = scan.stamp_ns
        heard.scans.append(scan)
        if not self._arrived or scan.stamp_ns > self._arrived[-1][0]:
            self._arrived.append((scan.stamp_ns, arrived_s))

    def _take_link(self, link: PoseReading, is_static: bool) -> None:
        if not link.transform.is_finite:
            return
        if is_static:
            self._links[link.child] = (link.frame, link.transform.normalized())
            return
        _, track = self._links.setdefault(link.child, (link.frame, PoseTrack()))
        if isinstance(track, PoseTrack):
            track.take(link.stamp_ns, link)

    def _place(self, heard: _Heard) -> _Placed | None:
        """Where the LiDAR of a robot is mounted and moves; None before its first scan and its transforms."""
        if heard.placed is not None or not heard.scans:
            return heard.placed
        options, frame = self._options, heard.scans[0].frame
        fixed = NO_MOTION
        base = frame
        for _ in self._links:  # a circle of them has no end
            above, link = self._links.get(base, ("", None))
            if not isinstance(link, Transform):
                break
            base, fixed = above, link.then(fixed)
        tracks: list[PoseTrack | Pose2D] = [heard.poses]
        if options.pose_by_tf:
            tracks = self._chain(base)
        if not tracks or (base == frame and options.mount is None and not options.pose_by_tf):
            return None
        mount = options.mount or Pose2D(fixed.x, fixed.y, fixed.yaw)
        where = PoseInterpolator(tracks)
        heard.placed = _Placed(where, mount, fixed.is_upside_down)
        return heard.placed

    def _chain(self, frame: str) -> list[PoseTrack | Pose2D]:
        """The links from the map down to a frame; empty until all are known."""
        links: list[PoseTrack | Pose2D] = []
        while frame != MAP:
            if frame not in self._links or len(links) > len(self._links):
                return []
            frame, link = self._links[frame]
            links.append(link if isinstance(link, PoseTrack) else Pose2D(link.x, link.y, link.yaw))
        return links[::-1]

    def _frames(self, now_s: float) -> Iterator[Detected]:
        team = list(self._heard.values())
        if self._node is None or not self._arrived:
            return
        if self._next is None:
            first = [heard.first_ns for heard in team if heard.first_ns is not None]
            if len(first) < len(team) and now_s - self._arrived[0][1] < self._options.patience_s:
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
                self._observe(node, robot, placed, heard.scans.popleft())
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
            self._drop("no pose is near their time")
            return
        said = NoReturn({}, {**PLAIN, **self._options.no_return}, math.inf)
        try:
            lidar = geometry_of(scan.geometry(), len(scan.ranges_m), placed.mount, placed.is_upside_down)
            node.observe(robot, estimate.pose, said.cleaned(scan), lidar, scan.stamp_ns / NS)
        except InputError as error:
            self._drop(str(error))

    def _drop(self, why: str) -> None:
        self.dropped[why] = self.dropped.get(why, 0) + 1
