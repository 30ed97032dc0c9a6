"""``MapWindow``: a fixed rectangle of the map frame's lattice that growing maps are drawn into."""

import math
from dataclasses import dataclass

import numpy as np

from midnet_bench.grid import OccupancyGrid

UNKNOWN = -1


@dataclass(frozen=True)
class MapWindow:
    """Whole cells whose corners lie on multiples of the resolution, as those of GMapping's maps do here."""

    column: int
    """of the first cell, counted from the map frame's origin"""
    row: int
    width: int
    """cells along x"""
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
