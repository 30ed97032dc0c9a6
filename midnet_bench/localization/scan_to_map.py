"""A scan laid onto a known map: where the robot must have been to see it, and how sure that is."""

import functools
import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import LidarGeometry

FloatArray = npt.NDArray[np.float64]

WIDE_M, NARROW_M = 0.15, 0.04
"""Distance to a wall at which a beam counts a quarter: in the first round, halved each round, in the last."""
GATE = 3.0
"""A beam that ends this many such distances from any wall has met something that the map does not have."""
MOST_ROUNDS = 20
SETTLED = 1e-4
"""metres and radians: a shorter last step ends the search"""
DAMPING_BEAMS = 4.0
"""A direction that fewer beams speak for is searched with caution."""

LEAST_BEAMS = 30
LEAST_SHARE = 0.3
"""of the beams with a return: if fewer lie on walls, nothing is said"""
BEAMS_PER_WITNESS = 30.0
"""Beams whose errors count as one: those on one wall share the error of its cells, scan after scan."""
VAGUE = 1.0
"""metres and radians: standard deviation along a direction of which the scan says nothing"""


class ScanToMap:
    """Fits scans to the walls of one prior map; built once, asked by all robots.

    Gauss-Newton on the distance from each beam's end to the nearest wall face, read between the centres of
    the map's cells. The Geman-McClure weights start wide and narrow down, so that beams which met a robot
    or an intruder lose their say.
    """

    def __init__(self, prior_map: OccupancyGrid) -> None:
        """``prior_map`` int8 (100 occupied, 0 free, -1 unknown), map frame; exact or explored."""
        free = (prior_map.data == 0).astype(np.uint8)
        beside_free = cv2.dilate(free, np.ones((3, 3), np.uint8))
        # Only faces pull: what lies behind one, solid or never seen, ends no beam.
        no_face = ((prior_map.data != 100) | (beside_free == 0)).astype(np.uint8)
        cells = cv2.distanceTransform(no_face, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self._distances_m = np.asarray(cells, dtype=np.float64) * prior_map.resolution
        self._cell_m = prior_map.resolution
        self._first_center = prior_map.center_of(0, 0)

    def match(
        self, pose: Pose2D, ranges_m: FloatArray, geometry: LidarGeometry
    ) -> tuple[Pose2D, FloatArray] | None:
        """The robot's pose by its scan, and the (3, 3) covariance of x, y, yaw; None if too little fits.

        The covariance is positive definite, metres and radians squared. It is wider than the fit alone
        would have it (``BEAMS_PER_WITNESS``), and about a metre along a corridor with no end in sight.

        Args:
            pose: where the robot believes it is, map frame; off by a few decimetres and degrees at most.
            ranges_m: (beams,) metres; beams outside the sensor's limits, inf or NaN are left out.
            geometry: of the beams, with the sensor's mount on the robot.
        """
        returned = (ranges_m > geometry.range_min_m) & (ranges_m < geometry.range_max_m)
        ends = ranges_m[returned, None] * _directions(geometry)[returned] + geometry.mount[:2]
        x, y = self._first_center
        start = np.array([pose.x - x, pose.y - y, pose.yaw])
        fit = _fit(self._distances_m, self._cell_m, ends, start)
        if fit.beams < max(LEAST_BEAMS, LEAST_SHARE * len(ends)):
            return None
        variance = BEAMS_PER_WITNESS * max(fit.variance_m2, self._cell_m**2 / 12.0)
        covariance = np.linalg.inv(fit.hessian / variance + np.eye(3) / VAGUE**2)
        dx, dy, yaw = fit.pose.tolist()
        return Pose2D(x + dx, y + dy, wrap_angle(yaw)), (covariance + covariance.T) / 2.0


class _Fit(NamedTuple):
    pose: FloatArray
    hessian: FloatArray
    beams: int
    """that end within the gate"""
    variance_m2: float
    """weighted mean of their squared distances"""


class _Terms(NamedTuple):
    hessian: FloatArray
    gradient: FloatArray
    beams: int
    variance_m2: float


@njit(cache=True)
def _fit(distances_m: FloatArray, cell_m: float, ends: FloatArray, start: FloatArray) -> _Fit:
    """The pose at which beam ends (B, 2), robot frame, lie best on the faces; from cell (0, 0)'s centre."""
    pose = start.copy()
    scale_m = WIDE_M
    for _ in range(MOST_ROUNDS):
        terms = _terms(distances_m, cell_m, ends, pose, scale_m)
        step = np.linalg.solve(terms.hessian + DAMPING_BEAMS * np.eye(3), terms.gradient)
        pose -= step
        if scale_m == NARROW_M and np.abs(step).max() < SETTLED:
            break
        scale_m = max(scale_m / 2.0, NARROW_M)
    terms = _terms(distances_m, cell_m, ends, pose, NARROW_M)
    return _Fit(pose, terms.hessian, terms.beams, terms.variance_m2)


@njit(cache=True)
def _terms(
    distances_m: FloatArray, cell_m: float, ends: FloatArray, pose: FloatArray, scale_m: float
) -> _Terms:
    """The weighted normal equations of the squared distances at a pose."""
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
        if distance > GATE * scale_m:
            continue
        slope[0] = (low_rise + v * (high_rise - low_rise)) / cell_m
        slope[1] = (high - low) / cell_m
        slope[2] = dx * slope[1] - dy * slope[0]
        weight = 1.0 / (1.0 + (distance / scale_m) ** 2) ** 2
        for i in range(3):
            gradient[i] += weight * distance * slope[i]
            for j in range(3):
                hessian[i, j] += weight * slope[i] * slope[j]
        beams += 1
        weights += weight
        squares += weight * distance**2
    return _Terms(hessian, gradient, beams, squares / max(weights, 1.0))


@functools.lru_cache(maxsize=16)
def _directions(geometry: LidarGeometry) -> FloatArray:
    """(beams, 2) unit vectors, robot frame."""
    angles = geometry.angles_rad + geometry.mount.yaw
    return np.column_stack((np.cos(angles), np.sin(angles)))
