"""A scan laid onto a known map: where the robot must have been to see it, and how sure that is."""

import math
from typing import NamedTuple

import cv2
import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos_sin, directions, hypot
from midnet_bench.geometry import Floats, LidarGeometry, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid, cells_to_unset

MIN_BEAMS = 30  # A fit to fewer beams that end on walls is not believed.
MIN_SHARE, MIN_SHARE_RECORDED = 0.5, 0.3
"""Nor one to a smaller share of the returns; maps of recordings lack more of what stands in a building."""
CORRELATED_BEAMS = 10.0  # So many beams of a wall count as one.
UNSEEN_DEVIATION = 1.0  # Standard deviation, metres and radians, of what no beam constrains.
WIDE_M, NARROW_M = 0.15, 0.04
"""Distance to a wall at which a beam counts a quarter: at first, and, after halvings, in the end, but no less
than one cell: a wall is not known better than that."""
GATE = 3.0
"""A beam that ends this many such distances from any wall has met something that the map does not have."""
MAX_ROUNDS = 20
SETTLED_STEP = 1e-4  # metres and radians: a shorter last step ends the search
MIN_INFORMATION = 0.05
"""A direction that no larger share of the beams on walls constrains counts as unseen: along a corridor whose
map is bumpy some beams always do, and would hold the robot to the same bumps."""


class NormalEquations(NamedTuple):
    """The weighted normal equations of the squared distances at a pose (x, y, yaw), 0 where unseen."""

    hessian: Floats
    gradient: Floats
    beams: int  # that end within the gate
    variance_m2: float  # weighted mean of their squared distances


class ScanToMap:
    """Fits scans to the walls of one prior map; one serves all robots.

    Gauss-Newton on the distance from each beam's end to the nearest wall face, negative behind it, read
    between the centres of the map's cells. The Geman-McClure weights start wide and narrow down, so that
    beams which met a robot or an intruder lose their weight. Errors of consecutive scans are correlated, as
    they meet the same cells, so the covariance is inflated: no number of beams makes a pose surer than a
    wall's place within its cell, however often the filter takes such a match.
    """

    def __init__(self, prior_map: OccupancyGrid, min_share: float = MIN_SHARE) -> None:
        """``prior_map``: int8 (100 occupied, 0 free, -1 unknown), map frame; exact or explored."""
        self._min_share = min_share
        # Around an explored map, whose outer walls are its last cells, beams end a little outside.
        margin = math.ceil(GATE * WIDE_M / prior_map.resolution) + 1
        cells = np.pad(prior_map.data, margin, constant_values=-1)
        free = cells == 0
        beside_free = cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)) == 1
        # Only faces pull: what lies behind one, solid or never seen, ends no beam.
        face = (cells == 100) & beside_free
        distances_m = cells_to_unset(~face).astype(np.float64) * prior_map.resolution
        self._distances_m = np.where(free, distances_m, -distances_m)
        # Where the known ends without a wall, the change of sign is no face.
        self._distances_m[beside_free & ~free & ~face] = np.nan
        self._cell_m = prior_map.resolution
        self._first_center = prior_map.center_of(-margin, -margin)

    def match(self, pose: Pose2D, ranges_m: Floats, geometry: LidarGeometry) -> tuple[Pose2D, Floats] | None:
        """The robot's pose by its scan, and the (3, 3) covariance of x, y, yaw; None if too little fits.

        ``pose``: the believed one, map frame, off by at most about 0.2 m and 6 degrees; ``ranges_m``:
        (beams,), where those outside the sensor's limits, inf or NaN are left out. The covariance is positive
        definite, metres and radians squared, and about a metre along a corridor with no end in sight.
        """
        returned = (ranges_m > geometry.range_min_m) & (ranges_m < geometry.range_max_m)
        beams = directions(geometry.angles_rad[returned] + geometry.mount.yaw)
        ends = ranges_m[returned, None] * beams + geometry.mount[:2]
        x, y = self._first_center
        start = np.array([pose.x - x, pose.y - y, pose.yaw])
        fitted, terms = fit(self._distances_m, self._cell_m, ends, start)
        if terms.beams < max(MIN_BEAMS, self._min_share * len(ends)):
            return None
        variance = CORRELATED_BEAMS * max(terms.variance_m2, self._cell_m * self._cell_m / 12.0)
        covariance = _inverse(terms.hessian / variance + np.eye(3) / (UNSEEN_DEVIATION * UNSEEN_DEVIATION))
        reach_m = max(math.sqrt(np.mean(np.square(ends).sum(axis=1))), self._cell_m)
        covariance += np.square(np.diag((self._cell_m, self._cell_m, self._cell_m / reach_m))) / 12.0
        dx, dy, yaw = fitted.tolist()
        return Pose2D(x + dx, y + dy, wrap_angle(yaw)), (covariance + covariance.T) / 2.0


@njit
def fit(distances_m: Floats, cell_m: float, ends: Floats, start: Floats) -> tuple[Floats, NormalEquations]:
    """(pose, terms) where a scan lies best on the wall faces, found from ``start``.

    ``distances_m``: (rows, columns) of cell centres to the nearest face, negative behind it, NaN unknown;
    ``ends``: (B, 2) of the beams, robot frame. Poses are (3,), x, y in metres from cell (0, 0)'s centre.
    """
    narrow_m = max(NARROW_M, cell_m)
    pose = start.copy()
    scale_m = WIDE_M
    for _ in range(MAX_ROUNDS):
        terms = _terms(distances_m, cell_m, ends, pose, scale_m)
        step = _step(terms.hessian, terms.gradient)
        pose -= step
        if scale_m == narrow_m and np.abs(step).max() < SETTLED_STEP:
            break
        scale_m = max(scale_m / 2.0, narrow_m)
    return pose, _terms(distances_m, cell_m, ends, pose, narrow_m)


@njit
def _terms(distances_m: Floats, cell_m: float, ends: Floats, pose: Floats, scale_m: float) -> NormalEquations:
    rows, columns = distances_m.shape
    hessian, gradient, slope = np.zeros((3, 3)), np.zeros(3), np.empty(3)
    beams, weights, squares = 0, 0.0, 0.0
    cos, sin = cos_sin(pose[2])
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
        share = distance / scale_m
        spread = 1.0 + share * share
        weight = 1.0 / (spread * spread)
        for i in range(3):
            gradient[i] += weight * distance * slope[i]
            for j in range(3):
                hessian[i, j] += weight * slope[i] * slope[j]
        beams += 1
        weights += weight
        squares += weight * distance * distance
    _leave_out_unseen(hessian, gradient, MIN_INFORMATION * weights)
    return NormalEquations(hessian, gradient, beams, squares / max(weights, 1.0))


@njit
def _leave_out_unseen(hessian: Floats, gradient: Floats, least: float) -> None:
    """Zero both along directions in the plane whose information is no more than ``least``.

    Left small, the cross terms would let a sure heading push the pose along a corridor.
    """
    mean = (hessian[0, 0] + hessian[1, 1]) / 2.0
    half, cross = (hessian[0, 0] - hessian[1, 1]) / 2.0, hessian[0, 1]
    spread, angle = hypot(half, cross), atan2(cross, half) / 2.0
    for say, toward in ((mean + spread, angle), (mean - spread, angle + math.pi / 2.0)):
        if say <= least:
            way = cos_sin(toward)
            of_yaw = way[0] * hessian[0, 2] + way[1] * hessian[1, 2]
            slope = way[0] * gradient[0] + way[1] * gradient[1]
            for i in range(2):
                gradient[i] -= slope * way[i]
                hessian[i, 2] -= of_yaw * way[i]
                hessian[2, i] = hessian[i, 2]
                for j in range(2):
                    hessian[i, j] -= say * way[i] * way[j]


@njit
def _step(hessian: Floats, gradient: Floats) -> Floats:
    """(3,) the solution of hessian @ step = gradient, 0 along what was left out: Gauss's elimination."""
    left, step = hessian.copy(), gradient.copy()
    for k in range(3):
        left[k, k] += 1e-6
    for k in range(3):
        for i in range(k + 1, 3):
            factor = left[i, k] / left[k, k]
            step[i] -= factor * step[k]
            left[i, k:] -= factor * left[k, k:]
    for k in range(2, -1, -1):
        for j in range(k + 1, 3):
            step[k] -= left[k, j] * step[j]
        step[k] /= left[k, k]
    return step


@njit
def _inverse(matrix: Floats) -> Floats:
    """(3, 3) the inverse of a symmetric, positive definite matrix; LAPACK's bits depend on the processor."""
    left, found = matrix.copy(), np.eye(3)
    for k in range(3):
        pivot = left[k, k]
        left[k] /= pivot
        found[k] /= pivot
        for i in range(3):
            if i != k:
                factor = left[i, k]
                left[i] -= factor * left[k]
                found[i] -= factor * found[k]
    return found
