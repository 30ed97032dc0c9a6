"""dwa_local_planner: the Dynamic Window Approach (Fox et al. 1997) with ROS 1's samples and critics."""

import math
from typing import NamedTuple

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Command, Floats, Pose2D, wrap_angle
from midnet_bench.navigation.costmap import Cells, RollingCostmap
from midnet_bench.navigation.local_planner import (
    GOAL,
    GOAL_FRONT,
    ILLEGAL,
    PATH,
    Grids,
    LocalPlanner,
    Plan,
    outline_cost,
    velocity_samples,
)
from midnet_bench.navigation.navigation_settings import PERIOD_S, NavigatorSettings

SIM_GRANULARITY_M, ANGULAR_SIM_GRANULARITY_RAD = 0.025, 0.1
"""dwa_local_planner, sim_granularity and angular_sim_granularity"""
VX_SAMPLES, VTH_SAMPLES = 20, 40  # turtlebot3, dwa_local_planner_params.yaml, vx_samples and vtheta_samples
PATH_DISTANCE_BIAS, FORWARD_POINT_DISTANCE_M = 32.0, 0.325
"""turtlebot3, dwa_local_planner_params.yaml, path_distance_bias and forward_point_distance"""
OSCILLATION_RESET_DIST_M, OSCILLATION_RESET_ANGLE_RAD = 0.05, 0.2
"""turtlebot3, dwa_local_planner_params.yaml, oscillation_reset_dist; dwa_local_planner, its angle"""
_Range = tuple[float, float, float]
_Situation = tuple[Cells, Grids, tuple[float, float, float], tuple[bool, bool, bool, bool], bool, Floats]
"""what all samples share: the window's costs and ``distance_grids``; the start, x, y in cells from its
lower-left corner, yaw in radians; the signs allowed: forwards, backwards, left, right; whether the alignment
critic counts; the outline's corners, (N, 2) in cells"""
_ESCAPE_AFTER_S = 2.0
"""after so long without a legal sample the planner looks for a way off instead of along the plan"""


class _Oscillation:
    """Which signs of velocity are forbidden, because the last commands swung to and fro.

    A speed of the opposite sign to the one before forbids that old sign; the same for turning, but only while
    the speed is no more than ``min_vel_trans_mps``. All is allowed again after moving or turning far enough.
    In move_base at 5 Hz each new plan clears the flags; plans here outlive a planner cycle.
    """

    def __init__(self, min_vel_trans_mps: float) -> None:
        self._min_vel_trans_mps = min_vel_trans_mps
        self.reset()

    def reset(self) -> None:
        self.allowed = (True, True, True, True)  # forwards, backwards, left, right
        self._last_speed_sign = self._last_turn_sign = 0
        self._set_at = Pose2D(0.0, 0.0, 0.0)

    def note(self, command: Command, pose: Pose2D) -> None:
        """Take the command that was chosen at ``pose``."""
        forwards, backwards, left, right = self.allowed
        sign = _sign(command.linear_mps)
        if sign != 0 and self._last_speed_sign == -sign:
            forwards, backwards = sign > 0, sign < 0
        self._last_speed_sign = sign or self._last_speed_sign
        if abs(command.linear_mps) <= self._min_vel_trans_mps:
            sign = _sign(command.angular_radps)
            if sign != 0 and self._last_turn_sign == -sign:
                left, right = sign > 0, sign < 0
            self._last_turn_sign = sign or self._last_turn_sign
        if (forwards, backwards, left, right) != self.allowed:
            self.allowed = (forwards, backwards, left, right)
            self._set_at = pose
        elif not all(self.allowed) and (
            pose.distance_to(self._set_at) > OSCILLATION_RESET_DIST_M
            or abs(wrap_angle(pose.yaw - self._set_at.yaw)) > OSCILLATION_RESET_ANGLE_RAD
        ):
            self.reset()


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)


class SearchParameters(NamedTuple):
    """What the compiled search needs of settings and robot, lengths in cells."""

    min_vel_trans: float
    max_vel_trans: float
    min_vel_theta: float
    sim_time: float
    cells_per_m: float
    path: float
    """total score per step of the path grid; also that of the alignment critic unless near the goal"""
    goal: float
    occupied: float  # total score per unit of cost
    forward_cells: float


class DwaPlanner(LocalPlanner):
    """Chooses the best of the velocities that can be reached within one control period.

    When none has been legal for two seconds, the velocity is chosen that leads away from obstacles, with the
    robot's bare outline for the padded one. dwa_local_planner has no such way off: where padding and the
    rounding to cells leave a robot no legal motion, or two robots stand nose to flank, it stands for ever.
    """

    def __init__(self, settings: NavigatorSettings) -> None:
        dwa, limits, resolution = settings.dwa, settings.dwa.limits, settings.local_costmap.resolution
        super().__init__(limits, dwa.sim_time_s, settings.local_costmap)
        self._bare_footprint_cells = np.array(settings.bare_footprint) / resolution
        self._cycles_without_sample = 0
        self._oscillation = _Oscillation(limits.min_vel_trans_mps)
        turn = float(limits.max_vel_theta_radps)
        self._ranges = (
            (limits.acc_lim_x_mps2 * PERIOD_S, float(limits.min_vel_x_mps), float(limits.max_vel_x_mps)),
            (limits.acc_lim_theta_radps2 * PERIOD_S, -turn, turn),
        )
        """of speed and turn: how far one period reaches, lowest, highest"""
        # numba looks at a tuple with names anew at every call, which takes longer than to pass it
        self._parameters = SearchParameters(
            min_vel_trans=float(limits.min_vel_trans_mps),
            max_vel_trans=float(limits.max_vel_trans_mps),
            min_vel_theta=float(limits.min_vel_theta_radps),
            sim_time=float(dwa.sim_time_s),
            cells_per_m=1.0 / resolution,
            path=PATH_DISTANCE_BIAS * resolution,
            goal=dwa.goal_distance_bias * resolution,
            occupied=float(dwa.occdist_scale),
            forward_cells=FORWARD_POINT_DISTANCE_M / resolution,
        )[:]

    def reset(self) -> None:
        """Allow all signs of velocity again."""
        self._oscillation.reset()

    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The sample with the lowest total of all critics; None when every sample is discarded.

        Two points depart from the original: arithmetic is in double precision, and the alignment critic's
        grids are made when plan or costmap change rather than at every cycle.
        """
        costs, ahead_m = costmap.costs, FORWARD_POINT_DISTANCE_M
        grids = self._grids(costmap, plan, pose, ahead_m, clears_footprint=False)
        start = (*costmap.to_cells(pose.x, pose.y), pose.yaw)
        aligned = math.hypot(plan.item(-2) - pose.x, plan.item(-1) - pose.y) > ahead_m
        seen = costs, grids, start, self._oscillation.allowed, aligned
        robot = velocity[:], self._ranges, self._parameters
        found, speed, turn = best_velocity((*seen, self._footprint_cells), *robot, False)
        self._cycles_without_sample = 0 if found else self._cycles_without_sample + 1
        if self._cycles_without_sample * PERIOD_S > _ESCAPE_AFTER_S:
            found, speed, turn = best_velocity((*seen, self._bare_footprint_cells), *robot, True)
        if not found:
            return None
        chosen = Command(speed, turn)
        self._oscillation.note(chosen, pose)
        return chosen


@njit
def best_velocity(
    now: _Situation,
    velocity: tuple[float, float],
    ranges: tuple[_Range, _Range],
    parameters: tuple[float, ...],
    escapes: bool,
) -> tuple[bool, float, float]:
    """(whether any is legal, speed in m/s, turn in rad/s) of the best among evenly spaced samples.

    ``velocity``: the present speed and turn; ``ranges``: of both how far one period reaches, lowest, highest;
    ``parameters``: ``SearchParameters``; ``escapes``: by ``escape``, not by ``search``.
    """
    speeds = _reachable(velocity[0], ranges[0], VX_SAMPLES)
    turns = _reachable(velocity[1], ranges[1], VTH_SAMPLES)
    params = SearchParameters(*parameters)
    if escapes:
        best = escape(now, speeds, turns, params)
    else:
        best, _ = search(now, speeds, turns, params)
    if best < 0:
        return False, 0.0, 0.0
    return True, speeds[best // len(turns)], turns[best % len(turns)]


@njit
def _reachable(now: float, limits: _Range, count: int) -> Floats:
    """Samples of what one period reaches from ``now``; a velocity outside comes back to the nearer end."""
    reach, low, high = limits
    return velocity_samples(min(max(low, now - reach), high), max(min(high, now + reach), low), count)


@njit
def search(now: _Situation, speeds: Floats, turns: Floats, params: SearchParameters) -> tuple[int, float]:
    """(index, total score) of the best sample, the lower index in a tie; (-1, inf) when none is legal.

    Index i * len(turns) + j stands for speeds[i], turns[j].

    All samples get the score of their last point first. Obstacle scores are never negative, and at least that
    of the start, which all samples share. So an arc is followed step by step only if its known part does not
    exceed the best total yet: that takes a tenth of scoring them all. The most promising ones are followed
    first until one is legal, then what is left in the order of the samples.
    """
    costs, _, start, _, _, footprint = now
    scores = _end_scores(now, speeds, turns, params)
    start_c, start_s = cos_sin(start[2])
    at_start = outline_cost(costs, start[0], start[1], start_c, start_s, footprint)
    if at_start == ILLEGAL:
        return -1, np.inf
    least = params.occupied * at_start
    best, best_total = -1, np.inf
    while best < 0:
        sample = int(np.argmin(scores))
        if scores[sample] == np.inf:
            return best, best_total
        total = _total(sample, scores[sample], now, speeds, turns, params, np.inf)
        if total < np.inf:
            best, best_total = sample, total
        scores[sample] = np.inf
    for sample in range(len(scores)):
        if scores[sample] + least <= best_total:
            total = _total(sample, scores[sample], now, speeds, turns, params, best_total)
            if total < best_total or (total == best_total and sample < best):
                best, best_total = sample, total
    return best, best_total


@njit
def _total(
    sample: int,
    score: float,
    now: _Situation,
    speeds: Floats,
    turns: Floats,
    params: SearchParameters,
    most: float,
) -> float:
    """All critics of a sample with that ``score`` at its last point; inf if discarded or above ``most``."""
    speed, turn = speeds[sample // len(turns)], turns[sample % len(turns)]
    highest = collision_cost(now, speed, turn, params.forward_cells, params, score, most)
    return np.inf if highest == ILLEGAL else score + params.occupied * highest


@njit
def _end_scores(now: _Situation, speeds: Floats, turns: Floats, params: SearchParameters) -> Floats:
    """(len(speeds) * len(turns),) what the critics of the last point give; inf where a sample is discarded.

    The last of n Euler points is known in closed form: the sum of n - 1 unit vectors, each turned on by the
    same angle. Half that angle alone needs a sine and a cosine; all other headings follow by turning on.
    """
    costs, grids, start, signs_allowed, aligned, _ = now
    height, width = costs.shape
    free_below = height * width
    forward = params.forward_cells
    # Flat and unsigned, so that no index is asked whether it counts from the end.
    path_grid, goal_grid = grids[PATH].reshape(-1), grids[GOAL].reshape(-1)
    front_grid = grids[GOAL_FRONT].reshape(-1)
    one, stride = np.uint32(1), np.uint32(width + 2)
    start_c, start_s = cos_sin(start[2])
    scores = np.full(len(speeds) * len(turns), np.inf)
    for j in range(len(turns)):
        turn = turns[j]
        if (turn > 0.0 and not signs_allowed[2]) or (turn < 0.0 and not signs_allowed[3]):
            continue
        steps_before = -1
        sum_c, sum_s, nose_x, nose_y = 0.0, 0.0, 0.0, 0.0
        half_turn = 0.5 * turn * params.sim_time
        half_turn_c, half_turn_s = cos_sin(half_turn)
        for i in range(len(speeds)):
            speed = speeds[i]
            if (speed > 0.0 and not signs_allowed[0]) or (speed < 0.0 and not signs_allowed[1]):
                continue
            if _is_too_slow(speed, turn, params) or abs(speed) - 1e-4 > params.max_vel_trans:
                continue
            steps = _simulation_steps(speed, turn, params)
            if steps != steps_before:
                steps_before = steps
                c, s = cos_sin(half_turn / steps)
                # half of what lies between the first heading and the last, and the heading there
                half_c, half_s = half_turn_c * c + half_turn_s * s, half_turn_s * c - half_turn_c * s
                middle_c, middle_s = start_c * half_c - start_s * half_s, start_s * half_c + start_c * half_s
                ratio = (steps - 1.0) if s == 0.0 else half_s / s
                ratio *= params.cells_per_m * params.sim_time / steps
                sum_c, sum_s = ratio * (middle_c * c + middle_s * s), ratio * (middle_s * c - middle_c * s)
                nose_x = start[0] + forward * (middle_c * half_c - middle_s * half_s)
                nose_y = start[1] + forward * (middle_s * half_c + middle_c * half_s)
            x, y = start[0] + speed * sum_c, start[1] + speed * sum_s
            ahead_x, ahead_y = nose_x + speed * sum_c, nose_y + speed * sum_s
            if not (
                0.0 <= x < width and 0.0 <= y < height and 0.0 <= ahead_x < width and 0.0 <= ahead_y < height
            ):
                continue
            cell = (np.uint32(y) + one) * stride + np.uint32(x) + one
            path, goal = path_grid[cell], goal_grid[cell]
            if path >= free_below or goal >= free_below:
                continue
            cell = (np.uint32(ahead_y) + one) * stride + np.uint32(ahead_x) + one
            score = params.goal * front_grid[cell]
            if aligned:
                score += params.path * path_grid[cell]
            scores[i * len(turns) + j] = score + params.path * path + params.goal * goal
    return scores


@njit
def collision_cost(
    now: _Situation,
    speed: float,
    turn: float,
    forward_cells: float,
    params: SearchParameters,
    score: float,
    most: float,
) -> int:
    """The highest cost that a simulated arc meets under outline and centre; -1 if a critic discards it.

    Also -1 once that cost takes a total that began as ``score`` beyond ``most``.

    Points: the start, then steps - 1 Euler steps (position along the old heading, then heading). Discarded
    are arcs with an illegal outline, a centre on a cell that path or goal grid block or do not reach, or,
    with ``forward_cells`` > 0, a point that far ahead which lies off the window.
    """
    costs, grids, start, _, _, footprint = now
    height, width = costs.shape
    free_below = height * width
    x, y = start[0], start[1]
    c, s = cos_sin(start[2])
    steps = _simulation_steps(speed, turn, params)
    dt = params.sim_time / steps
    turn_c, turn_s = cos_sin(turn * dt)
    advance = speed * params.cells_per_m * dt
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
        if score + params.occupied * highest > most:
            return ILLEGAL
        x += advance * c
        y += advance * s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
    return highest


@njit
def _is_too_slow(speed: float, turn: float, params: SearchParameters) -> bool:
    """Whether a sample moves too little; standing still always does."""
    is_slow = abs(speed) + 1e-4 < params.min_vel_trans and abs(turn) + 1e-4 < params.min_vel_theta
    return is_slow or (speed == 0.0 and turn == 0.0)


@njit
def _simulation_steps(speed: float, turn: float, params: SearchParameters) -> int:
    by_way = abs(speed) * (params.sim_time / SIM_GRANULARITY_M)
    return math.ceil(max(by_way, abs(turn) * (params.sim_time / ANGULAR_SIM_GRANULARITY_RAD)))


@njit
def escape(now: _Situation, speeds: Floats, turns: Floats, params: SearchParameters) -> int:
    """Index, as for ``search``, of the sample that ends farthest from obstacles, its outline on none; or -1.

    Farthest means the lowest cost under the centre, lower than at the start; the first wins a tie. No plan is
    asked for. Nothing is found from a start off the window.
    """
    costs, _, start, signs_allowed, aligned, footprint = now
    height, width = costs.shape
    if not (0.0 <= start[0] < width and 0.0 <= start[1] < height):
        return -1
    no_plan = np.zeros((3, height + 2, width + 2), dtype=np.int32)
    without_plan = costs, no_plan, start, signs_allowed, aligned, footprint
    best = -1
    lowest = int(costs[int(start[1]), int(start[0])])
    for sample in range(len(speeds) * len(turns)):
        speed, turn = speeds[sample // len(turns)], turns[sample % len(turns)]
        if _is_too_slow(speed, turn, params):
            continue
        steps = _simulation_steps(speed, turn, params)
        dt, speed_cells = params.sim_time / steps, speed * params.cells_per_m
        x, y, yaw = start
        for _ in range(steps - 1):
            c, s = cos_sin(yaw)
            x += speed_cells * dt * c
            y += speed_cells * dt * s
            yaw += turn * dt
        if not (0.0 <= x < width and 0.0 <= y < height) or costs[int(y), int(x)] >= lowest:
            continue
        if collision_cost(without_plan, speed, turn, 0.0, params, 0.0, np.inf) != ILLEGAL:
            best, lowest = sample, int(costs[int(y), int(x)])
    return best
