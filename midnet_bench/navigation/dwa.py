"""dwa_local_planner: the Dynamic Window Approach (Fox et al. 1997) with ROS 1's samples and critics."""

import math
from dataclasses import dataclass, field

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.messages import Command
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.dwa_kernels import Scales, best_velocity, escape
from midnet_bench.navigation.footprint import Footprint, corner_array
from midnet_bench.navigation.limits import LocalPlannerLimits
from midnet_bench.navigation.local_planner import LocalGoalGrids, Plan
from midnet_bench.navigation.rollout_kernels import turn_is_free


@dataclass(frozen=True)
class DwaSettings:
    """Parameters of DWAPlannerROS; the defaults are those of dwa_local_planner_params_burger.yaml.

    What never acts on a Burger is left out: the y axis, footprint scaling above 0.25 m/s, twirling, and
    ``use_dwa: false`` (that is Trajectory Rollout's way of sampling).
    """

    limits: LocalPlannerLimits = field(default_factory=LocalPlannerLimits)
    sim_time_s: float = 1.5
    sim_granularity_m: float = 0.025
    angular_sim_granularity_rad: float = 0.1
    vx_samples: int = 20
    vth_samples: int = 40
    path_distance_bias: float = 32.0
    goal_distance_bias: float = 20.0
    occdist_scale: float = 0.02
    forward_point_distance_m: float = 0.325
    oscillation_reset_dist_m: float = 0.05
    oscillation_reset_angle_rad: float = 0.2

    def __post_init__(self) -> None:
        for name in (
            "sim_time_s",
            "sim_granularity_m",
            "angular_sim_granularity_rad",
            "vx_samples",
            "vth_samples",
        ):
            if not getattr(self, name) > 0:
                raise InputError(f"dwa: {name} must be greater than 0 (got {getattr(self, name)})")


_STANDS_S = 2.0
"""how long no sample was legal before the planner looks for a way off instead of along the plan"""


class _Oscillation:
    """Which signs of velocity are forbidden, because the last commands swung to and fro.

    A speed of the opposite sign to the one before forbids that old sign; the same for turning, but only while
    the speed is no more than ``min_vel_trans``. All is allowed again after moving or turning far enough.
    Plans here outlive a planner cycle, so the flags do what they are for; in move_base at 5 Hz each new plan
    clears them.
    """

    def __init__(self, settings: DwaSettings) -> None:
        self._settings = settings
        self.clear()

    def clear(self) -> None:
        self.allowed = (True, True, True, True)
        """forwards, backwards, left, right"""
        self._last_speed_sign = 0
        self._last_turn_sign = 0
        self._set_at = Pose2D(0.0, 0.0, 0.0)

    def note(self, command: Command, pose: Pose2D) -> None:
        """Take the command that was chosen at ``pose``."""
        forwards, backwards, left, right = self.allowed
        sign = _sign(command.linear_mps)
        if sign != 0 and self._last_speed_sign == -sign:
            forwards, backwards = sign > 0, sign < 0
        self._last_speed_sign = sign or self._last_speed_sign
        if abs(command.linear_mps) <= self._settings.limits.min_vel_trans_mps:
            sign = _sign(command.angular_radps)
            if sign != 0 and self._last_turn_sign == -sign:
                left, right = sign > 0, sign < 0
            self._last_turn_sign = sign or self._last_turn_sign
        if (forwards, backwards, left, right) != self.allowed:
            self.allowed = (forwards, backwards, left, right)
            self._set_at = pose
        elif not all(self.allowed) and (
            pose.distance_to(self._set_at) > self._settings.oscillation_reset_dist_m
            or abs(wrap_angle(pose.yaw - self._set_at.yaw)) > self._settings.oscillation_reset_angle_rad
        ):
            self.clear()


class DwaPlanner:
    """Chooses the best of the velocities that can be reached within one control period.

    When none has been legal for two seconds, the velocity is chosen that leads away from obstacles, with the
    robot's bare outline for the padded one. dwa_local_planner has no such way off: where padding and the
    rounding to cells leave a robot no legal motion, or two robots stand nose to flank, it stands for ever.
    """

    def __init__(
        self,
        settings: DwaSettings,
        footprint: Footprint,
        bare_footprint: Footprint,
        resolution: float,
        period_s: float,
    ) -> None:
        self.settings = settings
        self._period_s = period_s
        self._footprint_cells = corner_array(footprint) / resolution
        self._bare_footprint_cells = corner_array(bare_footprint) / resolution
        self._cycles_without_sample = 0
        self._oscillation = _Oscillation(settings)
        self._grids = LocalGoalGrids()
        limits = settings.limits
        self._scales = Scales(
            min_vel_trans=float(limits.min_vel_trans_mps),
            max_vel_trans=float(limits.max_vel_trans_mps),
            min_vel_theta=float(limits.min_vel_theta_radps),
            sim_time=float(settings.sim_time_s),
            steps_per_mps=settings.sim_time_s / settings.sim_granularity_m,
            steps_per_radps=settings.sim_time_s / settings.angular_sim_granularity_rad,
            cells_per_m=1.0 / resolution,
            path=settings.path_distance_bias * resolution,
            goal=settings.goal_distance_bias * resolution,
            occupied=float(settings.occdist_scale),
            forward_cells=settings.forward_point_distance_m / resolution,
        )

    @property
    def limits(self) -> LocalPlannerLimits:
        """What the robot may do."""
        return self.settings.limits

    def forget(self) -> None:
        """Allow all signs of velocity again."""
        self._oscillation.clear()

    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The sample with the lowest total of all critics; None when every sample is discarded.

        Two points depart from the original: arithmetic is in double precision, and the alignment critic's
        grids are made when plan or costmap change rather than at every cycle.
        """
        settings, limits = self.settings, self.settings.limits
        reach_v = limits.acc_lim_x_mps2 * self._period_s
        reach_w = limits.acc_lim_theta_radps2 * self._period_s
        windows = (
            _window(velocity[0], reach_v, limits.min_vel_x_mps, limits.max_vel_x_mps),
            _window(velocity[1], reach_w, -limits.max_vel_theta_radps, limits.max_vel_theta_radps),
            (settings.vx_samples, settings.vth_samples),
        )
        end_x, end_y = plan[-1].tolist()
        start = (*costmap.layer.to_cells(pose.x, pose.y), pose.yaw)
        found, speed, turn = best_velocity(
            costmap.costs,
            self._grids.grids(costmap, plan, pose, settings.forward_point_distance_m),
            start,
            *windows,
            self._oscillation.allowed,
            math.hypot(end_x - pose.x, end_y - pose.y) > settings.forward_point_distance_m,
            self._footprint_cells,
            self._scales,
        )
        self._cycles_without_sample = 0 if found else self._cycles_without_sample + 1
        if self._cycles_without_sample * self._period_s > _STANDS_S:
            found, speed, turn = escape(
                costmap.costs, start, *windows, self._bare_footprint_cells, self._scales
            )
        if not found:
            return None
        chosen = Command(speed, turn)
        self._oscillation.note(chosen, pose)
        return chosen

    def turn_is_legal(self, costmap: RollingCostmap, pose: Pose2D, turn_radps: float) -> bool:
        """Whether turning on the spot at this rate for ``sim_time_s`` keeps the outline off obstacles."""
        x, y = costmap.layer.to_cells(pose.x, pose.y)
        angle = float(turn_radps) * self.settings.sim_time_s
        return bool(turn_is_free(costmap.costs, x, y, float(pose.yaw), angle, self._footprint_cells))


def _window(now: float, reach: float, low: float, high: float) -> tuple[float, float]:
    """What can be reached of [low, high]; a velocity outside it is brought back to the nearer end."""
    return min(max(low, now - reach), high), max(min(high, now + reach), low)


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)
