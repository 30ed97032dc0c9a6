"""What both kinds of SLAM share: scans as rays, the map drawn of them, which are due, a climb of poses."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit, numba
from midnet_bench.elementary import cos_sin, directions
from midnet_bench.geometry import Floats, Indices, LidarGeometry, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.scan_logs import Trajectory

ArgsT = TypeVar("ArgsT")
Score = Callable[[ArgsT, Pose2D, float], float]
"""The score of a pose, or anything up to the third argument if it cannot get above that."""

ORIGIN = Pose2D(0.0, 0.0, 0.0)
_MOVES = ((1, 0, 0), (-1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1))
_MARGIN_CELLS = 64  # spare cells on each side when the map grows, so that it does not grow with every scan


# as it is for Python; compiled loops take it in with the loop that they give it to call
@numba().extending.register_jitable(inline="always")
def hill_climb(
    score: Score[ArgsT], args: ArgsT, start: Pose2D, linear_step: float, angular_step: float, halvings: int
) -> tuple[Pose2D, float]:
    """The best pose that a hill climb from ``start`` finds, and its score; ``score`` gets ``args`` first.

    Each round tries a step forth and back in x, y (any unit of length) and yaw (radians) and takes the best
    of the six if it beats the present score. A round that finds nothing halves both steps, ``halvings`` times
    at most.
    """
    pose, best = start, score(args, start, -math.inf)
    while True:
        round_pose, round_best = pose, best
        for dx, dy, turn in _MOVES:
            tried = Pose2D(
                pose.x + dx * linear_step, pose.y + dy * linear_step, pose.yaw + turn * angular_step
            )
            found = score(args, tried, round_best)
            if found > round_best:
                round_pose, round_best = tried, found
        if round_best > best:
            pose, best = round_pose, round_best
        elif halvings > 0:
            halvings -= 1
            linear_step *= 0.5
            angular_step *= 0.5
        else:
            return pose, best


@njit
def rotate(points: Floats, yaw: float) -> Floats:
    """(B, 2) points turned by ``yaw``, radians."""
    cos, sin = cos_sin(yaw)
    rotated = np.empty_like(points)
    for b in range(points.shape[0]):
        rotated[b, 0] = cos * points[b, 0] - sin * points[b, 1]
        rotated[b, 1] = sin * points[b, 0] + cos * points[b, 1]
    return rotated


class ScanRays(NamedTuple):
    """What a scan says, as rays from the sensor."""

    ends_m: Floats  # (B, 2) ends of the rays in the sensor frame
    hits: int  # how many of them, from the first on, end at an obstacle; the others only clear


def scan_rays(geometry: LidarGeometry, ranges_m: Floats, usable_m: float) -> ScanRays:
    """The rays of a scan: first those that hit something nearer than ``usable_m``, then those that clear.

    GMapping's rule (``registerScan``): a return below ``usable_m`` (its maxUrange) clears and hits; one from
    there up to the sensor's largest range (0.01 m less, as slam_gmapping sets it) clears up to ``usable_m``.
    Not a number, 0, and what lies below the least or above the largest range say nothing. Infinity means
    "nothing within range" (REP 117) and clears up to ``usable_m``; GMapping drops it, and so never clears
    open space. GMapping has two conventions of beam angles, half a beam apart; here there is one.
    """
    largest_m = geometry.range_max_m - 0.01
    usable_m = min(usable_m, largest_m)
    valid = (ranges_m >= geometry.range_min_m) & (ranges_m > 0.0)
    hit = valid & (ranges_m < usable_m)
    clear = valid & ~hit & ((ranges_m <= largest_m) | np.isposinf(ranges_m))
    lengths = np.concatenate([ranges_m[hit], np.full(np.count_nonzero(clear), usable_m)])
    angles = geometry.angles_rad
    ends = lengths[:, None] * directions(np.concatenate([angles[hit], angles[clear]]))
    return ScanRays(ends, int(np.count_nonzero(hit)))


@njit
def trace_rays(pose: Floats, ends: Floats) -> tuple[Indices, Floats]:
    """((M, 2) column and row of each cell that rays visit before their end cells, (B, 2) x, y of their ends).

    Bresenham's lines as GMapping draws them (``gridlinetraversal.h``): where a line passes midway between two
    cells it takes another one than costmap_2d's, which ``navigation.costmap`` draws, in a third of all lines.
    ``pose``: (3,) of the sensor, cells and radians; ``ends``: (B, 2) of the rays in its frame, cells.
    """
    placed = np.empty_like(ends)
    cos, sin = cos_sin(pose[2])
    first_column, first_row = math.floor(pose[0]), math.floor(pose[1])
    count = 0
    for b in range(ends.shape[0]):
        placed[b, 0] = pose[0] + cos * ends[b, 0] - sin * ends[b, 1]
        placed[b, 1] = pose[1] + sin * ends[b, 0] + cos * ends[b, 1]
        dx, dy = math.floor(placed[b, 0]) - first_column, math.floor(placed[b, 1]) - first_row
        count += max(abs(dx), abs(dy))
    cells = np.empty((count, 2), dtype=np.int64)
    count = 0
    for b in range(ends.shape[0]):
        column, row = first_column, first_row
        dx, dy = math.floor(placed[b, 0]) - column, math.floor(placed[b, 1]) - row
        step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
        dx, dy = abs(dx), abs(dy)
        error = dx - dy
        for _ in range(max(dx, dy)):
            cells[count, 0], cells[count, 1] = column, row
            count += 1
            twice = 2 * error
            if twice > -dy:
                error -= dy
                column += step_x
            if twice < dx:
                error += dx
                row += step_y
    return cells, placed


class VisitMap:
    """Hits and visits of traced scans; a scan can be taken back, which leaves no trace of it.

    Each cell on a ray before the last gets a visit, the last one a visit and a hit; a ray that only clears
    stops before its last cell (GMapping, ``computeActiveArea`` and ``registerScan`` with generateMap).
    """

    def __init__(self, resolution_m: float) -> None:
        self.resolution_m = resolution_m
        self._origin_cells = np.zeros(2, dtype=np.int64)
        self._counts = np.zeros((2, 0, 0), dtype=np.int32)  # hits and visits

    def add(self, pose: Floats, ends_m: Floats, hits: int, count: int = 1) -> None:
        """Trace the rays of a scan from the sensor's pose (3,), metres and radians.

        ``count``: 1; -1 takes back a scan that was added with the same arguments.
        """
        if len(ends_m) == 0:
            return
        reach_m = math.sqrt(float(np.square(ends_m).sum(axis=1).max()))
        self._grow(pose[:2] - reach_m, pose[:2] + reach_m)
        cells = pose.copy()
        cells[:2] = pose[:2] / self.resolution_m - self._origin_cells
        _count(self._counts, cells, ends_m / self.resolution_m, hits, count)

    def occupancy(self, occupied_threshold: float) -> OccupancyGrid:
        """int8 grid of what is known: 100 where hits / visits exceeds the threshold, 0 elsewhere, -1 unknown.

        As large as the known cells; its origin is the corner of cell (0, 0), a multiple of the resolution
        (GMapping publishes that cell's centre, half a cell off the convention).
        """
        rows, columns = (np.flatnonzero(self._counts[1].any(axis=axis)) for axis in (1, 0))
        if len(rows) == 0:
            return OccupancyGrid(np.zeros((0, 0), dtype=np.int8), self.resolution_m, (0.0, 0.0))
        hits, visits = self._counts[:, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        data = np.where(hits > occupied_threshold * visits, 100, 0)
        data[visits == 0] = -1
        first = self._origin_cells + np.array([columns[0], rows[0]])
        x, y = (first * self.resolution_m).tolist()
        return OccupancyGrid(data.astype(np.int8), self.resolution_m, (x, y))

    def _grow(self, low_m: Floats, high_m: Floats) -> None:
        low = np.floor(low_m / self.resolution_m).astype(np.int64) - 1
        high = np.floor(high_m / self.resolution_m).astype(np.int64) + 2
        if self._counts.size == 0:
            self._origin_cells = low.copy()
        before = self._origin_cells - low
        after = high - self._origin_cells - self._counts.shape[:0:-1]
        before, after = (np.where(cells > 0, cells + _MARGIN_CELLS, 0) for cells in (before, after))
        if before.any() or after.any():
            self._counts = np.pad(self._counts, ((0, 0), (before[1], after[1]), (before[0], after[0])))
            self._origin_cells = self._origin_cells - before


@njit
def _count(counts: npt.NDArray[np.int32], pose: Floats, ends: Floats, hits: int, count: int) -> None:
    """Add ``count`` (1 or -1) to the hits and visits of the cells on a scan's rays; all lengths in cells."""
    cells, placed = trace_rays(pose, ends)
    for k in range(cells.shape[0]):
        counts[1, cells[k, 1], cells[k, 0]] += count
    for b in range(hits):
        column, row = math.floor(placed[b, 0]), math.floor(placed[b, 1])
        counts[0, row, column] += count
        counts[1, row, column] += count


class GridSlam(ABC):
    """SLAM that keeps its scans and draws a grid of them at its newest estimate of their poses."""

    _SLACK = (0.0, 0.0)  # a scan that moved by no more, metres and radians, stays where it is drawn

    def __init__(
        self,
        geometry: LidarGeometry,
        usable_m: float,
        update: tuple[float, float, float | None],
        resolution_m: float,
        occupied_threshold: float,
    ) -> None:
        """No scan yet.

        Returns nearer than ``usable_m`` hit; cells of ``resolution_m`` hit in more than the share
        ``occupied_threshold`` of their visits are occupied. ``update``: a scan is integrated after a drive of
        so many metres, a turn by so many radians, or after so many seconds; None: time alone is no reason.
        """
        self.geometry = geometry
        self.scores: list[float] = []
        """How well each integrated scan fitted the map then, 0 to 1; NaN where there was nothing to fit."""
        self._stamps_s: list[float] = []
        self._scans: list[ScanRays] = []
        self._usable_m, self._update = usable_m, update
        self._driven_m = self._turned_rad = 0.0
        self._is_next_due = True
        self._way_m = 0.0  # driven between the last two scans that were integrated
        self._resolution_m, self._occupied_threshold = resolution_m, occupied_threshold
        self._visit_map = VisitMap(resolution_m)
        self._drawn = np.empty((0, 3))  # the poses at which scans are drawn

    def process(self, odometry_pose: Pose2D, ranges_m: Floats, time_s: float) -> bool:
        """Take a scan; True if it was integrated, False if the robot had not moved or waited enough.

        ``odometry_pose``: the robot's base in the odometry frame then; ``ranges_m``: (beams,) metres.
        """
        if ranges_m.shape != (self.geometry.beams,):
            raise ValueError(f"a scan of shape {ranges_m.shape} from a sensor of {self.geometry.beams} beams")
        step = self._move(odometry_pose)
        self._driven_m += math.hypot(step.x, step.y)
        self._turned_rad += abs(step.yaw)
        linear_m, angular_rad, temporal_s = self._update
        is_due = self._is_next_due or self._driven_m >= linear_m or self._turned_rad >= angular_rad
        if not is_due and (temporal_s is None or time_s - self._stamps_s[-1] <= temporal_s):
            return False
        self._way_m = self._driven_m
        self._driven_m = self._turned_rad = 0.0
        self._is_next_due = False
        rays = scan_rays(self.geometry, ranges_m, self._usable_m)
        self._integrate(rays)
        self._scans.append(rays)
        self._stamps_s.append(time_s)
        return True

    def take_next(self) -> None:
        """Integrate the next scan, however little the robot has moved until then."""
        self._is_next_due = True

    @property
    @abstractmethod
    def best_pose(self) -> Pose2D:
        """The robot's base in the map frame, by all scans and the odometry since the last one."""

    @abstractmethod
    def _move(self, odometry_pose: Pose2D) -> Pose2D:
        """Go by newer odometry; the step since the last one, none for the first."""

    @abstractmethod
    def _integrate(self, rays: ScanRays) -> None:
        """Take a scan into the estimate, and its score into ``scores``."""

    @abstractmethod
    def _sensor_poses(self) -> Floats:
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

    def _base_pose(self, sensor_pose: Floats) -> Pose2D:
        pose = Pose2D(*sensor_pose.tolist()).compose(self.geometry.mount.inverse())
        return pose._replace(yaw=wrap_angle(pose.yaw))
