"""The search for the pose at which a scan fits a map, compiled."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

WIDE_M, NARROW_M = 0.15, 0.04
"""Distance to a wall at which a beam counts a quarter: at first, and, after halvings, in the end.

It does not end below one cell: a wall is not known better than that.
"""
GATE = 3.0
"""A beam that ends this many such distances from any wall has met something that the map does not have."""
MOST_ROUNDS = 20
SETTLED = 1e-4
"""metres and radians: a shorter last step ends the search"""
LEAST_SAY = 0.05
"""A direction for which no larger share of the beams on walls speaks is taken for unseen.

Along a corridor whose map is bumpy some always do, and would hold the robot to the same bumps as it drives.
"""


class Terms(NamedTuple):
    """The weighted normal equations of the squared distances at a pose (x, y, yaw), 0 where unseen."""

    hessian: FloatArray
    gradient: FloatArray
    beams: int
    """that end within the gate"""
    variance_m2: float
    """weighted mean of their squared distances"""


@njit(cache=True)
def fit(
    distances_m: FloatArray, cell_m: float, ends: FloatArray, start: FloatArray
) -> tuple[FloatArray, Terms]:
    """(pose, terms) where a scan lies best on the wall faces, found from ``start``.

    Args:
        distances_m: (rows, columns) of cell centres to the nearest face, negative behind it, NaN unknown.
        cell_m: side of a cell.
        ends: (B, 2) float64 ends of the beams, robot frame, metres.
        start: (3,) pose; x, y in metres from the centre of cell (0, 0), as is the pose that is returned.
    """
    narrow_m = max(NARROW_M, cell_m)
    pose = start.copy()
    scale_m = WIDE_M
    for _ in range(MOST_ROUNDS):
        terms = _terms(distances_m, cell_m, ends, pose, scale_m)
        step = _step(terms.hessian, terms.gradient)
        pose -= step
        if scale_m == narrow_m and np.abs(step).max() < SETTLED:
            break
        scale_m = max(scale_m / 2.0, narrow_m)
    return pose, _terms(distances_m, cell_m, ends, pose, narrow_m)


@njit(cache=True)
def _terms(
    distances_m: FloatArray, cell_m: float, ends: FloatArray, pose: FloatArray, scale_m: float
) -> Terms:
    rows, columns = distances_m.shape
    hessian, gradient, slope = np.zeros((3, 3)), np.zeros(3), np.empty(3)
    beams, weights, squares = 0, 0.0, 0.0
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    for b in range(ends.shape[0]):
        dx = cos * ends[b, 0] - sin * ends[b, 1]
        dy = sin * ends[b, 0] + cos * ends[b, 1]
        u, v = (pose[0] + dx) / cell_m, (pose[1] + dy) / cell_m
        column, row = math.floor(u), math.floor(v)
        if not (0 <= column < columns - 1 and 0 <= row < rows - 1):
            continue
        u, v = u - column, v - row
        low, high = distances_m[row, column], distances_m[row + 1, column]
        low_rise = distances_m[row, column + 1] - low
        high_rise = distances_m[row + 1, column + 1] - high
        low, high = low + u * low_rise, high + u * high_rise
        distance = low + v * (high - low)
        slope[0] = (low_rise + v * (high_rise - low_rise)) / cell_m
        slope[1] = (high - low) / cell_m
        # A beam goes down to the face it met; where it goes up, a wall's other side is the nearer one.
        if not (abs(distance) <= GATE * scale_m and dx * slope[0] + dy * slope[1] <= 0.0):
            continue
        slope[2] = dx * slope[1] - dy * slope[0]
        weight = 1.0 / (1.0 + (distance / scale_m) ** 2) ** 2
        for i in range(3):
            gradient[i] += weight * distance * slope[i]
            for j in range(3):
                hessian[i, j] += weight * slope[i] * slope[j]
        beams += 1
        weights += weight
        squares += weight * distance**2
    _leave_out_unseen(hessian, gradient, LEAST_SAY * weights)
    return Terms(hessian, gradient, beams, squares / max(weights, 1.0))


@njit(cache=True)
def _leave_out_unseen(hessian: FloatArray, gradient: FloatArray, least: float) -> None:
    """Zero what they say of the directions in the plane of which they say no more than ``least``.

    Not just leave it small: by the cross terms a sure heading would push the pose along a corridor.
    """
    mean = (hessian[0, 0] + hessian[1, 1]) / 2.0
    half, cross = (hessian[0, 0] - hessian[1, 1]) / 2.0, hessian[0, 1]
    spread, angle = math.hypot(half, cross), math.atan2(cross, half) / 2.0
    for say, toward in ((mean + spread, angle), (mean - spread, angle + math.pi / 2.0)):
        if say <= least:
            way = np.array([math.cos(toward), math.sin(toward)])
            of_yaw = way[0] * hessian[0, 2] + way[1] * hessian[1, 2]
            slope = way[0] * gradient[0] + way[1] * gradient[1]
            for i in range(2):
                gradient[i] -= slope * way[i]
                hessian[i, 2] -= of_yaw * way[i]
                hessian[2, i] = hessian[i, 2]
                for j in range(2):
                    hessian[i, j] -= say * way[i] * way[j]


@njit(cache=True)
def _step(hessian: FloatArray, gradient: FloatArray) -> FloatArray:
    """(3,) the solution of hessian @ step = gradient, 0 along what was left out: Gauss's elimination."""
    left, step = hessian.copy(), gradient.copy()
    for k in range(3):
        left[k, k] += 1e-6
    for k in range(3):
        for i in range(k + 1, 3):
            factor = left[i, k] / left[k, k]
            step[i] -= factor * step[k]
            for j in range(k, 3):
                left[i, j] -= factor * left[k, j]
    for k in range(2, -1, -1):
        for j in range(k + 1, 3):
            step[k] -= left[k, j] * step[j]
        step[k] /= left[k, k]
    return step
