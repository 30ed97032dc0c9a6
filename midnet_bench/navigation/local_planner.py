"""What both local planners share: shape, steps to plan and goal, cost of the outline, velocity samples."""

import math
from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, hypot
from midnet_bench.geometry import Command, Floats, Point, Pose2D
from midnet_bench.navigation.costmap import (
    INSCRIBED,
    LETHAL,
    NO_INFORMATION,
    Cells,
    RollingCostmap,
    clear_footprint,
    line_steps,
    next_cell,
)
from midnet_bench.navigation.navigation_settings import CostmapSettings, LocalPlannerLimits

Grids = npt.NDArray[np.int32]

Plan = Floats
"""(N, 2) points in the costmap's frame, metres, from the robot to where the plan leaves the window or ends"""

PATH, GOAL, GOAL_FRONT = 0, 1, 2
"""index of a grid among the three: to the plan, to the local goal, to the goal pushed ahead"""

ILLEGAL = -1  # cost of an outline on an obstacle, on unknown cells or off the window


class LocalPlanner(ABC):
    """Turns a plan into velocities, ten times a second."""

    def __init__(self, limits: LocalPlannerLimits, sim_time_s: float, costmap: CostmapSettings) -> None:
        self.limits = limits
        self.sim_time_s = sim_time_s
        self._footprint_cells = np.array(costmap.footprint) / costmap.resolution
        self._gridded: tuple[Cells, Plan] | None = None  # costs and plan that the newest grids are of
        self._newest_grids: Grids = np.empty((0, 0, 0), dtype=np.int32)

    @abstractmethod
    def reset(self) -> None:
        """Drop the memory against oscillation: there is a new goal or another way to it."""

    @abstractmethod
    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The velocity to drive now; None when no motion is legal."""

    def can_turn(self, costmap: RollingCostmap, pose: Pose2D, angle_rad: float) -> bool:
        """Whether the outline stays off obstacles while the robot turns on the spot by this angle."""
        x, y = costmap.to_cells(pose.x, pose.y)
        return bool(turn_is_free(costmap.costs, x, y, float(pose.yaw), angle_rad, self._footprint_cells))

    def _grids(
        self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, forward_m: float, clears_footprint: bool
    ) -> Grids:
        """``distance_grids``, made anew for another plan or costmap than before.

        With ``clears_footprint`` the cells under the robot count as free.
        """
        costs = costmap.costs
        if self._gridded is None or costs is not self._gridded[0] or plan is not self._gridded[1]:
            self._gridded = costs, plan
            if clears_footprint:
                costs = costs.copy()
                at = (*costmap.to_cells(pose.x, pose.y), pose.yaw)
                clear_footprint(costs, self._footprint_cells, at)
            resolution, robot = costmap.settings.resolution, (pose.x, pose.y)
            self._newest_grids = distance_grids(costs, plan, costmap.origin, resolution, robot, forward_m)
        return self._newest_grids


@njit
def distance_grids(
    costs: Cells, plan: Floats, origin: Point, resolution: float, robot: Point, forward_m: float
) -> Grids:
    """(3, H + 2, W + 2) int32 steps between 4-neighbours, indexed by PATH, GOAL, GOAL_FRONT.

    ``costs``: (H, W); ``origin``: its lower-left corner. ``plan``: (N, 2) points; in the third grid its last
    one is pushed ``forward_m`` farther from the ``robot``. All in one frame, metres.

    Element [k, row + 1, column + 1] belongs to a cell; the ring around them is -1. A cell of cost 253 or more
    next to a reached one holds H * W and passes nothing on; a cell that was not reached holds H * W + 1.
    Seeds spread whatever they cost.
    """
    points = (plan - np.array(origin)) / resolution
    end_x, end_y = points[-1, 0], points[-1, 1]
    ahead_x = end_x - (robot[0] - origin[0]) / resolution
    ahead_y = end_y - (robot[1] - origin[1]) / resolution
    distance = hypot(ahead_x, ahead_y)
    push = forward_m / resolution / distance if distance > 0.0 else 0.0
    height, width = costs.shape
    cells = height * width
    grids = np.empty((3, height + 2, width + 2), dtype=np.int32)
    grids[PATH].fill(-1)
    for row in range(height):
        cost, start = costs[row], grids[PATH, row + 1, 1:-1]
        for column in range(width):
            start[column] = cells + 2 if cost[column] >= INSCRIBED else cells + 1
    grids[GOAL], grids[GOAL_FRONT] = grids[PATH], grids[PATH]
    seeds, count = _plan_cells(costs, points, (end_x, end_y))
    _spread(seeds[:count], grids[PATH], cells)
    _spread(seeds[max(count - 1, 0) : count], grids[GOAL], cells)
    seeds, count = _plan_cells(costs, points, (end_x + push * ahead_x, end_y + push * ahead_y))
    _spread(seeds[max(count - 1, 0) : count], grids[GOAL_FRONT], cells)
    return grids


@njit
def _plan_cells(costs: Cells, plan: Floats, end: Point) -> tuple[npt.NDArray[np.int32], int]:
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
        pieces = max(1, int(np.ceil(hypot(x - old_x, y - old_y))))
        for piece in range(1, pieces + 1):
            at_x = old_x + (x - old_x) * piece / pieces
            at_y = old_y + (y - old_y) * piece / pieces
            inside = 0.0 <= at_x < width and 0.0 <= at_y < height
            if inside and costs[int(at_y), int(at_x)] != NO_INFORMATION:
                if count < len(found):
                    found[count] = (int(at_y) + 1) * (width + 2) + int(at_x) + 1
                    count += 1
            elif count > 0:
                return found, count
        old_x, old_y = x, y
    return found, count


@njit
def _spread(seeds: npt.NDArray[np.int32], grid: npt.NDArray[np.int32], cells: int) -> None:
    """Fill ``grid`` with the steps from the nearest seed, breadth first.

    ``grid`` holds ``cells`` + 1, or + 2 where a cell passes nothing on, within a ring of -1.
    """
    blocked, unreachable, closed = np.int32(cells), np.int32(cells + 1), np.int32(cells + 2)
    flat = grid.reshape(-1)
    queue = np.empty(cells, dtype=np.uint32)
    # unsigned indices spare numba's test for negative ones: a third of the time
    one, stride = np.uint32(1), np.uint32(grid.shape[1])
    head, tail = np.uint32(0), np.uint32(0)
    for seed in seeds:
        if flat[seed] != 0:
            flat[seed] = 0
            queue[tail] = seed
            tail += one
    steps = np.int32(0)
    while head < tail:
        steps += np.int32(1)
        last = tail
        while head < last:
            cell = queue[head]
            head += one
            for other in (cell - one, cell + one, cell - stride, cell + stride):
                if flat[other] == unreachable:
                    flat[other] = steps
                    queue[tail] = other
                    tail += one
    # Without a branch, rows taken out before: the compiler takes many cells at once. The ring's -1 is a large
    # number here.
    for row in range(1, len(grid) - 1):
        below, here, above = grid[row - 1], grid[row], grid[row + 1]
        for column in range(1, len(here) - 1):
            nearest = min(np.uint32(below[column]), np.uint32(above[column]))
            nearest = min(nearest, np.uint32(here[column - 1]), np.uint32(here[column + 1]))
            if here[column] == closed:
                here[column] = blocked if nearest < blocked else unreachable


@njit
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


@njit
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
        line = line_steps(int(new_x) - x0, int(new_y) - y0, width)
        index, error = y0 * width + x0, line[0] // 2
        for _ in range(line[0] + 1):
            highest = max(highest, int(flat[index]))
            index, error = next_cell(index, error, line)
        old_x, old_y = new_x, new_y
    return ILLEGAL if highest >= LETHAL else highest


@njit
def turn_is_free(costs: Cells, x: float, y: float, yaw: float, angle: float, footprint: Floats) -> bool:
    """Whether the outline stays legal while turning on the spot by ``angle``, every 0.017 rad (1 degree)."""
    steps = max(1, math.ceil(abs(angle) / 0.017))
    for i in range(steps + 1):
        at = yaw + angle * i / steps
        c, s = cos_sin(at)
        if outline_cost(costs, x, y, c, s, footprint) == ILLEGAL:
            return False
    return True
