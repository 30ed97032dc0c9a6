"""What can be set of the pose filter and of the fit of scans to the map."""

from dataclasses import dataclass, replace
from typing import Literal

from midnet_bench.settings import Settings, fixed, option

_TWIST_VARIANCE = {"world": (0.0, 0.0, 0.0), "encoder": (1e-4, 1e-4, 1e-2)}
"""vx, vy, vyaw by the odometry's source; see ``UkfSettings.suited_to``"""


@dataclass(frozen=True)
class UkfSettings(Settings):
    """What the filter trusts. Variances are in squared units (m/s, rad, rad/s).

    The process noise is robot_localization's default diagonal for the six states that its
    ``two_d_mode`` leaves free. Its default ``alpha`` is 0.001, which puts a weight of about -1e6 on the
    centre point; with 1 and ``kappa`` 0 no weight is negative, so a predicted covariance cannot lose
    its definiteness, and the estimates are the same to far below a millimetre.
    """

    vx_variance: float | None = fixed(
        None, "package: gazebo_ros_diff_drive, which publishes 0; encoder's is ours"
    )
    vy_variance: float | None = fixed(
        None, "package: gazebo_ros_diff_drive, which publishes 0; encoder's is ours"
    )
    vyaw_variance: float | None = fixed(
        None, "package: gazebo_ros_diff_drive, which publishes 0; encoder's is ours"
    )
    twist_is_mean: bool = False
    """whether odometry's twist is the mean since the last step, as encoders give it, or of the instant"""
    imu_yaw_variance: float = option(
        1e-6,
        "Variance of the IMU's heading, rad^2.",
        ge=0,
        le=100,
        source="ours: neither the paper nor TurtleBot3 gives one",
    )
    imu_yaw_rate_variance: float = fixed(1e-6, "ours: neither the paper nor TurtleBot3 gives one")
    process_noise_x: float = fixed(0.05, "package: robot_localization, process_noise_covariance")
    process_noise_y: float = fixed(0.05, "package: robot_localization, process_noise_covariance")
    process_noise_yaw: float = fixed(0.06, "package: robot_localization, process_noise_covariance")
    process_noise_vx: float = fixed(0.025, "package: robot_localization, process_noise_covariance")
    process_noise_vy: float = fixed(0.025, "package: robot_localization, process_noise_covariance")
    process_noise_vyaw: float = fixed(0.02, "package: robot_localization, process_noise_covariance")
    initial_variance: float = fixed(1e-9, "package: robot_localization, initial_estimate_covariance")
    alpha: float = fixed(
        1.0, "ours: robot_localization's 0.001 weights the centre point by -1e6; the estimates are the same"
    )
    beta: float = fixed(2.0, "package: robot_localization, beta")
    kappa: float = fixed(0.0, "package: robot_localization, kappa")

    def suited_to(self, source: Literal["world", "encoder"]) -> "UkfSettings":
        """These settings, what odometry's source decides filled in.

        A slipping wheel says little about turning, which the gyroscope knows a hundred times better; the
        sideways velocity that no wheel measures is a constraint, held to 1 cm/s. These variances are our
        choice; robot_localization leaves them to the publisher of the odometry.
        """
        names = ("vx_variance", "vy_variance", "vyaw_variance")
        open_ones = {
            name: variance
            for name, variance in zip(names, _TWIST_VARIANCE[source], strict=True)
            if getattr(self, name) is None
        }
        return replace(self, **open_ones, twist_is_mean=source == "encoder")

    @property
    def twist_variance(self) -> tuple[float, float, float]:
        """Variances of odometry's vx, vy, vyaw; 0, trusted fully, where nothing was said."""
        return self.vx_variance or 0.0, self.vy_variance or 0.0, self.vyaw_variance or 0.0

    @property
    def process_noise(self) -> tuple[float, float, float, float, float, float]:
        """Variances that x, y, yaw, vx, vy, vyaw gain per second."""
        return (
            self.process_noise_x,
            self.process_noise_y,
            self.process_noise_yaw,
            self.process_noise_vx,
            self.process_noise_vy,
            self.process_noise_vyaw,
        )


@dataclass(frozen=True)
class ScanToMapSettings(Settings):
    """When a scan's fit to the map is believed, and how much. All values are our choice."""

    min_beams: int = fixed(30, "ours: off unless localization=ukf+map")
    min_share: float = fixed(0.5, "ours: off unless localization=ukf+map; most returns are walls")
    correlated_beams: float = fixed(10.0, "ours: off unless localization=ukf+map")
    unseen_deviation: float = fixed(1.0, "ours: off unless localization=ukf+map")


RECORDED = ScanToMapSettings(min_share=0.3)
"""of recordings, whose maps lack more of what stands in a building"""
