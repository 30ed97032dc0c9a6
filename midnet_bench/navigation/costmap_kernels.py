"""The compiled loops of the costmap: beams into an obstacle layer, and inflation."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Cells = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float64]

_FREE, _LETHAL, _UNKNOWN, _INSCRIBED = 0, 254, 255, 253


@njit(cache=True)
def line_steps(dx: int, dy: int, width: int) -> tuple[int, int, int, int]:
    """(steps along the dominant axis, steps along the other, flat index step of each) of a grid line.

    The line is Bresenham's; x dominates ties. Walk it with an error that starts at half the dominant count.
    """
    step_x = 1 if dx > 0 else -1
    step_y = width if dy > 0 else -width
    if abs(dx) >= abs(dy):
        return abs(dx), abs(dy), step_x, step_y
    return abs(dy), abs(dx), step_y, step_x


@njit(cache=True)
def clear_line(cells: Cells, x0: int, y0: int, x1: int, y1: int, max_cells: int) -> None:
    """Set the cells from (x0, y0) towards (x1, y1) free, both ends too, ``max_cells`` (Euclidean) at most."""
    flat = cells.reshape(-1)
    width = cells.shape[1]
    major, minor, major_step, minor_step = line_steps(x1 - x0, y1 - y0, width)
    length = math.hypot(x1 - x0, y1 - y0)
    steps = major if length <= max_cells else int(max_cells / length * major)
    error = major // 2
    # Unsigned, so that no index is asked whether it counts from the end; steps back wrap round.
    index, along, aside = np.uint64(y0 * width + x0), np.uint64(major_step), np.uint64(minor_step)
    for _ in range(steps + 1):
        flat[index] = _FREE
        index += along
        error += minor
        if error >= major:
            index += aside
            error -= major


@njit(cache=True)
def clear_polygon(cells: Cells, corners: Floats) -> None:
    """Set the cells of a convex polygon free; nothing if a corner is off the grid or they are fewer than 3.

    ``corners``: (N, 2) in cells from the grid's lower-left corner. Each column is filled between the
    outline's lowest and highest cell.
    """
    height, width = cells.shape
    n = len(corners)
    if n < 3:
        return
    for i in range(n):
        x, y = corners[i, 0], corners[i, 1]
        if x < 0.0 or y < 0.0 or x >= width or y >= height:
            return
    lowest = np.full(width, height, dtype=np.int64)
    highest = np.full(width, -1, dtype=np.int64)
    for i in range(n):
        x0, y0 = int(corners[i - 1, 0]), int(corners[i - 1, 1])
        x1, y1 = int(corners[i, 0]), int(corners[i, 1])
        major, minor, major_step, minor_step = line_steps(x1 - x0, y1 - y0, width)
        error = major // 2
        index = y0 * width + x0
        for _ in range(major + 1):
            y, x = index // width, index % width
            lowest[x] = min(lowest[x], y)
            highest[x] = max(highest[x], y)
            index += major_step
            error += minor
            if error >= major:
                index += minor_step
                error -= major
    for x in range(width):
        for y in range(lowest[x], highest[x] + 1):
            cells[y, x] = _FREE


@njit(cache=True)
def placed(corners: Floats, pose: tuple[float, float, float]) -> Floats:
    """(N, 2) corners, given in the frame of ``pose`` (x, y, yaw), in the frame that it is given in."""
    x, y, yaw = pose
    c, s = math.cos(yaw), math.sin(yaw)
    moved = np.empty_like(corners)
    for i in range(len(corners)):
        moved[i, 0] = x + c * corners[i, 0] - s * corners[i, 1]
        moved[i, 1] = y + s * corners[i, 0] + c * corners[i, 1]
    return moved


@njit(cache=True)
def integrate_scan(
    cells: Cells,
    sensor: tuple[float, float, float],
    resolution: float,
    ranges: Floats,
    directions: Floats,
    range_limits: tuple[float, float],
    obstacle_range: float,
    raytrace_cells: int,
    inf_is_valid: bool,
    base: tuple[float, float, float],
    footprint: Floats,
    marked: npt.NDArray[np.int64],
) -> int:
    """Clear along every beam, then mark every hit, then free the footprint; returns how many were marked.

    ``sensor``: x, y in cells from the grid's lower-left corner, yaw in radians. ``ranges``: (B,) metres;
    ``directions``: (B, 2) cosine and sine of each beam in the sensor frame. A range outside
    [range_min, range_max) neither clears nor marks, except that +inf clears under ``inf_is_valid``.
    A hit at ``obstacle_range`` exactly is not marked. ``base``: as ``sensor``, where the robot stands;
    ``footprint``: (N, 2) cells, its corners in its base frame; empty to clear none. ``marked``: (B,), takes
    the flat indices of the marked cells.
    """
    height, width = cells.shape
    sensor_x, sensor_y, yaw = sensor
    cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
    inside = 0.0 <= sensor_x < width and 0.0 <= sensor_y < height
    start_x, start_y = int(sensor_x), int(sensor_y)
    pulled_in = 0.001 / resolution
    count = 0
    last_end = -1
    for i in range(len(ranges)):
        distance = ranges[i]
        if inf_is_valid and distance == math.inf:
            distance = range_limits[1] - 0.0001
        if not (range_limits[0] <= distance < range_limits[1]):
            continue
        reach = distance / resolution
        a = reach * (cos_yaw * directions[i, 0] - sin_yaw * directions[i, 1])
        b = reach * (sin_yaw * directions[i, 0] + cos_yaw * directions[i, 1])
        x, y = sensor_x + a, sensor_y + b
        if distance < obstacle_range and 0.0 <= x < width and 0.0 <= y < height:
            marked[count] = int(y) * width + int(x)
            count += 1
        if not inside:
            continue
        if x < 0.0:
            x, y = 0.0, sensor_y - b * sensor_x / a
        if y < 0.0:
            x, y = sensor_x - a * sensor_y / b, 0.0
        if x > width:
            x, y = width - pulled_in, sensor_y + b * (width - sensor_x) / a
        if y > height:
            x, y = sensor_x + a * (height - sensor_y) / b, height - pulled_in
        end_x, end_y = int(x), int(y)
        # Beams a degree apart often end in one cell, and the line to it is the same.
        if 0 <= end_x < width and 0 <= end_y < height and end_y * width + end_x != last_end:
            last_end = end_y * width + end_x
            clear_line(cells, start_x, start_y, end_x, end_y, raytrace_cells)
    flat = cells.reshape(-1)
    for i in range(count):
        flat[marked[i]] = _LETHAL
    if len(footprint) > 0:
        clear_polygon(cells, placed(footprint, base))
    return count


@njit(cache=True)
def combined(static: Cells, obstacles: Cells) -> Cells:
    """(H, W) uint8: the higher of both; an unknown cell gives way to a known one (combination method 1)."""
    height, width = static.shape
    costs = np.empty((height, width), dtype=np.uint8)
    for row in range(height):
        below, above, here = static[row], obstacles[row], costs[row]
        for x in range(width):
            if below[x] == _UNKNOWN or (above[x] != _UNKNOWN and above[x] > below[x]):
                here[x] = above[x]
            else:
                here[x] = below[x]
    return costs


@njit(cache=True)
def inflate(base: Cells, cost_by_squared_distance: Cells, reach: int) -> Cells:
    """(H, W) uint8: ``base`` with the cost of the distance to its nearest lethal cell, where that is higher.

    Exact Euclidean distances in two passes: down the columns first, then along the rows over the columns'
    results. Unknown cells take a cost of 253 or more only. ``reach`` in cells, at most 100;
    ``cost_by_squared_distance`` has reach**2 + 1 entries, and nothing is inflated beyond it.
    """
    height, width = base.shape
    far = np.int16(reach + 1)
    # Rows are taken out before their loops: the compiler then sees them apart and takes many cells at once.
    gap = np.full((height + 2, width), far, dtype=np.int16)
    for row in range(height):
        cells, below, here = base[row], gap[row], gap[row + 1]
        for x in range(width):
            here[x] = 0 if cells[x] == _LETHAL else min(np.int16(below[x] + 1), far)
    costs = base.copy()
    limit = reach * reach
    padded = np.full(width + 2 * reach, np.int16(far * far), dtype=np.int16)
    squared = np.empty(width, dtype=np.int16)
    for row in range(height - 1, -1, -1):
        above, here, nearest = gap[row + 2], gap[row + 1], far
        for x in range(width):
            here[x] = min(np.int16(above[x] + 1), here[x])
        for x in range(width):
            nearest = min(nearest, here[x])
        if nearest == far:
            continue
        for x in range(width):
            squared[x] = here[x] * here[x]
        padded[reach : reach + width] = squared
        for offset in range(1, reach + 1):
            left = padded[reach - offset : reach - offset + width]
            right = padded[reach + offset : reach + offset + width]
            added = np.int16(offset * offset)
            for x in range(width):
                squared[x] = min(squared[x], np.int16(min(left[x], right[x]) + added))
        row_of_costs = costs[row]
        for x in range(width):
            if squared[x] <= limit:
                cost = cost_by_squared_distance[squared[x]]
                old = row_of_costs[x]
                if (old == _UNKNOWN and cost >= _INSCRIBED) or (old != _UNKNOWN and cost > old):
                    row_of_costs[x] = cost
    return costs
