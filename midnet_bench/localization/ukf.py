"""The pose filter of robot_localization in its two-dimensional mode: wheel odometry's twist and an IMU."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.localization.localization_settings import UkfSettings

FloatArray = npt.NDArray[np.float64]

PROCESS_NOISE = (0.05, 0.05, 0.06, 0.025, 0.025, 0.02)
"""Variances that x, y, yaw, vx, vy, vyaw gain per second: robot_localization's default diagonal for the six
states that its ``two_d_mode`` leaves free."""
INITIAL_VARIANCE, BETA, KAPPA = 1e-9, 2.0, 0.0
"""robot_localization, initial_estimate_covariance, beta and kappa"""
MIN_VARIANCE = 1e-9
"""A smaller measurement variance, 0 included, is raised to this, as robot_localization does."""

WIDE_YAW_RAD = 0.5
"""how far from the mean the headings of sigma points may lie; their mean way is 2 % too short there"""

_POSE, _YAW = 0, 2  # index of the first state that is measured: by a pose; by odometry and IMU


class PlanarUkf:
    """An unscented Kalman filter over [x, y, yaw, vx, vy, vyaw]; velocities in the body frame.

    Merwe's scaled sigma points (van der Merwe 2004), as in filterpy, whose filter the tests compare it with.

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
      diagonal noise the pose lags the robot by that much (11 or 22 mm at 0.22 m/s and 10 Hz);
    * where nothing tells the heading, its variance grows without end, and the mean way of sigma points that
      look to all sides is no way at all. Points farther apart than ``WIDE_YAW_RAD`` therefore move along
      the mean heading, as all did in the package before 2021, and the pose follows dead reckoning.

    A value of a reading that is NaN or infinite is left out, as the package does, and the others are taken.
    """

    def __init__(self, initial: Pose2D, settings: UkfSettings) -> None:
        """A robot at rest at ``initial``, its pose in the map frame; a ``UkfTeam`` steps it."""
        self.settings = settings
        self._state = np.array([initial.x, initial.y, initial.yaw, 0.0, 0.0, 0.0])
        self._covariance = INITIAL_VARIANCE * np.eye(6)

    @property
    def pose(self) -> Pose2D:
        """The estimated pose in the map frame, yaw within [-pi, pi)."""
        x, y, yaw = self._state[:3].tolist()
        return Pose2D(x, y, wrap_angle(yaw))

    def correct_pose(self, pose: Pose2D, covariance: FloatArray) -> Pose2D:
        """The pose after a correction with an absolute one, such as a scan matched to the map.

        Args:
            pose: measured in the map frame.
            covariance: (3, 3) float64 of x, y, yaw; metres and radians, squared; positive definite.

        A pose or a covariance that is not finite corrects nothing.
        """
        if not (math.isfinite(pose.x + pose.y + pose.yaw) and np.isfinite(covariance).all()):
            return self.pose
        estimated_yaw = float(self._state[2])  # not wrapped
        yaw = estimated_yaw + wrap_angle(pose.yaw - estimated_yaw)
        self._state[:], self._covariance[:] = corrected(
            self._state, self._covariance, np.array([pose.x, pose.y, yaw]), covariance, _POSE
        )
        return self.pose


class UkfTeam:
    """The filters of n robots with one set of settings, stepped by one compiled call; each is independent."""

    def __init__(self, filters: Sequence[PlanarUkf]) -> None:
        """Makes each filter's state a view of its row here. Raises ValueError if their settings differ."""
        settings = filters[0].settings
        if any(other.settings != settings for other in filters):
            raise ValueError("the filters of a team need the same settings")
        self.states: FloatArray = np.array([each._state for each in filters])
        """(n, 6)"""
        self.covariances: FloatArray = np.array([each._covariance for each in filters])
        """(n, 6, 6)"""
        for row, each in enumerate(filters):
            each._state, each._covariance = self.states[row], self.covariances[row]
        self._change_lasts = 1.0 if settings.twist_is_mean else 0.5
        self._sigma = _sigma_weights(settings.alpha)
        vx, vy, wheel_rate = settings.twist_variance
        variances = [settings.imu_yaw_variance, vx, vy, wheel_rate, settings.imu_yaw_rate_variance]
        self._variances = np.maximum(variances, MIN_VARIANCE)

    def step(self, rows: npt.NDArray[np.int64], twists: FloatArray, imus: FloatArray, dt_s: float) -> None:
        """Let ``dt_s`` > 0 seconds pass for the filters of ``rows``, given the newest sensor readings.

        ``twists``: (n, 2) forward speed (m/s) and yaw rate (rad/s) of odometry; ``imus``: (n, 2) or more, yaw
        (rad) and yaw rate (rad/s) first. Raises ValueError unless ``dt_s`` is positive.
        """
        if not dt_s > 0.0:
            raise ValueError(f"dt_s must be positive, got {dt_s}")
        lasts_s = self._change_lasts * dt_s
        step_filters(
            rows, self.states, self.covariances, twists, imus, dt_s, lasts_s, self._sigma, self._variances
        )


_Sigma = tuple[float, FloatArray, FloatArray]
"""the spread of the sigma points, n + lambda; (13,) weights of mean and covariance, the centre point first"""


def _sigma_weights(alpha: float) -> _Sigma:
    scale = alpha * alpha * (6 + KAPPA)
    spread = scale - 6
    mean = np.full(13, 0.5 / (6 + spread))
    covariance = mean.copy()
    mean[0] = spread / (6 + spread)
    covariance[0] = spread / (6 + spread) + (1 - alpha * alpha + BETA)
    return scale, mean, covariance


@njit
def predicted(
    state: FloatArray, covariance: FloatArray, dt_s: float, lasts_s: float, sigma: _Sigma
) -> tuple[FloatArray, FloatArray]:
    """(6,) state and (6, 6) covariance ``dt_s`` later: the unscented transform of constant body velocity.

    ``lasts_s``: as for ``step_noise``. Raises LinAlgError where the covariance is not positive definite.
    """
    scale, wm, wc = sigma
    size = len(state)
    root = lower_root(scale * covariance)
    points = np.empty((2 * size + 1, size))
    points[0] = state
    for i in range(size):
        for k in range(size):
            points[1 + i, k] = state[k] + root[k, i]
            points[1 + size + i, k] = state[k] - root[k, i]
    mean = np.zeros(size)
    is_wide = scale * covariance[2, 2] > WIDE_YAW_RAD * WIDE_YAW_RAD
    for i in range(len(points)):
        heading = state[2] if is_wide else points[i, 2]
        c, s = cos_sin(heading)
        vx, vy = points[i, 3], points[i, 4]
        points[i, 0] += (c * vx - s * vy) * dt_s
        points[i, 1] += (s * vx + c * vy) * dt_s
        points[i, 2] += points[i, 5] * dt_s
        for k in range(size):
            mean[k] += wm[i] * points[i, k]
    spread = step_noise(state[2], dt_s, lasts_s)
    for i in range(len(points)):
        for j in range(size):
            weighted = wc[i] * (points[i, j] - mean[j])
            for k in range(size):
                spread[j, k] += weighted * (points[i, k] - mean[k])
    return mean, spread


@njit
def step_filters(
    rows: npt.NDArray[np.int64],
    states: FloatArray,
    covariances: FloatArray,
    twists: FloatArray,
    imus: FloatArray,
    dt_s: float,
    lasts_s: float,
    sigma: _Sigma,
    variances: FloatArray,
) -> None:
    """Predict and correct the filters of ``rows`` in place; arguments as for ``predicted``.

    ``variances``: (5,) of the measured yaw, vx, vy (a 0 that stands in for the wheels' constraint) and of the
    wheels' and the gyroscope's vyaw.
    """
    # Two independent readings of one quantity are one reading, weighted by trust: the same estimate, and the
    # innovation's covariance stays well conditioned where both variances are tiny.
    gyro_share = variances[3] / (variances[3] + variances[4])
    noise = np.diag(variances[:4])
    noise[3, 3] = variances[4] * gyro_share
    measured = np.zeros(4)
    for row in rows:
        state, covariance = predicted(states[row], covariances[row], dt_s, lasts_s, sigma)
        if not math.isfinite(twists[row, 0] + twists[row, 1] + imus[row, 0] + imus[row, 1]):
            states[row], covariances[row] = corrected_value_by_value(
                state, covariance, twists[row], imus[row], variances
            )
            continue
        # the whole turns that bring the measured yaw nearest to the estimate, which is not wrapped
        off = (imus[row, 0] - state[2] + math.pi) % (2.0 * math.pi) - math.pi
        measured[0] = state[2] + off
        measured[1] = twists[row, 0]
        measured[3] = twists[row, 1] + gyro_share * (imus[row, 1] - twists[row, 1])
        state, covariance = corrected(state, covariance, measured, noise, _YAW)
        states[row], covariances[row] = state, covariance


@njit
def corrected_value_by_value(
    state: FloatArray, covariance: FloatArray, twist: FloatArray, imu: FloatArray, variances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(6,) state and (6, 6) covariance after what is finite of (2,) ``twist`` and (2,) or more ``imu``.

    Their errors are independent, so one after the other is the same as all at once. vy is a part of the
    twist, and is left out with all of it. ``variances``: as for ``step_filters``.
    """
    near = state[2] + (imu[0] - state[2] + math.pi) % (2.0 * math.pi) - math.pi
    sideways = 0.0 if math.isfinite(twist[0]) or math.isfinite(twist[1]) else math.nan
    measured = np.array([near, twist[0], sideways, twist[1], imu[1]])
    for k, number in enumerate((2, 3, 4, 5, 5)):
        if math.isfinite(measured[k]):
            noise = variances[k : k + 1].copy().reshape(1, 1)
            state, covariance = corrected(state, covariance, measured[k : k + 1], noise, number)
    return state, covariance


@njit
def step_noise(yaw_rad: float, dt_s: float, lasts_s: float) -> FloatArray:
    """(6, 6): what a step of ``dt_s`` adds to the covariance.

    A change of velocity moves the robot, along its heading, for the ``lasts_s`` of the step that it acts in.
    """
    c, s = cos_sin(yaw_rad)
    c, s = lasts_s * c, lasts_s * s
    reach = np.zeros((6, 3))
    reach[0, 0], reach[0, 1] = c, -s
    reach[1, 0], reach[1, 1] = s, c
    reach[2, 2] = lasts_s
    for k in range(3):
        reach[3 + k, k] = 1.0
    noise = np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for k in range(3):
                noise[i, j] += reach[i, k] * (dt_s * PROCESS_NOISE[3 + k]) * reach[j, k]
    for k in range(3):
        noise[k, k] += dt_s * PROCESS_NOISE[k]
    return noise


@njit
def corrected(
    state: FloatArray, covariance: FloatArray, measured: FloatArray, noise: FloatArray, first: int
) -> tuple[FloatArray, FloatArray]:
    """(6,) state and (6, 6) covariance, symmetric, after measuring the states from number ``first`` on.

    ``measured``: (m,), ``noise``: (m, m). What is measured is a part of the state, and the unscented
    transform of a linear function is exact, so no sigma points are drawn: the innovation's covariance is that
    part of the state's, plus the noise.
    """
    size, count = len(state), len(measured)
    root = lower_root(covariance[first : first + count, first : first + count] + noise)
    # whitened: what the state and the innovation have in common, and the innovation, by the root's inverse
    common, surprise = np.empty((count, size)), np.empty(count)
    for i in range(count):
        surprise[i] = measured[i] - state[first + i]
        for j in range(size):
            common[i, j] = covariance[first + i, j]
        for k in range(i):
            surprise[i] -= root[i, k] * surprise[k]
            for j in range(size):
                common[i, j] -= root[i, k] * common[k, j]
        surprise[i] /= root[i, i]
        for j in range(size):
            common[i, j] /= root[i, i]
    mean, after = state.copy(), covariance.copy()
    for k in range(count):
        for i in range(size):
            mean[i] += common[k, i] * surprise[k]
            for j in range(size):
                after[i, j] -= common[k, i] * common[k, j]
    return mean, 0.5 * (after + after.T)


@njit
def lower_root(matrix: FloatArray) -> FloatArray:
    """(n, n) lower triangular L with L L' the symmetric ``matrix``: Cholesky's.

    For a handful of rows a call of LAPACK takes several times as long. Raises LinAlgError where the matrix is
    not positive definite.
    """
    size = len(matrix)
    root = np.zeros((size, size))
    for i in range(size):
        for j in range(i + 1):
            left = matrix[i, j]
            for k in range(j):
                left -= root[i, k] * root[j, k]
            if i > j:
                root[i, j] = left / root[j, j]
            elif left > 0.0:
                root[i, i] = math.sqrt(left)
            else:
                raise np.linalg.LinAlgError("Matrix is not positive definite.")
    return root
