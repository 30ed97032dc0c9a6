"""Section IV.B.2: what the local grid has and the prior map has not."""

from typing import cast

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.midnet.binary_map import FREE, OCCUPIED

BinaryArray = npt.NDArray[np.uint8]


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


def foreground_directly(a: BinaryArray, b: BinaryArray) -> BinaryArray:
    """D without C, what Eqs. 5 and 6 amount to: 255 where A is occupied and B is free, else 0."""
    return ((a == OCCUPIED) & (b == FREE)).view(np.uint8) * np.uint8(255)
