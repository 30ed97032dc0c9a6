"""What a robot may do and when it has arrived: base_local_planner's LocalPlannerLimits without its y axis."""

from dataclasses import dataclass, replace

from midnet_bench.errors import InputError


@dataclass(frozen=True)
class LocalPlannerLimits:
    """Velocities in the body frame, accelerations, tolerances; defaults: dwa_local_planner_params_burger."""

    max_vel_x_mps: float = 0.22
    min_vel_x_mps: float = -0.22
    """negative: may drive backwards"""
    max_vel_trans_mps: float = 0.22
    min_vel_trans_mps: float = 0.11
    """slower than this *and* turning slower than ``min_vel_theta_radps`` is no command"""
    max_vel_theta_radps: float = 2.75
    min_vel_theta_radps: float = 1.37
    acc_lim_x_mps2: float = 2.5
    acc_lim_theta_radps2: float = 3.2
    trans_stopped_vel_mps: float = 0.1
    theta_stopped_vel_radps: float = 0.1
    xy_goal_tolerance_m: float = 0.05
    yaw_goal_tolerance_rad: float = 0.17

    def __post_init__(self) -> None:
        if self.min_vel_x_mps > self.max_vel_x_mps:
            raise InputError(
                f"local planner: min_vel_x_mps {self.min_vel_x_mps} must not exceed "
                f"max_vel_x_mps {self.max_vel_x_mps}"
            )
        for name in (
            "acc_lim_x_mps2",
            "acc_lim_theta_radps2",
            "xy_goal_tolerance_m",
            "yaw_goal_tolerance_rad",
        ):
            if not getattr(self, name) > 0.0:
                raise InputError(f"local planner: {name} must be greater than 0 (got {getattr(self, name)})")

    def at_speed(self, top_mps: float) -> "LocalPlannerLimits":
        """The limits of a robot whose top speed is ``top_mps``; its other speeds change in proportion."""
        share = top_mps / self.max_vel_x_mps
        return replace(
            self,
            max_vel_x_mps=top_mps,
            min_vel_x_mps=share * self.min_vel_x_mps,
            max_vel_trans_mps=share * self.max_vel_trans_mps,
            min_vel_trans_mps=share * self.min_vel_trans_mps,
        )
