"""Grids of square cells over the plane, and the way from cells to metres and back."""

import math
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import CELL_SLACK, cell_along

FREE, UNKNOWN, OCCUPIED = 0, -1, 100  # Values of an int8 occupancy grid (nav_msgs/OccupancyGrid).
OCCUPIED_FROM = 65  # Values of a map from here on are obstacles (map_server's occupied_thresh).

RESOLUTION_TOLERANCE = 1e-4
"""Share by which two resolutions may differ and be the same: 32 bits, as messages have them, round 0.05 by
2e-8 of it; the six decimals of a saved map round 1/30 by 1e-5, and 1 cm or more by 5e-5. A thousand cells are
then a tenth of a cell longer than they say, and no sizes of cells in use lie so near to each other."""
_BITS_32 = math.ldexp(1.0, -24)  # share by which 32 bits round

FAR_CELLS = 2000
"""From the map frame's origin, along x or y: a map that grows begins there, or at its first scan if that is
further off, as in a log in UTM. All between would take gigabytes; nearer, it does not weigh."""

ScalarT = TypeVar("ScalarT", bound=np.generic)


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A grid whose row 0 has the lowest y and whose column 0 has the lowest x.

    ``data[row, column]`` is what the holder says it is: published costs (int8, -1 unknown, 0 to 100)
    or a binary grid (uint8, 0 occupied, 255 free or unknown; Eq. 1). ``origin`` is the lower-left
    *corner* of cell (0, 0), metres; there is no rotation: a file's is turned when it is read (item 18).
    """

    data: npt.NDArray[Any]
    resolution: float  # metres per cell
    origin: tuple[float, float]  # (x, y), metres

    def __repr__(self) -> str:
        """Size, resolution and origin; not the cells."""
        return (
            f"OccupancyGrid({self.width} x {self.height} cells of {self.resolution:g} m, "
            f"{self.data.dtype}, origin ({self.origin[0]:g}, {self.origin[1]:g}))"
        )

    @property
    def width(self) -> int:
        """Number of columns (x)."""
        return int(self.data.shape[1])

    @property
    def height(self) -> int:
        """Number of rows (y)."""
        return int(self.data.shape[0])

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of the outer cell edges, metres."""
        x, y = self.origin
        return x, y, x + self.width * self.resolution, y + self.height * self.resolution

    @property
    def x_centers(self) -> npt.NDArray[np.float64]:
        """(width,) x of the columns' centres, metres."""
        return np.asarray(self.origin[0] + (np.arange(self.width) + 0.5) * self.resolution)

    @property
    def y_centers(self) -> npt.NDArray[np.float64]:
        """(height,) y of the rows' centres, metres."""
        return np.asarray(self.origin[1] + (np.arange(self.height) + 0.5) * self.resolution)

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """(column, row) of the cell that holds the point, by ``cell_along``; may lie outside the grid."""
        (left, low), resolution = self.origin, self.resolution
        return cell_along(x - left, resolution), cell_along(y - low, resolution)

    def center_of(self, column: int, row: int) -> tuple[float, float]:
        """(x, y) of a cell's centre, metres."""
        return (
            self.origin[0] + (column + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def contains_cell(self, column: int, row: int) -> bool:
        """Whether (column, row) lies on the grid."""
        return 0 <= column < self.width and 0 <= row < self.height

    def at_resolution(self, resolution: float) -> "OccupancyGrid":
        """The same cells with exactly this resolution. Raises ValueError if it is another one than theirs."""
        if not same_resolution(self.resolution, resolution):
            raise ValueError(f"cells of {self.resolution:g} m are not of {resolution:g} m")
        return self if resolution == self.resolution else replace(self, resolution=resolution)

    def with_data(self, data: npt.NDArray[Any]) -> "OccupancyGrid":
        """Other values of the same shape in the same place."""
        if data.shape != self.data.shape:
            raise ValueError(f"data of shape {data.shape} on a grid of shape {self.data.shape}")
        return OccupancyGrid(data, self.resolution, self.origin)


def same_resolution(one: float, other: float) -> bool:
    """Whether two resolutions are one and the same but for what files and messages round."""
    return math.isclose(one, other, rel_tol=RESOLUTION_TOLERANCE)


def as_written(resolution: float) -> float:
    """The resolution of at most six decimals that 32 bits have made this one, or this one if it is none such.

    0.05000000074505806, of a nav_msgs/MapMetaData, is 0.05.
    """
    decimal = round(resolution, 6)
    return decimal if math.isclose(decimal, resolution, rel_tol=_BITS_32) else resolution


@dataclass(frozen=True)
class MapWindow:
    """Whole cells whose corners lie on multiples of the resolution, as those of GMapping's maps do here."""

    column: int  # of the first cell, counted from the map frame's origin
    row: int
    width: int  # cells along x
    height: int
    resolution_m: float

    @classmethod
    def around_origin(cls, width_m: float, height_m: float, resolution_m: float) -> "MapWindow":
        """The least window that holds a rectangle about the map frame's origin."""
        columns, rows = (math.ceil(side / 2.0 / resolution_m - 1e-9) for side in (width_m, height_m))
        return cls(-columns, -rows, 2 * columns, 2 * rows, resolution_m)

    def empty(self) -> OccupancyGrid:
        """An int8 grid of unknown cells."""
        origin = (self.column * self.resolution_m, self.row * self.resolution_m)
        return OccupancyGrid(
            np.full((self.height, self.width), UNKNOWN, dtype=np.int8), self.resolution_m, origin
        )

    def cut(self, grid: OccupancyGrid) -> OccupancyGrid:
        """What ``grid`` (int8, on the same lattice) says inside the window; -1 where it says nothing."""
        window = self.empty()
        left = round(grid.origin[0] / self.resolution_m) - self.column
        low = round(grid.origin[1] / self.resolution_m) - self.row
        x0, x1 = max(left, 0), min(left + grid.width, self.width)
        y0, y1 = max(low, 0), min(low + grid.height, self.height)
        if x0 < x1 and y0 < y1:
            window.data[y0:y1, x0:x1] = grid.data[y0 - low : y1 - low, x0 - left : x1 - left]
        return window


def cell_centers(grid: OccupancyGrid, cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """(N, 2) x, y of the centres of the set cells in the grid's frame, metres; rows first."""
    rows, columns = np.nonzero(cells)
    return np.stack((grid.x_centers[columns], grid.y_centers[rows]), axis=1)


def cells_of(grid: OccupancyGrid, points: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
    """(N, 2) ``cell_along`` both axes, column and row, of each of (N, 2) points, on the grid or off it."""
    return np.asarray(np.floor((points - grid.origin) / grid.resolution + CELL_SLACK).astype(np.int64))


def cell_middles(grid: OccupancyGrid, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(N, 2) the centre of the cell that each of (N, 2) points lies in, on the grid or off it, metres."""
    return np.asarray(grid.origin + (cells_of(grid, points) + 0.5) * grid.resolution)


def values_at(
    values: npt.NDArray[ScalarT], grid: OccupancyGrid, points: npt.NDArray[np.float64], outside: float
) -> npt.NDArray[ScalarT]:
    """(N,) of (H, W) ``values`` on the cells of ``grid`` at (N, 2) points; ``outside`` off the grid."""
    columns, rows = cells_of(grid, points).T
    on_grid = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
    found = np.full(len(points), outside, dtype=values.dtype)
    found[on_grid] = values[rows[on_grid], columns[on_grid]]
    return found


def connected_to(column: int, row: int, cells: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """(H, W) bool: the set cells that steps in x and y over set cells reach from (column, row).

    None are set where that cell is not set or lies off the grid.
    """
    height, width = cells.shape
    if not (0 <= column < width and 0 <= row < height and cells[row, column]):
        return np.zeros_like(cells)
    _, labels = cv2.connectedComponents(cells.view(np.uint8), connectivity=4)
    return np.asarray(labels == labels[row, column])


def cells_to_unset(cells: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """(H, W) float32, in cells: from each set cell's centre to that of the nearest one that is 0 or False.

    The squares are whole numbers, so their roots are rounded here: OpenCV's go by the number of its threads.
    """
    if not cells.size:  # which OpenCV does not survive
        return np.zeros(cells.shape, np.float32)
    found = cv2.distanceTransform(cells.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.sqrt(np.rint(np.square(found, dtype=np.float64))), dtype=np.float32)
