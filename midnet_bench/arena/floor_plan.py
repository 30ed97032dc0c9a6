"""``arena_yaml``: an arena's file out of a grid of wall and floor, such as a drawn plan or a map."""

import json
import math
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.agents.patrol import DRIVABLE_M
from midnet_bench.arena.arena import MOST_BLOCKS
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M, TEAM
from midnet_bench.errors import InputError
from midnet_bench.geometry import Booleans, Indices, mean_point
from midnet_bench.grid import OccupancyGrid, cells_to_unset

Rectangle = tuple[int, int, int, int]
"""first row, first column, one past the last row, one past the last column"""

SPACING_M = 0.6  # between the starts of two guards, as in Map 1
START_CLEARANCE_M = SPACING_M / 2.0 / math.sqrt(0.345) + ROBOT_CLEARANCE_M
"""about the centre of the ring on which a team of five starts: sin(36 deg) squared is 0.345"""
GROUND_M = 1.0  # of the plane, on each side of the enclosure
ROOM_SHARE = 0.05  # A room inside has at least this share of the floor of the largest one.


def dark_cells(pixels: npt.NDArray[np.uint8], resolution_m: float) -> OccupancyGrid:
    """A bool grid centred on the origin: True where a pixel is darker than half-way to white.

    Args:
        pixels: (height, width, channels) uint8, row 0 at the top: grey, colours, or colours and alpha. What
            is mostly transparent is floor.
        resolution_m: side of a pixel.
    """
    colours = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, :1]
    dark = colours.sum(axis=2, dtype=np.uint16) < 128 * colours.shape[2]
    if pixels.shape[2] == 4:
        dark &= pixels[:, :, 3] >= 128
    return centred(np.ascontiguousarray(dark[::-1]), resolution_m)


class Speck(NamedTuple):
    """A small piece of wall that touches no other: dirt, lettering, or a pillar."""

    size_m: float  # its longest side along an axis
    at: tuple[float, float]  # its middle, metres


def without_specks(dark: OccupancyGrid, most_m: float) -> OccupancyGrid:
    """The same without pieces of wall that are at most ``most_m`` long along both axes."""
    labels, _, small = _pieces_up_to(dark, most_m)
    return dark.with_data(dark.data & ~np.isin(labels, small))


def specks(dark: OccupancyGrid, most_m: float) -> list[Speck]:
    """The pieces of wall that are at most ``most_m`` long along both axes, the largest first."""
    _, boxes, small = _pieces_up_to(dark, most_m)
    found = []
    for left, low, width, height in boxes[small].tolist():
        x = float(dark.x_centers[[left, left + width - 1]].sum()) / 2.0
        y = float(dark.y_centers[[low, low + height - 1]].sum()) / 2.0
        found.append(Speck(max(width, height) * dark.resolution, (x, y)))
    return sorted(found, key=lambda speck: -speck.size_m)


def _pieces_up_to(
    dark: OccupancyGrid, most_m: float
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], Indices]:
    """Each cell's piece; each piece's first column and row, width and height; the pieces small enough."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(dark.data.astype(np.uint8), connectivity=8)
    sides_m = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * dark.resolution
    return np.asarray(labels), np.asarray(stats[:, :4]), 1 + np.flatnonzero(sides_m <= most_m + 1e-9)


def cropped(dark: OccupancyGrid) -> OccupancyGrid:
    """The part with wall, centred again; all of it where there is none."""
    rows, columns = np.nonzero(dark.data)
    if not len(rows):
        return dark
    part = dark.data[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    return centred(np.ascontiguousarray(part), dark.resolution)


def centred(cells: Booleans, resolution_m: float) -> OccupancyGrid:
    """A grid whose middle is the origin."""
    height, width = cells.shape
    return OccupancyGrid(cells, resolution_m, (-width * resolution_m / 2.0, -height * resolution_m / 2.0))


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
    high = row + _run(np.all(band[row:], axis=1))
    low = row + 1 - _run(np.all(band[row::-1], axis=1))
    return low, left, high, right


def _run(cells: Booleans) -> int:
    """How many are set from the first on."""
    return int(np.append(cells, False).argmin())


def start_of_guards(dark: OccupancyGrid) -> tuple[float, float]:
    """Where a team may start: with room about it, near the middle of the largest room.

    A room is the floor that a Burger can drive to from one place. One that the grid's edge does not cut comes
    first, if it is no mere nook: what lies around a building is no room of it.

    Raises:
        InputError: there is no floor.
    """
    floor = (~dark.data).astype(np.uint8)
    gap_m = cells_to_unset(floor) * dark.resolution
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        (floor * (gap_m >= DRIVABLE_M)).astype(np.uint8), connectivity=4
    )
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    if not areas.any():
        raise InputError(f"there is no floor in it that is {2 * DRIVABLE_M:g} m wide")
    edges = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    inner = areas.copy()
    inner[edges] = 0
    is_room = inner.max() >= ROOM_SHARE * areas.max()
    # the grid's edge counts as wall
    room_m = cells_to_unset(np.pad(floor, 1))[1:-1, 1:-1]
    room_m = np.where(labels == (inner if is_room else areas).argmax(), room_m * dark.resolution, 0.0)
    rows, columns = np.nonzero(room_m >= min(START_CLEARANCE_M, float(room_m.max())))
    x, y = dark.x_centers[columns], dark.y_centers[rows]
    middle_x, middle_y = mean_point(np.stack((x, y), axis=1))
    nearest = int(np.argmin(np.square(x - middle_x) + np.square(y - middle_y)))
    return float(x[nearest]), float(y[nearest])


def arena_yaml(dark: OccupancyGrid, name: str, heading: list[str]) -> str:
    """The file of an arena whose walls are the set cells, exactly.

    Args:
        dark: bool, True where there is wall, centred on the origin; its extent is the enclosure.
        name: the arena's.
        heading: lines that tell where it is from.

    Raises:
        InputError: there is no wall or no floor, or the walls take too many rectangles.
    """
    blocks = list(islice(rectangles(dark.data), MOST_BLOCKS + 1))
    if len(blocks) > MOST_BLOCKS:
        raise InputError(
            f"its walls take more than {MOST_BLOCKS} rectangles; shrink the image, or draw slanted and "
            "ragged walls plainer"
        )
    if not blocks:
        raise InputError("there is no wall in it: nothing is dark")
    x, y = start_of_guards(dark)
    (left, low), side = dark.origin, dark.resolution
    corners = (
        (left + c0 * side, low + r0 * side, left + c1 * side, low + r1 * side) for r0, c0, r1, c1 in blocks
    )
    wide_m, high_m = dark.width * side, dark.height * side
    return "\n".join(
        [
            *(f"# {' '.join(line.split())}" for line in heading),
            "# Lengths in metres, the origin at the middle of the plane.",
            f"name: {json.dumps(name, ensure_ascii=False)}",
            f"plane_m: [{_metres(wide_m + 2 * GROUND_M)}, {_metres(high_m + 2 * GROUND_M)}]",
            f"enclosure_m: [{_metres(wide_m)}, {_metres(high_m)}]    # its diagonal is p of Eq. 12",
            "wall_thickness_m: 0.15    # of walls that you add as lines",
            "wall_height_m: 1.0",
            "walls: []                 # lines that walls follow, corner by corner: [[0, 0], [2, 0], [2, 1]]",
            f"robots:                   # a team of up to {TEAM} starts in a ring, looking outwards",
            f"  center_m: [{_metres(x)}, {_metres(y)}]",
            f"  spacing_m: {SPACING_M:g}",
            "stationary_intruders:     # drawn once per seed",
            "  count: 0",
            "  size_m: [0.4, 1.0]",
            "mobile_intruders:         # TurtleBot3 Burgers",
            "  count: 2",
            "  clear_of_robots_m: 1.0",
            "blocks:                   # rectangles of wall: x_min, y_min, x_max, y_max",
            *(f"  - [{', '.join(map(_metres, block))}]" for block in corners),
            "",
        ]
    )


def _metres(value: float) -> str:
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
