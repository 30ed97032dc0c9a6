"""Ray counting: how often each cell was hit and how often a beam went through it, from known poses.

That is all that a map needs where poses are known, or a laser stands still (the counting model of occupancy
grids; GMapping keeps the same two numbers). It also separates stationary from moving objects.
"""

import math

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import Scan
from midnet_bench.navigation.costmap import line_steps

Counts = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]

MOST_CELLS = 25_000_000
"""as many as a map may have: 250 by 250 m at 5 cm"""
MARGIN_CELLS = 64
"""by which the grid grows beyond what it has to hold"""
SEEN_TWICE = 2
"""a cell that was hit less often is no wall, whatever its share"""
STAYS_S, STAYS_OF_ALL, STAYS_SHARE = 4.0, 0.5, 0.5
"""what is hit so many seconds long, or that part of a shorter recording, by that share of beams, stays put"""


class RayCounts:
    """Hits, passes, and the times of the first and last hit of each cell; the grid grows as it must."""

    def __init__(
        self, resolution_m: float, origin: tuple[float, float] = (0.0, 0.0), shape: tuple[int, int] = (1, 1)
    ) -> None:
        """``shape``: (rows, columns) to begin with; cells lie on the lattice of ``origin``."""
        self.resolution_m = resolution_m
        self.origin = origin
        self.hits: Counts = np.zeros(shape, np.int32)
        self.passes: Counts = np.zeros(shape, np.int32)
        self.first_s = np.full(shape, np.inf, np.float32)
        self.last_s = np.full(shape, -np.inf, np.float32)
        self.began_s: float | None = None
        self.newest_s: float | None = None

    def take(self, scan: Scan, points: Floats, range_m: float = math.inf) -> None:
        """Count one scan's returns, (n, 2) metres, up to ``range_m``, and the way to them.

        Raises:
            InputError: they lie too far off for any map; nothing is counted then.
        """
        sensor = scan.pose.compose(scan.lidar.mount)
        if range_m < scan.lidar.range_max_m:
            points = points[np.hypot(points[:, 0] - sensor.x, points[:, 1] - sensor.y) <= range_m]
        if not len(points):
            return
        self._hold(np.minimum(points.min(axis=0), sensor[:2]), np.maximum(points.max(axis=0), sensor[:2]))
        if self.began_s is None:
            self.began_s = scan.stamp_s
        self.newest_s = scan.stamp_s
        cells = np.floor((points - self.origin) / self.resolution_m).astype(np.int64)
        column, row = (math.floor((sensor[axis] - self.origin[axis]) / self.resolution_m) for axis in (0, 1))
        since_s = np.float32(scan.stamp_s - self.began_s)
        count_rays(self.hits, self.passes, self.first_s, self.last_s, column, row, cells, since_s)

    def _hold(self, low: Floats, high: Floats) -> None:
        """Grow until two corners, metres, lie inside."""
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise InputError("ray counts: a return lies nowhere; poses and ranges must be finite")
        rows, columns = self.hits.shape
        first = np.floor((low - self.origin) / self.resolution_m).astype(np.int64)
        last = np.floor((high - self.origin) / self.resolution_m).astype(np.int64)
        left, below = (max(-int(first[axis]) + MARGIN_CELLS, 0) if first[axis] < 0 else 0 for axis in (0, 1))
        right = int(last[0]) - columns + 1 + MARGIN_CELLS if last[0] >= columns else 0
        above = int(last[1]) - rows + 1 + MARGIN_CELLS if last[1] >= rows else 0
        if not (left or below or right or above):
            return
        if (rows + below + above) * (columns + left + right) > MOST_CELLS:
            wide_m = self.resolution_m * max(columns + left + right, rows + below + above)
            raise InputError(
                f"ray counts: returns {wide_m:.0f} m "
                "apart need a map that is too large; are the poses in metres?"
            )
        around = ((below, above), (left, right))
        self.hits, self.passes = np.pad(self.hits, around), np.pad(self.passes, around)
        self.first_s = np.pad(self.first_s, around, constant_values=np.inf)
        self.last_s = np.pad(self.last_s, around, constant_values=-np.inf)
        self.origin = (
            self.origin[0] - left * self.resolution_m,
            self.origin[1] - below * self.resolution_m,
        )

    def shares(self) -> npt.NDArray[np.float64]:
        """(rows, columns) hits of all that met the cell or went through it; 0 where nothing did."""
        seen = self.hits + self.passes
        return np.asarray(self.hits / np.maximum(seen, 1))

    def map(self, hit_threshold: float) -> OccupancyGrid:
        """int8: 100 where at least that share of the beams ended, 0 where fewer did, -1 where none came."""
        cells = np.full(self.hits.shape, -1, np.int8)
        cells[self.hits + self.passes > 0] = 0
        cells[(self.shares() >= hit_threshold) & (self.hits >= SEEN_TWICE)] = 100
        return OccupancyGrid(cells, self.resolution_m, self.origin)

    def stays(self) -> npt.NDArray[np.bool_]:
        """(rows, columns) cells that hold what stays put, walls among them."""
        if self.began_s is None or self.newest_s is None:
            return np.zeros(self.hits.shape, np.bool_)
        least_s = min(STAYS_S, STAYS_OF_ALL * (self.newest_s - self.began_s))
        spans = self.last_s - self.first_s
        often = (self.shares() >= STAYS_SHARE) & (self.hits > SEEN_TWICE)
        return np.asarray(often & (spans >= least_s) & (spans > 0.0))

    def near_what_stays(self) -> npt.NDArray[np.bool_]:
        """The same with the cells beside them."""
        return np.asarray(cv2.dilate(self.stays().astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)

    def newest_hit_s(self, corner: tuple[float, float], opposite: tuple[float, float]) -> float:
        """When a cell of a rectangle was hit last, seconds of the scans' clock; -inf if never."""
        (x0, y0), (x1, y1) = (
            (
                math.floor((x - self.origin[0]) / self.resolution_m),
                math.floor((y - self.origin[1]) / self.resolution_m),
            )
            for x, y in (corner, opposite)
        )
        part = self.last_s[max(y0, 0) : max(y1 + 1, 0), max(x0, 0) : max(x1 + 1, 0)]
        return float(part.max(initial=-np.inf)) + (self.began_s or 0.0)


@njit
def count_rays(
    hits: Counts,
    passes: Counts,
    first_s: npt.NDArray[np.float32],
    last_s: npt.NDArray[np.float32],
    column: int,
    row: int,
    ends: npt.NDArray[np.int64],
    time_s: np.float32,
) -> None:
    """Add one scan: a pass for each cell before an end, a hit for the end; all lie on the grid.

    Args:
        hits: (rows, columns), as are the next three.
        passes: see above.
        first_s: time of the first hit.
        last_s: time of the last hit.
        column: of the sensor's cell.
        row: of the sensor's cell.
        ends: (n, 2) columns and rows.
        time_s: of the scan.
    """
    width = hits.shape[1]
    flat_hits, flat_passes = hits.reshape(-1), passes.reshape(-1)
    flat_first, flat_last = first_s.reshape(-1), last_s.reshape(-1)
    for k in range(len(ends)):
        dx, dy = ends[k, 0] - column, ends[k, 1] - row
        along, across, step_along, step_across = line_steps(dx, dy, width)
        place, error = row * width + column, along // 2
        for _ in range(along):
            flat_passes[place] += 1
            place += step_along
            error += across
            if error >= along:
                place += step_across
                error -= along
        flat_hits[place] += 1
        flat_first[place] = min(flat_first[place], time_s)
        flat_last[place] = max(flat_last[place], time_s)
