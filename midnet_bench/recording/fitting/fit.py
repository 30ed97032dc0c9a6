"""How well scans lie on a map: the share of their returns on its walls."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OCCUPIED_FROM, UNKNOWN, OccupancyGrid, values_at
from midnet_bench.messages import LidarGeometry
from midnet_bench.recording.poses import PoseTrack

Floats = npt.NDArray[np.float64]

ON_WALL_M, ON_WALL_CELLS = 0.1, 1.5
"""A return this near to a mapped wall lies on it: the larger of the two counts."""

WALL_DEPTH_M = 0.2
"""Occupied cells further than this from any other are what lies behind a wall, not the wall."""


class Sample(NamedTuple):
    """One scan of a robot, and where the robot was at about that time."""

    time_ns: int
    """of the scan, by the clock of the poses"""
    ranges_m: Floats
    """(beams,) metres; inf where nothing was met, NaN where the reading says nothing"""
    lidar: LidarGeometry
    """its mount is what is believed so far"""
    track: PoseTrack
    """the robot's poses from a little before to a little after the scan, map frame"""

    @property
    def pose(self) -> Pose2D:
        """Of the robot at the scan's time, map frame."""
        return Pose2D(*self.track.at_times(np.array([self.time_ns]))[0].tolist())

    def ends(self) -> tuple[npt.NDArray[np.int64], Floats]:
        """(n,) the beams that met something within the sensor's limits, and (n, 2) where, sensor frame."""
        lidar = self.lidar
        met = np.isfinite(self.ranges_m) & (self.ranges_m > 0.0)
        met &= (self.ranges_m >= lidar.range_min_m) & (self.ranges_m <= lidar.range_max_m)
        beams = np.flatnonzero(met)
        return beams, lidar.directions[beams] * self.ranges_m[beams, None]


class Walls:
    """The distance to the nearest wall of a map, everywhere on it."""

    def __init__(self, grid: OccupancyGrid) -> None:
        """``grid``: int8, -1 unknown, 65 and more occupied, map frame. Raises InputError without a wall."""
        occupied = grid.data >= OCCUPIED_FROM
        if not occupied.any():
            raise InputError("map: no cell of it is occupied; a map with walls is needed")
        self.grid = grid
        self.near_m = max(ON_WALL_M, ON_WALL_CELLS * grid.resolution)
        """a return at most this far from a wall lies on it"""
        # around the map too: a moved scan may lie beyond its edge
        margin = math.ceil(1.0 / grid.resolution)
        solid = np.pad(occupied.view(np.uint8), margin)
        # where all behind a wall is drawn solid, nothing ends a beam there
        depth = 2 * math.ceil(WALL_DEPTH_M / grid.resolution) + 1
        wall = solid - cv2.erode(solid, np.ones((depth, depth), np.uint8))
        to_wall = cv2.distanceTransform(1 - wall, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self.distances_m = to_wall * np.float32(grid.resolution)
        """float32 (H, W), from a cell's centre to that of the nearest occupied one of a wall; a metre of
        margin all around"""
        x, y = grid.origin
        self.corner = (x - margin * grid.resolution, y - margin * grid.resolution)
        """(x, y) of the first cell's outer corner, metres"""
        self.far_m = float(self.distances_m.max()) + 1.0
        """the distance of points off the field"""

    def distances(self, points: Floats) -> Floats:
        """(n,) metres from (n, 2) points of the map frame to the nearest wall, as their cells have it."""
        rows, columns = self.distances_m.shape
        column, row = (
            np.floor((points[:, k] - self.corner[k]) / self.grid.resolution).astype(np.int64) for k in (0, 1)
        )
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        found = np.full(len(points), self.far_m)
        found[inside] = self.distances_m[row[inside], column[inside]]
        return found

    def on_walls(self, points: Floats) -> npt.NDArray[np.bool_]:
        """(n,) whether each of (n, 2) points of the map frame lies on a mapped wall."""
        return np.asarray(self.distances(points) <= self.near_m)

    def unmapped(self, points: Floats) -> npt.NDArray[np.bool_]:
        """(n,) whether each of (n, 2) points lies outside the map or in a cell that it does not know."""
        return np.asarray(values_at(self.grid.data, self.grid, points, UNKNOWN) == UNKNOWN)


class Shares(NamedTuple):
    """Where returns lie."""

    returns: int
    on_walls: float
    """share that lies on mapped walls, 0 to 1; NaN without a return"""
    unmapped: float
    """share that lies on no wall and outside the map or in unknown cells"""

    @property
    def in_the_free(self) -> float:
        """The rest: what lies where the map says that nothing is."""
        return 1.0 - self.on_walls - self.unmapped


class Fit(NamedTuple):
    """How the scans of a recording lie on a map."""

    total: Shares
    """of all returns"""
    robot_off_map: float
    """share of the samples in which the robot itself is outside the map or in a cell that it does not know"""


def fit_of(samples: Sequence[Sample], walls: Walls) -> Fit:
    """How the scans lie on the walls as everything is set now."""
    off = returns = on = unknown = 0
    for sample in samples:
        pose = sample.pose
        points = pose.compose(sample.lidar.mount).transform(sample.ends()[1])
        on_walls = walls.on_walls(points)
        returns, on = returns + len(points), on + int(on_walls.sum())
        unknown += int((walls.unmapped(points) & ~on_walls).sum())
        off += bool(walls.unmapped(np.array([pose[:2]]))[0])
    return Fit(_shares(returns, on, unknown), off / len(samples) if samples else math.nan)


def _shares(returns: int, on_walls: int, unmapped: int) -> Shares:
    if returns == 0:
        return Shares(0, math.nan, math.nan)
    return Shares(returns, on_walls / returns, unmapped / returns)
