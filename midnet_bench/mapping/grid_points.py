"""From the cells of a grid to points in metres and back, a whole array at a time."""

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid

OCCUPIED_FROM = 65
"""Values of a map from here on are obstacles (map_server's occupied_thresh)."""

_SLACK = 1e-6
"""Of a cell: keeps a point that rounding moves off its cell's lower edge on that cell."""

ScalarT = TypeVar("ScalarT", bound=np.generic)


def cell_centres(grid: OccupancyGrid, cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """(N, 2) x, y of the centres of the set cells in the grid's frame, metres; rows first."""
    rows, columns = np.nonzero(cells)
    columns_rows = np.stack((columns, rows), axis=1).astype(np.float64)
    return (columns_rows + 0.5) * grid.resolution + grid.origin


def moved(points: npt.NDArray[np.float64], pose: Pose2D) -> npt.NDArray[np.float64]:
    """(N, 2) points that are given in the frame of ``pose``, in its parent frame."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + (pose.x, pose.y), dtype=np.float64)


def values_at(
    values: npt.NDArray[ScalarT], grid: OccupancyGrid, points: npt.NDArray[np.float64], outside: float
) -> npt.NDArray[ScalarT]:
    """(N,) of (H, W) ``values`` on the cells of ``grid`` at (N, 2) points; ``outside`` off the grid."""
    columns, rows = np.floor((points - grid.origin) / grid.resolution + _SLACK).astype(np.int64).T
    on_grid = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
    found = np.full(len(points), outside, dtype=values.dtype)
    found[on_grid] = values[rows[on_grid], columns[on_grid]]
    return found
