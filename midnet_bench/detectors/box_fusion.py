"""``Fusion``: what makes one list of the robots' boxes, in the place of Algorithms 3 and 4."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.midnet.detection import BoxArray


class Fusion(Protocol):
    """A class of these is made anew for each trial, of its own options, and may remember what it saw."""

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> npt.ArrayLike:
        """The team's boxes of one frame.

        Args:
            found: for each robot (n, 4) boxes without its allies: x_min, y_min, x_max, y_max, map frame,
                metres. They must stay as they are.
            time_s: of the frame, more at each call.

        Returns:
            (n, 4) boxes, or an empty list.
        """


def ious(some: BoxArray, others: BoxArray) -> npt.NDArray[np.float64]:
    """(n, m) Eq. 7 of each of ``some`` with each of ``others``."""
    return pair_ious(some[:, None], others[None])


def pair_ious(some: BoxArray, others: BoxArray) -> npt.NDArray[np.float64]:
    """(...) Eq. 7 of (..., 4) boxes with as many others."""
    low = np.maximum(some[..., :2], others[..., :2])
    high = np.minimum(some[..., 2:], others[..., 2:])
    both = np.clip(high - low, 0.0, None).prod(axis=-1)
    return np.asarray(both / (areas(some) + areas(others) - both))


def areas(boxes: BoxArray) -> npt.NDArray[np.float64]:
    """(...) square metres of (..., 4) boxes."""
    return np.asarray((boxes[..., 2:] - boxes[..., :2]).prod(axis=-1))


def all_of(found: Sequence[BoxArray]) -> BoxArray:
    """The boxes of all robots, the largest first and then by their corners, whatever the robots' order is."""
    boxes = np.concatenate([*found, np.empty((0, 4))])
    return boxes[np.lexsort((*boxes.T[::-1], -areas(boxes)))]
