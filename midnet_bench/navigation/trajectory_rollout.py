"""base_local_planner's TrajectoryPlannerROS: Trajectory Rollout (Gerkey and Konolige 2008)."""

import math
from typing import NamedTuple

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Command, Pose2D, wrap_angle
from midnet_bench.navigation.costmap import Cells, Floats, RollingCostmap
from midnet_bench.navigation.local_planner import (
    GOAL,
    ILLEGAL,
    PATH,
    Grids,
    LocalPlanner,
    Plan,
    outline_cost,
)
from midnet_bench.navigation.navigation_settings import Footprint, TrajectoryRolloutSettings

HITS, BLOCKED = -1.0, -2.0
"""cost of a rollout whose footprint is illegal or off the window; of one that leaves path or goal's reach"""


class RolloutParameters(NamedTuple):
    """What the compiled search needs of the settings; cells where scored, metres where simulated."""

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


class TrajectoryRolloutPlanner(LocalPlanner):
    """Chooses among velocities that can be reached within ``sim_time_s``, ramping towards each."""

    def __init__(self, settings: TrajectoryRolloutSettings, footprint: Footprint, resolution: float) -> None:
        super().__init__(settings.limits, settings.sim_time_s, footprint, resolution)
        self.settings = settings
        self._parameters = RolloutParameters(
            acc_x=float(settings.limits.acc_lim_x_mps2),
            acc_theta=float(settings.limits.acc_lim_theta_radps2),
            sim_time=float(settings.sim_time_s),
            steps_per_m=1.0 / settings.sim_granularity_m,
            steps_per_radps=1.0 / settings.angular_sim_granularity_rad,
            cells_per_m=1.0 / resolution,
            path=float(settings.path_distance_bias),
            goal=float(settings.goal_distance_bias),
            occupied=float(settings.occdist_scale),
            lookahead_m=float(settings.heading_lookahead_m),
            min_in_place=float(settings.limits.min_vel_theta_radps),
        )
        self._turned_to: set[int] = set()
        self._only_side = 0
        self._turned_at = Pose2D(math.inf, math.inf, 0.0)
        self._escape_from: Pose2D | None = None

    def reset(self) -> None:
        """Allow turns on the spot to both sides, and end an escape."""
        self._turned_to.clear()
        self._only_side = 0
        self._turned_at = Pose2D(math.inf, math.inf, 0.0)
        self._escape_from = None

    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The velocity of the cheapest rollout; else backing up, if need be with the footprint in collision.

        Only a start from which the centre cannot reach the plan gives None. After backing up began, nothing
        else is tried until the robot has moved or turned far enough.
        """
        settings, limits = self.settings, self.settings.limits
        grids = self._grids(costmap, plan, pose, 0.0, clears_footprint=True)
        start = (*costmap.layer.to_cells(pose.x, pose.y), float(pose.yaw))
        v, w = float(velocity[0]), float(velocity[1])
        self._end_escape(pose)
        if self._escape_from is None:
            reach_v, reach_w = (
                limits.acc_lim_x_mps2 * settings.sim_time_s,
                limits.acc_lim_theta_radps2 * settings.sim_time_s,
            )
            to_end = math.hypot(plan[-1, 0] - pose.x, plan[-1, 1] - pose.y)
            fastest = min(limits.max_vel_x_mps, to_end / settings.sim_time_s)
            fastest = max(min(fastest, v + reach_v), limits.min_vel_x_mps)
            slowest = min(max(limits.min_vel_x_mps, v - reach_v), fastest)
            left = min(limits.max_vel_theta_radps, w + reach_w)
            right = max(-limits.max_vel_theta_radps, w - reach_w)
            cost, speed, turn = search_rollouts(
                costmap.costs,
                grids,
                start,
                (v, w),
                np.linspace(slowest, fastest, settings.vx_samples),
                np.linspace(right, left, settings.vtheta_samples),
                (self._only_side >= 0, self._only_side <= 0),
                self._footprint_cells,
                self._parameters,
            )
            if cost >= 0.0:
                self._note(speed, turn, pose)
                return Command(float(speed), float(turn))
        cost, *_ = roll_out(
            costmap.costs,
            grids,
            start,
            (v, w),
            float(settings.escape_vel_mps),
            0.0,
            self._footprint_cells,
            self._parameters,
            math.inf,
        )
        if cost == BLOCKED:
            return None
        if self._escape_from is None:
            self._escape_from = pose
        return Command(settings.escape_vel_mps, 0.0)

    def _note(self, speed: float, turn: float, pose: Pose2D) -> None:
        """The second turn on the spot to a side forbids the other side until the robot has moved."""
        if speed <= 0.0 and turn != 0.0:
            side = 1 if turn > 0.0 else -1
            if side in self._turned_to:
                self._only_side = side
            self._turned_to.add(side)
            self._turned_at = pose
        elif pose.distance_to(self._turned_at) > self.settings.oscillation_reset_dist_m:
            self._turned_to.clear()
            self._only_side = 0

    def _end_escape(self, pose: Pose2D) -> None:
        if self._escape_from is not None and (
            pose.distance_to(self._escape_from) > self.settings.escape_reset_dist_m
            or abs(wrap_angle(pose.yaw - self._escape_from.yaw)) > self.settings.escape_reset_theta_rad
        ):
            self._escape_from = None


@njit
def search_rollouts(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    velocity: tuple[float, float],
    speeds: Floats,
    turns: Floats,
    sides_allowed: tuple[bool, bool],
    footprint: Floats,
    params: RolloutParameters,
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
            cost = roll_out(costs, grids, start, velocity, speeds[i], turn, footprint, params, bound)[0]
            if cost >= 0.0 and (best < 0.0 or cost < best):
                best, best_speed, best_turn = cost, speeds[i], turn
    spacing = turns[1] - turns[0] if len(turns) > 1 else 0.0
    nearest = np.inf
    for j in range(len(turns)):
        if abs(turns[j]) <= spacing or not sides_allowed[0 if turns[j] > 0.0 else 1]:
            continue
        turn = max(turns[j], params.min_in_place) if turns[j] > 0.0 else min(turns[j], -params.min_in_place)
        bound = best if best >= 0.0 else np.inf
        cost, x, y, yaw = roll_out(costs, grids, start, velocity, 0.0, turn, footprint, params, bound)
        if cost < 0.0 or cost > bound:
            continue
        c, s = cos_sin(yaw)
        x += params.lookahead_m * params.cells_per_m * c
        y += params.lookahead_m * params.cells_per_m * s
        if 0.0 <= x < width and 0.0 <= y < height:
            distance = grids[GOAL, int(y) + 1, int(x) + 1]
            if distance < nearest:
                nearest = distance
                best, best_speed, best_turn = cost, 0.0, turn
    return best, best_speed, best_turn


@njit
def roll_out(
    costs: Cells,
    grids: Grids,
    start: tuple[float, float, float],
    velocity: tuple[float, float],
    speed: float,
    turn: float,
    footprint: Floats,
    params: RolloutParameters,
    bound: float,
) -> tuple[float, float, float, float]:
    """(cost, x, y, yaw at the end) of driving towards (speed, turn) under the acceleration limits.

    Cost: path and goal distance of the last scored point, in cells, and the highest cell cost met, weighted;
    -1 or -2 when illegal. The footprint's outline is looked at only if what the centre meets does not exceed
    ``bound`` already; otherwise the cost returned is some value above it.
    """
    height, width = costs.shape
    count = int(
        max(abs(speed) * params.sim_time * params.steps_per_m, abs(turn) * params.steps_per_radps) + 0.5
    )
    count = max(1, count)
    dt = params.sim_time / count
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
            c, s = cos_sin(yaw)
            if outlines:
                under = outline_cost(costs, x, y, c, s, footprint)
                if under == ILLEGAL:
                    return HITS, x, y, yaw
                highest = max(highest, under)
            highest = max(highest, int(costs[row, column]))
            path, goal = grids[PATH, row + 1, column + 1], grids[GOAL, row + 1, column + 1]
            if outlines and (path >= height * width or goal >= height * width):
                return BLOCKED, x, y, yaw
            v = min(v + params.acc_x * dt, speed) if v < speed else max(v - params.acc_x * dt, speed)
            w = min(w + params.acc_theta * dt, turn) if w < turn else max(w - params.acc_theta * dt, turn)
            x += v * params.cells_per_m * c * dt
            y += v * params.cells_per_m * s * dt
            yaw += w * dt
        cost = params.path * path + params.goal * goal + params.occupied * highest
        if cost > bound:
            break
    return cost, x, y, yaw
