"""The prior maps that robots explored, for arenas that come with the package."""

from functools import cache
from pathlib import Path

from midnet_bench.grid import OccupancyGrid
from midnet_bench.map_server import load_map

FOLDER = Path(__file__).parent / "maps"
"""``ARENA.yaml`` and ``ARENA.pgm``, chosen from ``campaigns/mapping.yaml``"""


def explored_map(arena: str) -> OccupancyGrid | None:
    """The explored map of a packaged arena, int8 (100 occupied, 0 free, -1 unknown), or None without one."""
    path = FOLDER / f"{arena}.yaml"
    return _load(path) if path.is_file() else None


@cache
def _load(path: Path) -> OccupancyGrid:
    grid = load_map(path)
    grid.data.flags.writeable = False
    return grid
