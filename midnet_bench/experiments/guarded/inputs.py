"""Arenas and prior maps as text inside a trial's parameters, so that a trial needs no file.

A campaign names files; their contents are read when its parameters are checked. A trial then runs on
any machine, and its id changes when a file's contents do. What comes with the package is named; the name of
an explored map holds a digest of its cells, so that the id changes with them here too.
"""

import base64
import hashlib
import json
import logging
import zlib
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from pydantic import Field

from midnet_bench.arena.arena import Arena, arena_names, checked_arena, explored_map, load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid, same_resolution
from midnet_bench.io.checked_yaml import Spec
from midnet_bench.io.map_server import load_map

EXACT, EXPLORED, WORST = "exact", "explored", "explored-worst"
SHOWN = 30  # characters of a text that a message quotes


def inline_arena(value: str) -> str:
    """A packaged arena's name as it is; else the contents of the YAML file, as JSON. Raises InputError."""
    if value in arena_names():
        return value
    try:
        arena = arena_from(value)
    except InputError as error:
        raise InputError(f"arena: {error}") from error
    return value if value.startswith("{") else arena.model_dump_json()


def arena_from(value: str) -> Arena:
    """The arena that ``inline_arena`` wrote down. Raises InputError."""
    return _arena_of_text(value) if value.startswith("{") else load_arena(value)


@lru_cache(maxsize=16)
def _arena_of_text(value: str) -> Arena:
    source = repr(value[:SHOWN])
    try:
        return checked_arena(json.loads(value), source)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{source} is no arena; give a name or a YAML file") from error


def inline_prior_map(value: str | None, arena: str) -> str:
    """``exact`` as it is, explored maps with the arena's name and a digest; else a file's contents.

    Args:
        value: ``exact``, ``explored``, ``explored-worst``, a map_server YAML file, or what this function
            made of one of them; None: explored where the package has such a map, else exact.
        arena: as ``inline_arena`` wrote it down.

    Raises:
        InputError: there is no such map, or a digest is not that of this version's map.
    """
    if value is None:
        value = EXPLORED if not arena.startswith("{") and explored_map(arena) is not None else EXACT
        if value == EXACT:
            _note_exact(arena if not arena.startswith("{") else arena_from(arena).name)
    if value == EXACT:
        return value
    if value.startswith("{"):
        _from_text(value)
        return value
    which, path = value.split(":")[0], Path(value)
    if which in (EXPLORED, WORST):
        name = f"{which}:{arena}:{_digest(_explored(which, arena))}"
        if value not in (which, name):
            raise InputError(f"prior_map: '{value}' is not the map that this version has, '{name}'")
        return name
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(
            f"prior_map: {value!r} is neither '{EXPLORED}' nor '{WORST}' nor '{EXACT}' nor the YAML file of"
            " a map"
        )
    try:
        grid = load_map(path)
    except InputError as error:
        raise InputError(f"prior_map: {error}") from error
    return _as_text(grid)


@cache
def _note_exact(arena: str) -> None:
    """Once in a process."""
    logging.getLogger("midnet_bench").info(
        "note: no explored map of '%s' comes with midnet-bench: guards have the exact one; --map FILE gives"
        " them another",
        arena,
    )


def prior_map_from(value: str | None, arena: str, resolution_m: float) -> OccupancyGrid:
    """The prior map, int8, 100 occupied, 0 free, -1 unknown, map frame; arguments as ``inline_prior_map``.

    Raises:
        InputError: as ``inline_prior_map``; or its resolution is not that of the local costmaps (item 19), or
            it ends inside the arena.
    """
    taken = inline_prior_map(value, arena)
    if taken == EXACT:
        return render_exact(arena_from(arena), resolution_m)
    is_packaged = taken.startswith(EXPLORED)
    grid = _explored(taken.split(":")[0], arena) if is_packaged else _from_text(taken)
    if not same_resolution(grid.resolution, resolution_m):
        raise InputError(
            f"prior_map: resolution {grid.resolution:g} m differs from the local costmaps' "
            f"{resolution_m:g} m; resample it by 'midnet-bench map --from-map FILE', set resolution_m, or "
            "take prior_map=exact"
        )
    if not is_packaged:
        _check_covers(grid, arena_from(arena))
    return grid.at_resolution(resolution_m)


def check_patrol(grid: OccupancyGrid, arena: str, robots: int, clearance_m: float, reach_m: float) -> None:
    """Raises InputError unless guards can patrol the arena on a map, as far as no seed decides.

    ``reach_m``: of a guard's footprint from its axle.
    """
    from midnet_bench.agents.patrol import patrol_points  # OpenCV, which a packaged map does not need
    from midnet_bench.arena.layout import robot_starts

    place = arena_from(arena)
    start = robot_starts(place, robots)[0]
    patrol_points(grid, (start.x, start.y), place.enclosure_m, clearance_m, reach_m)


def _check_covers(grid: OccupancyGrid, arena: Arena) -> None:
    """Raise InputError if the map ends inside the arena: guards beyond its edge would detect nothing."""
    # from face to face of the walls; an explorer may have seen no more of them
    half_x, half_y = ((side - arena.wall_thickness_m) / 2.0 - grid.resolution for side in arena.enclosure_m)
    x_min, y_min, x_max, y_max = grid.extent
    if x_min > -half_x or y_min > -half_y or x_max < half_x or y_max < half_y:
        width_m, height_m = arena.enclosure_m
        raise InputError(
            f"prior_map: it reaches from ({x_min:g}, {y_min:g}) to ({x_max:g}, {y_max:g}) m and does not "
            f"cover the arena, {width_m:g} x {height_m:g} m about (0, 0); is it this arena's map, and its "
            "origin right?"
        )


@lru_cache(maxsize=16)
def _digest(grid: OccupancyGrid) -> str:
    """Of one of the package's maps, which cannot be written to."""
    place = repr((grid.resolution, grid.origin, grid.data.shape)).encode()
    return hashlib.sha256(place + grid.data.tobytes()).hexdigest()[:8]


def _explored(which: str, arena: str) -> OccupancyGrid:
    grid = None if arena.startswith("{") else explored_map(arena, which == WORST)
    if grid is None:
        name = "ARENA.yaml" if arena.startswith("{") else arena
        raise InputError(
            f"prior_map: no map '{which}' of this arena comes with midnet-bench; make one by "
            f"'midnet-bench map {name}' and give it by --map, or take prior_map=exact"
        )
    return grid


def _as_text(grid: OccupancyGrid) -> str:
    cells = base64.b64encode(zlib.compress(grid.data.tobytes(), 9)).decode()
    return json.dumps(
        {"resolution": grid.resolution, "origin": grid.origin, "shape": grid.data.shape, "int8": cells}
    )


class _MapText(Spec):
    """What ``_as_text`` writes down."""

    resolution: float = Field(gt=0)
    origin: tuple[float, float]
    shape: tuple[int, int]
    int8: str


def _from_text(text: str) -> OccupancyGrid:
    try:
        written = _MapText.model_validate_json(text)
        packed = base64.b64decode(written.int8, validate=True)
        cells = np.frombuffer(zlib.decompress(packed), dtype=np.int8).reshape(written.shape)
    except (ValueError, zlib.error) as error:
        raise InputError(
            f"prior_map: {text[:SHOWN]!r} is no map; give a YAML file, {EXPLORED} or {EXACT}"
        ) from error
    return OccupancyGrid(cells, written.resolution, written.origin)
