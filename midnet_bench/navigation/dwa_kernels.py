"""The search of the Dynamic Window Approach, compiled."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.navigation.map_grid import GOAL, GOAL_FRONT, PATH
from midnet_bench.navigation.rollout_kernels import ILLEGAL, outline_cost, velocity_samples

Cells = npt.NDArray[np.uint8]
Grids = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]


class Scales(NamedTuple):
    """What ``search`` needs of the settings, in cells where they are lengths."""

    min_vel_trans: float
    max_vel_trans: float
    min_vel_theta: float
    sim_time: float
    steps_per_mps: float
    """simulation steps per metre per second"""
    steps_per_radps: float
    cells_per_m: float
    path: float
    """total score per step of the path grid; also that of the alignment critic unless near the goal"""
    goal: float
    occupied: float
    """total score per unit of cost"""
    forward_cells: float


@njit(cache=True)
def collision_cost(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    speed_cells: float,
    turn: float,
    steps: int,
    dt: float,
    forward_cells: float,
    footprint: Floats,
) -> int:
    """The highest cost that a simulated arc meets under outline and centre; -1 if a critic discards it.

    Points: the start, then steps - 1 Euler steps (position along the old heading, then heading). Discarded
    are arcs with an illegal outline, a centre on a cell that path or goal grid block or do not reach, or,
    with ``forward_cells`` > 0, a point that far ahead which lies off the window.
    """
    height, width = costs.shape
    free_below = height * width
    x, y = start[0], start[1]
    c, s = math.cos(start[2]), math.sin(start[2])
    turn_c, turn_s = math.cos(turn * dt), math.sin(turn * dt)
    advance = speed_cells * dt
    highest = 0
    for _ in range(steps):
        if not (0.0 <= x < width and 0.0 <= y < height):
            return ILLEGAL
        column, row = int(x), int(y)
        if grids[PATH, row + 1, column + 1] >= free_below or grids[GOAL, row + 1, column + 1] >= free_below:
            return ILLEGAL
        if forward_cells > 0.0:
            ahead_x, ahead_y = x + forward_cells * c, y + forward_cells * s
            if not (0.0 <= ahead_x < width and 0.0 <= ahead_y < height):
                return ILLEGAL
        under = outline_cost(costs, x, y, c, s, footprint)
        if under == ILLEGAL:
            return ILLEGAL
        highest = max(highest, under, int(costs[row, column]))
        x += advance * c
        y += advance * s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    return highest


@njit(cache=True)
def _simulation_steps(speed: float, turn: float, scales: Scales) -> int:
    return math.ceil(max(abs(speed) * scales.steps_per_mps, abs(turn) * scales.steps_per_radps))


@njit(cache=True)
def _end_scores(
    grids: Grids,
    start: tuple[float, float, float],
    speeds: Floats,
    turns: Floats,
    signs_allowed: tuple[bool, bool, bool, bool],
    aligned: bool,
    scales: Scales,
) -> Floats:
    """(len(speeds) * len(turns),) what the critics of the last point give; inf where a sample is discarded.

    The last of n Euler points is known in closed form: the sum of n - 1 unit vectors, each turned on by the
    same angle.
    """
    height, width = grids.shape[1] - 2, grids.shape[2] - 2
    free_below = height * width
    forward = scales.forward_cells
    scores = np.full(len(speeds) * len(turns), np.inf)
    for j in range(len(turns)):
        turn = turns[j]
        if (turn > 0.0 and not signs_allowed[2]) or (turn < 0.0 and not signs_allowed[3]):
            continue
        steps_before = -1
        sum_c, sum_s, end_c, end_s = 0.0, 0.0, 0.0, 0.0
        for i in range(len(speeds)):
            speed = speeds[i]
            if (speed > 0.0 and not signs_allowed[0]) or (speed < 0.0 and not signs_allowed[1]):
                continue
            if abs(speed) + 1e-4 < scales.min_vel_trans and abs(turn) + 1e-4 < scales.min_vel_theta:
                continue
            if abs(speed) - 1e-4 > scales.max_vel_trans:
                continue
            steps = _simulation_steps(speed, turn, scales)
            if steps == 0:
                continue
            if steps != steps_before:
                steps_before = steps
                angle = turn * scales.sim_time / steps
                half = math.sin(0.5 * angle)
                ratio = (steps - 1.0) if half == 0.0 else math.sin(0.5 * (steps - 1) * angle) / half
                middle = start[2] + 0.5 * (steps - 2) * angle
                sum_c, sum_s = ratio * math.cos(middle), ratio * math.sin(middle)
                end_c = math.cos(start[2] + (steps - 1) * angle)
                end_s = math.sin(start[2] + (steps - 1) * angle)
            advance = speed * scales.cells_per_m * scales.sim_time / steps
            x, y = start[0] + advance * sum_c, start[1] + advance * sum_s
            ahead_x, ahead_y = x + forward * end_c, y + forward * end_s
            if not (0.0 <= x < width and 0.0 <= y < height):
                continue
            if not (0.0 <= ahead_x < width and 0.0 <= ahead_y < height):
                continue
            row, column = int(y) + 1, int(x) + 1
            path, goal = grids[PATH, row, column], grids[GOAL, row, column]
            if path >= free_below or goal >= free_below:
                continue
            row, column = int(ahead_y) + 1, int(ahead_x) + 1
            score = scales.goal * grids[GOAL_FRONT, row, column]
            if aligned:
                score += scales.path * grids[PATH, row, column]
            scores[i * len(turns) + j] = score + scales.path * path + scales.goal * goal
    return scores


@njit(cache=True)
def search(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    speeds: Floats,
    turns: Floats,
    signs_allowed: tuple[bool, bool, bool, bool],
    aligned: bool,
    footprint: Floats,
    scales: Scales,
) -> tuple[int, float]:
    """(index, total score) of the best sample, the lower index in a tie; (-1, inf) when none is legal.

    Index i * len(turns) + j stands for speeds[i], turns[j]. ``start``: x, y in cells from the window's
    lower-left corner, yaw in radians. ``signs_allowed``: forwards, backwards, left, right.

    All samples get the score of their last point first, which costs a look-up each. Obstacle scores are only
    added and never negative, and at least that of the start, which all samples share. So an arc is followed
    step by step only when its known part does not exceed the best total yet, which leaves the result that of
    scoring them all. The most promising ones are followed first until one is legal.
    """
    scores = _end_scores(grids, start, speeds, turns, signs_allowed, aligned, scales)
    at_start = outline_cost(costs, start[0], start[1], math.cos(start[2]), math.sin(start[2]), footprint)
    if at_start == ILLEGAL:
        return -1, np.inf
    least = scales.occupied * at_start
    best, best_total = -1, np.inf
    in_order = -1
    while True:
        if best < 0:
            sample = int(np.argmin(scores))
            if scores[sample] == np.inf:
                return -1, np.inf
        else:
            in_order += 1
            while in_order < len(scores) and not scores[in_order] + least <= best_total:
                in_order += 1
            if in_order == len(scores):
                return best, best_total
            sample = in_order
        speed, turn = speeds[sample // len(turns)], turns[sample % len(turns)]
        steps = _simulation_steps(speed, turn, scales)
        highest = collision_cost(
            costs,
            grids,
            start,
            speed * scales.cells_per_m,
            turn,
            steps,
            scales.sim_time / steps,
            scales.forward_cells,
            footprint,
        )
        if highest != ILLEGAL:
            total = scores[sample] + scales.occupied * highest
            if total < best_total or (total == best_total and sample < best):
                best, best_total = sample, total
        scores[sample] = np.inf


@njit(cache=True)
def best_velocity(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    speed_window: tuple[float, float],
    turn_window: tuple[float, float],
    counts: tuple[int, int],
    signs_allowed: tuple[bool, bool, bool, bool],
    aligned: bool,
    footprint: Floats,
    scales: Scales,
) -> tuple[bool, float, float]:
    """(whether any is legal, speed in m/s, turn in rad/s) of the best among evenly spaced samples."""
    speeds = velocity_samples(speed_window[0], speed_window[1], counts[0])
    turns = velocity_samples(turn_window[0], turn_window[1], counts[1])
    best, _ = search(costs, grids, start, speeds, turns, signs_allowed, aligned, footprint, scales)
    if best < 0:
        return False, 0.0, 0.0
    return True, speeds[best // len(turns)], turns[best % len(turns)]


@njit(cache=True)
def escape(
    costs: Cells,
    start: tuple[float, float, float],
    speed_window: tuple[float, float],
    turn_window: tuple[float, float],
    counts: tuple[int, int],
    footprint: Floats,
    scales: Scales,
) -> tuple[bool, float, float]:
    """As ``best_velocity``, of the sample that ends farthest from obstacles without an outline on one.

    Farthest means the lowest cost under the centre, lower than at the start; the first wins a tie. No plan is
    asked for.
    """
    speeds = velocity_samples(speed_window[0], speed_window[1], counts[0])
    turns = velocity_samples(turn_window[0], turn_window[1], counts[1])
    height, width = costs.shape
    no_plan = np.zeros((3, height + 2, width + 2), dtype=np.int32)
    best = -1
    lowest = int(costs[int(start[1]), int(start[0])])
    for sample in range(len(speeds) * len(turns)):
        speed, turn = speeds[sample // len(turns)], turns[sample % len(turns)]
        if abs(speed) + 1e-4 < scales.min_vel_trans and abs(turn) + 1e-4 < scales.min_vel_theta:
            continue
        steps = _simulation_steps(speed, turn, scales)
        if steps == 0:
            continue
        dt, speed_cells = scales.sim_time / steps, speed * scales.cells_per_m
        x, y, yaw = start
        for _ in range(steps - 1):
            x += speed_cells * dt * math.cos(yaw)
            y += speed_cells * dt * math.sin(yaw)
            yaw += turn * dt
        if not (0.0 <= x < width and 0.0 <= y < height) or costs[int(y), int(x)] >= lowest:
            continue
        met = collision_cost(costs, no_plan, start, speed_cells, turn, steps, dt, 0.0, footprint)
        if met != ILLEGAL:
            best, lowest = sample, int(costs[int(y), int(x)])
    if best < 0:
        return False, 0.0, 0.0
    return True, speeds[best // len(turns)], turns[best % len(turns)]
