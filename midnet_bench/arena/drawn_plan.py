"""``plan_of``: what of a drawn plan is wall, and what is a line of another meaning."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.arena.floor_plan import centred, cropped, set_part, without_cracks
from midnet_bench.geometry import Booleans, Indices
from midnet_bench.grid import OccupancyGrid

DARK = 128  # of 255: a pixel whose colours are darker on average is wall
COLOURED = 64  # of 255: between a pixel's strongest and weakest colour, from here on it is no grey
SPECK_M = 0.6  # up to this length a piece of wall that touches no other may be dirt or a letter
SHOWN_SPECKS = 5
THIN_SHARE = 0.6  # of the usual thickness: what is thinner may be no wall
LINE_M = 0.5  # A thin line has at least this length.
MOSTLY_DARK = 0.6  # of the pixels
FAINT_SHARE = 0.02  # of the wall's pixels: less of another kind is not worth a word
HEALED_M = 0.15  # thickness up to which a coloured line across a wall leaves no gap in it


class Kind(IntEnum):
    """What became of a pixel."""

    FLOOR = 0
    WALL = 1
    FILLED = 2  # floor as wall: closed all around, and too narrow for a robot
    COLOURED = 3  # floor from here on
    THIN = 4
    SPECK = 5
    BESIDE = 6
    PALE = 7  # darker than usual walls need, and lighter than the threshold


@dataclass(frozen=True)
class Drawing:
    """How walls are drawn in a plan, and what of it is none."""

    threshold: int = DARK  # 1 to 255: what is darker is wall
    has_light_walls: bool = False  # light lines on a dark ground: as if all colours were inverted
    drops_coloured: bool = False  # what has a colour is floor
    drop_thin_m: float = 0.0  # lines thinner than this are floor
    drop_specks_m: float = 0.0  # pieces of wall that touch no other and are at most as long are floor
    drops_beside: bool = False  # what lies wholly beside the largest piece of wall is floor


class Plan(NamedTuple):
    """A plan that was read."""

    kinds: OccupancyGrid
    """uint8, of ``Kind``, the whole image in the arena's frame: the middle of ``walls`` is the origin"""
    walls: OccupancyGrid  # bool, without the blank margin, centred on the origin


class Speck(NamedTuple):
    """A small piece of wall that touches no other: dirt, lettering, or a pillar."""

    size_m: float  # its longest side along an axis
    at: tuple[float, float]  # its middle, metres


def plan_of(pixels: npt.NDArray[np.uint8], resolution_m: float, drawing: Drawing) -> Plan:
    """What became of each pixel of an image.

    Args:
        pixels: (height, width, channels) uint8, row 0 at the top: grey, colours, or colours and alpha. What
            is mostly transparent is floor.
        resolution_m: side of a pixel.
        drawing: how it is drawn.
    """
    dark = dark_cells(pixels, resolution_m, drawing)
    kinds = dark.with_data(dark.data.astype(np.uint8))
    if drawing.threshold < DARK:
        pale = dark_cells(pixels, resolution_m, Drawing(has_light_walls=drawing.has_light_walls)).data
        kinds.data[pale & ~dark.data] = Kind.PALE
    if drawing.drops_coloured:
        _drop(kinds, ~_without_colours(dark.data, _coloured(pixels), resolution_m), Kind.COLOURED)
    filled = without_cracks(_walls(kinds)).data & (kinds.data != Kind.WALL)
    kinds.data[filled] = Kind.FILLED
    if drawing.drop_thin_m > 0.0:
        _drop(kinds, ~_opened(_walls(kinds).data, _pixels(drawing.drop_thin_m, resolution_m)), Kind.THIN)
    _drop(kinds, ~without_specks(_walls(kinds), drawing.drop_specks_m).data, Kind.SPECK)
    if drawing.drops_beside:
        _drop(kinds, _beside(_walls(kinds).data), Kind.BESIDE)
    walls = _walls(kinds)
    inner, (rows, columns) = cropped(walls), set_part(walls.data)
    origin = inner.origin[0] - columns.start * resolution_m, inner.origin[1] - rows.start * resolution_m
    return Plan(OccupancyGrid(kinds.data, resolution_m, origin), inner)


def dark_cells(
    pixels: npt.NDArray[np.uint8], resolution_m: float, drawing: Drawing | None = None
) -> OccupancyGrid:
    """A bool grid centred on the origin: True where a pixel is darker than the threshold; see ``plan_of``."""
    drawing = drawing or Drawing()
    colours = pixels[:, :, :3] if pixels.shape[2] >= 3 else pixels[:, :, :1]
    channels = colours.shape[2]
    sums = colours.sum(axis=2, dtype=np.uint16)
    if drawing.has_light_walls:
        sums = (255 * channels - sums).astype(np.uint16)
    dark = sums < drawing.threshold * channels
    if pixels.shape[2] == 4:
        dark &= pixels[:, :, 3] >= 128
    return centred(np.ascontiguousarray(dark[::-1]), resolution_m)


def remarks(pixels: npt.NDArray[np.uint8], plan: Plan, drawing: Drawing) -> Iterator[str]:
    """What in a plan may be no wall, each with the option that makes it floor."""
    resolution_m, walls = plan.kinds.resolution, _walls(plan.kinds).data
    drawn = plan.kinds.data == Kind.WALL
    count = np.count_nonzero(drawn)
    if not count:
        return
    if not drawing.has_light_walls and count > MOSTLY_DARK * walls.size:
        yield f"{count / walls.size:.0%} of the image is wall: are walls drawn light on dark? --walls light"
    colours = drawn & _coloured(pixels)
    if not drawing.drops_coloured and np.count_nonzero(colours) > FAINT_SHARE * count:
        share = np.count_nonzero(colours) / count
        yield f"{share:.0%} of the wall is drawn in colour: dimension lines? --drop-coloured makes it floor"
    level = drawing.threshold // 2
    black = dark_cells(pixels, resolution_m, Drawing(level, drawing.has_light_walls)).data
    # of a black line's soft edges no pixel is far from it
    soft = cv2.dilate(black.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    grey = np.count_nonzero(drawn & ~soft & ~colours)
    if black.any() and grey > FAINT_SHARE * count:
        yield (
            f"{grey / count:.0%} of the wall is grey, not black: door arcs, furniture?"
            f" --threshold {level} makes it floor"
        )
    if drawing.drop_thin_m == 0.0 and (thin := _thin_lines(walls, resolution_m)):
        length_m, least_m, usual_m = thin
        yield (
            f"about {length_m:.0f} m of lines are thinner than {least_m:.3g} m, walls are {usual_m:.2g} m"
            f" thick: door arcs, dimension lines? --drop-thin {least_m:.3g} makes them floor"
        )
    if small := specks(_walls(plan.kinds), SPECK_M):
        places = ", ".join(f"({x:.2f}, {y:.2f})" for _, (x, y) in small[:SHOWN_SPECKS])
        more = ", ..." if len(small) > SHOWN_SPECKS else ""
        size_m = math.ceil(small[0].size_m * 100.0 - 1e-6) / 100.0
        yield (
            f"{len(small)} small piece{'s' if len(small) > 1 else ''} of wall up to {size_m:g} m long, at"
            f" {places}{more}: specks or lettering? --drop-specks {size_m:g} makes them floor"
        )
    if not drawing.drops_beside and (beside := _pieces(_beside(walls))):
        yield (
            f"{beside} piece{'s' if beside > 1 else ''} of wall lie{'' if beside > 1 else 's'} beside the"
            " building: a title, a scale bar, dimension lines? --drop-beside makes them floor"
        )


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


def _walls(kinds: OccupancyGrid) -> OccupancyGrid:
    return kinds.with_data((kinds.data == Kind.WALL) | (kinds.data == Kind.FILLED))


def _drop(kinds: OccupancyGrid, dropped: Booleans, kind: Kind) -> None:
    kinds.data[dropped & _walls(kinds).data] = kind


def _coloured(pixels: npt.NDArray[np.uint8]) -> Booleans:
    """Where an image is no grey, the lowest row first."""
    if pixels.shape[2] < 3:
        return np.zeros(pixels.shape[:2], np.bool_)
    colours = pixels[::-1, :, :3]
    return np.asarray(colours.max(axis=2) - colours.min(axis=2) >= COLOURED)


def _without_colours(dark: Booleans, coloured: Booleans, resolution_m: float) -> Booleans:
    """Dark pixels without coloured lines; where such a line crosses a wall, the wall goes on."""
    kept = dark & ~coloured
    healed = _closed(kept, min(_thickness(dark & coloured), _pixels(HEALED_M, resolution_m)) + 2)
    return kept | (dark & coloured & healed)


def _pixels(length_m: float, resolution_m: float) -> int:
    return max(1, math.ceil(length_m / resolution_m - 1e-6))


def _disc(pixels: int) -> npt.NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (pixels, pixels)), np.uint8)


def _opened(dark: Booleans, pixels: int) -> Booleans:
    """The dark pixels of lines that are at least so many pixels thick."""
    opened = _morphed(dark, cv2.MORPH_OPEN, _disc(pixels))
    # a disc does not reach into corners
    side = 2 * math.ceil(0.21 * pixels) + 1
    return dark & (cv2.dilate(opened.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _closed(dark: Booleans, pixels: int) -> Booleans:
    """The dark pixels and what lies in gaps between them that are less than so many pixels wide."""
    return _morphed(dark, cv2.MORPH_CLOSE, np.ones((pixels, pixels), np.uint8))


def _morphed(dark: Booleans, operation: int, kernel: npt.NDArray[np.uint8]) -> Booleans:
    """``cv2.morphologyEx``, as if floor went on around the image."""
    margin = max(kernel.shape)
    padded = np.pad(dark.astype(np.uint8), margin)
    return np.asarray(cv2.morphologyEx(padded, operation, kernel)[margin:-margin, margin:-margin] > 0)


def _thickness(dark: Booleans) -> int:
    """How many pixels lines are thick: half of the dark area is in lines at least as thick; 0 without any."""
    area = np.count_nonzero(dark)
    low, high = 0, max(dark.shape) + 1
    while area and high - low > 1:
        middle = min((low + high) // 2, 2 * low + 1)
        opened = _morphed(dark, cv2.MORPH_OPEN, np.ones((middle, middle), np.uint8))
        low, high = (middle, high) if 2 * np.count_nonzero(opened) >= area else (low, middle)
    return low


def _thin_lines(walls: Booleans, resolution_m: float) -> tuple[float, float, float] | None:
    """Length of the lines that are thinner than most; the thickness that parts them; that of most; metres."""
    usual = _thickness(walls)
    least = max(2, math.ceil(THIN_SHARE * usual))
    if least >= usual:
        return None
    thin = walls & ~_opened(walls, least)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thin.astype(np.uint8), connectivity=8)
    sides = stats[1:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1)
    long = 1 + np.flatnonzero(sides * resolution_m >= LINE_M)
    lines = np.isin(labels, long)
    if not lines.any():
        return None
    length_m = float(np.count_nonzero(lines)) / max(1, _thickness(lines)) * resolution_m
    return length_m, least * resolution_m, usual * resolution_m


def _beside(walls: Booleans) -> Booleans:
    """Pieces of wall that lie wholly beside the rectangle about the largest one."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(walls.astype(np.uint8), connectivity=8)
    if len(stats) < 3:
        return np.zeros_like(walls)
    left, low, width, height = stats[:, :4].T
    main = 1 + int((width[1:] * height[1:]).argmax())
    beside = (left >= left[main] + width[main]) | (left + width <= left[main])
    beside |= (low >= low[main] + height[main]) | (low + height <= low[main])
    beside[0] = False
    return np.asarray(beside[labels])


def _pieces(cells: Booleans) -> int:
    return int(cv2.connectedComponents(cells.astype(np.uint8), connectivity=8)[0]) - 1
