"""Sections IV.B.2 to IV.B.4: what the local grid has and the prior map has not, as boxes in metres."""

from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid

BinaryArray = npt.NDArray[np.uint8]
Contour = npt.NDArray[np.int32]


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


def find_contours(d: npt.NDArray[np.uint8]) -> Sequence[Contour]:
    """The outer border of each 8-connected blob of D, each (n, 1, 2) int32, (column, row).

    Borders of holes are left out: a hollow blob is one object (item 22). The blobs come in OpenCV's
    order, the one that starts in the highest row first.
    """
    contours, _ = cv2.findContours(d, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return cast(Sequence[Contour], contours)


def bounding_boxes(
    contours: Sequence[Contour],
    first_cell: tuple[int, int],
    prior: OccupancyGrid,
    min_area_cells: int = 1,
) -> list[Box]:
    """The upright rectangle around each contour, metres, map frame.

    A box spans the outer edges of its cells, so one cell is one resolution wide (item 24). Edges are
    counted from the prior map's origin: two robots that find the same cells give equal boxes.

    Args:
        contours: of :func:`find_contours`.
        first_cell: (column, row) on the prior map of the cropped grid's cell (0, 0).
        prior: the prior map.
        min_area_cells: rectangles of fewer cells are dropped; 1 keeps all (item 23).
    """
    x0, y0 = prior.origin
    resolution = prior.resolution
    boxes = []
    for contour in contours:
        column, row, width, height = cv2.boundingRect(contour)
        if width * height < min_area_cells:
            continue
        column += first_cell[0]
        row += first_cell[1]
        boxes.append(
            Box(
                x0 + column * resolution,
                y0 + row * resolution,
                x0 + (column + width) * resolution,
                y0 + (row + height) * resolution,
            )
        )
    return boxes
