"""Where one map may lie in another, from image features that both show."""

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.grid_points import OCCUPIED_FROM

_HALO_M = 1.0
_RATIO = 0.7
_INLIER_CELLS = 3.0
_LEAST_MATCHES = 6


class Proposal(NamedTuple):
    """A placement of one map in another, as features suggest it."""

    pose: Pose2D
    """the second map's frame in the first map's frame"""
    confidence: float
    """inliers / (8 + 0.3 * matches), OpenCV's measure of a pair of images"""
    scale: float
    """what the features say of the maps' relative size, divided out of ``pose``; 1 when they agree"""


def propose(first: OccupancyGrid, second: OccupancyGrid) -> Proposal | None:
    """The placement that most feature matches agree on; None when fewer than six matches are found.

    multirobot_map_merge's front end: AKAZE features, the ratio test at 0.7 both ways, RANSAC for rotation,
    translation and one scale. What it is fed differs: not the grid's bytes, where the ragged edge of the
    unknown is the strongest feature, but each cell's distance from the nearest occupied one up to 1 m,
    which two partial views of a wall have in common.

    Args:
        first: int8, occupied from 65 on.
        second: the same; of any resolution.
    """
    points_a, descriptors_a = _features(first)
    points_b, descriptors_b = _features(second)
    pairs = sorted(
        set(_distinct(descriptors_a, descriptors_b))
        | {(a, b) for b, a in _distinct(descriptors_b, descriptors_a)}
    )
    if len(pairs) < _LEAST_MATCHES:
        return None
    matched_a, matched_b = points_a[[a for a, _ in pairs]], points_b[[b for _, b in pairs]]
    cv2.setRNGSeed(0)
    transform, inlier_mask = cv2.estimateAffinePartial2D(
        matched_b,
        matched_a,
        method=cv2.RANSAC,
        ransacReprojThreshold=_INLIER_CELLS * max(first.resolution, second.resolution),
        maxIters=5000,
        confidence=0.999,
    )
    if transform is None:
        return None
    inliers = inlier_mask.ravel().astype(bool)
    (c, _, _), (s, _, _) = transform.tolist()
    yaw = math.atan2(s, c)
    center_a, center_b = matched_a[inliers].mean(axis=0), matched_b[inliers].mean(axis=0)
    turned = Pose2D(0.0, 0.0, yaw).compose(Pose2D(float(center_b[0]), float(center_b[1]), 0.0))
    pose = Pose2D(float(center_a[0]) - turned.x, float(center_a[1]) - turned.y, yaw)
    return Proposal(pose, float(inliers.sum()) / (8.0 + 0.3 * len(pairs)), math.hypot(c, s))


def _features(grid: OccupancyGrid) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]:
    """((N, 2) x, y in the grid's frame in metres, (N, 61) descriptors)."""
    not_wall = (grid.data < OCCUPIED_FROM).view(np.uint8)
    none = np.zeros((0, 2)), np.zeros((0, 61), dtype=np.uint8)
    if not_wall.all():
        return none
    distance_m = cv2.distanceTransform(not_wall, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.resolution
    image = np.rint(np.minimum(distance_m, _HALO_M) * (255.0 / _HALO_M)).astype(np.uint8)
    keypoints, descriptors = cv2.AKAZE.create().detectAndCompute(image, None)
    if descriptors is None:
        return none
    pixels = np.array([keypoint.pt for keypoint in keypoints])
    return (pixels + 0.5) * grid.resolution + grid.origin, descriptors


def _distinct(queries: npt.NDArray[np.uint8], targets: npt.NDArray[np.uint8]) -> list[tuple[int, int]]:
    """(query, target) where the best target is clearly better than the second best."""
    if len(targets) < 2:
        return []
    ranked = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(queries, targets, k=2)
    return [
        (best.queryIdx, best.trainIdx)
        for best, next_best in ranked
        if best.distance < _RATIO * next_best.distance
    ]
