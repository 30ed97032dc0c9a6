"""Ray counting: how often each cell was hit and how often a beam went through it; what is not on the map.

That is all that a map needs where poses are known, or a laser stands still (the counting model of occupancy
grids; GMapping keeps the same two numbers). It also separates stationary from moving objects.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Scan
from midnet_bench.grid import FAR_CELLS, OccupancyGrid
from midnet_bench.midnet.detection import FREE
from midnet_bench.navigation.costmap import line_steps
from midnet_bench.recording.files.readings import MOST_CELLS

Counts = npt.NDArray[np.int32]

MARGIN_CELLS = 64  # by which the grid grows beyond what it has to hold
SEEN_TWICE = 2  # a cell that was hit less often is no wall, whatever its share
STAYS_S, STAYS_OF_ALL, STAYS_SHARE = 4.0, 0.5, 0.5
"""what is hit so many seconds long, or that part of a shorter recording, by that share of beams, stays put"""


class RayCounts:
    """Hits, passes, and the times of the first and last hit of each cell; the grid grows as it must."""

    def __init__(
        self, resolution_m: float, origin: tuple[float, float] = (0.0, 0.0), shape: tuple[int, int] = (1, 1)
    ) -> None:
        """``shape``: (rows, columns) to begin with; cells lie on the lattice of ``origin``."""
        self.resolution_m, self.origin = resolution_m, origin
        self.hits: Counts = np.zeros(shape, np.int32)
        self.passes: Counts = np.zeros(shape, np.int32)
        self.first_s = np.full(shape, np.inf, np.float32)
        self.last_s = np.full(shape, -np.inf, np.float32)
        self.began_s: float | None = None
        self.newest_s = 0.0

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
        self._hold(np.concatenate((points, [sensor[:2]])))
        self.began_s = scan.stamp_s if self.began_s is None else self.began_s
        self.newest_s = scan.stamp_s
        column, row = self._cells(np.array(sensor[:2])).tolist()
        since_s, cells = np.float32(scan.stamp_s - self.began_s), self._cells(points)
        count_rays(self.hits, self.passes, self.first_s, self.last_s, column, row, cells, since_s)

    def _cells(self, points: Floats) -> npt.NDArray[np.int64]:
        """(..., 2) column and row of each of (..., 2) points."""
        return np.asarray(np.floor((points - self.origin) / self.resolution_m).astype(np.int64))

    def _hold(self, points: Floats) -> None:
        """Grow until all points, metres, lie inside."""
        if not np.isfinite(points).all():
            raise InputError("ray counts: a return lies nowhere; poses and ranges must be finite")
        rows, columns = self.hits.shape
        first = self._cells(points[-1])
        if self.began_s is None and (rows, columns) == (1, 1) and np.abs(first).max() > FAR_CELLS:
            x, y = (self.origin + first * self.resolution_m).tolist()
            self.origin = x, y
        low, high = self._cells(points.min(axis=0)), self._cells(points.max(axis=0)) - (columns - 1, rows - 1)
        left, below = np.where(low < 0, MARGIN_CELLS - low, 0).tolist()
        right, above = np.where(high > 0, MARGIN_CELLS + high, 0).tolist()
        rows, columns = rows + below + above, columns + left + right
        if (rows, columns) == self.hits.shape:
            return
        if rows * columns > MOST_CELLS:
            raise InputError(
                f"ray counts: returns {self.resolution_m * max(columns, rows):.0f} m apart need a map that "
                "is too large; are the poses in metres?"
            )
        around = ((below, above), (left, right))
        self.hits, self.passes = np.pad(self.hits, around), np.pad(self.passes, around)
        self.first_s = np.pad(self.first_s, around, constant_values=np.inf)
        self.last_s = np.pad(self.last_s, around, constant_values=-np.inf)
        x, y = self.origin
        self.origin = x - left * self.resolution_m, y - below * self.resolution_m

    def shares(self) -> npt.NDArray[np.float64]:
        """(rows, columns) hits of all that met the cell or went through it; 0 where nothing did."""
        return np.asarray(self.hits / np.maximum(self.hits + self.passes, 1))

    def map(self, hit_threshold: float) -> OccupancyGrid:
        """int8: 100 where at least that share of the beams ended, 0 where fewer did, -1 where none came."""
        cells = np.where(self.hits + self.passes > 0, np.int8(0), np.int8(-1))
        cells[(self.shares() >= hit_threshold) & (self.hits >= SEEN_TWICE)] = 100
        return OccupancyGrid(cells, self.resolution_m, self.origin)

    def stays(self) -> npt.NDArray[np.bool_]:
        """(rows, columns) cells that hold what stays put, walls among them."""
        least_s = min(STAYS_S, STAYS_OF_ALL * (self.newest_s - (self.began_s or 0.0)))
        spans = self.last_s - self.first_s
        often = (self.shares() >= STAYS_SHARE) & (self.hits > SEEN_TWICE)
        return np.asarray(often & (spans >= least_s) & (spans > 0.0))

    def newest_hit_s(self, corner: tuple[float, float], opposite: tuple[float, float]) -> float:
        """When a cell of a rectangle was hit last, seconds of the scans' clock; -inf if never."""
        (x0, y0), (x1, y1) = self._cells(np.array((corner, opposite))).tolist()
        part = self.last_s[max(y0, 0) : max(y1 + 1, 0), max(x0, 0) : max(x1 + 1, 0)]
        return float(part.max(initial=-np.inf)) + (self.began_s or 0.0)


class Unmapped(NamedTuple):
    """One thing that stays put and is not on the map; map frame, metres, seconds of the scans' clock."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float
    cells: int
    hits: int
    first_s: float  # when it was hit first
    last_s: float


def unmapped(
    counts: RayCounts, prior_map: OccupancyGrid, prior: OccupancyGrid
) -> tuple[list[Unmapped], OccupancyGrid]:
    """What stays put off the map's inflated walls, and the map with its cells occupied.

    Args:
        counts: of the whole recording, on the map's lattice; they may reach beyond the map.
        prior_map: int8, 100 occupied.
        prior: the grid that is subtracted, uint8, 0 occupied.
    """
    cell_m, (x0, y0), began_s = prior_map.resolution, prior_map.origin, counts.began_s or 0.0
    column, row = (round((prior_map.origin[axis] - counts.origin[axis]) / cell_m) for axis in (0, 1))
    window = slice(row, row + prior_map.height), slice(column, column + prior_map.width)
    on_map = counts.stays()[window] & (prior.data == FREE)
    number, blobs = cv2.connectedComponents(dilated(on_map), connectivity=8)
    things = []
    for blob in range(1, number):
        rows, columns = at = np.nonzero(on_map & (blobs == blob))
        low = x0 + float(columns.min()) * cell_m, y0 + float(rows.min()) * cell_m
        high = x0 + float(columns.max() + 1) * cell_m, y0 + float(rows.max() + 1) * cell_m
        hits, first_s, last_s = (part[window][at] for part in (counts.hits, counts.first_s, counts.last_s))
        seen_s = began_s + float(first_s.min()), began_s + float(last_s.max())
        things.append(Unmapped(*low, *high, len(rows), int(hits.sum()), *seen_s))
    patched = np.where(on_map, np.int8(100), prior_map.data)
    return sorted(things, key=lambda thing: -thing.hits), prior_map.with_data(patched)


def dilated(cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.uint8]:
    """(rows, columns) the cells and those beside them."""
    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((3, 3), np.uint8)))


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
    """Add one scan: a pass for each cell from the sensor's to one of (n, 2) ends, a hit for the end."""
    width = hits.shape[1]
    flat_hits, flat_passes = hits.reshape(-1), passes.reshape(-1)
    flat_first, flat_last = first_s.reshape(-1), last_s.reshape(-1)
    for k in range(len(ends)):
        dx, dy = ends[k, 0] - column, ends[k, 1] - row
        along, across, step_along, step_across = line_steps(dx, dy, width)
        cell, error = row * width + column, along // 2
        for _ in range(along):
            flat_passes[cell] += 1
            cell += step_along
            error += across
            if error >= along:
                cell += step_across
                error -= along
        flat_hits[cell] += 1
        flat_first[cell] = min(flat_first[cell], time_s)
        flat_last[cell] = max(flat_last[cell], time_s)
