"""Sections IV.A and IV.B: what one robot's local grid has and the prior map has not, as boxes in metres.

A costmap becomes a binary grid (IV.A). Cropping (B.1): grids have row 0 at the lowest y, so the paper's
left-top corner is the lowest x and y (item 17). Its H and h are the extents in y (item 13). Lattices are
compared by whole cells; a local grid that lies a fraction of a cell off is shifted by up to one cell, and the
fatter prior map has to cover that. Then subtraction (B.2), and contours (B.3) of which only the boxes are
kept (B.4).
"""

import math
from typing import NamedTuple, TypeVar, cast

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Pose2D, cell_along
from midnet_bench.grid import OccupancyGrid, same_resolution
from midnet_bench.midnet.midnet_settings import Align, Unknown

BinaryArray = npt.NDArray[np.uint8]
Window = tuple[int, int, int, int]
"""x1, y1, x2, y2: where the local grid lies on the prior map, in its cells; half-open, may reach outside"""
BoxArray = Floats  # (n, 4): x_min, y_min, x_max, y_max of each box, metres, map frame

AnyGrid = TypeVar("AnyGrid", np.uint8, np.int8)

OCCUPIED = 0  # black, where something is
FREE = 255  # white, where nothing is, or nothing is known


def binary_map(costs: npt.NDArray[np.int8], thresh: int, unknown: Unknown = "free") -> BinaryArray:
    """The grid E of Eq. 1, uint8 of the costs' shape: 0 where cost >= ``thresh``, else 255.

    Eq. 1 leaves -1 (unknown) out; the text beside it calls such a cell free (item 4). Raises InputError if
    the costs are not int8: as uint8, unknown would read 255 and count as occupied.
    """
    if costs.dtype != np.int8:
        raise InputError(
            f"costmap: its values are {costs.dtype}; int8 is needed, as costmap_2d publishes them:"
            " 0 to 100, and -1 where nothing is known"
        )
    free = costs < np.int8(thresh)
    if unknown == "occupied":
        free &= costs >= 0
    grid = free.view(np.uint8)
    return np.negative(grid, out=grid)  # of bytes: 1 becomes 255


class Crop(NamedTuple):
    """Half-open ranges of cells, equal in size, of the local grid and of the prior map; all 0 if empty."""

    x1_lmap: int
    y1_lmap: int
    x2_lmap: int
    y2_lmap: int
    x1_gmap: int
    y1_gmap: int
    x2_gmap: int
    y2_gmap: int

    @property
    def is_empty(self) -> bool:
        """Whether the window has no cell on the prior map."""
        return self.x1_lmap == self.x2_lmap

    def of_local(self, data: npt.NDArray[AnyGrid]) -> npt.NDArray[AnyGrid]:
        """The covered part of the local grid, a view."""
        return data[self.y1_lmap : self.y2_lmap, self.x1_lmap : self.x2_lmap]

    def of_prior(self, data: BinaryArray) -> BinaryArray:
        """The covered part of the prior map, a view."""
        return data[self.y1_gmap : self.y2_gmap, self.x1_gmap : self.x2_gmap]


EMPTY_CROP = Crop(0, 0, 0, 0, 0, 0, 0, 0)


def robot_cell(pose: Pose2D, prior: OccupancyGrid) -> tuple[int, int]:
    """(x_c, y_c) of Eq. 4: the (column, row) of the prior map where the robot is, by floor (item 16)."""
    (x_0, y_0), r = prior.origin, prior.resolution
    return cell_along(pose.x - x_0, r), cell_along(pose.y - y_0, r)


def window_around(cell: tuple[int, int], width: int, height: int) -> Window:
    """The window of Eqs. 2 and 3, ``width`` x ``height`` cells about the robot's cell.

    Half of an odd size is rounded down: [c - w // 2, c - w // 2 + w) (item 16).
    """
    x1, y1 = cell[0] - width // 2, cell[1] - height // 2
    return x1, y1, x1 + width, y1 + height


def window_at_origin(costmap: OccupancyGrid, prior: OccupancyGrid) -> Window:
    """The window by the costmap's own origin, to the nearest cell of the prior map.

    costmap_2d keeps the robot up to two cells off the window's middle, since its window moves by
    whole cells and lags; this window is where the costmap says it is, not where Eqs. 2 and 3 put it.
    """
    x1 = math.floor((costmap.origin[0] - prior.origin[0]) / prior.resolution + 0.5)
    y1 = math.floor((costmap.origin[1] - prior.origin[1]) / prior.resolution + 0.5)
    return x1, y1, x1 + costmap.width, y1 + costmap.height


def cropping_coordinates(window: Window, prior_width: int, prior_height: int) -> Crop:
    """Algorithm 1, Find Cropping Coordinates: what the window and the prior map have in common.

    The algorithm sets only coordinates that are out of bounds; the others start as the whole local
    grid and the whole window (item 14). A window wholly outside gives an empty crop (item 15).
    """
    x1_gmap, y1_gmap, x2_gmap, y2_gmap = window
    width, height = x2_gmap - x1_gmap, y2_gmap - y1_gmap
    x1_lmap, y1_lmap, x2_lmap, y2_lmap = 0, 0, width, height
    if x1_gmap < 0:
        x1_lmap, x1_gmap = abs(x1_gmap), 0
    if y1_gmap < 0:
        y1_lmap, y1_gmap = abs(y1_gmap), 0
    if x2_gmap > prior_width:
        x2_lmap, x2_gmap = width - (x2_gmap - prior_width), prior_width
    if y2_gmap > prior_height:
        y2_lmap, y2_gmap = height - (y2_gmap - prior_height), prior_height
    if x1_lmap >= x2_lmap or y1_lmap >= y2_lmap:
        return EMPTY_CROP
    return Crop(x1_lmap, y1_lmap, x2_lmap, y2_lmap, x1_gmap, y1_gmap, x2_gmap, y2_gmap)


def crop_to_prior(costmap: OccupancyGrid, prior: OccupancyGrid, pose: Pose2D, align: Align = "floor") -> Crop:
    """Section IV.B.1 in full: the cells that the local grid and the prior map have in common.

    ``align``: ``floor``, Eqs. 2 to 4 from the robot's pose; ``origin``, from the costmap's own origin. Raises
    InputError if the two grids differ in resolution (item 19).
    """
    if not same_resolution(costmap.resolution, prior.resolution):
        raise InputError(
            f"costmap: resolution {costmap.resolution:g} m differs from the prior map's"
            f" {prior.resolution:g} m; give both the same"
        )
    if align == "origin":
        window = window_at_origin(costmap, prior)
    else:
        height, width = costmap.data.shape
        window = window_around(robot_cell(pose, prior), width, height)
    prior_height, prior_width = prior.data.shape
    return cropping_coordinates(window, prior_width, prior_height)


def common_occupancy(a: BinaryArray, b: BinaryArray) -> BinaryArray:
    """C of Eq. 5: 0 where both ``a`` (local) and ``b`` (prior) are occupied, else 255 (item 20).

    Both are uint8 of one shape with at least one cell, 0 or 255.
    """
    return cast(BinaryArray, cv2.bitwise_or(a, b))


def foreground(a: BinaryArray, c: BinaryArray) -> BinaryArray:
    """D of Eq. 6, |A - C|: 255 where ``a`` is occupied and ``c`` is not, else 0.

    Plain subtraction of bytes would wrap round to 1 instead of 255 (item 21).
    """
    return cast(BinaryArray, cv2.absdiff(a, c))


def bounding_boxes(
    d: BinaryArray, first_cell: tuple[int, int], prior: OccupancyGrid, min_area_cells: int = 1
) -> BoxArray:
    """The upright rectangle around the outer contour of each blob of D: (n, 4), metres, map frame.

    A box spans the outer edges of its cells, so one cell is one resolution wide (item 24). Edges are
    counted from the prior map's origin: two robots that find the same cells give equal boxes. Blobs are
    8-connected. What lies in a hole is left out: a hollow blob is one object (item 22). The blob that
    starts in the highest row comes first. ``first_cell``: (column, row) on the prior map of D's cell (0, 0);
    rectangles of fewer than ``min_area_cells`` cells are dropped; 1 keeps all (item 23).
    """
    contours = cv2.findContours(d, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0] if d.size else ()
    column, row = first_cell
    corners = [
        (column + x, row + y, column + x + width, row + y + height)
        for x, y, width, height in map(cv2.boundingRect, contours)
        if width * height >= min_area_cells
    ]
    return np.array(corners).reshape(-1, 4) * prior.resolution + (*prior.origin, *prior.origin)


def with_returns(boxes: BoxArray, points: Floats, shares: Floats, least: int) -> BoxArray:
    """The boxes that hold at least ``least`` of (m, 2) points, map frame, each by its share of 0 to 1.

    The paper has no such rule. One return alone may be a phantom, and inflation makes a box of many cells of
    it, so that ``min_area_cells`` cannot tell it from a person.
    """
    x, y = points[:, 0, None], points[:, 1, None]
    inside = (x >= boxes[:, 0]) & (x <= boxes[:, 2]) & (y >= boxes[:, 1]) & (y <= boxes[:, 3])
    return boxes[np.where(inside, shares[:, None], 0.0).sum(axis=0) >= least]


def shrunk(boxes: BoxArray, margin_m: float) -> BoxArray:
    """Boxes with ``margin_m`` taken off every side, never past their own centres (item 25)."""
    low, high = boxes[:, :2], boxes[:, 2:]
    margins = np.minimum(margin_m, (high - low) / 2.0)
    return np.concatenate((low + margins, high - margins), axis=1)
