"""A scan laid onto a known map: where the robot must have been to see it, and how sure that is."""

import functools
import math

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.localization.scan_to_map_kernels import GATE, WIDE_M, fit
from midnet_bench.messages import LidarGeometry

FloatArray = npt.NDArray[np.float64]

LEAST_BEAMS = 30
"""with a return: fewer, a twelfth of the circle, may all meet one wall; our choice"""
LEAST_SHARE = 0.3
"""of the beams with a return: if fewer lie on walls, nothing is said; our choice"""
BEAMS_PER_WITNESS = 10.0
"""Beams that count as one: neighbours meet the same cells, and the next scan meets them again; our choice."""
VAGUE = 1.0
"""metres and radians: standard deviation along a direction of which the scan says nothing"""


class ScanToMap:
    """Fits scans to the walls of one prior map; built once, asked by all robots.

    Gauss-Newton on the distance from each beam's end to the nearest wall face, negative behind it, read
    between the centres of the map's cells. The Geman-McClure weights start wide and narrow down, so that
    beams which met a robot or an intruder lose their say.

    Scan after scan errs alike, against the same cells. So the covariance counts a wall's beams as few, and
    no number of them makes a position surer than a wall's place within its cell: a filter that takes each
    scan for news does not grow sure by repetition.
    """

    def __init__(self, prior_map: OccupancyGrid) -> None:
        """``prior_map`` int8 (100 occupied, 0 free, -1 unknown), map frame; exact or explored."""
        # Around an explored map, whose outer walls are its last cells, beams end a little outside.
        margin = math.ceil(GATE * WIDE_M / prior_map.resolution) + 1
        cells = np.pad(prior_map.data, margin, constant_values=-1)
        free = cells == 0
        beside_free = cv2.dilate(free.astype(np.uint8), np.ones((3, 3), np.uint8)) == 1
        # Only faces pull: what lies behind one, solid or never seen, ends no beam.
        face = (cells == 100) & beside_free
        to_face = cv2.distanceTransform((~face).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        distances_m = to_face.astype(np.float64) * prior_map.resolution
        self._distances_m = np.where(free, distances_m, -distances_m)
        # Where the known ends without a wall, the change of sign is no face.
        self._distances_m[beside_free & ~free & ~face] = np.nan
        self._cell_m = prior_map.resolution
        self._first_center = prior_map.center_of(-margin, -margin)

    def match(
        self, pose: Pose2D, ranges_m: FloatArray, geometry: LidarGeometry
    ) -> tuple[Pose2D, FloatArray] | None:
        """The robot's pose by its scan, and the (3, 3) covariance of x, y, yaw; None if too little fits.

        The covariance is positive definite, metres and radians squared. It is wider than the fit alone
        would have it, and about a metre along a corridor with no end in sight.

        Args:
            pose: where the robot believes it is, map frame; off by at most about 0.2 m and 6 degrees, and
                towards a wall by half its thickness if no other one can tell: beyond, its far side is nearer.
            ranges_m: (beams,) metres; beams outside the sensor's limits, inf or NaN are left out.
            geometry: of the beams, with the sensor's mount on the robot.
        """
        returned = (ranges_m > geometry.range_min_m) & (ranges_m < geometry.range_max_m)
        ends = ranges_m[returned, None] * _directions(geometry)[returned] + geometry.mount[:2]
        x, y = self._first_center
        start = np.array([pose.x - x, pose.y - y, pose.yaw])
        fitted, terms = fit(self._distances_m, self._cell_m, ends, start)
        if terms.beams < max(LEAST_BEAMS, LEAST_SHARE * len(ends)):
            return None
        variance = BEAMS_PER_WITNESS * max(terms.variance_m2, self._cell_m**2 / 12.0)
        covariance = np.linalg.inv(terms.hessian / variance + np.eye(3) / VAGUE**2)
        covariance += np.diag((self._cell_m, self._cell_m, 0.0)) ** 2 / 12.0
        dx, dy, yaw = fitted.tolist()
        return Pose2D(x + dx, y + dy, wrap_angle(yaw)), (covariance + covariance.T) / 2.0


@functools.lru_cache(maxsize=16)
def _directions(geometry: LidarGeometry) -> FloatArray:
    """(beams, 2) unit vectors, robot frame."""
    angles = geometry.angles_rad + geometry.mount.yaw
    return np.column_stack((np.cos(angles), np.sin(angles)))
