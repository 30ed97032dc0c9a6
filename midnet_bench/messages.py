"""What a robot's sensors say, in the shape of the ROS messages of the same names."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D


@dataclass(frozen=True)
class LidarGeometry:
    """How a planar LiDAR's beams leave its axis; all of one scan at one instant."""

    beams: int
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: Pose2D
    """the sensor in the robot's base frame"""

    @property
    def angles_rad(self) -> npt.NDArray[np.float64]:
        """(beams,) direction of each beam in the sensor frame, radians."""
        return self.angle_min_rad + self.angle_increment_rad * np.arange(self.beams, dtype=np.float64)

    @cached_property
    def directions(self) -> npt.NDArray[np.float64]:
        """(beams, 2) unit vector along each beam in the sensor frame."""
        from midnet_bench.elementary import directions  # which needs a compiler

        return directions(self.angles_rad)


class Scan(NamedTuple):
    """sensor_msgs/LaserScan, and where the robot took itself to be then."""

    ranges_m: npt.NDArray[np.float64]
    """(beams,); inf where nothing was met, nan where the reading is void"""
    lidar: LidarGeometry
    pose: Pose2D
    """of the robot, map frame"""
    stamp_s: float

    def returns(self, range_m: float) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """(n,) the beams that met something within ``range_m``, and (n, 2) where, map frame, metres."""
        lidar = self.lidar
        near = (self.ranges_m >= lidar.range_min_m) & (self.ranges_m <= min(range_m, lidar.range_max_m))
        beams = np.flatnonzero(near)
        points = lidar.directions[beams] * self.ranges_m[beams, None]
        return beams, self.pose.compose(lidar.mount).transform(points)


class Odometry(NamedTuple):
    """nav_msgs/Odometry in the plane: pose in the odom frame, velocities in the body frame."""

    pose: Pose2D
    linear_mps: float
    angular_radps: float


class Imu(NamedTuple):
    """sensor_msgs/Imu in the plane."""

    yaw_rad: float
    yaw_rate_radps: float
    acceleration_x_mps2: float
    """forward; no filter here reads it, but without its noise the gyroscope's random draws would be others"""


class Command(NamedTuple):
    """geometry_msgs/Twist in the plane, body frame."""

    linear_mps: float
    angular_radps: float


STOP = Command(0.0, 0.0)
