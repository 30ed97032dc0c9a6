"""What can be set of the pose filter; the fit of scans to the map has constants alone."""

from dataclasses import dataclass, replace
from typing import Literal

from midnet_bench.settings import Settings, option


@dataclass(frozen=True)
class UkfSettings(Settings):
    """What the filter trusts. Variances are in squared units (m/s, rad, rad/s)."""

    twist_variance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """of odometry's vx, vy, vyaw; 0, as gazebo_ros_diff_drive publishes it, is trusted fully"""
    twist_is_mean: bool = False
    """whether odometry's twist is the mean since the last step, as encoders give it, or of the instant"""
    imu_yaw_variance: float = option(
        1e-6,
        "Variance of the IMU's heading, rad^2.",
        ge=0,
        le=100,
        source="ours: neither the paper nor TurtleBot3 gives one",
    )
    imu_yaw_rate_variance: float = 1e-6  # our choice; neither the paper nor TurtleBot3 gives one

    def suited_to(self, source: Literal["world", "encoder"]) -> "UkfSettings":
        """These settings for odometry of that source.

        A slipping wheel says little about turning, which the gyroscope knows a hundred times better; the
        sideways velocity that no wheel measures is a constraint, held to 1 cm/s. The encoders' variances are
        our choice; robot_localization leaves them to the publisher of the odometry.
        """
        if source == "world":
            return self
        return replace(self, twist_variance=(1e-4, 1e-4, 1e-2), twist_is_mean=True)
