"""base_local_planner's TrajectoryPlannerROS: Trajectory Rollout (Gerkey and Konolige 2008).

dwa false, meter_scoring false, no heading scoring. TurtleBot3's base_local_planner_params.yaml, which no
launch file loads, does not carry a Burger round a corner as it is: at 0.08 m/s a step of 0.05 m looks no
farther than the start, and 0.6 rad/s2 is a fifth of what the robot does. So some values are DWA's.
"""

import math

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Command, Floats, Pose2D, wrap_angle
from midnet_bench.navigation.costmap import Cells, RollingCostmap
from midnet_bench.navigation.local_planner import GOAL, ILLEGAL, PATH, Grids, LocalPlanner, Plan, outline_cost
from midnet_bench.navigation.navigation_settings import NavigatorSettings

SIM_TIME_S = 1.5  # as DWA's; with the file's 0.8 s a slow robot looks no farther than its start
SIM_GRANULARITY_M = 0.025  # base_local_planner, sim_granularity; the file's 0.05 m as sim_time
ANGULAR_SIM_GRANULARITY_RAD = 0.025  # base_local_planner, angular_sim_granularity
VX_SAMPLES, VTHETA_SAMPLES = 18, 20
"""turtlebot3, base_local_planner_params.yaml, vx_samples and vtheta_samples"""
PATH_DISTANCE_BIAS, GOAL_DISTANCE_BIAS = 0.6, 0.8  # base_local_planner, pdist_scale and gdist_scale
OCCDIST_SCALE = 0.05  # with the package's 0.01 a robot cuts corners until it is stuck
HEADING_LOOKAHEAD_M = 0.325  # base_local_planner, heading_lookahead
OSCILLATION_RESET_DIST_M = 0.05  # base_local_planner, oscillation_reset_dist
ESCAPE_VEL_MPS, ESCAPE_RESET_DIST_M, ESCAPE_RESET_THETA_RAD = -0.1, 0.10, math.pi / 2
"""base_local_planner, escape_vel, escape_reset_dist and escape_reset_theta"""

_Situation = tuple[
    Cells, Grids, tuple[float, float, float], tuple[float, float], Floats, tuple[float, float, float]
]
"""what all rollouts share: the window's costs and ``distance_grids``; the start, x, y in cells from its
lower-left corner, yaw in radians; speed and turn there; the outline's corners, (N, 2) in cells; the robot's
accelerations, m/s2 and rad/s2, and the cells of a metre"""
HITS, BLOCKED = -1.0, -2.0
"""cost of a rollout whose footprint is illegal or off the window; of one that leaves path or goal's reach"""


class TrajectoryRolloutPlanner(LocalPlanner):
    """Chooses among velocities that can be reached within ``SIM_TIME_S``, ramping towards each."""

    def __init__(self, settings: NavigatorSettings) -> None:
        limits, resolution = settings.rollout_limits, settings.local_costmap.resolution
        super().__init__(limits, SIM_TIME_S, settings.local_costmap)
        self._robot = float(limits.acc_lim_x_mps2), float(limits.acc_lim_theta_radps2), 1.0 / resolution
        self.reset()

    def reset(self) -> None:
        """Allow turns on the spot to both sides, and end an escape."""
        self._turned_to: set[int] = set()
        self._only_side = 0
        self._turned_at = Pose2D(math.inf, math.inf, 0.0)
        self._escape_from: Pose2D | None = None

    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The velocity of the cheapest rollout; else backing up, if need be with the footprint in collision.

        Only a start from which the centre cannot reach the plan gives None. After backing up began, nothing
        else is tried until the robot has moved or turned far enough.
        """
        limits = self.limits
        grids = self._grids(costmap, plan, pose, 0.0, clears_footprint=True)
        start = (*costmap.to_cells(pose.x, pose.y), float(pose.yaw))
        v, w = float(velocity[0]), float(velocity[1])
        now = costmap.costs, grids, start, (v, w), self._footprint_cells, self._robot
        if (began := self._escape_from) is not None and (
            pose.distance_to(began) > ESCAPE_RESET_DIST_M
            or abs(wrap_angle(pose.yaw - began.yaw)) > ESCAPE_RESET_THETA_RAD
        ):
            self._escape_from = None
        if self._escape_from is None:
            reach_v, reach_w = limits.acc_lim_x_mps2 * SIM_TIME_S, limits.acc_lim_theta_radps2 * SIM_TIME_S
            to_end = math.hypot(plan[-1, 0] - pose.x, plan[-1, 1] - pose.y)
            fastest = min(limits.max_vel_x_mps, to_end / SIM_TIME_S)
            fastest = max(min(fastest, v + reach_v), limits.min_vel_x_mps)
            slowest = min(max(limits.min_vel_x_mps, v - reach_v), fastest)
            left = min(limits.max_vel_theta_radps, w + reach_w)
            right = max(-limits.max_vel_theta_radps, w - reach_w)
            cost, speed, turn = search_rollouts(
                now,
                np.linspace(slowest, fastest, VX_SAMPLES),
                np.linspace(right, left, VTHETA_SAMPLES),
                (self._only_side >= 0, self._only_side <= 0),
                float(limits.min_vel_theta_radps),
            )
            if cost >= 0.0:
                self._note(speed, turn, pose)
                return Command(float(speed), float(turn))
        if roll_out(now, (ESCAPE_VEL_MPS, 0.0), math.inf)[0] == BLOCKED:
            return None
        if self._escape_from is None:
            self._escape_from = pose
        return Command(ESCAPE_VEL_MPS, 0.0)

    def _note(self, speed: float, turn: float, pose: Pose2D) -> None:
        """The second turn on the spot to a side forbids the other side until the robot has moved."""
        if speed <= 0.0 and turn != 0.0:
            side = 1 if turn > 0.0 else -1
            if side in self._turned_to:
                self._only_side = side
            self._turned_to.add(side)
            self._turned_at = pose
        elif pose.distance_to(self._turned_at) > OSCILLATION_RESET_DIST_M:
            self._turned_to.clear()
            self._only_side = 0


@njit
def search_rollouts(
    now: _Situation, speeds: Floats, turns: Floats, sides_allowed: tuple[bool, bool], min_in_place: float
) -> tuple[float, float, float]:
    """(cost, speed, turn) of the best rollout; a negative cost when none is legal.

    For each speed straight on first, then its turns but for the last; the lowest cost wins, the first in a
    tie. Then turns on the spot, at ``min_in_place`` at least: one that costs no more wins if the point
    ``HEADING_LOOKAHEAD_M`` ahead of its end is nearer to the goal than that of the turns on the spot before
    it. ``sides_allowed``: left, right.
    """
    (height, width), grids, robot = now[0].shape, now[1], now[5]
    best, best_speed, best_turn = HITS, 0.0, 0.0
    for i in range(len(speeds)):
        for j in range(len(turns)):
            turn = 0.0 if j == 0 else turns[j - 1]
            bound = best if best >= 0.0 else np.inf
            cost = roll_out(now, (speeds[i], turn), bound)[0]
            if cost >= 0.0 and (best < 0.0 or cost < best):
                best, best_speed, best_turn = cost, speeds[i], turn
    spacing = turns[1] - turns[0] if len(turns) > 1 else 0.0
    nearest = np.inf
    for j in range(len(turns)):
        if abs(turns[j]) <= spacing or not sides_allowed[0 if turns[j] > 0.0 else 1]:
            continue
        turn = max(turns[j], min_in_place) if turns[j] > 0.0 else min(turns[j], -min_in_place)
        bound = best if best >= 0.0 else np.inf
        cost, x, y, yaw = roll_out(now, (0.0, turn), bound)
        if cost < 0.0 or cost > bound:
            continue
        c, s = cos_sin(yaw)
        x += HEADING_LOOKAHEAD_M * robot[2] * c
        y += HEADING_LOOKAHEAD_M * robot[2] * s
        if 0.0 <= x < width and 0.0 <= y < height:
            distance = grids[GOAL, int(y) + 1, int(x) + 1]
            if distance < nearest:
                nearest = distance
                best, best_speed, best_turn = cost, 0.0, turn
    return best, best_speed, best_turn


@njit
def roll_out(now: _Situation, target: tuple[float, float], bound: float) -> tuple[float, float, float, float]:
    """(cost, x, y, yaw at the end) of driving towards ``target``, m/s and rad/s, from the present velocity.

    Cost: path and goal distance of the last scored point, in cells, and the highest cell cost met, weighted;
    -1 or -2 when illegal. The footprint's outline is looked at only if what the centre meets does not exceed
    ``bound`` already; otherwise the cost returned is some value above it.
    """
    costs, grids, start, velocity, footprint, (acc_x, acc_theta, cells_per_m) = now
    height, width = costs.shape
    speed, turn = target
    by_way = abs(speed) * SIM_TIME_S * (1.0 / SIM_GRANULARITY_M)
    count = max(1, int(max(by_way, abs(turn) * (1.0 / ANGULAR_SIM_GRANULARITY_RAD)) + 0.5))
    dt = SIM_TIME_S / count
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
            v = min(v + acc_x * dt, speed) if v < speed else max(v - acc_x * dt, speed)
            w = min(w + acc_theta * dt, turn) if w < turn else max(w - acc_theta * dt, turn)
            x += v * cells_per_m * c * dt
            y += v * cells_per_m * s * dt
            yaw += w * dt
        cost = PATH_DISTANCE_BIAS * path + GOAL_DISTANCE_BIAS * goal + OCCDIST_SCALE * highest
        if cost > bound:
            break
    return cost, x, y, yaw
