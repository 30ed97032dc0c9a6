"""``RobotModel``: what a robot is, said once for its navigation, its simulation and its pictures."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from midnet_bench.messages import Command, LidarGeometry

Outline = tuple[tuple[float, float], ...]
"""(x, y) of the corners in the robot's base frame, metres"""


class Disc(NamedTuple):
    """What the beams of other robots meet: a disc in the scan plane."""

    radius_m: float
    offset_x_m: float
    """its centre ahead of the axle"""


@dataclass(frozen=True)
class RobotModel:
    """A robot with two driven wheels and a planar LiDAR. Its base frame lies under the middle of the axle."""

    name: str
    urdf: Path
    """its body for the simulator"""
    base_link_height_m: float
    """of the description's root above the floor"""
    body: Outline
    """the description's collision shapes seen from above, counter-clockwise"""
    footprint: Outline
    """what move_base plans with: a rectangle that its maker took somewhat larger than the body"""
    radius_m: float
    """robot_radius of its maker's costmaps: a disc about the base frame that leaves out the corners"""
    wheel_radius_m: float
    wheel_separation_m: float
    max_linear_mps: float
    max_angular_radps: float
    rim_acceleration_mps2: float
    """how fast the speed of a wheel's rim changes"""
    wheel_torque_nm: float
    gyration_radius_m: float
    """square root of its inertia about the vertical axis over its mass"""
    lidar: LidarGeometry
    lidar_height_m: float
    """of the scan plane above the floor"""
    profiles: Mapping[str, Disc]
    """what its own kind's beams meet of it, by the names of the option ``robot_profile``"""

    def clamped(self, command: Command) -> Command:
        """What a command comes to within the robot's limits."""
        linear = min(max(command.linear_mps, -self.max_linear_mps), self.max_linear_mps)
        angular = min(max(command.angular_radps, -self.max_angular_radps), self.max_angular_radps)
        return Command(linear, angular)

    def rim_speeds(self, command: Command) -> tuple[float, float]:
        """How fast the rims of the left and the right wheel turn at a command, which is clamped, m/s."""
        linear, angular = self.clamped(command)
        half = angular * self.wheel_separation_m / 2.0
        return linear - half, linear + half

    @property
    def body_reach_m(self) -> float:
        """From the middle of the axle to the farthest corner of the body, metres."""
        return max(math.hypot(*corner) for corner in self.body)

    @property
    def footprint_reach_m(self) -> float:
        """The footprint's circumscribed radius: to its farthest corner from the axle's middle, metres."""
        return max(math.hypot(*corner) for corner in self.footprint)
