"""The pose filter of robot_localization in its two-dimensional mode: wheel odometry's twist and an IMU."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.localization.ukf_kernels import corrected, predicted
from midnet_bench.messages import Imu, Odometry

FloatArray = npt.NDArray[np.float64]

LEAST_VARIANCE = 1e-9
"""A smaller measurement variance, 0 included, is raised to this, as robot_localization does."""

_POSE, _YAW = 0, 2
"""number of the first state that a measurement of the pose, or of yaw and velocities, says something of"""


@dataclass(frozen=True)
class UkfSettings:
    """What the filter trusts. Variances are in squared units (m/s, rad, rad/s).

    The process noise is robot_localization's default diagonal for the six states that its
    ``two_d_mode`` leaves free. Its default ``alpha`` is 0.001, which puts a weight of about -1e6 on the
    centre point; with 1 and ``kappa`` 0 no weight is negative, so a predicted covariance cannot lose
    its definiteness, and the estimates are the same to far below a millimetre.
    """

    twist_variance: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """odometry's vx, vy, vyaw; the default is Gazebo's ``world`` odometry: trusted fully"""
    twist_is_mean: bool = False
    """whether odometry's twist is the mean since the last step, as encoders give it, or of the instant"""
    imu_yaw_variance: float = 1e-6
    imu_yaw_rate_variance: float = 1e-6
    process_noise: tuple[float, float, float, float, float, float] = (0.05, 0.05, 0.06, 0.025, 0.025, 0.02)
    """x, y, yaw, vx, vy, vyaw: variance gained per second"""
    initial_variance: float = 1e-9
    """of every state at the start, whose pose is known"""
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    @classmethod
    def for_odometry(cls, source: Literal["world", "encoder"]) -> "UkfSettings":
        """Settings for exact odometry (``world``) or for wheels that slip (``encoder``).

        A slipping wheel says little about turning, which the gyroscope knows a hundred times better; the
        sideways velocity that no wheel measures is a constraint, held to 1 cm/s. These variances are our
        choice; robot_localization leaves them to whoever publishes the odometry.
        """
        if source == "world":
            return cls()
        return cls(twist_variance=(1e-4, 1e-4, 1e-2), twist_is_mean=True)


class PlanarUkf:
    """An unscented Kalman filter over [x, y, yaw, vx, vy, vyaw]; velocities in the body frame.

    The state is what robot_localization's 15 come down to with ``two_d_mode`` and no acceleration fused,
    and so are the fused quantities: vx, vy (a measured 0 that stands in for the wheels' constraint) and
    vyaw of the odometry's twist, yaw and vyaw of the IMU, never odometry's pose beside its velocities.

    Departures from the package, on purpose:

    * the covariance update is the textbook one (P - K S K'), not the package's, which leaves the
      measurement noise out of S there and keeps P too large;
    * yaw is averaged linearly, unwrapped, and the IMU's yaw is taken to the nearest turn, so the circular
      mean that drives the package to NaN at a large heading variance does not occur;
    * a change of velocity acts within the step that it happens in, so the noise of velocities reaches the
      position too: over half the step, or over all of it if the twist is a mean. With the package's
      diagonal noise the pose lags the robot by that much (11 or 22 mm at 0.22 m/s and 10 Hz).
    """

    def __init__(self, initial: Pose2D, settings: UkfSettings) -> None:
        """A robot at rest at ``initial``, its pose in the map frame."""
        self._filter = _CompiledUkf(settings)
        self._filter.x = np.array([initial.x, initial.y, initial.yaw, 0.0, 0.0, 0.0])
        self._filter.P = settings.initial_variance * np.eye(6)
        vx, vy, wheel_rate = (max(variance, LEAST_VARIANCE) for variance in settings.twist_variance)
        yaw = max(settings.imu_yaw_variance, LEAST_VARIANCE)
        gyro_rate = max(settings.imu_yaw_rate_variance, LEAST_VARIANCE)
        # Two independent readings of one quantity are one reading, weighted by trust: the same estimate,
        # and S stays well conditioned where both variances are tiny.
        self._gyro_share = wheel_rate / (wheel_rate + gyro_rate)
        self._filter.R = np.diag([yaw, vx, vy, gyro_rate * self._gyro_share])

    @property
    def pose(self) -> Pose2D:
        """The estimated pose in the map frame, yaw within [-pi, pi)."""
        x, y, yaw = self._filter.x[:3].tolist()
        return Pose2D(x, y, wrap_angle(yaw))

    @property
    def velocity(self) -> tuple[float, float]:
        """(forward velocity in m/s, turn rate in rad/s), body frame."""
        return float(self._filter.x[3]), float(self._filter.x[5])

    @property
    def covariance(self) -> FloatArray:
        """(6, 6) float64, a copy: the covariance of x, y, yaw, vx, vy, vyaw."""
        return self._filter.P.copy()

    def step(self, odometry: Odometry, imu: Imu, dt_s: float) -> Pose2D:
        """The pose ``dt_s`` > 0 seconds after the last step, given what odometry and IMU say now."""
        if not dt_s > 0.0:
            raise ValueError(f"dt_s must be positive, got {dt_s}")
        self._filter.predict(dt_s)
        yaw_rate = odometry.angular_radps + self._gyro_share * (imu.yaw_rate_radps - odometry.angular_radps)
        measured = np.array([self._near_yaw(imu.yaw_rad), odometry.linear_mps, 0.0, yaw_rate])
        self._filter.update(measured, self._filter.R, _YAW)
        return self.pose

    def correct_pose(self, pose: Pose2D, covariance: FloatArray) -> Pose2D:
        """The pose after a correction with an absolute one, such as a scan matched to the map.

        Args:
            pose: measured in the map frame.
            covariance: (3, 3) float64 of x, y, yaw; metres and radians, squared; positive definite.
        """
        measured = np.array([pose.x, pose.y, self._near_yaw(pose.yaw)])
        self._filter.update(measured, covariance, _POSE)
        return self.pose

    def _near_yaw(self, yaw_rad: float) -> float:
        """``yaw_rad`` plus the whole turns that bring it nearest to the estimate, which is not wrapped."""
        estimate = float(self._filter.x[2])
        return estimate + wrap_angle(yaw_rad - estimate)


class _CompiledUkf(UnscentedKalmanFilter):  # type: ignore[misc]
    """filterpy's filter with its two steps compiled: the same estimates, a tenth of the time."""

    x: FloatArray
    P: FloatArray

    def __init__(self, settings: UkfSettings) -> None:
        points = MerweScaledSigmaPoints(6, settings.alpha, settings.beta, settings.kappa)
        super().__init__(6, 4, 1.0, hx=None, fx=None, points=points)
        self._scale = settings.alpha**2 * (6 + settings.kappa)
        self._noise = np.array(settings.process_noise)
        self._change_lasts = 1.0 if settings.twist_is_mean else 0.5

    def predict(self, dt: float) -> None:
        """Move on by ``dt`` seconds at constant body velocity."""
        lasts_s = self._change_lasts * dt
        self.x, self.P = predicted(self.x, self.P, self._noise, dt, lasts_s, self._scale, self.Wm, self.Wc)

    def update(self, z: FloatArray, R: FloatArray, first: int) -> None:
        """Correct by ``z``, a measurement of the states from number ``first`` on, of covariance ``R``."""
        self.x, self.P = corrected(self.x, self.P, z, R, first)
