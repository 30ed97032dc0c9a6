"""Arenas and prior maps as text inside a trial's parameters, so that a trial needs no file.

A campaign names files; what they say is taken in when its parameters are checked. A trial then runs on
any machine, and its id changes when a file's contents do. What comes with the package is named; the name of
an explored map holds a digest of its cells, so that the id changes with them here too.
"""

import base64
import hashlib
import json
import zlib
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.map_server import load_map
from midnet_bench.simulation.arena import Arena, arena_names, load_arena
from midnet_bench.simulation.exact_map import render_exact
from midnet_bench.simulation.explored_map import explored_map

EXACT, EXPLORED = "exact", "explored"


def inline_arena(value: str) -> str:
    """A packaged arena's name as it is; else the contents of the YAML file, as JSON. Raises InputError."""
    if value in arena_names() or value.startswith("{"):
        return value
    return load_arena(value).model_dump_json()


def arena_from(value: str) -> Arena:
    """The arena that ``inline_arena`` wrote down."""
    return Arena.model_validate_json(value) if value.startswith("{") else load_arena(value)


def inline_prior_map(value: str, arena: str) -> str:
    """``exact`` as it is, ``explored`` with the arena's name and a digest of the map; else a file's contents.

    Args:
        value: ``exact``, ``explored``, a map_server YAML file, or what this function made of one of them.
        arena: as ``inline_arena`` wrote it down.

    Raises:
        InputError: there is no such map, or a digest is not that of this version's map.
    """
    if value == EXACT or value.startswith("{"):
        return value
    if value.split(":")[0] == EXPLORED:
        return _named_explored(value, arena)
    path = Path(value)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(
            f"prior_map: '{value}' is neither '{EXPLORED}' nor '{EXACT}' nor the YAML file of a map"
        )
    return _as_text(load_map(path))


def prior_map_from(value: str, arena: Arena, resolution_m: float) -> OccupancyGrid:
    """The prior map that ``inline_prior_map`` wrote down: int8, 100 occupied, 0 free, -1 unknown, map frame.

    Raises:
        InputError: its resolution is not that of the local costmaps (item 19).
    """
    if value == EXACT:
        return render_exact(arena, resolution_m)
    grid = _explored(value.split(":")[1]) if value.startswith(EXPLORED) else _from_text(value)
    if abs(grid.resolution - resolution_m) > 1e-9:
        raise InputError(
            f"prior_map: resolution {grid.resolution:g} m differs from the local costmaps' "
            f"{resolution_m:g} m; resample the map, set resolution_m, or take prior_map=exact"
        )
    return grid


def _named_explored(value: str, arena: str) -> str:
    """``explored:ARENA:DIGEST`` of the package's map; the same again if ``value`` is that already."""
    grid = _explored(arena)
    place = repr((grid.resolution, grid.origin, grid.data.shape)).encode()
    name = f"{EXPLORED}:{arena}:{hashlib.sha256(place + grid.data.tobytes()).hexdigest()[:8]}"
    if value not in (EXPLORED, name):
        raise InputError(f"prior_map: '{value}' is not the map that this version has, '{name}'")
    return name


def _explored(arena: str) -> OccupancyGrid:
    grid = None if arena.startswith("{") else explored_map(arena)
    if grid is None:
        name = "ARENA.yaml" if arena.startswith("{") else arena
        raise InputError(
            f"prior_map: no explored map of this arena comes with midnet-bench; make one by "
            f"'midnet-bench map {name}' and give it by --map, or take prior_map=exact"
        )
    return grid


def _as_text(grid: OccupancyGrid) -> str:
    cells = base64.b64encode(zlib.compress(grid.data.tobytes(), 9)).decode()
    return json.dumps(
        {"resolution": grid.resolution, "origin": grid.origin, "shape": grid.data.shape, "int8": cells}
    )


def _from_text(text: str) -> OccupancyGrid:
    written = json.loads(text)
    cells = np.frombuffer(zlib.decompress(base64.b64decode(written["int8"])), dtype=np.int8)
    x, y = written["origin"]
    return OccupancyGrid(cells.reshape(written["shape"]), written["resolution"], (float(x), float(y)))
