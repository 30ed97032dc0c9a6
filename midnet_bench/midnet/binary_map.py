"""Section IV.A: a costmap as a binary grid."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from midnet_bench.settings import Settings, option

OCCUPIED = 0
"""black, where something is"""
FREE = 255
"""white, where nothing is, or nothing is known"""

INT8 = np.dtype(np.int8)

Unknown = Literal["free", "occupied"]


@dataclass(frozen=True)
class PriorMapSettings(Settings):
    """How the prior map's costmap becomes the grid that is subtracted."""

    thresh: int = option(
        30,
        "Cost from which a cell of the prior map's costmap counts as occupied, thresh of Eq. 1; 30 is"
        " 0.225 m around a wall, a higher one reaches less far.",
        ge=1,
        le=100,
        key="thresh_global",
        source="ours: II.A and IV.A give no number; 0.12 m farther than thresh_local",
    )
    unknown: Unknown = option(
        "free",
        "What counts as lying in cells of the prior map that nobody has explored: nothing (free) or a"
        " wall (occupied).",
        key="unknown_in_prior",
        source="paper: IV.A, white is a free or an unknown cell",
    )


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
    if costs.dtype != INT8:
        raise ValueError(f"costs are {costs.dtype}; int8 is needed, where -1 means unknown")
    free = costs < np.int8(thresh)
    if unknown == "occupied":
        free &= costs >= 0
    grid = free.view(np.uint8)
    return np.negative(grid, out=grid)  # of bytes: 1 becomes 255
