"""Where the guards go next: the random patrol of section V.B."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.grid import OccupancyGrid

CLEARANCE_M = 0.4
"""Third condition of section V.B: patrol points keep this far from any occupied cell."""

DRAWS_PER_RELAXATION = 200
RELAXATION = 0.9
"""After so many failed draws z shrinks by this factor (paper-notes item 59)."""

Point = tuple[float, float]


def safe_distance(diagonal_m: float, robots: int, z_factor: float = 0.5) -> float:
    """The distance z of Eq. 12, metres: p / 2q with p the enclosure's diagonal and q the number of robots."""
    return z_factor * diagonal_m / robots


def points_clear_of_walls(
    prior_map: OccupancyGrid, reachable: npt.NDArray[np.bool_], clearance_m: float = CLEARANCE_M
) -> npt.NDArray[np.float64]:
    """(n, 2) centres, metres, of the reachable cells at least ``clearance_m`` from every occupied cell.

    ``prior_map`` holds published occupancy (100 occupied); ``reachable`` is a mask of its shape. Distance
    runs from centre to centre.
    """
    free = (prior_map.data != 100).astype(np.uint8)
    distance_m = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * prior_map.resolution
    rows, columns = np.nonzero((distance_m >= clearance_m) & reachable)
    return np.column_stack(
        [
            prior_map.origin[0] + (columns + 0.5) * prior_map.resolution,
            prior_map.origin[1] + (rows + 0.5) * prior_map.resolution,
        ]
    )


class Patrol:
    """Draws patrol points for a team and counts how often the paper's conditions had to be relaxed."""

    def __init__(self, points: npt.NDArray[np.float64], z_m: float, rng: np.random.Generator) -> None:
        """``points`` (n, 2), metres: where a patrol point may lie; ``z_m``: Eq. 12."""
        self.points = points
        self.z_m = z_m
        self.relaxations = 0
        self._rng = rng

    def next_point(self, position: Point, goals_of_others: Sequence[Point]) -> Point:
        """A random point at least z from ``position`` and from each goal of the others, metres.

        Robots without a goal are left out of ``goals_of_others`` (item 60); distances are straight lines
        (item 61). One robot at the centre of an arena has no such point at all, so z shrinks by a tenth
        after every 200 draws that fail, for this draw only (item 59).
        """
        keep_away = np.array([position, *goals_of_others], dtype=np.float64)
        z_m = self.z_m
        while True:
            draws = self.points[self._rng.integers(len(self.points), size=DRAWS_PER_RELAXATION)]
            gaps = draws[:, None, :] - keep_away[None, :, :]
            good = np.flatnonzero(np.hypot(gaps[..., 0], gaps[..., 1]).min(axis=1) >= z_m)
            if len(good):
                x, y = draws[good[0]]
                return float(x), float(y)
            z_m = z_m * RELAXATION if z_m > 0.01 else -math.inf
            self.relaxations += 1
