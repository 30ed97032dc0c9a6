"""A prior map drawn exactly from an arena's walls, and maps in cells of another size."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.arena import Arena
from midnet_bench.errors import InputError
from midnet_bench.grid import FREE, OCCUPIED, OCCUPIED_FROM, UNKNOWN, OccupancyGrid, same_resolution
from midnet_bench.io.map_server import MOST_PIXELS

_HAIR = 1e-6  # of a cell: less is no area


def render_exact(arena: Arena, resolution_m: float = 0.05) -> OccupancyGrid:
    """An int8 grid over the whole plane, map frame: 100 where there is wall, 0 elsewhere, no unknown.

    A cell is occupied when it shares area with a wall, so both faces (what a LiDAR marks) and all that
    lies between them are. A face that only touches a cell's edge does not fill it. Cell edges lie on
    whole multiples of the resolution counted from the plane's lower-left corner; with walls centred on
    them, a thickness of an odd number of cells puts the faces in the middle of cells, where the LiDAR's
    noise seldom carries a return into the next one. Intruders are no part of it.
    """
    grid = arena.plane_grid(resolution_m, np.int8(FREE))
    half_cell = resolution_m / 2.0
    x, y = grid.x_centers, grid.y_centers
    for wall in arena.wall_solids():
        box = wall.bounding_box()
        left, right = np.searchsorted(x, (box.x_min - half_cell + 1e-9, box.x_max + half_cell - 1e-9))
        low, high = np.searchsorted(y, (box.y_min - half_cell + 1e-9, box.y_max + half_cell - 1e-9))
        # The map's two axes do not part cell and wall here; where the wall's own do not, they overlap.
        c, s = wall.pose.direction
        reach = half_cell * (abs(c) + abs(s)) - 1e-9
        dx, dy = x[left:right] - wall.pose.x, (y[low:high] - wall.pose.y)[:, None]
        overlap = (np.abs(c * dx + s * dy) < wall.length_m / 2.0 + reach) & (
            np.abs(c * dy - s * dx) < wall.width_m / 2.0 + reach
        )
        grid.data[low:high, left:right][overlap] = OCCUPIED
    return grid


def resampled(grid: OccupancyGrid, resolution_m: float) -> OccupancyGrid:
    """A map (int8) in cells of another size, from the same lower left corner on; no wall gets lost.

    A cell becomes occupied when it shares area with an occupied cell; else unknown when it shares area with
    an unknown cell, or with what lies beyond the map; else what the costliest of its cells is. Walls grow by
    less than a cell on each side. A map of that resolution stays as it is.

    Raises:
        InputError: it would have more cells than a map may.
    """
    ratio = resolution_m / grid.resolution
    if same_resolution(resolution_m, grid.resolution):
        return grid.at_resolution(resolution_m)
    sizes = [math.ceil(cells / ratio - _HAIR) for cells in grid.data.shape]
    if sizes[0] * sizes[1] > MOST_PIXELS:
        raise InputError(
            f"resolution_m: {resolution_m:g} m makes {sizes[1]} x {sizes[0]} cells of the map; at most"
            f" {MOST_PIXELS} are made: take a larger one"
        )
    is_occupied, is_unknown = grid.data >= OCCUPIED_FROM, grid.data < FREE
    # what wins is larger: free and its costs, unknown, occupied
    ranks = np.where(is_occupied, 101, np.where(is_unknown, 100, grid.data)).astype(np.int8)
    # half a new cell beyond the map is unknown; one row and column more for reduceat to end at
    ranks = np.pad(ranks, ((0, 2), (0, 2)), constant_values=100)
    for axis, size in enumerate(sizes):
        ranks = _greatest(ranks, axis, size, ratio)
    values = np.where(ranks == 101, OCCUPIED, np.where(ranks == 100, UNKNOWN, ranks)).astype(np.int8)
    return OccupancyGrid(values, resolution_m, grid.origin)


def _greatest(values: npt.NDArray[np.int8], axis: int, size: int, ratio: float) -> npt.NDArray[np.int8]:
    """The greatest of the values that share length with each of ``size`` cells, each ``ratio`` cells long."""
    edges = np.arange(size + 1) * ratio
    ends = np.floor(edges[:-1] + _HAIR), np.ceil(edges[1:] - _HAIR)
    pairs = np.minimum(np.stack(ends, axis=1).astype(np.int64).ravel(), values.shape[axis] - 1)
    return np.asarray(np.maximum.reduceat(values, pairs, axis).take(np.arange(0, 2 * size, 2), axis))
