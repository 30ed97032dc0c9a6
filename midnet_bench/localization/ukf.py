"""The pose filter of robot_localization in its two-dimensional mode: wheel odometry's twist and an IMU."""

import math
from collections.abc import Sequence

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Floats, Indices, Pose2D, wrap_angle
from midnet_bench.localization.localization_settings import UkfSettings

PROCESS_NOISE = (0.05, 0.05, 0.06, 0.025, 0.025, 0.02)
"""Variances that x, y, yaw, vx, vy, vyaw gain per second: robot_localization's default diagonal for the six
states that its ``two_d_mode`` leaves free."""
INITIAL_VARIANCE = 1e-9  # robot_localization, initial_estimate_covariance
MIN_VARIANCE = 1e-9
"""A smaller measurement variance, 0 included, is raised to this, as robot_localization does."""
WIDE_YAW_RAD = 0.5
"""how far from the mean the headings of sigma points may lie; their mean way is 2 % too short there"""

ALPHA, BETA, KAPPA = 1.0, 2.0, 0.0
"""Merwe's scaled sigma points. robot_localization's alpha of 0.001 puts a weight of about -1e6 on the centre
point; with 1 no weight is negative, so a predicted covariance cannot lose its definiteness, and the estimates
are the same to far below a millimetre."""
SPREAD = ALPHA * ALPHA * (6 + KAPPA)  # of the sigma points of six states
MEAN_WEIGHTS = np.array([(SPREAD - 6) / SPREAD] + [0.5 / SPREAD] * 12)
COVARIANCE_WEIGHTS = MEAN_WEIGHTS + np.array([1 - ALPHA * ALPHA + BETA] + [0.0] * 12)

_POSE, _YAW = 0, 2  # index of the first state that is measured: by a pose; by odometry and IMU


class PlanarUkf:
    """An unscented Kalman filter over [x, y, yaw, vx, vy, vyaw]; velocities in the body frame.

    The state is what robot_localization's 15 come down to with ``two_d_mode`` and no acceleration fused. Of
    odometry it fuses vx, vy (a measured 0, the wheels' constraint) and vyaw, of the IMU yaw and vyaw.

    Departures from the package, on purpose:

    * the covariance update is the textbook one (P - K S K'), not the package's, which leaves the
      measurement noise out of S there and keeps P too large;
    * yaw is averaged linearly, unwrapped: the package's circular mean gives NaN at a large heading variance;
    * a change of velocity acts within the step that it happens in, so the noise of velocities reaches the
      position too. With the package's diagonal noise the pose lags the robot by 11 or 22 mm;
    * sigma points whose headings lie farther apart than ``WIDE_YAW_RAD`` move along the mean heading: the
      mean way of points that look to all sides is no way at all.
    """

    def __init__(self, initial: Pose2D, settings: UkfSettings) -> None:
        """A robot at rest at ``initial``, its pose in the map frame; a ``UkfTeam`` steps it."""
        self.settings = settings
        self.state = np.array([initial.x, initial.y, initial.yaw, 0.0, 0.0, 0.0])
        self.covariance = INITIAL_VARIANCE * np.eye(6)

    @property
    def pose(self) -> Pose2D:
        """The estimated pose in the map frame, yaw within [-pi, pi)."""
        x, y, yaw = self.state[:3].tolist()
        return Pose2D(x, y, wrap_angle(yaw))

    def correct_pose(self, pose: Pose2D, covariance: Floats) -> Pose2D:
        """The pose after a correction with a measured one, such as a scan matched to the map.

        ``covariance``: (3, 3) of x, y, yaw in metres and radians, squared; positive definite.
        """
        estimated_yaw = float(self.state[2])  # not wrapped
        measured = np.array([pose.x, pose.y, estimated_yaw + wrap_angle(pose.yaw - estimated_yaw)])
        self.state[:], self.covariance[:] = corrected(
            self.state, self.covariance, measured, covariance, _POSE
        )
        return self.pose


class UkfTeam:
    """The filters of n robots with one set of settings, stepped by one compiled call; each is independent."""

    def __init__(self, filters: Sequence[PlanarUkf]) -> None:
        """Makes each filter's state and covariance a view of its row here."""
        self.states: Floats = np.array([each.state for each in filters])  # (n, 6)
        self.covariances: Floats = np.array([each.covariance for each in filters])  # (n, 6, 6)
        for row, each in enumerate(filters):
            each.state, each.covariance = self.states[row], self.covariances[row]
        settings = filters[0].settings
        self._change_lasts = 1.0 if settings.twist_is_mean else 0.5
        vx, vy, wheel_rate = settings.twist_variance
        variances = [settings.imu_yaw_variance, vx, vy, wheel_rate, settings.imu_yaw_rate_variance]
        self._variances = np.maximum(variances, MIN_VARIANCE)

    def step(self, rows: Indices, twists: Floats, imus: Floats, dt_s: float) -> None:
        """Let ``dt_s`` > 0 seconds pass for the filters of ``rows``, given the newest sensor readings.

        ``twists``: (n, 2) forward speed (m/s) and yaw rate (rad/s) of odometry; ``imus``: (n, 2) or more, yaw
        (rad) and yaw rate (rad/s) first.
        """
        lasts_s = self._change_lasts * dt_s
        step_filters(rows, self.states, self.covariances, twists, imus, dt_s, lasts_s, self._variances)


@njit
def step_filters(
    rows: Indices,
    states: Floats,
    covariances: Floats,
    twists: Floats,
    imus: Floats,
    dt_s: float,
    lasts_s: float,
    variances: Floats,
) -> None:
    """Predict and correct the filters of ``rows`` in place.

    ``lasts_s``: for how much of the step a change of velocity acts; ``variances``: (5,) of the measured yaw,
    vx, vy and of the wheels' and the gyroscope's vyaw.
    """
    # Two independent readings of one quantity are one reading, weighted by trust: the same estimate, and the
    # innovation's covariance stays well conditioned where both variances are tiny.
    gyro_share = variances[3] / (variances[3] + variances[4])
    noise = np.diag(variances[:4])
    noise[3, 3] = variances[4] * gyro_share
    measured = np.zeros(4)
    for row in rows:
        state, covariance = predicted(states[row], covariances[row], dt_s, lasts_s)
        # the whole turns that bring the measured yaw nearest to the estimate, which is not wrapped
        off = (imus[row, 0] - state[2] + math.pi) % (2.0 * math.pi) - math.pi
        measured[0] = state[2] + off
        measured[1] = twists[row, 0]
        measured[3] = twists[row, 1] + gyro_share * (imus[row, 1] - twists[row, 1])
        states[row], covariances[row] = corrected(state, covariance, measured, noise, _YAW)


@njit
def predicted(state: Floats, covariance: Floats, dt_s: float, lasts_s: float) -> tuple[Floats, Floats]:
    """(6,) state and (6, 6) covariance ``dt_s`` later: the unscented transform of constant body velocity.

    Raises LinAlgError where the covariance is not positive definite.
    """
    size = len(state)
    root = lower_root(SPREAD * covariance)
    points = np.empty((2 * size + 1, size))
    points[0] = state
    for i in range(size):
        for k in range(size):
            points[1 + i, k] = state[k] + root[k, i]
            points[1 + size + i, k] = state[k] - root[k, i]
    mean = np.zeros(size)
    is_wide = SPREAD * covariance[2, 2] > WIDE_YAW_RAD * WIDE_YAW_RAD
    for i in range(len(points)):
        c, s = cos_sin(state[2] if is_wide else points[i, 2])
        vx, vy = points[i, 3], points[i, 4]
        points[i, 0] += (c * vx - s * vy) * dt_s
        points[i, 1] += (s * vx + c * vy) * dt_s
        points[i, 2] += points[i, 5] * dt_s
        for k in range(size):
            mean[k] += MEAN_WEIGHTS[i] * points[i, k]
    spread = step_noise(state[2], dt_s, lasts_s)
    for i in range(len(points)):
        for j in range(size):
            weighted = COVARIANCE_WEIGHTS[i] * (points[i, j] - mean[j])
            for k in range(size):
                spread[j, k] += weighted * (points[i, k] - mean[k])
    return mean, spread


@njit
def step_noise(yaw_rad: float, dt_s: float, lasts_s: float) -> Floats:
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
    state: Floats, covariance: Floats, measured: Floats, noise: Floats, first: int
) -> tuple[Floats, Floats]:
    """(6,) state and (6, 6) covariance, symmetric, after measuring the states from number ``first`` on.

    ``measured``: (m,), ``noise``: (m, m). What is measured is a part of the state, so the innovation's
    covariance is that part of the state's, plus the noise: no sigma points are needed.
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
def lower_root(matrix: Floats) -> Floats:
    """(n, n) lower triangular L with L L' the symmetric ``matrix``: Cholesky's, without LAPACK's long call.

    Raises LinAlgError where the matrix is not positive definite.
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
