"""``Detector``: what makes boxes of a team's observations, in the place of sections IV.A and IV.B."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import lengths
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation


class Detector(Protocol):
    """A class of these is made anew for each trial, and may remember what it saw.

    It is made of ``(prior_map, range_m)`` and its own options, which have defaults: the map, int8, 100
    occupied, 0 free, -1 unknown, and the distance up to which an intruder has to be found, metres.
    """

    def detect(self, team: Sequence[Observation]) -> Sequence[npt.ArrayLike]:
        """For each robot the boxes of what it sees that the map has not.

        Args:
            team: what each robot tells: its pose, its costmap and its last scan. Others' data must stay as
                they are.

        Returns:
            As many lists of boxes as robots, each (n, 4) or empty: x_min, y_min, x_max, y_max, map frame,
            metres. Allies may be among them.
        """


def groups_of(points: npt.NDArray[np.float64], gap_m: float) -> list[npt.NDArray[np.float64]]:
    """(n, 2) points in the beams' order, cut wherever two neighbours are more than ``gap_m`` apart.

    The last group goes on in the first, as beams go round.
    """
    if not len(points):
        return []
    apart = lengths(points - np.roll(points, 1, axis=0)) > gap_m
    first = int(np.argmax(apart))  # 0 where nothing is apart
    return np.split(np.roll(points, -first, axis=0), np.flatnonzero(np.roll(apart, -first))[1:])


def extents(groups: Sequence[npt.NDArray[np.float64]], margin_m: float) -> BoxArray:
    """(n, 4) the box around each group of points, grown by ``margin_m`` on every side."""
    boxes = [[*group.min(axis=0) - margin_m, *group.max(axis=0) + margin_m] for group in groups]
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
