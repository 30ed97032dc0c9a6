"""The obstacle layer of a costmap: what the beams of a LiDAR have marked and cleared."""

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.messages import LidarGeometry
from midnet_bench.navigation.cost_values import FREE_SPACE, LETHAL, NO_INFORMATION, reach_cells
from midnet_bench.navigation.costmap_kernels import integrate_scan
from midnet_bench.navigation.costmap_settings import CostmapSettings
from midnet_bench.navigation.footprint import corner_array

_Value = TypeVar("_Value", bound=np.generic)


class ObstacleLayer:
    """Cells that are free (0), an obstacle (254) or unseen (255), on a lattice that never moves.

    The layer's lower-left corner lies ``column``, ``row`` whole cells from ``lattice_origin``, so that two
    grids of one lattice always differ by whole cells. Marks stay until a beam passes, the footprint covers
    them, they leave the window, they outlive ``memory_s`` or ``clear_outside`` takes them. Points are kept in
    double precision, where ROS has 32-bit floats.
    """

    def __init__(
        self, settings: CostmapSettings, width: int, height: int, lattice_origin: tuple[float, float]
    ) -> None:
        self.settings = settings
        self.lattice_origin = lattice_origin
        self.column = 0
        self.row = 0
        self._unseen = NO_INFORMATION if settings.track_unknown else FREE_SPACE
        self.cells: npt.NDArray[np.uint8] = np.full((height, width), self._unseen, dtype=np.uint8)
        self._remembers_for_ever = math.isinf(settings.memory_s)
        self._marked_at_s = np.full((height, width), -math.inf)
        cleared = settings.footprint if settings.footprint_clearing else ()
        self._footprint_cells = corner_array(cleared) / settings.resolution
        self._marked = np.empty(0, dtype=np.int64)
        self._raytrace_cells = reach_cells(settings.raytrace_range_m, settings.resolution)

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower-left corner, metres."""
        return (
            self.lattice_origin[0] + self.column * self.settings.resolution,
            self.lattice_origin[1] + self.row * self.settings.resolution,
        )

    def to_cells(self, x: float, y: float) -> tuple[float, float]:
        """A point in cells from the lower-left corner of this layer, not rounded."""
        column, row = self.to_lattice(x, y)
        return column - self.column, row - self.row

    def to_lattice(self, x: float, y: float) -> tuple[float, float]:
        """A point in cells from the lattice's origin, not rounded."""
        resolution = self.settings.resolution
        return (x - self.lattice_origin[0]) / resolution, (y - self.lattice_origin[1]) / resolution

    def move_to(self, column: int, row: int, width: int, height: int) -> None:
        """Cover another rectangle of the lattice; what leaves is forgotten, what enters is unseen."""
        if (column, row) == (self.column, self.row) and self.cells.shape == (height, width):
            return
        self.cells = _moved(self.cells, column - self.column, row - self.row, width, height, self._unseen)
        if not self._remembers_for_ever:
            self._marked_at_s = _moved(
                self._marked_at_s, column - self.column, row - self.row, width, height, -math.inf
            )
        self.column, self.row = column, row

    def update(
        self,
        pose: Pose2D,
        sensor_pose: Pose2D,
        ranges_m: npt.NDArray[np.float64],
        geometry: LidarGeometry,
        time_s: float,
    ) -> None:
        """Take one scan: clear along all beams, then mark all hits, then free the footprint."""
        settings = self.settings
        if not self._remembers_for_ever:
            self._forget(time_s)
        if len(self._marked) < len(ranges_m):
            self._marked = np.empty(len(ranges_m), dtype=np.int64)
        count = integrate_scan(
            self.cells,
            (*self.to_cells(sensor_pose.x, sensor_pose.y), sensor_pose.yaw),
            settings.resolution,
            np.ascontiguousarray(ranges_m, dtype=np.float64),
            geometry.directions,
            (geometry.range_min_m, geometry.range_max_m),
            settings.obstacle_range_m,
            self._raytrace_cells,
            settings.inf_is_valid,
            (*self.to_cells(pose.x, pose.y), pose.yaw),
            self._footprint_cells,
            self._marked,
        )
        if not self._remembers_for_ever:
            self._marked_at_s.reshape(-1)[self._marked[:count]] = time_s

    def clear_outside(self, x: float, y: float, side_m: float) -> None:
        """Forget everything outside the square of side ``side_m`` centred on (x, y), bounds excluded.

        The layer itself is addressed, not a name: move_base's clearing recovery looks for ``obstacles``,
        TurtleBot3's layer is called ``obstacle_layer``, and so the original clears nothing.
        """
        half = side_m / 2.0
        x0, y0 = (int(value) for value in self.to_cells(x - half, y - half))
        x1, y1 = (int(value) for value in self.to_cells(x + half, y + half))
        kept = (slice(max(y0 + 1, 0), max(y1, 0)), slice(max(x0 + 1, 0), max(x1, 0)))
        cleared = np.full_like(self.cells, self._unseen)
        cleared[kept] = self.cells[kept]
        self.cells = cleared

    def _forget(self, time_s: float) -> None:
        memory_s = self.settings.memory_s
        if memory_s == 0.0:
            self.cells.fill(self._unseen)
        else:
            self.cells[(self.cells == LETHAL) & (self._marked_at_s < time_s - memory_s)] = FREE_SPACE


def _moved(
    old: npt.NDArray[_Value], columns: int, rows: int, width: int, height: int, unseen: float
) -> npt.NDArray[_Value]:
    new = np.full((height, width), unseen, dtype=old.dtype)
    x0, x1 = max(columns, 0), min(columns + width, old.shape[1])
    y0, y1 = max(rows, 0), min(rows + height, old.shape[0])
    if x0 < x1 and y0 < y1:
        new[y0 - rows : y1 - rows, x0 - columns : x1 - columns] = old[y0:y1, x0:x1]
    return new
