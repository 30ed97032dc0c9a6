"""The search of Trajectory Rollout, compiled."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.navigation.map_grid import GOAL, PATH
from midnet_bench.navigation.rollout_kernels import ILLEGAL, outline_cost

Cells = npt.NDArray[np.uint8]
Grids = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]

HITS, BLOCKED = -1.0, -2.0
"""cost of a rollout whose footprint is illegal or off the window; of one that leaves path or goal's reach"""


class RolloutScales(NamedTuple):
    """What the search needs of the settings; distances in cells where scored, metres where simulated."""

    acc_x: float
    acc_theta: float
    sim_time: float
    steps_per_m: float
    steps_per_radps: float
    cells_per_m: float
    path: float
    goal: float
    occupied: float
    lookahead_m: float
    min_in_place: float


@njit(cache=True)
def roll_out(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    velocity: tuple[float, float],
    speed: float,
    turn: float,
    footprint: Floats,
    scales: RolloutScales,
    bound: float,
) -> tuple[float, float, float, float]:
    """(cost, x, y, yaw at the end) of driving towards (speed, turn) under the acceleration limits.

    Cost: path and goal distance of the last scored point, in cells, and the highest cell cost met, weighted;
    -1 or -2 when illegal. The footprint's outline is looked at only if what the centre meets does not exceed
    ``bound`` already; otherwise the cost returned is some value above it.
    """
    height, width = costs.shape
    count = int(
        max(abs(speed) * scales.sim_time * scales.steps_per_m, abs(turn) * scales.steps_per_radps) + 0.5
    )
    count = max(1, count)
    dt = scales.sim_time / count
    path, goal, cost = 0, 0, 0.0
    x, y, yaw = start
    for outlines in (False, True):
        x, y, yaw = start
        v, w = velocity
        highest = 0
        for _ in range(count):
            if not (0.0 <= x < width and 0.0 <= y < height):
                return HITS, x, y, yaw
            column, row = int(x), int(y)
            if outlines:
                under = outline_cost(costs, x, y, math.cos(yaw), math.sin(yaw), footprint)
                if under == ILLEGAL:
                    return HITS, x, y, yaw
                highest = max(highest, under)
            highest = max(highest, int(costs[row, column]))
            path, goal = grids[PATH, row + 1, column + 1], grids[GOAL, row + 1, column + 1]
            if outlines and (path >= height * width or goal >= height * width):
                return BLOCKED, x, y, yaw
            v = min(v + scales.acc_x * dt, speed) if v < speed else max(v - scales.acc_x * dt, speed)
            w = min(w + scales.acc_theta * dt, turn) if w < turn else max(w - scales.acc_theta * dt, turn)
            x += v * scales.cells_per_m * math.cos(yaw) * dt
            y += v * scales.cells_per_m * math.sin(yaw) * dt
            yaw += w * dt
        cost = scales.path * path + scales.goal * goal + scales.occupied * highest
        if cost > bound:
            break
    return cost, x, y, yaw


@njit(cache=True)
def search_rollouts(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    velocity: tuple[float, float],
    speeds: Floats,
    turns: Floats,
    sides_allowed: tuple[bool, bool],
    footprint: Floats,
    scales: RolloutScales,
) -> tuple[float, float, float]:
    """(cost, speed, turn) of the best rollout; a negative cost when none is legal.

    For each speed straight on first, then its turns but for the last; the lowest cost wins, the first in a
    tie. Then turns on the spot, at ``min_in_place`` at least: one that costs no more wins if the point
    ``lookahead_m`` ahead of its end is nearer to the goal than that of the turns on the spot before it.
    ``sides_allowed``: left, right.
    """
    height, width = costs.shape
    best, best_speed, best_turn = HITS, 0.0, 0.0
    for i in range(len(speeds)):
        for j in range(len(turns)):
            turn = 0.0 if j == 0 else turns[j - 1]
            bound = best if best >= 0.0 else np.inf
            cost = roll_out(costs, grids, start, velocity, speeds[i], turn, footprint, scales, bound)[0]
            if cost >= 0.0 and (best < 0.0 or cost < best):
                best, best_speed, best_turn = cost, speeds[i], turn
    spacing = turns[1] - turns[0] if len(turns) > 1 else 0.0
    nearest = np.inf
    for j in range(len(turns)):
        if abs(turns[j]) <= spacing or not sides_allowed[0 if turns[j] > 0.0 else 1]:
            continue
        turn = max(turns[j], scales.min_in_place) if turns[j] > 0.0 else min(turns[j], -scales.min_in_place)
        bound = best if best >= 0.0 else np.inf
        cost, x, y, yaw = roll_out(costs, grids, start, velocity, 0.0, turn, footprint, scales, bound)
        if cost < 0.0 or cost > bound:
            continue
        x += scales.lookahead_m * scales.cells_per_m * math.cos(yaw)
        y += scales.lookahead_m * scales.cells_per_m * math.sin(yaw)
        if 0.0 <= x < width and 0.0 <= y < height:
            distance = grids[GOAL, int(y) + 1, int(x) + 1]
            if distance < nearest:
                nearest = distance
                best, best_speed, best_turn = cost, 0.0, turn
    return best, best_speed, best_turn
