"""``localize``: the poses of a recording, corrected by matching its scans to the map."""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from midnet_bench.geometry import Floats, Pose2D, Scan, wrap_angle
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, cells_of, cells_to_unset
from midnet_bench.localization.scan_to_map import MIN_SHARE_RECORDED, ScanToMap
from midnet_bench.recording.fitting.fit import Walls

THICKEST_M = 0.3  # a wall that is drawn thicker is solid: its face is where it is
ON_WALL_M = 0.15  # returns this near to a wall show how thick the walls of a match are
SLIPPED, USUAL = 11.3, 7.8
"""A match whose squared Mahalanobis distance is above the first (99 % of the chi-square distribution of three
values) says that the motion slipped: the pose is doubted by as much as it exceeds the second (95 %)."""


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
        near = self._walls.distances(ends) < ON_WALL_M
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
