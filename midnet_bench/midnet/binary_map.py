"""Section IV.A: a costmap as a binary grid."""

from typing import Literal

import numpy as np
import numpy.typing as npt

OCCUPIED = 0
"""black, where something is"""
FREE = 255
"""white, where nothing is, or nothing is known"""

Unknown = Literal["free", "occupied"]


def binary_map(costs: npt.NDArray[np.int8], thresh: int, unknown: Unknown = "free") -> npt.NDArray[np.uint8]:
    """The grid E of Eq. 1, uint8 of the costs' shape: 0 where cost >= ``thresh``, else 255.

    Eq. 1 leaves -1 (unknown) out; the text beside it calls such a cell free (item 4).

    Args:
        costs: int8 of any shape, published costs: 0 to 100, -1 unknown.
        thresh: in the same units, 1 to 100.
        unknown: what a cell of cost -1 becomes.

    Raises:
        ValueError: the costs are not int8 (as uint8, unknown would read 255 and count as occupied).
    """
    if costs.dtype != np.int8:
        raise ValueError(f"costs are {costs.dtype}; int8 is needed, where -1 means unknown")
    free = costs < thresh
    if unknown == "occupied":
        free &= costs >= 0
    return free.view(np.uint8) * np.uint8(FREE)
