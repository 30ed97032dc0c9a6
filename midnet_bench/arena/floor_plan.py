"""An arena out of a grid of wall and floor, such as a drawn plan or a map, and the text of its file."""

import json
from collections.abc import Iterator
from itertools import islice

import cv2
import numpy as np

from midnet_bench.agents.patrol import DRIVABLE_M
from midnet_bench.arena.arena import MOST_BLOCKS, TEAM, Arena, Corners, checked_arena
from midnet_bench.errors import InputError
from midnet_bench.geometry import Booleans
from midnet_bench.grid import OccupancyGrid, cells_to_unset

Rectangle = tuple[int, int, int, int]
"""first row, first column, one past the last row, one past the last column"""

GROUND_M = 1.0  # of the plane, on each side of the enclosure
LONGEST_M = 200.0 - 2.0 * GROUND_M  # of the enclosure: the plane has at most 200 m a side
COARSEST_M = 0.25
"""cells that walls are never drawn coarser than: they grow by less than one, and a door of 0.8 m stays one"""


def set_part(cells: Booleans) -> tuple[slice, slice]:
    """The rows and the columns from the first set cell to the last one; all where none is set."""
    if not cells.any():
        height, width = cells.shape
        return slice(0, height), slice(0, width)
    rows, columns = (np.flatnonzero(cells.any(axis=axis)) for axis in (1, 0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def cropped(dark: OccupancyGrid) -> OccupancyGrid:
    """The part with wall, centred again; all of it where there is none."""
    if not dark.data.any():
        return dark
    return centred(np.ascontiguousarray(dark.data[set_part(dark.data)]), dark.resolution)


def centred(cells: Booleans, resolution_m: float) -> OccupancyGrid:
    """A grid whose middle is the origin."""
    height, width = cells.shape
    return OccupancyGrid(cells, resolution_m, (-width * resolution_m / 2.0, -height * resolution_m / 2.0))


def coarser(grid: OccupancyGrid, times: int) -> OccupancyGrid:
    """Cells so many times as large, from the same lower left corner on, each the greatest of its cells.

    Of a bool grid those are set in which any cell is. Beyond the grid is 0.
    """
    height, width = grid.data.shape
    padded = np.pad(grid.data, ((0, -height % times), (0, -width % times)))
    parts = padded.reshape(padded.shape[0] // times, times, padded.shape[1] // times, times)
    return OccupancyGrid(np.asarray(parts.max(axis=(1, 3))), grid.resolution * times, grid.origin)


def without_cracks(dark: OccupancyGrid) -> OccupancyGrid:
    """The same with floor as wall that is closed all around and too narrow for a robot.

    Nothing enters it and no beam does, as inside a hatched wall. Floor at the grid's edge is not closed.
    """
    floor = ~dark.data
    _, labels = cv2.connectedComponents(floor.astype(np.uint8), connectivity=4)
    is_kept = np.zeros(int(labels.max()) + 1, np.bool_)
    is_kept[labels[cells_to_unset(floor) * dark.resolution >= DRIVABLE_M]] = True
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        is_kept[edge] = True
    return dark.with_data(~is_kept[labels] | dark.data)


def blocks_of(dark: OccupancyGrid) -> list[Rectangle] | None:
    """Rectangles that are the set cells exactly; None: they are more than an arena may have."""
    found = list(islice(rectangles(dark.data), MOST_BLOCKS + 1))
    return None if len(found) > MOST_BLOCKS else found


def rectangles(dark: Booleans) -> Iterator[Rectangle]:
    """Rectangles that together cover the set cells and no other, none of which could be any larger.

    Each begins at the first cell that is not covered yet, row by row, and grows along its row and then
    across, or the other way round: whichever covers more that is not covered yet. They may overlap.
    """
    missing = dark.copy()
    flat, at = missing.reshape(-1), 0
    while at < flat.size:
        at += int(flat[at:].argmax())
        if not flat[at]:
            return
        row, column = divmod(at, dark.shape[1])
        wide = _grown(dark, row, column)
        left, low, right, high = _grown(dark.T, column, row)
        candidates: tuple[Rectangle, ...] = (wide, (low, left, high, right))
        low, left, high, right = max(
            candidates, key=lambda one: int(missing[one[0] : one[2], one[1] : one[3]].sum())
        )
        missing[low:high, left:right] = False
        yield low, left, high, right


def _grown(dark: Booleans, row: int, column: int) -> Rectangle:
    """The run of set cells along a row that holds a set cell, and as many rows on both sides as are full."""
    right = column + _run(dark[row, column:])
    left = column + 1 - _run(dark[row, column::-1])
    band = dark[:, left:right]
    high = row + _full_rows(band[row:])
    low = row + 1 - _full_rows(band[row::-1])
    return low, left, high, right


def _full_rows(band: Booleans) -> int:
    """How many rows are full from the first on; looks no further than it has to."""
    count, step = 0, 8
    while count < len(band):
        part = np.asarray(band[count : count + step].all(axis=1))
        full = _run(part)
        count, step = count + full, 2 * step
        if full < len(part):
            break
    return count


def _run(cells: Booleans) -> int:
    """How many are set from the first on."""
    return int(np.append(cells, False).argmin())


def sides_of(dark: OccupancyGrid) -> tuple[float, float]:
    """The width and the height of a plan, metres.

    Raises InputError: there is no wall, or it is larger than an arena may be.
    """
    wide_m, high_m = (round(cells * dark.resolution, 9) for cells in (dark.width, dark.height))
    if max(wide_m, high_m) > LONGEST_M:
        raise InputError(
            f"it is {wide_m:g} x {high_m:g} m large, and an arena has at most {LONGEST_M:g} m a side: cut a"
            f" part out of it; or is a cell not {dark.resolution:g} m?"
        )
    if not dark.data.any():
        raise InputError("there is no wall in it: nothing is dark")
    return wide_m, high_m


def arena_of(dark: OccupancyGrid, blocks: list[Rectangle], name: str) -> Arena:
    """An arena whose walls are the set cells of a grid, exactly; its robots are those of any arena.

    Args:
        dark: bool, True where there is wall, centred on the origin; its extent is the enclosure.
        blocks: its rectangles.
        name: the arena's.

    Raises:
        InputError: there is no wall, or it is larger than an arena may be.
    """
    (left, low), side, (wide_m, high_m) = dark.origin, dark.resolution, sides_of(dark)
    corners: list[Corners] = [
        (
            round(left + c0 * side, 9),
            round(low + r0 * side, 9),
            round(left + c1 * side, 9),
            round(low + r1 * side, 9),
        )
        for r0, c0, r1, c1 in blocks
    ]
    values = {
        "name": name,
        "plane_m": (wide_m + 2.0 * GROUND_M, high_m + 2.0 * GROUND_M),
        "enclosure_m": (wide_m, high_m),
        "wall_thickness_m": 0.15,
        "wall_height_m": 1.0,
        "mobile_intruders": {"count": 2},
        "blocks": corners,
    }
    return checked_arena(values, name)


def arena_yaml(arena: Arena, heading: list[str]) -> str:
    """The file of an arena that :func:`arena_of` made, robots and all.

    Args:
        arena: whose blocks are its walls.
        heading: lines that tell where it is from.
    """
    robots, intruders = arena.robots, arena.mobile_intruders
    no_entry = ", ".join(_point(point) for point in arena.no_entry_m)
    return "\n".join(
        [
            *(f"# {' '.join(line.split())}" for line in heading),
            "# Lengths in metres, the origin at the middle of the plane.",
            f"name: {json.dumps(arena.name, ensure_ascii=False)}",
            f"plane_m: {_point(arena.plane_m)}",
            f"enclosure_m: {_point(arena.enclosure_m)}    # its diagonal is p of Eq. 12",
            "wall_thickness_m: 0.15    # of walls that you add as lines",
            "wall_height_m: 1.0",
            "walls: []                 # lines that walls follow, corner by corner: [[0, 0], [2, 0], [2, 1]]",
            f"robots:                   # a team of up to {robots.team} starts in a ring, looking outwards",
            f"  center_m: {_point(robots.center_m)}",
            f"  spacing_m: {robots.spacing_m:g}",
            *([f"  team: {robots.team}"] if robots.team != TEAM else []),
            "stationary_intruders:     # drawn once per seed",
            "  count: 0",
            "  size_m: [0.4, 1.0]",
            "mobile_intruders:         # TurtleBot3 Burgers",
            f"  count: {intruders.count}",
            f"  clear_of_robots_m: {intruders.clear_of_robots_m:.1f}",
            *([f"no_entry_m: [{no_entry}]    # in floor that no robot reaches"] if no_entry else []),
            "blocks:                   # rectangles of wall: x_min, y_min, x_max, y_max",
            *(f"  - [{', '.join(map(_metres, block))}]" for block in arena.blocks),
            "",
        ]
    )


def _point(point: tuple[float, float]) -> str:
    return f"[{_metres(point[0])}, {_metres(point[1])}]"


def _metres(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
