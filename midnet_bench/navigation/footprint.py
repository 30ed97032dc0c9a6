"""A robot's outline: convex polygons in its base frame, their radii and their place in the world."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.navigation.costmap_kernels import placed

Footprint = tuple[tuple[float, float], ...]
"""the corners of a convex polygon in order, (x, y) in the base frame, metres"""

BURGER: Footprint = ((-0.105, -0.105), (-0.105, 0.105), (0.041, 0.105), (0.041, -0.105))
"""TurtleBot3 Burger (costmap_common_params_burger.yaml), unpadded"""


def padded(footprint: Footprint, padding_m: float) -> Footprint:
    """Each coordinate moved away from zero by ``padding_m``; a zero stays (costmap_2d's rule)."""

    def grown(value: float) -> float:
        return value + math.copysign(padding_m, value) if value else value

    return tuple((grown(x), grown(y)) for x, y in footprint)


BURGER_PADDED = padded(BURGER, 0.01)
"""with costmap_2d's own padding"""


def radii(footprint: Footprint) -> tuple[float, float]:
    """(inscribed, circumscribed) radius about the base frame's origin, metres."""
    corners = np.asarray(footprint, dtype=np.float64)
    edges = np.roll(corners, -1, axis=0) - corners
    along = np.clip(-(corners * edges).sum(axis=1) / (edges * edges).sum(axis=1), 0.0, 1.0)
    nearest = corners + along[:, None] * edges
    return float(np.hypot(*nearest.T).min()), float(np.hypot(*corners.T).max())


def at_pose(corners: npt.NDArray[np.float64], pose: Pose2D) -> npt.NDArray[np.float64]:
    """(N, 2) corners, given in the base frame, in the frame in which ``pose`` is given, metres."""
    return np.asarray(placed(corners, (pose.x, pose.y, pose.yaw)))


def corner_array(footprint: Footprint) -> npt.NDArray[np.float64]:
    """(N, 2) float64 corners, metres."""
    return np.array(footprint, dtype=np.float64).reshape(-1, 2)
