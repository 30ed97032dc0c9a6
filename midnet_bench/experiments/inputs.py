"""Arenas and prior maps as text inside a trial's parameters, so that a trial needs no file.

A campaign names files; what they say is taken in when its parameters are checked. A trial then runs on
any machine, and its id changes when a file's contents do.
"""

import base64
import json
import zlib
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.map_server import load_map
from midnet_bench.simulation.arena import Arena, arena_names, load_arena
from midnet_bench.simulation.exact_map import render_exact

EXACT = "exact"


def inline_arena(value: str) -> str:
    """A packaged arena's name as it is; else the contents of the YAML file, as JSON. Raises InputError."""
    if value in arena_names() or value.startswith("{"):
        return value
    return load_arena(value).model_dump_json()


def arena_from(value: str) -> Arena:
    """The arena that ``inline_arena`` wrote down."""
    return Arena.model_validate_json(value) if value.startswith("{") else load_arena(value)


def inline_prior_map(value: str) -> str:
    """``exact`` as it is; else the contents of the map_server YAML file and its image, as JSON."""
    if value == EXACT or value.startswith("{"):
        return value
    path = Path(value)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"prior_map: '{value}' is neither '{EXACT}' nor the YAML file of a map_server map")
    grid = load_map(path)
    cells = base64.b64encode(zlib.compress(grid.data.tobytes(), 9)).decode()
    return json.dumps(
        {"resolution": grid.resolution, "origin": grid.origin, "shape": grid.data.shape, "int8": cells}
    )


def prior_map_from(value: str, arena: Arena, resolution_m: float) -> OccupancyGrid:
    """The prior map, int8 (100 occupied, 0 free, -1 unknown), map frame: rendered or as it was written down.

    Raises:
        InputError: its resolution is not that of the local costmaps (paper-notes item 19).
    """
    if value == EXACT:
        return render_exact(arena, resolution_m)
    written = json.loads(value)
    if abs(written["resolution"] - resolution_m) > 1e-9:
        raise InputError(
            f"prior_map: resolution {written['resolution']:g} m differs from the local costmaps' "
            f"{resolution_m:g} m; resample the map or set resolution_m"
        )
    cells = np.frombuffer(zlib.decompress(base64.b64decode(written["int8"])), dtype=np.int8)
    x, y = written["origin"]
    return OccupancyGrid(cells.reshape(written["shape"]), written["resolution"], (float(x), float(y)))
