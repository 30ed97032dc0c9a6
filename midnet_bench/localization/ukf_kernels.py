"""The compiled steps of the planar unscented Kalman filter, over [x, y, yaw, vx, vy, vyaw]."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Floats = npt.NDArray[np.float64]


@njit(cache=True)
def step_noise(yaw_rad: float, per_second: Floats, dt_s: float, lasts_s: float) -> Floats:
    """(6, 6): what a step of ``dt_s`` adds to the covariance; ``per_second``: (6,) variances.

    A change of velocity moves the robot, along its heading, for the ``lasts_s`` of the step that it acts in.
    """
    c, s = lasts_s * math.cos(yaw_rad), lasts_s * math.sin(yaw_rad)
    reach = np.zeros((6, 3))
    reach[0, 0], reach[0, 1] = c, -s
    reach[1, 0], reach[1, 1] = s, c
    reach[2, 2] = lasts_s
    for k in range(3):
        reach[3 + k, k] = 1.0
    noise = (reach * (dt_s * per_second[3:])) @ reach.T
    for k in range(3):
        noise[k, k] += dt_s * per_second[k]
    return noise


@njit(cache=True)
def predicted(
    state: Floats,
    covariance: Floats,
    per_second: Floats,
    dt_s: float,
    lasts_s: float,
    scale: float,
    wm: Floats,
    wc: Floats,
) -> tuple[Floats, Floats]:
    """(6,) state and (6, 6) covariance ``dt_s`` later: the unscented transform of constant body velocity.

    ``scale``: the spread of the sigma points, n + lambda; ``wm``, ``wc``: (13,) weights of mean and
    covariance, the centre point first; ``per_second``, ``lasts_s``: as for ``step_noise``. Raises LinAlgError
    where the covariance is not positive definite.
    """
    size = len(state)
    root = np.linalg.cholesky(scale * covariance)
    points = np.empty((2 * size + 1, size))
    points[0] = state
    for i in range(size):
        for k in range(size):
            points[1 + i, k] = state[k] + root[k, i]
            points[1 + size + i, k] = state[k] - root[k, i]
    mean = np.zeros(size)
    for i in range(len(points)):
        c, s = math.cos(points[i, 2]), math.sin(points[i, 2])
        vx, vy = points[i, 3], points[i, 4]
        points[i, 0] += (c * vx - s * vy) * dt_s
        points[i, 1] += (s * vx + c * vy) * dt_s
        points[i, 2] += points[i, 5] * dt_s
        for k in range(size):
            mean[k] += wm[i] * points[i, k]
    spread = step_noise(state[2], per_second, dt_s, lasts_s)
    for i in range(len(points)):
        for j in range(size):
            weighted = wc[i] * (points[i, j] - mean[j])
            for k in range(size):
                spread[j, k] += weighted * (points[i, k] - mean[k])
    return mean, spread


@njit(cache=True)
def corrected(
    state: Floats, covariance: Floats, measured: Floats, noise: Floats, first: int
) -> tuple[Floats, Floats]:
    """(6,) state and (6, 6) covariance, symmetric, after measuring the states from number ``first`` on.

    ``measured``: (m,), ``noise``: (m, m). What is measured is a part of the state, and the unscented
    transform of a linear function is exact, so no sigma points are drawn: the innovation's covariance is that
    part of the state's, plus the noise.
    """
    last = first + len(measured)
    cross = np.ascontiguousarray(covariance[:, first:last])
    innovation = cross[first:last] + noise
    gain = np.linalg.solve(innovation, cross.T).T
    after = covariance - gain @ cross.T
    return state + gain @ (measured - state[first:last]), 0.5 * (after + after.T)
