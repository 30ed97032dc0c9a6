"""Where one map lies in another: a proposal by features, its refinement on the grids, and its rivals."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import scipy.fft

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, cell_centers, values_at
from midnet_bench.mapping.hill_climb import hill_climb

FloatArray = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]

TOLERANCE_M = 0.1
"""Walls this near to each other are the same wall; a wall deeper than this in free space contradicts it."""

_REACHES_M = {0.2: 3, 0.1: 3, 0.05: 4}
"""reach of a wall's pull, metres: how often the step is halved, to 3 mm at last"""
_POINTS = 1500
_COARSE_CELL_M = 0.1
_PEAKS_PER_TURN = 2
_PEAK_RADIUS_M = 0.6
_CONTRADICTION_WEIGHT = 3.0

_HALO_M = 1.0
_RATIO = 0.7
_INLIER_CELLS = 3.0
_MIN_MATCHES = 6


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
    translation and one scale (OpenCV's draws from a generator of its own, always alike). What it is fed
    differs: not the grid's bytes, where the ragged edge of the unknown is the strongest feature, but each
    cell's distance from the nearest occupied one up to 1 m, which two partial views of a wall have in
    common.

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
    if len(pairs) < _MIN_MATCHES:
        return None
    matched_a, matched_b = points_a[[a for a, _ in pairs]], points_b[[b for _, b in pairs]]
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


def _features(grid: OccupancyGrid) -> tuple[FloatArray, npt.NDArray[np.uint8]]:
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


@dataclass(frozen=True, eq=False)
class WallMap:
    """A map as the alignment sees it."""

    grid: OccupancyGrid
    walls: FloatArray
    """(N, 2) centres of the occupied cells, metres"""
    open_space: FloatArray
    """(M, 2) centres of the free cells deeper than the tolerance"""
    to_wall_m: Image
    """(H, W) from each cell to the nearest occupied one"""
    depth_m: Image
    """(H, W) from each free cell to the nearest that is not free; 0 there"""
    pulls: tuple[Image, ...]
    """(H, W) each, from far-reaching to near: what a wall of the other map gains here, -1 to 1"""

    @property
    def wall_m(self) -> float:
        """Length of all its wall, as if one cell thick."""
        return len(self.walls) * self.grid.resolution

    @classmethod
    def of(cls, grid: OccupancyGrid) -> "WallMap":
        """The alignment's view of an int8 grid with at least one occupied cell."""
        occupied = grid.data >= OCCUPIED_FROM
        free = (grid.data >= 0) & ~occupied
        to_wall_m = _distance_m(~occupied, grid.resolution)
        depth_m = _distance_m(np.pad(free, 1), grid.resolution)[1:-1, 1:-1]
        pulls = tuple(
            np.exp(-0.5 * (to_wall_m / reach) ** 2) - np.minimum(depth_m / (2.0 * reach), 1.0)
            for reach in _REACHES_M
        )
        return cls(
            grid,
            cell_centers(grid, occupied),
            cell_centers(grid, depth_m > TOLERANCE_M),
            to_wall_m,
            depth_m,
            pulls,
        )


class Fit(NamedTuple):
    """What two maps say of each other: metres of wall one cell thick, the mean of both directions."""

    shared_m: float
    """wall of one that meets wall of the other"""
    contradicted_m: float
    """wall of one that lies in open space of the other; wall in the unknown counts nowhere"""

    @property
    def agreement(self) -> float:
        """Share of shared wall in both, 0 to 1; 0 without overlap."""
        total = self.shared_m + self.contradicted_m
        return self.shared_m / total if total > 0.0 else 0.0

    def evidence_m(self, least_agreement: float) -> float:
        """Shared wall less contradictions, these weighted so that it is 0 at ``least_agreement``."""
        if least_agreement == 1.0:
            return -math.inf if self.contradicted_m else self.shared_m
        return self.shared_m - self.contradicted_m * least_agreement / (1.0 - least_agreement)


def fit(a: WallMap, b: WallMap, pose: Pose2D) -> Fit:
    """How ``a`` and ``b`` agree with b's frame at ``pose`` in a's frame."""
    shared_m = contradicted_m = 0.0
    for seen, other, placed in ((a, b, pose), (b, a, pose.inverse())):
        walls = placed.transform(other.walls)
        same = values_at(seen.to_wall_m, seen.grid, walls, outside=math.inf) <= TOLERANCE_M
        in_the_open = values_at(seen.depth_m, seen.grid, walls, outside=0.0) > TOLERANCE_M
        shared_m += 0.5 * other.grid.resolution * float(np.count_nonzero(same))
        contradicted_m += 0.5 * other.grid.resolution * float(np.count_nonzero(in_the_open & ~same))
    return Fit(shared_m, contradicted_m)


def refine(a: WallMap, b: WallMap, pose: Pose2D) -> Pose2D:
    """The placement near ``pose`` at which walls lie best on walls and not in open space.

    A hill climb on a score that is summed over the walls of both maps; its reach shrinks from 0.2 to 0.05 m.
    Open space has to count against a wall: on walls alone, two views of a wall from either side settle face
    on face, a wall's thickness off.
    """
    points_a, points_b = (m.walls[:: max(1, len(m.walls) // _POINTS)] for m in (a, b))
    middle = b.walls.mean(axis=0)
    radius_m = float(np.hypot(*(b.walls - middle).T).mean()) + b.grid.resolution
    # Turning about b's middle keeps the three moves independent.
    to_middle = Pose2D(float(middle[0]), float(middle[1]), 0.0)
    from_middle = to_middle.inverse()
    at = pose.compose(to_middle)

    def score(pulls: tuple[Image, Image], pose: Pose2D, enough: float) -> float:
        placed = pose.compose(from_middle)
        on_a = _interpolated(pulls[0], a.grid, placed.transform(points_b))
        return on_a + _interpolated(pulls[1], b.grid, placed.inverse().transform(points_a))

    both = zip(a.pulls, b.pulls, strict=True)
    for pulls, (reach_m, halvings) in zip(both, _REACHES_M.items(), strict=True):
        at, _ = hill_climb(score, pulls, at, reach_m, reach_m / radius_m, halvings)
    return at.compose(from_middle)


def coarse_placements(a: WallMap, b: WallMap, yaw_rad: float) -> list[Pose2D]:
    """Placements anywhere, good to 0.1 m, at ``yaw_rad`` and the three quarter turns from it, best first.

    Buildings have right angles, so this is where a placement's rivals are. For each turn all shifts
    are scored at once by correlation (FFT): wall on wall less three times wall on open space.
    """
    placements: list[tuple[float, Pose2D]] = []
    walls_a, open_a, origin_a = _coarse(a, 0.0)
    gain_a = np.where(_grown(walls_a), 1.0, -_CONTRADICTION_WEIGHT * open_a)
    for quarter in range(4):
        yaw = yaw_rad + quarter * math.pi / 2.0
        walls_b, open_b, origin_b = _coarse(b, yaw)
        loss_b = np.where(_grown(walls_b), 0.0, _CONTRADICTION_WEIGHT * open_b)
        shape = [
            scipy.fft.next_fast_len(m + n, real=True)
            for m, n in zip(walls_a.shape, walls_b.shape, strict=True)
        ]
        spectrum = scipy.fft.rfft2(gain_a, shape) * np.conj(scipy.fft.rfft2(walls_b, shape))
        spectrum -= scipy.fft.rfft2(walls_a, shape) * np.conj(scipy.fft.rfft2(loss_b, shape))
        scores = scipy.fft.irfft2(spectrum, shape)
        for _ in range(_PEAKS_PER_TURN):
            row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
            # The correlation is cyclic: shifts past the first map's size stand for negative ones.
            shift = [
                int(i) - (n if i >= size else 0)
                for i, n, size in zip((row, column), shape, walls_a.shape, strict=True)
            ]
            x, y = (origin_a + _COARSE_CELL_M * np.array(shift[::-1]) - origin_b).tolist()
            placements.append((float(scores[row, column]), Pose2D(x, y, yaw)))
            around = np.arange(
                -round(_PEAK_RADIUS_M / _COARSE_CELL_M), round(_PEAK_RADIUS_M / _COARSE_CELL_M) + 1
            )
            scores[np.ix_((row + around) % shape[0], (column + around) % shape[1])] = -np.inf
    return [pose for score, pose in sorted(placements, key=lambda item: -item[0]) if score > 0.0]


def _coarse(m: WallMap, yaw_rad: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(walls, open space, origin) of the map turned by ``yaw_rad``: 1 on cells of 0.1 m that hold any."""
    turn = Pose2D(0.0, 0.0, yaw_rad)
    walls, spaces = turn.transform(m.walls), turn.transform(m.open_space)
    points = np.concatenate((walls, spaces))
    origin = points.min(axis=0)
    width, height = ((points.max(axis=0) - origin) / _COARSE_CELL_M).astype(np.int64) + 1
    grids = np.zeros((2, height, width))
    for grid, centres in zip(grids, (walls, spaces), strict=True):
        columns, rows = ((centres - origin) / _COARSE_CELL_M).astype(np.int64).T
        grid[rows, columns] = 1.0
    return grids[0], grids[1], origin


def _grown(cells: FloatArray) -> npt.NDArray[np.bool_]:
    """The set cells and their eight neighbours."""
    return cv2.dilate(cells, np.ones((3, 3))) > 0.0


def _distance_m(mask: npt.NDArray[np.bool_], resolution: float) -> Image:
    """(H, W) float32 from each set cell's centre to the nearest cell that is not set, metres."""
    cells = cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(cells * resolution, dtype=np.float32)


def _interpolated(image: Image, grid: OccupancyGrid, points: FloatArray) -> float:
    """The sum over the points of the image's values between cell centres; 0 off the grid."""
    columns, rows = ((points - grid.origin) / grid.resolution - 0.5).astype(np.float32).T.copy()
    values = cv2.remap(
        image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0
    )
    return float(np.sum(values))
