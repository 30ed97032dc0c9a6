"""``OccupancyGrid``: values on square cells with a place in the world, as nav_msgs has it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A grid whose row 0 has the lowest y and whose column 0 has the lowest x.

    ``data[row, column]`` is what the holder says it is: published costs (int8, -1 unknown, 0 to 100)
    or a binary grid (uint8, 0 occupied, 255 free or unknown; Eq. 1). ``origin`` is the lower-left
    *corner* of cell (0, 0), metres; there is no rotation (item 18).
    """

    data: npt.NDArray[Any]
    resolution: float
    """metres per cell"""
    origin: tuple[float, float]
    """(x, y), metres"""

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

    def cell_at(self, x: float, y: float) -> tuple[int, int]:
        """(column, row) of the cell that holds the point, by floor; may lie outside the grid."""
        return (
            math.floor((x - self.origin[0]) / self.resolution),
            math.floor((y - self.origin[1]) / self.resolution),
        )

    def center_of(self, column: int, row: int) -> tuple[float, float]:
        """(x, y) of a cell's centre, metres."""
        return (
            self.origin[0] + (column + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )

    def contains_cell(self, column: int, row: int) -> bool:
        """Whether (column, row) lies on the grid."""
        return 0 <= column < self.width and 0 <= row < self.height

    def with_data(self, data: npt.NDArray[Any]) -> "OccupancyGrid":
        """Other values of the same shape in the same place."""
        if data.shape != self.data.shape:
            raise ValueError(f"data of shape {data.shape} on a grid of shape {self.data.shape}")
        return OccupancyGrid(data, self.resolution, self.origin)
