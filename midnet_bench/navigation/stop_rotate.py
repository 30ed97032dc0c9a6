"""The last steps at a goal: stop, then turn to its heading (LatchedStopRotateController)."""

import math

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.messages import STOP, Command
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.limits import LocalPlannerLimits
from midnet_bench.navigation.local_planner import LocalPlanner


class StopRotate:
    """Takes over once the robot is within the position tolerance, and keeps the robot until a new goal.

    move_base looks for the latch among its own parameters, so that the planner's file cannot set it; here it
    is always on, since a robot that turns on the spot does not leave its place. Without a goal heading the
    goal is reached with the position.
    """

    def __init__(self, planner: LocalPlanner, period_s: float) -> None:
        self._planner = planner
        self._period_s = period_s
        self._at_position = False
        self._rotating = False

    def forget(self) -> None:
        """Begin with a new goal."""
        self._at_position = False
        self._rotating = False

    def arrived_at(self, goal: tuple[float, float], pose: Pose2D) -> bool:
        """Whether the robot is, or was since the goal was set, within the position tolerance."""
        near = math.hypot(goal[0] - pose.x, goal[1] - pose.y) <= self._planner.limits.xy_goal_tolerance_m
        self._at_position = self._at_position or near
        return self._at_position

    def finished(self, goal_yaw: float | None, pose: Pose2D, velocity: Command) -> bool:
        """Whether heading and standstill are reached too; to be asked once ``arrived_at`` holds."""
        limits = self._planner.limits
        if goal_yaw is None:
            return True
        turned = abs(wrap_angle(goal_yaw - pose.yaw)) <= limits.yaw_goal_tolerance_rad
        return turned and _stopped(velocity, limits)

    def command(
        self, costmap: RollingCostmap, goal_yaw: float, pose: Pose2D, velocity: Command
    ) -> Command | None:
        """The velocity to stop or to turn with; None when turning would hit something."""
        limits = self._planner.limits
        v, w = velocity
        reach_v, reach_w = (
            limits.acc_lim_x_mps2 * self._period_s,
            limits.acc_lim_theta_radps2 * self._period_s,
        )
        angle = wrap_angle(goal_yaw - pose.yaw)
        if abs(angle) <= limits.yaw_goal_tolerance_rad:
            self._rotating = False
            return STOP
        if not self._rotating and not _stopped(velocity, limits):
            return Command(
                math.copysign(max(0.0, abs(v) - reach_v), v), math.copysign(max(0.0, abs(w) - reach_w), w)
            )
        self._rotating = True
        low, high = limits.min_vel_theta_radps, limits.max_vel_theta_radps
        speed = min(max(abs(angle), low), high)
        speed = min(max(speed, abs(w) - reach_w), abs(w) + reach_w)
        speed = min(speed, math.sqrt(2.0 * limits.acc_lim_theta_radps2 * abs(angle)))
        turn = math.copysign(min(max(speed, low), high), angle)
        return Command(0.0, turn) if self._planner.turn_is_legal(costmap, pose, turn) else None


def _stopped(velocity: Command, limits: LocalPlannerLimits) -> bool:
    return (
        abs(velocity[0]) <= limits.trans_stopped_vel_mps
        and abs(velocity[1]) <= limits.theta_stopped_vel_radps
    )
