"""What GMapping and graph SLAM share: which scans are due, the map along a trajectory, the trajectory."""

import math
from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import LidarGeometry, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.trajectory import Trajectory
from midnet_bench.mapping.scans import ScanRays, VisitMap


class GridSlam(ABC):
    """SLAM that keeps its scans and draws a grid of them at its newest estimate of their poses."""

    _SLACK = (0.0, 0.0)
    """a scan that moved by no more, metres and radians, stays where it is drawn"""

    def __init__(
        self,
        geometry: LidarGeometry,
        update: tuple[float, float, float | None],
        resolution_m: float,
        occupied_threshold: float,
    ) -> None:
        """No scan yet.

        Args:
            geometry: of the sensor and its mount.
            update: a scan is integrated after a drive of so many metres, a turn by so many radians, or after
                so many seconds; None: time alone is no reason.
            resolution_m: side of a cell of the map.
            occupied_threshold: cells hit in more than this share of their visits are occupied.
        """
        self.geometry = geometry
        self.scores: list[float] = []
        """How well each integrated scan fitted the map then, 0 to 1; NaN where there was nothing to fit."""
        self._stamps_s: list[float] = []
        self._scans: list[ScanRays] = []
        self._update = update
        self._driven_m = self._turned_rad = 0.0
        self._is_next_due = False
        self._way_m = 0.0
        """driven between the last two scans that were integrated"""
        self._resolution_m, self._occupied_threshold = resolution_m, occupied_threshold
        self._visit_map = VisitMap(resolution_m)
        self._drawn = np.empty((0, 3))
        """the poses at which scans are drawn"""

    @abstractmethod
    def process(self, odometry_pose: Pose2D, ranges_m: npt.NDArray[np.float64], time_s: float) -> bool:
        """Take a scan; True if it was integrated, False if the robot had not moved or waited enough.

        Args:
            odometry_pose: the robot's base in the odometry frame when the scan was taken.
            ranges_m: (beams,) metres.
            time_s: when the scan was taken, seconds.
        """

    def take_next(self) -> None:
        """Integrate the next scan, however little the robot has moved until then."""
        self._is_next_due = True

    @property
    @abstractmethod
    def best_pose(self) -> Pose2D:
        """The robot's base in the map frame, by all scans and the odometry since the last one."""

    @abstractmethod
    def _sensor_poses(self) -> npt.NDArray[np.float64]:
        """(N, 3) where the sensor was at each integrated scan, map frame, metres and radians."""

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot's base was at each integrated scan, map frame."""
        poses = [self._base_pose(pose) for pose in self._sensor_poses()]
        return Trajectory(np.array(self._stamps_s), np.array(poses, dtype=np.float64).reshape(-1, 3))

    def occupancy(self, anew: bool = False) -> OccupancyGrid:
        """The map along the trajectory: int8, 100 occupied, 0 free, -1 unknown.

        Only scans that moved since the last call are drawn again; ``anew`` draws all, so that not even a
        rounding at a cell's edge depends on how often the map was read before.
        """
        if anew:
            self._visit_map, self._drawn = VisitMap(self._resolution_m), np.empty((0, 3))
        poses, old = self._sensor_poses(), len(self._drawn)
        moved = np.abs(poses[:old] - self._drawn)
        again = (moved[:, :2].max(axis=1) > self._SLACK[0]) | (moved[:, 2] > self._SLACK[1])
        for k in map(int, np.flatnonzero(again)):
            self._visit_map.add(self._drawn[k], *self._scans[k], count=-1)
            self._visit_map.add(poses[k], *self._scans[k])
            self._drawn[k] = poses[k]
        for k in range(old, len(poses)):
            self._visit_map.add(poses[k], *self._scans[k])
        self._drawn = np.concatenate([self._drawn, poses[old:]])
        return self._visit_map.occupancy(self._occupied_threshold)

    def _is_due(self, step: Pose2D, time_s: float) -> bool:
        """Whether the scan at ``time_s``, ``step`` after the one before, is to be integrated."""
        self._driven_m += math.hypot(step.x, step.y)
        self._turned_rad += abs(step.yaw)
        linear_m, angular_rad, temporal_s = self._update
        due = self._is_next_due or not self._stamps_s
        due = due or self._driven_m >= linear_m or self._turned_rad >= angular_rad
        if not due and (temporal_s is None or time_s - self._stamps_s[-1] <= temporal_s):
            return False
        self._way_m = self._driven_m
        self._driven_m = self._turned_rad = 0.0
        self._is_next_due = False
        return True

    def _integrate(self, rays: ScanRays, time_s: float, score: float) -> None:
        self._scans.append(rays)
        self._stamps_s.append(time_s)
        self.scores.append(score)

    def _base_pose(self, sensor_pose: npt.NDArray[np.float64]) -> Pose2D:
        pose = Pose2D(*sensor_pose.tolist()).compose(self.geometry.mount.inverse())
        return pose._replace(yaw=wrap_angle(pose.yaw))
