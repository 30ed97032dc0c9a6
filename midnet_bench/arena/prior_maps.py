"""The prior maps of an arena: drawn exactly from its walls, or explored by robots and kept in the package."""

import math
from functools import cache
from pathlib import Path

import numpy as np

from midnet_bench.arena.arena import Arena
from midnet_bench.grid import FREE, OCCUPIED, OccupancyGrid
from midnet_bench.io.map_server import load_map


def render_exact(arena: Arena, resolution_m: float = 0.05) -> OccupancyGrid:
    """An int8 grid over the whole plane, map frame: 100 where there is wall, 0 elsewhere, no unknown.

    A cell is occupied when it shares area with a wall, so both faces (what a LiDAR marks) and all that
    lies between them are. A face that only touches a cell's edge does not fill it. Cell edges lie on
    whole multiples of the resolution counted from the plane's lower-left corner; with walls centred on
    them, a thickness of an odd number of cells puts the faces in the middle of cells, where the LiDAR's
    noise seldom carries a return into the next one. Intruders are no part of it.
    """
    columns, rows = (math.ceil(side / resolution_m - 1e-9) for side in arena.plane_m)
    origin = (-columns * resolution_m / 2.0, -rows * resolution_m / 2.0)
    grid = OccupancyGrid(np.full((rows, columns), FREE, dtype=np.int8), resolution_m, origin)
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


FOLDER = Path(__file__).parent / "maps"
"""``ARENA.yaml`` and ``ARENA.pgm``, chosen from ``campaigns/mapping.yaml``; ``ARENA_worst``, its worst map"""


def explored_map(arena: str, worst: bool = False) -> OccupancyGrid | None:
    """An explored map of a packaged arena, int8 (100 occupied, 0 free, -1 unknown), or None without one.

    The best of the finished maps of the campaign, or the ``worst`` of them: first and last by the rule of
    ``mapping_choice`` in the campaign's report.
    """
    path = FOLDER / f"{arena}{'_worst' if worst else ''}.yaml"
    return _load(path) if path.is_file() else None


@cache
def _load(path: Path) -> OccupancyGrid:
    grid = load_map(path)
    grid.data.flags.writeable = False
    return grid
