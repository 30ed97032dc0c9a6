"""What the bytes of a costmap mean, and what they become when a costmap is published (costmap_2d)."""

import math

import cv2
import numpy as np
import numpy.typing as npt

FREE_SPACE = 0
INSCRIBED = 253
"""the robot's centre here means contact, whatever its heading"""
LETHAL = 254
"""an obstacle is in this cell"""
NO_INFORMATION = 255

OCCUPIED = 100
"""an occupancy grid's surely occupied cell"""


def _published_values() -> npt.NDArray[np.int8]:
    table = np.zeros(256, dtype=np.int8)
    graded = np.arange(1, INSCRIBED)
    table[graded] = 1 + 97 * (graded - 1) // 251
    table[INSCRIBED] = 99
    table[LETHAL] = OCCUPIED
    table[NO_INFORMATION] = -1
    return table


PUBLISHED = _published_values()
"""(256,) int8: published occupancy of each cost: 0 -> 0, 1..252 -> 1..98, 253 -> 99, 254 -> 100, 255 -> -1"""


def published(costs: npt.NDArray[np.uint8]) -> npt.NDArray[np.int8]:
    """(H, W) int8 occupancy values of a costmap, as costmap_2d publishes them."""
    return np.asarray(cv2.LUT(costs, PUBLISHED), dtype=np.int8)


def inflation_costs(
    reach_cells: int, resolution: float, inscribed_radius_m: float, cost_scaling_factor: float
) -> npt.NDArray[np.uint8]:
    """(reach_cells**2 + 1,) uint8: a cell's cost by its squared distance, in cells, to a lethal one.

    254 at 0, 253 within the inscribed radius, then 252 exp(-k (distance - inscribed radius)), truncated.
    """
    distance_m = np.sqrt(np.arange(reach_cells**2 + 1)) * resolution
    beyond_m = np.maximum(distance_m - inscribed_radius_m, 0.0)
    graded = (252.0 * np.exp(-cost_scaling_factor * beyond_m)).astype(np.uint8)
    costs = np.where(beyond_m == 0.0, np.uint8(INSCRIBED), graded)
    costs[0] = LETHAL
    return costs


def reach_cells(radius_m: float, resolution: float) -> int:
    """A length as whole cells, rounded up, at least 0: how costmap_2d turns radii and ranges into cells."""
    return max(0, math.ceil(round(radius_m / resolution, 9)))
