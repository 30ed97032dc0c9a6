"""How scans lie on a map: the share of their returns on its walls, and poses corrected by matching them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, LidarGeometry, Pose2D, Scan, wrap_angle
from midnet_bench.grid import OCCUPIED_FROM, UNKNOWN, OccupancyGrid, cells_of, cells_to_unset, values_at
from midnet_bench.localization.scan_to_map import MIN_SHARE_RECORDED, ScanToMap
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
THICKEST_M = 0.3  # a wall that is drawn thicker is solid: its face is where it is
NEAR_WALL_M = 0.15  # returns this near to a wall show how thick the walls of a match are
SLIPPED, USUAL = 11.3, 7.8
"""A match whose squared Mahalanobis distance is above the first (99 % of the chi-square distribution of three
values) says that the motion slipped: the pose is doubted by as much as it exceeds the second (95 %)."""


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


@dataclass(frozen=True)
class LocalizerSettings:
    """What is believed of the recorded poses and of the ranges: standard deviations, all our choice."""

    start_m: float = 0.05  # of the first recorded pose, along x and along y
    start_rad: float = math.radians(1.0)
    drift_m: float = 0.02  # of place that the recorded motion gains over a metre; grows with the way's root
    drift_rad: float = math.radians(1.0)  # the same of the yaw
    drift_rad_per_rad: float = 0.03  # the same over the first radian of a turn
    range_error: float = 0.03  # of what all ranges of a sensor are off by, as a share of them
    bias_lasts_m: float = 1.0  # way over which what a match is off by falls to a third
    every_m: float = 0.5  # a match is taken when the robot has moved so far since the last, as amcl does ...
    every_rad: float = 0.2  # ... or turned so far


class Localizer:
    """One robot's poses in the map, from its recorded motion and from its scans; it keeps no history.

    A Kalman filter: recorded poses, of odometry or motion capture, give the motion from scan to scan and
    where it began. ``PlanarUkf`` would hold the sideways velocity to 0, but the point that poses are recorded
    of need not lie on an axle.

    What is off in a match of ``ScanToMap`` is much the same in the next: walls are drawn too thick, ranges
    all short or all long. So three of the six states are the matches' own bias, which loses its hold as the
    robot moves on (a Gauss-Markov process): no number of matches makes a pose surer than the walls are.
    """

    def __init__(self, grid: OccupancyGrid, settings: LocalizerSettings | None = None) -> None:
        """``grid``: int8, map frame. Raises InputError: it has no wall."""
        self._settings = settings or LocalizerSettings()
        self._matcher, self._walls = ScanToMap(grid, MIN_SHARE_RECORDED), Walls(grid)
        self._thickness_m = _thickness(grid)
        self._recorded: Pose2D | None = None
        self._pose = Pose2D(0.0, 0.0, 0.0)
        self._bias = np.zeros(3)
        start = self._settings.start_m, self._settings.start_m, self._settings.start_rad
        self._covariance = np.diag(np.square((*start, 0.0, 0.0, 0.0)))
        self._is_biased = False
        self._moved_m = self._turned_rad = math.inf

    @property
    def covariance(self) -> Floats:
        """(3, 3) a copy: of x, y, yaw of the last corrected pose, metres and radians, squared."""
        return self._covariance[:3, :3].copy()

    def corrected(self, scan: Scan) -> Pose2D:
        """The robot's pose at a scan, map frame, yaw in [-pi, pi); scans come in order of time.

        ``scan.pose`` is the recorded one. A scan of which too little lies on walls corrects nothing.
        """
        self._predict(scan.pose)
        settings = self._settings
        if self._moved_m >= settings.every_m or self._turned_rad >= settings.every_rad:
            self._correct(scan)
        return self._pose._replace(yaw=wrap_angle(self._pose.yaw))

    def _predict(self, recorded: Pose2D) -> None:
        before, self._recorded = self._recorded, recorded
        if before is None:
            self._pose = recorded
            return
        step, settings = recorded.relative_to(before), self._settings
        there = self._pose.compose(step)
        turning = np.eye(6)
        turning[0, 2], turning[1, 2] = self._pose.y - there.y, there.x - self._pose.x
        moved_m, turned_rad = math.hypot(step.x, step.y), abs(step.yaw)
        place = settings.drift_m**2 * moved_m
        heading = settings.drift_rad**2 * moved_m + settings.drift_rad_per_rad**2 * turned_rad
        noise = np.diag((place, place, heading, 0.0, 0.0, 0.0))
        turned = turning @ self._covariance @ turning.T
        self._covariance = 0.5 * (turned + turned.T) + noise
        self._pose = there
        self._moved_m += moved_m
        self._turned_rad += turned_rad

    def _correct(self, scan: Scan) -> None:
        found = self._matcher.match(self._pose, scan.ranges_m, scan.lidar)
        if found is None:
            return
        matched, noise = found
        self._let_bias_change(self._bias_covariance(scan._replace(pose=matched)))
        self._moved_m = self._turned_rad = 0.0
        x, y, yaw = self._pose
        off = np.array([matched.x - x, matched.y - y, wrap_angle(matched.yaw - yaw)]) - self._bias
        # a match is the pose and its bias
        common = self._covariance[:, :3] + self._covariance[:, 3:]
        expected = common[:3] + common[3:] + noise
        distance2 = float(off @ np.linalg.solve(expected, off))
        if distance2 > SLIPPED:
            self._covariance[:3, :3] *= distance2 / USUAL
            common = self._covariance[:, :3] + self._covariance[:, 3:]
            expected = common[:3] + common[3:] + noise
        gain = np.linalg.solve(expected, common.T).T
        change = gain @ off
        after = self._covariance - gain @ common.T
        self._covariance = 0.5 * (after + after.T)
        self._pose = Pose2D(*(self._pose + change[:3]).tolist())
        self._bias = self._bias + change[3:]

    def _let_bias_change(self, bias_covariance: Floats) -> None:
        """The bias since the last match: the less of it is left, the further the robot has moved."""
        left = math.exp(-self._moved_m / self._settings.bias_lasts_m) if self._is_biased else 0.0
        self._is_biased = True
        self._bias = left * self._bias
        self._covariance[:, 3:] *= left
        self._covariance[3:, :] *= left
        self._covariance[3:, 3:] += (1.0 - left * left) * bias_covariance

    def _bias_covariance(self, scan: Scan) -> Floats:
        """(3, 3) covariance of a match's bias: thickness of the walls, scale of the ranges."""
        beams, ends = scan.returns(math.inf)
        near = self._walls.distances(ends) < NEAR_WALL_M
        ranges_m = scan.ranges_m[beams[near]]
        if not len(ranges_m):
            return np.zeros((3, 3))
        grid = self._walls.grid
        columns, rows = np.clip(cells_of(grid, ends[near]), 0, (grid.width - 1, grid.height - 1)).T
        thickness_m = float(self._thickness_m[rows, columns].mean())
        squared_range_m2 = float(np.square(ranges_m).mean())
        # evenly within the wall's thickness; ranges that are all too short move a pose and do not turn it
        wall = thickness_m * thickness_m / 12.0
        place = wall + self._settings.range_error**2 * squared_range_m2
        return np.diag((place, place, wall / squared_range_m2))


def _thickness(grid: OccupancyGrid) -> Floats:
    """(H, W) how thick the walls about each cell are drawn, metres: one cell at least; 0 for solid ones."""
    occupied = np.pad((grid.data >= OCCUPIED_FROM).view(np.uint8), 1)
    inner = cells_to_unset(occupied)
    reach = 2 * math.ceil(THICKEST_M / 2.0 / grid.resolution) + 1
    deepest = cv2.dilate(inner, np.ones((reach, reach), np.uint8))[1:-1, 1:-1]
    thickness_m = np.maximum(2.0 * deepest.astype(np.float64) - 1.0, 1.0) * grid.resolution
    return np.where(thickness_m <= THICKEST_M, thickness_m, 0.0)
