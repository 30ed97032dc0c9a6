"""Layered costmaps in the manner of costmap_2d: one that rolls with a robot, one over a static map."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import LidarGeometry
from midnet_bench.navigation.cost_values import (
    FREE_SPACE,
    LETHAL,
    NO_INFORMATION,
    OCCUPIED,
    inflation_costs,
    published,
    reach_cells,
)
from midnet_bench.navigation.costmap_kernels import combined, inflate
from midnet_bench.navigation.costmap_settings import CostmapSettings
from midnet_bench.navigation.obstacle_layer import ObstacleLayer


class _Inflation:
    """Inflates a grid of lethal, free and unknown cells with one costmap's parameters."""

    def __init__(self, settings: CostmapSettings) -> None:
        self.reach = reach_cells(settings.inflation_radius_m, settings.resolution)
        self._costs = inflation_costs(
            self.reach, settings.resolution, settings.inscribed_radius_m, settings.cost_scaling_factor
        )

    def __call__(self, base: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        return np.asarray(inflate(base, self._costs, self.reach))


class RollingCostmap:
    """A square window that follows its robot: an obstacle layer and its inflation, no static map.

    The window always lies on the lattice of ``lattice_origin`` (a prior map's origin, say). With
    ``settings.centered`` the robot's cell c (by floor) is the middle one and the window is
    [c - n // 2, c - n // 2 + n) at every update, as Eqs. 2 to 4 of the paper take for granted. Without,
    the window moves as costmap_2d's does: towards robot - (n - 0.5) / 2 cells, by whole cells truncated
    towards zero, which leaves the robot up to about one cell off the middle, depending on where it came from.
    """

    def __init__(self, settings: CostmapSettings, lattice_origin: tuple[float, float] = (0.0, 0.0)) -> None:
        self.settings = settings
        self.layer = ObstacleLayer(settings, settings.size_cells, settings.size_cells, lattice_origin)
        self._inflation = _Inflation(settings)
        self._costs: npt.NDArray[np.uint8] | None = None

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower-left corner, metres."""
        return self.layer.origin

    @property
    def costs(self) -> npt.NDArray[np.uint8]:
        """(n, n) uint8 costs, row 0 lowest y; computed on first use after an update. Not to be written to."""
        if self._costs is None:
            self._costs = self._inflation(self.layer.cells)
        return self._costs

    def update(
        self,
        pose: Pose2D,
        sensor_pose: Pose2D,
        ranges_m: npt.NDArray[np.float64],
        geometry: LidarGeometry,
        time_s: float,
    ) -> None:
        """Move the window to the robot and take one scan.

        ``pose`` and ``sensor_pose``: the robot's base and its LiDAR at the scan's instant, in the costmap's
        frame. ``ranges_m``: (B,), inf or NaN where nothing came back.
        """
        column, row = self._window(pose)
        self.layer.move_to(column, row, self.settings.size_cells, self.settings.size_cells)
        self.layer.update(pose, sensor_pose, ranges_m, geometry, time_s)
        self._costs = None

    def clear_outside(self, x: float, y: float, side_m: float) -> None:
        """Forget all obstacles outside a square centred on (x, y)."""
        self.layer.clear_outside(x, y, side_m)
        self._costs = None

    def published(self) -> OccupancyGrid:
        """The costmap as nav_msgs has it: int8, 0 to 100 and -1."""
        return OccupancyGrid(published(self.costs), self.settings.resolution, self.origin)

    def _window(self, pose: Pose2D) -> tuple[int, int]:
        n = self.settings.size_cells
        x, y = self.layer.to_lattice(pose.x, pose.y)
        if self.settings.centered:
            return math.floor(x) - n // 2, math.floor(y) - n // 2
        column, row, half = self.layer.column, self.layer.row, (n - 0.5) / 2.0
        return column + int(x - half - column), row + int(y - half - row)


class GlobalCostmap:
    """The costmap of a whole map: static layer, obstacle layer, inflation.

    Scans are taken into the obstacle layer at once, but the inflation around them waits until ``costs`` is
    asked for, and then only the rectangle that scans have touched since is done again.
    """

    def __init__(self, settings: CostmapSettings, static_map: OccupancyGrid) -> None:
        self.settings = settings
        self._inflation = _Inflation(settings)
        self._scan_cells = 1 + reach_cells(
            max(settings.raytrace_range_m, settings.obstacle_range_m), settings.resolution
        )
        self.layer = ObstacleLayer(settings, static_map.width, static_map.height, static_map.origin)
        self.set_static(static_map)

    def set_static(self, static_map: OccupancyGrid) -> None:
        """Put another static map (int8, -1 to 100) below the obstacle layer; marks stay where they are.

        The map may have grown or moved by whole cells, as a map under construction does. Raises InputError
        for another resolution.
        """
        if static_map.resolution != self.settings.resolution:
            raise InputError(
                f"prior map: resolution {static_map.resolution} differs from the global costmap's "
                f"{self.settings.resolution}; set both to the same"
            )
        x, y = self.layer.to_cells(*static_map.origin)
        column, row = self.layer.column + round(x), self.layer.row + round(y)
        self.layer.move_to(column, row, static_map.width, static_map.height)
        self.static = static_layer(static_map, self.settings.track_unknown)
        self.static_costs = self._inflation(self.static)
        """what the costs would be without any obstacle layer"""
        self._costs = self.static_costs.copy()
        self._touched = (0, 0, static_map.width, static_map.height)

    @property
    def origin(self) -> tuple[float, float]:
        """(x, y) of the lower-left corner, metres."""
        return self.layer.origin

    @property
    def costs(self) -> npt.NDArray[np.uint8]:
        """(H, W) uint8 costs, row 0 lowest y, up to date. Not to be written to."""
        x0, y0, x1, y1 = self._touched
        if x0 < x1 and y0 < y1:
            reach = self._inflation.reach
            outer = self._clipped(x0 - 2 * reach, y0 - 2 * reach, x1 + 2 * reach, y1 + 2 * reach)
            inner = self._clipped(x0 - reach, y0 - reach, x1 + reach, y1 + reach)
            inflated = self._inflation(combined(self.static[_box(outer)], self.layer.cells[_box(outer)]))
            dx, dy = inner[0] - outer[0], inner[1] - outer[1]
            self._costs[_box(inner)] = inflated[dy : dy + inner[3] - inner[1], dx : dx + inner[2] - inner[0]]
            self._touched = (0, 0, 0, 0)
        return self._costs

    def update(
        self,
        pose: Pose2D,
        sensor_pose: Pose2D,
        ranges_m: npt.NDArray[np.float64],
        geometry: LidarGeometry,
        time_s: float,
    ) -> None:
        """Take one scan; arguments as for ``RollingCostmap.update``."""
        self.layer.update(pose, sensor_pose, ranges_m, geometry, time_s)
        if math.isinf(self.settings.memory_s):
            x, y = (math.floor(value) for value in self.layer.to_cells(sensor_pose.x, sensor_pose.y))
            reach = self._scan_cells
            self._touch(x - reach, y - reach, x + reach + 1, y + reach + 1)
        else:
            self._touch(0, 0, self.static.shape[1], self.static.shape[0])

    def clear_outside(self, x: float, y: float, side_m: float) -> None:
        """Forget the obstacle layer (never the static map) outside a square centred on (x, y)."""
        self.layer.clear_outside(x, y, side_m)
        self._touch(0, 0, self.static.shape[1], self.static.shape[0])

    def published(self) -> OccupancyGrid:
        """The costmap as nav_msgs has it: int8, 0 to 100 and -1."""
        return OccupancyGrid(published(self.costs), self.settings.resolution, self.origin)

    def _touch(self, x0: int, y0: int, x1: int, y1: int) -> None:
        box = self._clipped(x0, y0, x1, y1)
        old = self._touched
        if old[0] < old[2] and old[1] < old[3]:
            box = (min(box[0], old[0]), min(box[1], old[1]), max(box[2], old[2]), max(box[3], old[3]))
        self._touched = box

    def _clipped(self, x0: int, y0: int, x1: int, y1: int) -> tuple[int, int, int, int]:
        height, width = self.static.shape
        return (
            min(max(x0, 0), width),
            min(max(y0, 0), height),
            min(max(x1, 0), width),
            min(max(y1, 0), height),
        )


def static_layer(static_map: OccupancyGrid, track_unknown: bool) -> npt.NDArray[np.uint8]:
    """(H, W) uint8: 254 where the map says 100, 255 where unknown (0 unless tracked), 0 elsewhere.

    That is the static layer with its default threshold and ``trinary_costmap``: 99 is free. One
    ``track_unknown`` serves all layers, where costmap_2d has one per layer and lets an obstacle layer that
    does not track wipe out the static layer's unknown cells.
    """
    values = static_map.data
    if values.dtype != np.int8:
        raise ValueError(f"a static map holds int8 occupancy (-1 to 100), got {values.dtype}")
    layer = np.where(values >= OCCUPIED, np.uint8(LETHAL), np.uint8(FREE_SPACE))
    if track_unknown:
        layer[values < 0] = NO_INFORMATION
    return layer


def static_costs(static_map: OccupancyGrid, settings: CostmapSettings) -> OccupancyGrid:
    """The published global costmap (int8) of a map without any scan: what the prior map is cut from."""
    costs = _Inflation(settings)(static_layer(static_map, settings.track_unknown))
    return static_map.with_data(published(costs))


def _box(bounds: tuple[int, int, int, int]) -> tuple[slice, slice]:
    x0, y0, x1, y1 = bounds
    return slice(y0, y1), slice(x0, x1)
