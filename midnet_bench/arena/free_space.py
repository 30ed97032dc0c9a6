"""Where a Burger's centre may be: the set that goals, starts and escapes are drawn from."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.arena import Arena
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Solid, lengths
from midnet_bench.grid import OccupancyGrid, cell_centers, connected_to

RESOLUTION_M = 0.05
GOAL_CLEARANCE_M = 0.4
"""From a mobile intruder's goal to walls and stationary intruders (item 49), or the robot's own reach."""
DOOR_M = 0.25  # a narrower gap, as at the round corner of a drawn wall, is no door


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """Free cells inside the enclosure that can be reached from the security robots' start."""

    grid: OccupancyGrid  # bool (rows, columns) over the plane, map frame: True where a centre may be

    @cached_property
    def _centers(self) -> Floats:
        """(n, 2) x, y of the free cells' centres, metres."""
        return cell_centers(self.grid, self.grid.data)

    def contains(self, x: float, y: float) -> bool:
        """Whether the cell that holds (x, y) is free."""
        column, row = self.grid.cell_at(x, y)
        return self.grid.contains_cell(column, row) and bool(self.grid.data[row, column])

    def distance_to(self, x: float, y: float) -> float:
        """Metres from (x, y) to the centre of the nearest free cell."""
        return float(lengths(self._centers - (x, y)).min())

    def draw(
        self, rng: np.random.Generator, away_from: tuple[float, float] | None = None, at_least_m: float = 0.0
    ) -> tuple[float, float]:
        """The centre (x, y) of a free cell, all equally likely, ``at_least_m`` from ``away_from``.

        Takes one number from ``rng``. Raises InputError when there is no such cell.
        """
        places = self._centers
        if away_from is not None:
            places = places[lengths(places - away_from) >= at_least_m]
        if len(places) == 0:
            place = "" if away_from is None else f" from ({away_from[0]:g}, {away_from[1]:g})"
            raise InputError(f"arena: no free point is {at_least_m:g} m away{place}; lower escape_distance_m")
        x, y = places[int(rng.integers(len(places)))].tolist()
        return x, y


@lru_cache(maxsize=16)
def widest_pair_m(arena: Arena, clearance_m: float) -> float:
    """The greatest distance in metres between two points where a robot's centre may be, walls alone.

    Raises:
        InputError: as :func:`free_space`.
    """
    free = free_space(arena, clearance_m).grid
    # of a row of cells only the two ends can be the farthest from anything
    rows = np.repeat(np.flatnonzero(free.data.any(axis=1)), 2)
    columns = np.concatenate([np.flatnonzero(row)[[0, -1]] for row in free.data[rows[::2]]])
    points = np.stack((free.x_centers[columns], free.y_centers[rows]), axis=1)
    return float(lengths(points[:, None] - points[None]).max())


def doors(arena: Arena, key: str = "escape_at") -> list[tuple[float, float]]:
    """The middles (x, y) of the gaps in the outer wall, map frame, metres: sides south, east, north, west.

    A gap's ends are found to a centimetre; it is as wide as a robot, or no door. ``key``: the option that
    asks for them.

    Raises:
        InputError: there is none.
    """
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    corners = np.array([[-half_x, -half_y], [half_x, -half_y], [half_x, half_y], [-half_x, half_y]])
    found = []
    for corner, following in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        steps = round(float(np.abs(following - corner).sum()) / 0.01)
        along = corner + np.linspace(0.0, 1.0, steps + 1)[:, None] * (following - corner)
        is_open = np.all([solid.distance_to(along) > 1e-6 for solid in arena.wall_solids()], axis=0)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], is_open, [False])).astype(np.int8)))
        for first, last in edges.reshape(-1, 2).tolist():
            if (last - first) * 0.01 < DOOR_M:
                continue
            x, y = ((along[first] + along[last - 1]) / 2.0).tolist()
            found.append((x, y))
    if not found:
        raise InputError(f"arena '{arena.name}': its outer wall has no gap; take {key}: anywhere")
    return found


def free_space(arena: Arena, clearance_m: float, obstacles: tuple[Solid, ...] = ()) -> FreeSpace:
    """Cells whose centre is ``clearance_m`` or more from every wall and from ``obstacles``.

    Without ``obstacles`` it is what the guards know (the prior map has no intruder in it), with
    ``layout.stationary`` it is the truth. Distances are exact, not taken on the grid.

    Raises:
        InputError: the security robots' start is not free.
    """
    floor = open_floor(arena, clearance_m, obstacles)
    reachable = connected_to(*floor.cell_at(*arena.robots.center_m), floor.data)
    if not reachable.any():
        raise InputError(
            f"arena '{arena.name}': robots.center_m: less than {clearance_m:g} m from a wall or an obstacle"
        )
    return FreeSpace(floor.with_data(reachable))


def open_floor(arena: Arena, clearance_m: float, obstacles: tuple[Solid, ...] = ()) -> OccupancyGrid:
    """A bool grid over the plane: the same cells, whether or not anything reaches them."""
    near = cells_near(arena, obstacles, clearance_m)
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    inside = (np.abs(near.x_centers) < half_x) & (np.abs(near.y_centers) < half_y)[:, None]
    return near.with_data(~near.data & inside)


def border_labels(labels: npt.NDArray[Any], arena: Arena, grid: OccupancyGrid) -> set[int]:
    """The labels that cells at the enclosure's edge have; ``labels`` of the cells of ``grid``."""
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    columns = np.flatnonzero(np.abs(grid.x_centers) < half_x)[[0, -1]]
    rows = np.flatnonzero(np.abs(grid.y_centers) < half_y)[[0, -1]]
    inner = labels[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
    return {*np.unique(np.concatenate([inner[0], inner[-1], inner[:, 0], inner[:, -1]])).tolist()}


def cells_near(arena: Arena, obstacles: tuple[Solid, ...], distance_m: float) -> OccupancyGrid:
    """A bool grid over the plane: True where a cell's centre is closer than this to a wall or an obstacle."""
    near = _near_walls(arena.walls_alone, distance_m)
    return marked(near.with_data(near.data.copy()), obstacles, distance_m)


@lru_cache(maxsize=16)
def _near_walls(arena: Arena, distance_m: float) -> OccupancyGrid:
    """What walls alone give, once for all trials in one arena: 3 ms in Map 2, 0.2 s with 1500 blocks."""
    near = marked(arena.plane_grid(RESOLUTION_M, np.False_), arena.wall_solids(), distance_m)
    near.data.flags.writeable = False
    return near


def marked(near: OccupancyGrid, solids: tuple[Solid, ...], distance_m: float) -> OccupancyGrid:
    """``near`` itself, a bool grid, the cells set whose centres are closer than this to one of ``solids``."""
    x, y = near.x_centers, near.y_centers
    for solid in solids:
        box = solid.bounding_box()
        left, right = np.searchsorted(x, (box.x_min - distance_m, box.x_max + distance_m))
        low, high = np.searchsorted(y, (box.y_min - distance_m, box.y_max + distance_m))
        mesh = np.stack(np.meshgrid(x[left:right], y[low:high]), axis=-1)
        # Walls put cell centres at round distances; a hair's breadth keeps rounding from deciding those.
        close = solid.distance_to(mesh.reshape(-1, 2)) < distance_m - 1e-9
        near.data[low:high, left:right] |= close.reshape(mesh.shape[:2])
    return near
