"""What a Burger believes of its own motion: exactly, as Gazebo told it, or from its wheel encoders."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.messages import Odometry
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.settings import OdometrySettings

TICK_RAD = 2.0 * math.pi / 4096
"""The least turn of a wheel that its encoder tells apart."""


class EncoderOdometer:
    """Dead reckoning of one robot from its wheels' angles."""

    def __init__(
        self,
        start: Pose2D,
        wheel_angles_rad: npt.NDArray[np.float64],
        settings: OdometrySettings,
        rng: np.random.Generator,
        robot: RobotModel = BURGER,
    ) -> None:
        """Start at a known pose (so the odom frame is the map frame) and draw this robot's own errors."""
        self._pose = start
        self._ticks = _ticks(wheel_angles_rad)
        self._rng = rng
        self._slip = settings.slip_m_per_sqrt_m
        self._scales = 1.0 + settings.radius_error * rng.standard_normal(2)
        self._travel_per_tick_m = TICK_RAD * robot.wheel_radius_m
        self._separation_m = robot.wheel_separation_m * (
            1.0 + settings.separation_error * rng.standard_normal()
        )

    def update(self, wheel_angles_rad: npt.NDArray[np.float64], elapsed_s: float) -> Odometry:
        """The pose and the mean velocity after ``elapsed_s``, from ``Simulator.wheel_angles``.

        The pose moves along the heading half-way through the turn (midpoint rule).
        """
        ticks = _ticks(wheel_angles_rad)
        travel = (ticks - self._ticks) * self._travel_per_tick_m * self._scales
        travel += self._slip * np.sqrt(np.abs(travel)) * self._rng.standard_normal(2)
        self._ticks = ticks
        left, right = travel.tolist()
        forward, turn = (left + right) / 2.0, (right - left) / self._separation_m
        heading = self._pose.yaw + turn / 2.0
        self._pose = Pose2D(
            self._pose.x + forward * math.cos(heading),
            self._pose.y + forward * math.sin(heading),
            wrap_angle(self._pose.yaw + turn),
        )
        return Odometry(self._pose, forward / elapsed_s, turn / elapsed_s)


def _ticks(wheel_angles_rad: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.floor(wheel_angles_rad / TICK_RAD)
