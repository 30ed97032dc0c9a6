"""How well the scans of a recording lie on a map: the share of their returns on its walls."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, LidarGeometry, Pose2D
from midnet_bench.grid import OCCUPIED_FROM, UNKNOWN, OccupancyGrid, cells_to_unset, values_at
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.survey import spread
from midnet_bench.recording.plan import Link, Recorded, RobotPlan, geometry_of
from midnet_bench.recording.poses import PoseInterpolator, PoseTrack, stamp_ns
from midnet_bench.recording.setup import RecordingSetup

Points = npt.NDArray[np.complex128]
"""(n,) x + iy, metres: a turn is one product"""

ON_WALL_M, ON_WALL_CELLS = 0.075, 1.5
"""A return this near to a mapped wall lies on it: the larger of the two counts."""
WALL_DEPTH_M = 0.2
"""Occupied cells further than this from any other are what lies behind a wall, not the wall."""
REACH_S, STEP_S = 0.8, 0.04  # how far before and after a scan its robot's poses are sampled, and how densely


class Sample(NamedTuple):
    """One scan of a robot, and where the robot was at about that time."""

    time_ns: int  # of the scan, by the clock of the poses
    ranges_m: Floats  # (beams,) metres; inf where nothing was met, NaN where the reading says nothing
    lidar: LidarGeometry  # its mount is what is believed so far
    track: PoseTrack  # the robot's poses from a little before to a little after the scan, map frame

    @property
    def pose(self) -> Pose2D:
        """Of the robot at the scan's time, map frame."""
        return Pose2D(*self.track.at_times(np.array([self.time_ns]))[0].tolist())

    def ends(self) -> Floats:
        """(n, 2) where the beams ended that met something within the sensor's limits, sensor frame."""
        lidar = self.lidar
        met = np.isfinite(self.ranges_m) & (self.ranges_m > 0.0)
        met &= (self.ranges_m >= lidar.range_min_m) & (self.ranges_m <= lidar.range_max_m)
        return np.asarray(lidar.directions[met] * self.ranges_m[met, None])


def samples_of(recorded: Recorded, robot: RobotPlan, setup: RecordingSetup, most: int = 120) -> list[Sample]:
    """At most so many scans of a robot that have a pose, spread over what was looked at."""
    links: list[PoseTrack | Pose2D] = []
    for link in robot.pose.links:
        if not isinstance(link, Link):
            links.append(link)
            continue
        links.append(track := PoseTrack())
        for reading in link.seen(recorded.surveys):
            track.take(stamp_ns(reading, setup.clock) + recorded.offsets_ns[link.source], reading)
    pose_of = PoseInterpolator(links)
    stream = recorded.surveys[robot.source].streams[robot.scan_topic]
    around_ns = (np.arange(-REACH_S, REACH_S + STEP_S / 2.0, STEP_S) * NS).astype(np.int64)
    samples = []
    for scan in spread([scan for scan in stream.scans if len(scan.ranges_m)], most):
        time_ns = stamp_ns(scan, setup.clock) + recorded.offsets_ns[robot.source] - robot.delay_ns
        estimate = pose_of.at(time_ns)
        if estimate is None or estimate.age_s > setup.max_pose_age_s:
            continue
        numbers = scan.geometry(robot.no_return.range_max_m)
        try:
            lidar = geometry_of(numbers, len(scan.ranges_m), robot.mount, robot.is_mirrored)
        except InputError:
            continue  # the replay says so
        track = PoseTrack()
        for near_ns in (time_ns + around_ns).tolist():
            near = pose_of.at(near_ns)
            if near is not None and near.age_s <= setup.max_pose_age_s:
                track.add(near_ns, near.pose)
        samples.append(Sample(time_ns, robot.no_return.cleaned(scan), lidar, track))
    return samples


class Walls:
    """The distance to the nearest wall of a map, everywhere on it and a metre around: a likelihood field."""

    def __init__(self, grid: OccupancyGrid) -> None:
        """``grid``: int8, -1 unknown, 65 and more occupied, map frame. Raises InputError without a wall."""
        occupied = grid.data >= OCCUPIED_FROM
        if not occupied.any():
            raise InputError("map: no cell of it is occupied; a map with walls is needed")
        self.grid = grid
        self.near_m = max(ON_WALL_M, ON_WALL_CELLS * grid.resolution)
        """a return at most this far from a wall lies on it"""
        margin = math.ceil(1.0 / grid.resolution)
        solid = np.pad(occupied.view(np.uint8), margin)
        # where all behind a wall is drawn solid, nothing ends a beam there
        depth = 2 * math.ceil(WALL_DEPTH_M / grid.resolution) + 1
        wall = solid - cv2.erode(solid, np.ones((depth, depth), np.uint8))
        self.distances_m = cells_to_unset(1 - wall).astype(np.float64) * grid.resolution
        """(H, W), from a cell's centre to that of the nearest occupied one of a wall"""
        self.first_center = grid.center_of(-margin, -margin)

    def distances(self, points: Floats) -> Floats:
        """(n,) metres from (n, 2) points of the map frame to the nearest wall."""
        return self.read(points)[0]

    def read(self, points: Floats) -> tuple[Floats, Points]:
        """The same and (n,) its slope along x and y as x + iy, both read between the centres of four cells.

        A point beyond the margin has the distance of the margin's nearest cell.
        """
        columns, cell_m = self.distances_m.shape[1], self.grid.resolution
        # short of the last centres, so that each point has cells to its right and above
        last = np.array(self.distances_m.shape[::-1]) - 1.001
        at = np.clip((points - self.first_center) / cell_m, 0.0, last)
        cells = at.astype(np.int64)
        (x, y), first = (at - cells).T, cells @ (1, columns)
        to_corners = 0, 1, columns, columns + 1
        low, right, high, high_right = (self.distances_m.take(first + to) for to in to_corners)
        low_rise, high_rise = right - low, high_right - high
        low, high = low + x * low_rise, high + x * high_rise
        slopes = low_rise + y * (high_rise - low_rise) + 1j * (high - low)
        return low + y * (high - low), slopes / cell_m

    def unmapped(self, points: Floats) -> npt.NDArray[np.bool_]:
        """(n,) whether each of (n, 2) points lies outside the map or in a cell that it does not know."""
        return np.asarray(values_at(self.grid.data, self.grid, points, UNKNOWN) == UNKNOWN)


class Fit(NamedTuple):
    """How the scans of a recording lie on a map; shares are 0 to 1, NaN without a return or sample."""

    returns: int
    on_walls: float  # share of the returns that lies on mapped walls
    unmapped: float  # share that lies on no wall and outside the map or in unknown cells
    robot_off_map: float
    """share of the samples in which the robot itself is outside the map or in a cell that it does not know"""

    @property
    def in_the_free(self) -> float:
        """The rest: what lies where the map says that nothing is."""
        return 1.0 - self.on_walls - self.unmapped


def fit_of(samples: Sequence[Sample], walls: Walls) -> Fit:
    """How the scans lie on the walls as everything is set now."""
    ends = [one.pose.compose(one.lidar.mount).transform(one.ends()) for one in samples]
    points = np.concatenate([np.empty((0, 2)), *ends])
    robots = np.array([sample.pose for sample in samples]).reshape(-1, 3)[:, :2]
    on_walls = walls.distances(points) <= walls.near_m
    kinds = on_walls, walls.unmapped(points) & ~on_walls, walls.unmapped(robots)
    return Fit(len(points), *(float(np.mean(kind)) if len(kind) else math.nan for kind in kinds))
