"""Scans as both kinds of SLAM take them: what rays they are, and what cells the rays pass."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, directions
from midnet_bench.messages import LidarGeometry


class ScanRays(NamedTuple):
    """What a scan says, as rays from the sensor."""

    ends_m: npt.NDArray[np.float64]
    """(B, 2) ends of the rays in the sensor frame"""
    hits: int
    """how many of them, from the first on, end at an obstacle; the others only clear"""


def scan_rays(geometry: LidarGeometry, ranges_m: npt.NDArray[np.float64], usable_m: float) -> ScanRays:
    """The rays of a scan: first those that hit something nearer than ``usable_m``, then those that clear.

    GMapping's rule (``registerScan``): a return below ``usable_m`` clears and hits; one from there up to the
    sensor's largest range (0.01 m less, as slam_gmapping sets it) clears up to ``usable_m``. Not a number,
    0, anything below the sensor's least range and a finite return beyond its largest say nothing.
    Infinity means "nothing within range" (REP 117) and clears up to ``usable_m``; GMapping drops it,
    and then never clears open space.

    Args:
        geometry: of the sensor; one convention of beam angles for matching and drawing (GMapping has two,
            half a beam apart).
        ranges_m: (B,) as the sensor reported them.
        usable_m: ``maxUrange``.
    """
    largest_m = geometry.range_max_m - 0.01
    usable_m = min(usable_m, largest_m)
    angles = geometry.angles_rad
    valid = (ranges_m >= geometry.range_min_m) & (ranges_m > 0.0)
    hit = valid & (ranges_m < usable_m)
    clear = valid & ~hit & ((ranges_m <= largest_m) | np.isposinf(ranges_m))
    lengths = np.concatenate([ranges_m[hit], np.full(np.count_nonzero(clear), usable_m)])
    ends = lengths[:, None] * directions(np.concatenate([angles[hit], angles[clear]]))
    return ScanRays(ends, int(np.count_nonzero(hit)))


@njit
def trace_rays(
    pose: npt.NDArray[np.float64], ends: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """((M, 2) column and row of each cell that rays visit before their end cells, (B, 2) x, y of their ends).

    Args:
        pose: (3,) of the sensor, cells and radians.
        ends: (B, 2) of the rays in the sensor frame, cells.
    """
    placed = np.empty_like(ends)
    cos, sin = cos_sin(pose[2])
    column, row = math.floor(pose[0]), math.floor(pose[1])
    count = 0
    for b in range(ends.shape[0]):
        placed[b, 0] = pose[0] + cos * ends[b, 0] - sin * ends[b, 1]
        placed[b, 1] = pose[1] + sin * ends[b, 0] + cos * ends[b, 1]
        count += max(abs(math.floor(placed[b, 0]) - column), abs(math.floor(placed[b, 1]) - row))
    cells = np.empty((count, 2), dtype=np.int64)
    count = 0
    for b in range(ends.shape[0]):
        count += trace_line(column, row, math.floor(placed[b, 0]), math.floor(placed[b, 1]), cells[count:])
    return cells, placed


@njit
def trace_line(column: int, row: int, end_column: int, end_row: int, cells: npt.NDArray[np.int64]) -> int:
    """How many cells Bresenham's line visits before its end cell; ``cells[:count]`` holds them.

    As GMapping draws it (``gridlinetraversal.h``): where a line passes midway between two cells it takes
    another one than costmap_2d's, which ``navigation.costmap.line_steps`` walks, in a third of all lines.
    """
    dx, dy = abs(end_column - column), abs(end_row - row)
    step_x = 1 if end_column > column else -1
    step_y = 1 if end_row > row else -1
    error = dx - dy
    count = max(dx, dy)
    for k in range(count):
        cells[k, 0] = column
        cells[k, 1] = row
        twice = 2 * error
        if twice > -dy:
            error -= dy
            column += step_x
        if twice < dx:
            error += dx
            row += step_y
    return count
