"""A room drawn by hand, drives through it with scans cast by hand, and the shared recordings as samples."""

import dataclasses
import math
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import Sample
from midnet_bench.recording.poses import PoseTrack
from midnet_bench.rng import stream

CELL_M = 0.05
MOUNT = Pose2D(0.1, 0.02, 0.05)
BARE = Pose2D(0.0, 0.0, 0.0)
RECORDINGS = Path(__file__).parents[3] / "shared" / "data" / "recordings"


def rectangle(x0, y0, x1, y1):
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


WALLS = np.array(
    rectangle(0.0, 0.0, 8.0, 6.0)
    + rectangle(3.0, 0.0, 3.2, 2.2)
    + rectangle(5.4, 3.5, 5.6, 6.0)
    + rectangle(1.5, 4.0, 2.1, 4.5)
    + rectangle(6.5, 1.2, 7.0, 2.4)
)
"""of a room of 8 by 6 m with four things in it: x and y of both ends of each wall"""
WAYPOINTS = [(2.2, 3.2), (4.2, 3.0), (4.3, 1.2), (5.8, 1.0), (5.8, 2.8), (7.2, 3.0), (7.0, 5.0)]


def room():
    """The map of that room, whose walls lie in the middle of their cells."""
    origin = (-1.0 - CELL_M / 2.0, -1.0 - CELL_M / 2.0)
    data = np.zeros((round(8.0 / CELL_M), round(10.0 / CELL_M)), dtype=np.int8)
    for x0, y0, x1, y1 in WALLS:
        along = np.linspace(0.0, 1.0, 2000)
        columns = ((x0 + along * (x1 - x0) - origin[0]) / CELL_M).astype(int)
        rows = ((y0 + along * (y1 - y0) - origin[1]) / CELL_M).astype(int)
        data[rows, columns] = 100
    return OccupancyGrid(data, CELL_M, origin)


def moved(grid, x, y):
    return OccupancyGrid(grid.data, grid.resolution, (grid.origin[0] + x, grid.origin[1] + y))


def cast(sensor, angles, discs=(), walls=WALLS):
    """(beams,) to the first wall or disc (x, y, radius) along each angle of the sensor, inf where none is."""
    heading = sensor.yaw + angles
    ways = np.stack((np.cos(heading), np.sin(heading)), axis=1)[:, None]
    begin, along = walls[:, :2] - sensor[:2], walls[:, 2:] - walls[:, :2]
    cross = ways[..., 0] * along[:, 1] - ways[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        ranges = (begin[:, 0] * along[:, 1] - begin[:, 1] * along[:, 0]) / cross
        share = (begin[:, 0] * ways[..., 1] - begin[:, 1] * ways[..., 0]) / cross
    met = (share >= 0.0) & (share <= 1.0) & (ranges > 0.0)
    found = np.where(met, ranges, np.inf).min(axis=1)
    for x, y, radius_m in discs:
        x, y = x - sensor.x, y - sensor.y
        ahead = ways[:, 0, 0] * x + ways[:, 0, 1] * y
        aside = radius_m**2 - (x * x + y * y - ahead * ahead)
        hit = (aside > 0.0) & (ahead > 0.0)
        found[hit] = np.minimum(found[hit], (ahead - np.sqrt(np.maximum(aside, 0.0)))[hit])
    return found


@dataclasses.dataclass(frozen=True)
class Way:
    """Poses of a drive."""

    times_s: np.ndarray
    poses: np.ndarray

    def at(self, time_s):
        """The pose at an instant, each number by itself."""
        return Pose2D(*(float(np.interp(time_s, self.times_s, column)) for column in self._columns))

    @cached_property
    def _columns(self):
        return [*self.poses[:, :2].T, np.unwrap(self.poses[:, 2])]

    def near(self, time_s):
        """The recorded poses from a second before an instant to a second after it."""
        track = PoseTrack()
        first, last = np.searchsorted(self.times_s, (time_s - 1.0, time_s + 1.0))
        for k in range(max(first - 1, 0), min(last + 1, len(self.times_s))):
            track.add(round(self.times_s[k] * NS), Pose2D(*self.poses[k].tolist()))
        return track


@lru_cache
def way(kind, seconds):
    """The poses of a robot at 50 Hz: one that turns at waypoints, drives straight, or is at rest."""
    x, y, yaw = (0.6, 3.0, 0.2) if kind == "straight" else (1.0, 1.0, 0.6)
    times_s, poses, reached = np.arange(0.0, seconds, 0.02), [], 0
    for _ in times_s:
        poses.append((x, y, yaw))
        to_x, to_y = WAYPOINTS[reached % len(WAYPOINTS)]
        if math.hypot(to_x - x, to_y - y) < 0.2:
            reached += 1
        off = (math.atan2(to_y - y, to_x - x) - yaw + math.pi) % (2.0 * math.pi) - math.pi
        turn = min(max(2.0 * off, -0.6), 0.6) if kind == "turns" else 0.0
        speed = {"turns": 0.22 * max(0.0, math.cos(off)), "straight": 0.22, "rest": 0.0}[kind]
        x, y = x + 0.02 * speed * math.cos(yaw), y + 0.02 * speed * math.sin(yaw)
        yaw += 0.02 * turn
    return Way(times_s, np.array(poses))


def drive(kind="turns", delay_s=0.0, mount=MOUNT, mirrored=False, beams=360, view=2.0 * math.pi, range_m=8.0):
    """Samples of a drive at 3 Hz; ``mount`` and ``mirrored`` are the truth, the samples say bare and not."""
    track = way(kind, {"turns": 30.0, "straight": 18.0, "rest": 8.0}[kind])
    lidar = LidarGeometry(beams, -view / 2.0, view / beams, 0.12, range_m, BARE)
    angles, rng = lidar.angles_rad * (-1.0 if mirrored else 1.0), stream(1, "scans")
    samples = []
    for time_s in np.arange(1.0, track.times_s[-1] - 1.0, 1.0 / 3.0):
        ranges_m = cast(track.at(time_s).compose(mount), angles) + rng.normal(0.0, 0.01, len(angles))
        ranges_m = np.where(ranges_m < range_m, ranges_m, np.inf)
        samples.append(Sample(round((time_s + delay_s) * NS), ranges_m, lidar, track.near(time_s)))
    return samples


def mounted(samples, mount):
    """The same with the mount set to this."""
    return [each._replace(lidar=dataclasses.replace(each.lidar, mount=mount)) for each in samples]


@lru_cache
def recorded(name):
    """(times, (n, beams) ranges, the geometry on the true mount, the poses) of a shared recording.

    By the times at which the bag recorded them, as its truth goes by.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    times_s, scans, poses = [], [], []
    with AnyReader(
        [RECORDINGS / name / f"{name}.bag"], default_typestore=get_typestore(Stores.ROS1_NOETIC)
    ) as bag:
        topics = [each for each in bag.connections if each.topic in ("/scan", "/ego_pose")]
        for topic, time_ns, raw in bag.messages(connections=topics):
            message = bag.deserialize(raw, topic.msgtype)
            if topic.topic == "/scan":
                times_s.append(time_ns * 1e-9)
                scans.append(np.array(message.ranges, dtype=np.float64))
                last = message
            else:
                at, turn = message.pose.position, message.pose.orientation
                yaw = math.atan2(
                    2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)
                )
                poses.append((time_ns * 1e-9, at.x, at.y, yaw))
    lidar = LidarGeometry(
        len(last.ranges), last.angle_min, last.angle_increment, last.range_min, last.range_max, TRUE_MOUNT
    )
    table = np.array(poses)
    return np.array(times_s), np.array(scans), lidar, Way(table[:, 0], table[:, 1:])


TRUE_MOUNT = Pose2D(-0.153, 0.021, 0.0065)  # of the shared recordings, as their meta.yaml has it


def recorded_samples(name):
    """The samples of a shared recording."""
    times_s, scans, lidar, track = recorded(name)
    return [
        Sample(round(float(time_s) * NS), ranges_m, lidar, track.near(time_s))
        for time_s, ranges_m in zip(times_s, scans, strict=True)
    ]
