"""Distance grids of base_local_planner: steps from each cell of the local window to the plan or its end."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Cells = npt.NDArray[np.uint8]
Grids = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]

PATH, GOAL, GOAL_FRONT = 0, 1, 2
"""index of a grid among the three: to the plan, to the local goal, to the goal pushed ahead"""

_BLOCKED_FROM = 253
_UNKNOWN = 255


@njit(cache=True)
def distance_grids(costs: Cells, plan: Floats, pushed_end: tuple[float, float]) -> Grids:
    """(3, H + 2, W + 2) int32 steps between 4-neighbours, indexed by PATH, GOAL, GOAL_FRONT.

    ``costs``: (H, W). ``plan``: (N, 2) points in cells from the window's lower-left corner. The third grid
    belongs to the plan with its last point moved to ``pushed_end``. Element [k, row + 1, column + 1] belongs
    to a cell; the ring around them is -1. A cell of cost 253 or more next to a reached one holds H * W and
    passes nothing on; a cell that was not reached holds H * W + 1. Seeds spread whatever they cost.
    """
    height, width = costs.shape
    grids = np.empty((3, height + 2, width + 2), dtype=np.int32)
    queue = np.empty(height * width, dtype=np.uint32)
    seeds, count = _plan_cells(costs, plan, (plan[-1, 0], plan[-1, 1]))
    _spread(costs, seeds[:count], queue, grids[PATH])
    _spread(costs, seeds[max(count - 1, 0) : count], queue, grids[GOAL])
    seeds, count = _plan_cells(costs, plan, pushed_end)
    _spread(costs, seeds[max(count - 1, 0) : count], queue, grids[GOAL_FRONT])
    return grids


@njit(cache=True)
def local_grids(
    costs: Cells,
    plan: Floats,
    origin: tuple[float, float],
    resolution: float,
    robot: tuple[float, float],
    forward_m: float,
) -> Grids:
    """``distance_grids`` of a plan in metres whose end is pushed ``forward_m`` farther from the robot.

    ``origin``: the window's lower-left corner; ``robot``: x, y; all in one frame, metres.
    """
    cells = np.empty_like(plan)
    for i in range(len(plan)):
        cells[i, 0] = (plan[i, 0] - origin[0]) / resolution
        cells[i, 1] = (plan[i, 1] - origin[1]) / resolution
    end_x, end_y = cells[-1, 0], cells[-1, 1]
    ahead_x, ahead_y = (
        end_x - (robot[0] - origin[0]) / resolution,
        end_y - (robot[1] - origin[1]) / resolution,
    )
    distance = math.hypot(ahead_x, ahead_y)
    push = forward_m / resolution / distance if distance > 0.0 else 0.0
    return distance_grids(costs, cells, (end_x + push * ahead_x, end_y + push * ahead_y))


@njit(cache=True)
def _plan_cells(costs: Cells, plan: Floats, end: tuple[float, float]) -> tuple[npt.NDArray[np.int32], int]:
    """Flat indices (in the ringed grid) of the plan's first run of known cells inside the window.

    Gaps wider than a cell are filled by evenly spaced points; the plan's last point is replaced by ``end``.
    """
    height, width = costs.shape
    found = np.empty(4 * (height + width) + len(plan), dtype=np.int32)
    count = 0
    last = len(plan) - 1
    old_x, old_y = plan[0, 0], plan[0, 1]
    for i in range(last + 1):
        x, y = (end[0], end[1]) if i == last else (plan[i, 0], plan[i, 1])
        pieces = max(1, int(np.ceil(np.hypot(x - old_x, y - old_y))))
        for piece in range(1, pieces + 1):
            at_x = old_x + (x - old_x) * piece / pieces
            at_y = old_y + (y - old_y) * piece / pieces
            inside = 0.0 <= at_x < width and 0.0 <= at_y < height
            if inside and costs[int(at_y), int(at_x)] != _UNKNOWN:
                if count < len(found):
                    found[count] = (int(at_y) + 1) * (width + 2) + int(at_x) + 1
                    count += 1
            elif count > 0:
                return found, count
        old_x, old_y = x, y
    return found, count


@njit(cache=True)
def _spread(
    costs: Cells, seeds: npt.NDArray[np.int32], queue: npt.NDArray[np.uint32], grid: npt.NDArray[np.int32]
) -> None:
    """Fill ``grid`` with the steps from the nearest seed, breadth first."""
    height, width = costs.shape
    blocked = np.int32(height * width)
    unreachable = np.int32(blocked + 1)
    closed = np.int32(blocked + 2)
    grid[0] = -1
    grid[-1] = -1
    for row in range(height):
        grid[row + 1, 0] = -1
        grid[row + 1, width + 1] = -1
        for column in range(width):
            grid[row + 1, column + 1] = closed if costs[row, column] >= _BLOCKED_FROM else unreachable
    flat = grid.reshape(-1)
    # Unsigned, so that no index is asked whether it counts from the end: a third of the time.
    one, stride = np.uint32(1), np.uint32(width + 2)
    head, tail = np.uint32(0), np.uint32(0)
    for seed in seeds:
        if flat[seed] != 0:
            flat[seed] = 0
            queue[tail] = seed
            tail += one
    while head < tail:
        cell = queue[head]
        head += one
        following = np.int32(flat[cell] + 1)
        for other in (cell - one, cell + one, cell - stride, cell + stride):
            value = flat[other]
            if value == unreachable:
                flat[other] = following
                queue[tail] = other
                tail += one
            elif value == closed:
                flat[other] = blocked
    for row in range(1, height + 1):
        for column in range(1, width + 1):
            if grid[row, column] == closed:
                grid[row, column] = unreachable
