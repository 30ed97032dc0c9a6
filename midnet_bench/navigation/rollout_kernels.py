"""What both local planners compile: velocity samples, the cost under a footprint's outline."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.navigation.costmap_kernels import line_steps

Cells = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

ILLEGAL = -1
_LETHAL = 254


@njit(cache=True)
def velocity_samples(low: float, high: float, count: int) -> Floats:
    """``count`` (at least 2) evenly spaced values from low to high, and 0 if they straddle it without a hit.

    One value when low equals high.
    """
    if low == high:
        return np.full(1, low)
    n = max(2, count)
    samples = np.empty(n + 1)
    size = 0
    for i in range(n):
        value = high if i == n - 1 else low + i * (high - low) / (n - 1)
        if size > 0 and samples[size - 1] < 0.0 < value:
            samples[size] = 0.0
            size += 1
        samples[size] = value
        size += 1
    return samples[:size]


@njit(cache=True)
def outline_cost(costs: Cells, x: float, y: float, cos_yaw: float, sin_yaw: float, footprint: Floats) -> int:
    """The highest cost under a footprint's outline; -1 if it is lethal or unknown there or off the grid.

    x, y and ``footprint`` (N, 2) in cells. The inside is not examined, and 253 is legal.
    """
    height, width = costs.shape
    flat = costs.reshape(-1)
    n = len(footprint)
    highest = 0
    old_x = x + cos_yaw * footprint[n - 1, 0] - sin_yaw * footprint[n - 1, 1]
    old_y = y + sin_yaw * footprint[n - 1, 0] + cos_yaw * footprint[n - 1, 1]
    if not (0.0 <= old_x < width and 0.0 <= old_y < height):
        return ILLEGAL
    for i in range(n):
        new_x = x + cos_yaw * footprint[i, 0] - sin_yaw * footprint[i, 1]
        new_y = y + sin_yaw * footprint[i, 0] + cos_yaw * footprint[i, 1]
        if not (0.0 <= new_x < width and 0.0 <= new_y < height):
            return ILLEGAL
        x0, y0 = int(old_x), int(old_y)
        major, minor, major_step, minor_step = line_steps(int(new_x) - x0, int(new_y) - y0, width)
        error = major // 2
        index = y0 * width + x0
        for _ in range(major + 1):
            highest = max(highest, int(flat[index]))
            index += major_step
            error += minor
            if error >= major:
                index += minor_step
                error -= major
        old_x, old_y = new_x, new_y
    return ILLEGAL if highest >= _LETHAL else highest


@njit(cache=True)
def turn_is_free(costs: Cells, x: float, y: float, yaw: float, angle: float, footprint: Floats) -> bool:
    """Whether the outline stays legal while turning on the spot by ``angle``, every 0.017 rad (1 degree)."""
    steps = max(1, math.ceil(abs(angle) / 0.017))
    for i in range(steps + 1):
        at = yaw + angle * i / steps
        if outline_cost(costs, x, y, math.cos(at), math.sin(at), footprint) == ILLEGAL:
            return False
    return True
