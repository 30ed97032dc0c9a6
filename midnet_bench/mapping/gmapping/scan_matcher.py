"""How well a scan fits a particle's map, and the pose where it fits best.

Poses and beams are in *cells* here: metres divided by the map's resolution, counted from the corner of
the map's table, so that the cell of a point is its floor. Maps are the patches of ``particle_map``.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import exp
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.gmapping.gmapping_settings import GmappingSettings
from midnet_bench.mapping.hill_climb import hill_climb, rotate

PATCH_CELLS = 32
"""side of a patch, cells"""
PATCH_SHIFT = 5
"""a cell's row or column shifted right by this is that of its patch"""
EMPTY = 1e9
"""coordinate that stands for "no hits here": so far away that it is never the nearest"""

_NONE_SQUARED = EMPTY * EMPTY
_NO_CANDIDATE = 1e12
"""cells squared: far above any distance within three cells, far below one to EMPTY"""

FloatArray = npt.NDArray[np.float64]
MeanArray = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int32]


class Matching(NamedTuple):
    """The parameters of scan matching, lengths in cells."""

    linear_step: float
    angular_step: float
    """radians"""
    iterations: int
    sigma: float
    """squared cells"""
    odometry_pull: float
    """per squared cell"""
    heading_pull: float
    """per squared radian"""
    minimum_score: float
    likelihood_sigma: float
    """squared cells"""
    miss_log_likelihood: float


def matching_in_cells(settings: GmappingSettings) -> Matching:
    """The scan-matching part of the settings, metres turned into cells."""
    cell_m = settings.resolution_m
    return Matching(
        linear_step=settings.linear_step_m / cell_m,
        angular_step=settings.angular_step_rad,
        iterations=settings.iterations,
        sigma=settings.sigma_m2 / (cell_m * cell_m),
        odometry_pull=settings.linear_reliability * (cell_m * cell_m),
        heading_pull=settings.angular_reliability,
        minimum_score=settings.minimum_score,
        likelihood_sigma=settings.likelihood_sigma_m2 / (cell_m * cell_m),
        miss_log_likelihood=-settings.miss_m2 / settings.likelihood_sigma_m2,
    )


@njit
def nearest_hit_squared(means: MeanArray, table: IndexArray, x: float, y: float) -> float:
    """Squared distance from (x, y) to the nearest mean hit point in the 3 x 3 cells around it, cells^2.

    More than 1e12 if those cells hold no hits. GMapping also wants a cell some way back along the beam to be
    free, but looks at an unrelated cell, so the test never decides anything; it is left out here.
    """
    column = math.floor(x)
    row = math.floor(y)
    rows, columns = table.shape
    if not (1 <= column < columns * PATCH_CELLS - 1 and 1 <= row < rows * PATCH_CELLS - 1):
        return _NONE_SQUARED
    best = _NONE_SQUARED
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            patch = table[r >> PATCH_SHIFT, c >> PATCH_SHIFT]
            inner_row = r & (PATCH_CELLS - 1)
            inner_column = c & (PATCH_CELLS - 1)
            dx = means[patch, inner_row, inner_column, 0] - (x - (c - inner_column))
            dy = means[patch, inner_row, inner_column, 1] - (y - (r - inner_row))
            best = min(best, dx * dx + dy * dy)
    return best


@njit
def match_score(
    means: MeanArray, table: IndexArray, rotated: FloatArray, x: float, y: float, sigma: float, enough: float
) -> float:
    """Sum over the beams of exp(-d^2 / sigma), d to the nearest mean hit point; 0 for a beam without one.

    Not d^2 / (2 sigma^2): GMapping's sigma is a squared length (``scanmatcher.h``, score). 0 as soon as the
    beams that are left cannot lift the sum above ``enough``.
    """
    total = 0.0
    for b in range(rotated.shape[0]):
        squared = nearest_hit_squared(means, table, x + rotated[b, 0], y + rotated[b, 1])
        if squared < _NO_CANDIDATE:
            total += exp(-squared / sigma)
        if total + (rotated.shape[0] - 1 - b) <= enough:
            return 0.0
    return total


@njit
def log_likelihood(
    means: MeanArray, table: IndexArray, rotated: FloatArray, x: float, y: float, sigma: float, miss: float
) -> float:
    """Sum over the beams of -d^2 / sigma, or ``miss`` for a beam without a candidate (likelihoodAndScore)."""
    total = 0.0
    for b in range(rotated.shape[0]):
        squared = nearest_hit_squared(means, table, x + rotated[b, 0], y + rotated[b, 1])
        total += -squared / sigma if squared < _NO_CANDIDATE else miss
    return total


_Climb = tuple[MeanArray, IndexArray, FloatArray, FloatArray, FloatArray, Pose2D, Matching]
"""map, beams, a copy of them turned by a yaw, that yaw as (1,), the first pose, and the parameters"""


@njit
def _held_score(args: _Climb, pose: Pose2D, enough: float) -> float:
    """The score of a pose, times exp(-odometry_pull * d^2 - heading_pull * t^2) at d and t from the first."""
    means, table, beams, rotated, rotated_yaw, start, matching = args
    dx, dy, turn = pose.x - start.x, pose.y - start.y, pose.yaw - start.yaw
    pull = exp(-matching.odometry_pull * (dx * dx + dy * dy) - matching.heading_pull * (turn * turn))
    if pull == 0.0:  # too far from odometry for any match
        return 0.0
    if pose.yaw != rotated_yaw[0]:
        rotate(beams, pose.yaw, rotated)
        rotated_yaw[0] = pose.yaw
    return pull * match_score(means, table, rotated, pose.x, pose.y, matching.sigma, enough / pull)


@njit
def climb(
    means: MeanArray, table: IndexArray, beams: FloatArray, start: Pose2D, matching: Matching
) -> tuple[Pose2D, float]:
    """The best pose that a hill climb from ``start``, held by its odometry, finds, and its score."""
    args = (means, table, beams, np.empty_like(beams), np.full(1, np.nan), start, matching)
    m = matching
    return hill_climb(_held_score, args, start, m.linear_step, m.angular_step, m.iterations)


@njit(nogil=True)
def match_particles(
    means: MeanArray, tables: IndexArray, beams: FloatArray, poses: FloatArray, matching: Matching
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """((N, 3) poses, (N,) log-likelihoods, (N,) scores): every particle at its best match.

    A score lies between 0 and the number of beams. A particle whose match scores no more than the minimum
    keeps the pose that its noisy odometry gave it.

    Args:
        means: (P, 32, 32, 2) float32 mean hit points of all patches, cells from the patch's corner; EMPTY
            where there are none.
        tables: (N, rows, columns) int32 patch numbers of each particle's map; patch 0 has no hits.
        beams: (B, 2) float64 ends of the usable beams in the sensor frame, cells.
        poses: (N, 3) float64 sensor poses, cells and radians.
        matching: parameters.
    """
    matched = poses.copy()
    likelihoods = np.empty(poses.shape[0])
    scores = np.empty(poses.shape[0])
    rotated = np.empty_like(beams)
    for n in range(poses.shape[0]):
        start = Pose2D(poses[n, 0], poses[n, 1], poses[n, 2])
        found, score = climb(means, tables[n], beams, start, matching)
        scores[n] = score
        if score > matching.minimum_score:
            matched[n, 0], matched[n, 1], matched[n, 2] = found.x, found.y, found.yaw
        rotate(beams, matched[n, 2], rotated)
        likelihoods[n] = log_likelihood(
            means,
            tables[n],
            rotated,
            matched[n, 0],
            matched[n, 1],
            matching.likelihood_sigma,
            matching.miss_log_likelihood,
        )
    return matched, likelihoods, scores
