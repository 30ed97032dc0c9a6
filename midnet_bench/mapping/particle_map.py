"""The maps of GMapping's particles, how well a scan fits one of them, and the pose where it fits best.

A map is patches of cells, shared until one is written to. In the compiled loops poses and beams are in
*cells*: metres divided by the map's resolution, counted from the corner of the map's table, so that the cell
of a point is its floor.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit, numba
from midnet_bench.elementary import exp
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.grid_slam import hill_climb, rotate, trace_rays
from midnet_bench.mapping.mapping_settings import GmappingSettings

PATCH_CELLS = 32  # side of a patch, cells
PATCH_SHIFT = 5  # a cell's row or column shifted right by this is that of its patch
EMPTY = 1e9  # coordinate that stands for "no hits here": so far away that it is never the nearest

_NONE_SQUARED = EMPTY * EMPTY
_NO_CANDIDATE = 1e12  # cells squared: far above any distance within three cells, far below one to EMPTY

FloatArray = npt.NDArray[np.float64]
MeanArray = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int32]


class Matching(NamedTuple):
    """The parameters of scan matching, lengths in cells."""

    linear_step: float
    angular_step: float  # radians
    iterations: int
    sigma: float  # squared cells
    odometry_pull: float  # per squared cell
    heading_pull: float  # per squared radian
    minimum_score: float
    likelihood_sigma: float  # squared cells
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


PartT = TypeVar("PartT")
PARTS_PER_THREAD = 4  # some particles climb longer than others; a thread that is done takes the next part
_FULLNESS = 0.1
"""hits / visits above which a cell counts as an obstacle in matching (GMapping's fullnessThreshold)"""


def cores() -> int:
    """How many threads a process that works alone should take; ``NUMBA_NUM_THREADS`` says it if set."""
    return int(numba().config.NUMBA_NUM_THREADS)


class ParticleThreads:
    """Calls compiled loops that release Python's lock (``nogil``) for parts of the particles at once.

    Each particle is worked on by itself, so the number of threads changes no result.
    """

    def __init__(self, particles: int, threads: int) -> None:
        parts = min(particles, threads * PARTS_PER_THREAD) if threads > 1 else 1
        ends = [particles * part // parts for part in range(parts + 1)]
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def over_particles(self, loop: Callable[[slice], PartT]) -> list[PartT]:
        """What ``loop`` gives for each part, in the order of the particles."""
        return list(map(loop, self._parts) if self._pool is None else self._pool.map(loop, self._parts))


class ParticleMaps:
    """One map of mean hit points for each of N particles.

    A cell holds how many beams ended in it, how many ended in it or passed through, and the mean of the ends.
    GMapping registers ends only, so what has moved away is matched for ever; here a ray
    counts against the cells it passes, and a cell whose hits / visits sinks to 0.1 is emptied.
    Cells without a hit are not counted, so free space costs no memory.

    A map is a table of patch numbers into one pool; copying a particle copies its table (copy on write).
    Cell (c, r) spans [c, c + 1) x [r, r + 1) times the resolution: corners lie on multiples of it, where
    GMapping puts the centres.
    """

    def __init__(self, particles: int, resolution_m: float, threads: ParticleThreads | None = None) -> None:
        self.resolution_m = resolution_m
        self._threads = threads or ParticleThreads(particles, 1)
        self.origin_cells = np.zeros(2, dtype=np.int64)
        """(column, row) of the tables' first cell on the lattice through the map frame's origin"""
        self.tables: IndexArray = np.zeros((particles, 1, 1), dtype=np.int32)
        """(N, rows, columns) patch numbers; patch 0 is empty and never written"""
        self.means: MeanArray = np.full((1, PATCH_CELLS, PATCH_CELLS, 2), EMPTY, dtype=np.float32)
        """(P, 32, 32, 2) mean hit points in cells from their patch's corner; EMPTY where there are no hits"""
        self.hits: IndexArray = np.zeros((1, PATCH_CELLS, PATCH_CELLS), dtype=np.int32)
        self.visits: IndexArray = np.zeros((1, PATCH_CELLS, PATCH_CELLS), dtype=np.int32)

    def to_cells(self, poses: FloatArray) -> FloatArray:
        """(N, 3) poses with x and y in cells from the tables' corner instead of metres in the map frame."""
        cells = poses.copy()
        cells[:, :2] = poses[:, :2] / self.resolution_m - self.origin_cells
        return cells

    def to_metres(self, poses: FloatArray) -> FloatArray:
        """The inverse of ``to_cells``."""
        metres = poses.copy()
        metres[:, :2] = (poses[:, :2] + self.origin_cells) * self.resolution_m
        return metres

    def register(self, poses: FloatArray, ends_m: FloatArray, hits: int) -> None:
        """Enter a scan into every particle's map at that particle's pose.

        Args:
            poses: (N, 3) float64 sensor poses in the map frame, metres and radians.
            ends_m: (B, 2) float64 ends of the rays in the sensor frame.
            hits: how many of them, from the first on, end at an obstacle; the others only clear.
        """
        reach_m = math.sqrt(float(np.square(ends_m).sum(axis=1).max(initial=0.0)))
        self._grow(poses[:, :2].min(axis=0) - reach_m, poses[:, :2].max(axis=0) + reach_m)
        cells = self.to_cells(poses)
        ends = ends_m / self.resolution_m
        touched = self._threads.over_particles(
            lambda part: mark_patches(self.tables[part], cells[part], ends, hits)
        )
        self._own(np.concatenate(touched))
        # each particle owns the patches that it writes to
        self._threads.over_particles(
            lambda part: register_rays(
                self.means, self.hits, self.visits, self.tables[part], cells[part], ends, hits
            )
        )

    def resample(self, ancestors: npt.NDArray[np.int64]) -> None:
        """Give particle n a copy of the map of particle ``ancestors[n]``."""
        self.tables = self.tables[ancestors]

    def _grow(self, low_m: FloatArray, high_m: FloatArray) -> None:
        """Let the tables cover the rectangle and a cell around it."""
        low = np.floor(low_m / self.resolution_m).astype(np.int64) - 1 - self.origin_cells
        high = np.floor(high_m / self.resolution_m).astype(np.int64) + 1 - self.origin_cells
        rows, columns = self.tables.shape[1:]
        before = np.maximum(-(low // PATCH_CELLS), 0)
        after = np.maximum(high // PATCH_CELLS + 1 - (columns, rows), 0)
        if before.any() or after.any():
            self.tables = np.pad(self.tables, ((0, 0), (before[1], after[1]), (before[0], after[0])))
            self.origin_cells = self.origin_cells - before * PATCH_CELLS

    def _own(self, touched: npt.NDArray[np.bool_]) -> None:
        """Give each (particle, patch) that is about to be written a patch of its own."""
        users = np.bincount(self.tables.ravel(), minlength=len(self.means))
        old = self.tables[touched]
        shared = (old == 0) | (users[old] > 1)
        where = tuple(index[shared] for index in np.nonzero(touched))
        old = old[shared]
        free = np.flatnonzero(users[1:] == 0) + 1
        if len(free) < len(old):
            self._enlarge_pool(max(len(old) - len(free), len(self.means)))
            free = np.concatenate([free, np.arange(len(users), len(self.means))])
        new = free[: len(old)]
        self.means[new] = self.means[old]
        self.hits[new] = self.hits[old]
        self.visits[new] = self.visits[old]
        self.tables[where] = new

    def _enlarge_pool(self, patches: int) -> None:
        self.means = np.concatenate([self.means, np.empty((patches, *self.means.shape[1:]), np.float32)])
        counts = np.empty((patches, *self.hits.shape[1:]), np.int32)
        self.hits = np.concatenate([self.hits, counts])
        self.visits = np.concatenate([self.visits, counts])


@njit(nogil=True)
def mark_patches(tables: IndexArray, poses: FloatArray, ends: FloatArray, hits: int) -> npt.NDArray[np.bool_]:
    """(N, rows, columns) bool: the patches of each particle that a scan may change.

    Those in which a ray ends, and those with hits that a ray passes through.
    """
    touched = np.zeros(tables.shape, dtype=np.bool_)
    for n in range(tables.shape[0]):
        cells, placed = trace_rays(poses[n], ends)
        for k in range(cells.shape[0]):
            row, column = cells[k, 1] >> PATCH_SHIFT, cells[k, 0] >> PATCH_SHIFT
            if tables[n, row, column] != 0:
                touched[n, row, column] = True
        for b in range(hits):
            touched[n, math.floor(placed[b, 1]) >> PATCH_SHIFT, math.floor(placed[b, 0]) >> PATCH_SHIFT] = (
                True
            )
    return touched


@njit(nogil=True)
def register_rays(
    means: MeanArray,
    cell_hits: IndexArray,
    cell_visits: IndexArray,
    tables: IndexArray,
    poses: FloatArray,
    ends: FloatArray,
    hits: int,
) -> None:
    """Count a scan into patches that ``mark_patches`` found and each particle owns: passes, then hits."""
    for n in range(tables.shape[0]):
        cells, placed = trace_rays(poses[n], ends)
        for k in range(cells.shape[0]):
            patch = tables[n, cells[k, 1] >> PATCH_SHIFT, cells[k, 0] >> PATCH_SHIFT]
            r, c = cells[k, 1] & (PATCH_CELLS - 1), cells[k, 0] & (PATCH_CELLS - 1)
            if cell_hits[patch, r, c] == 0:
                continue
            cell_visits[patch, r, c] += 1
            if cell_hits[patch, r, c] <= _FULLNESS * cell_visits[patch, r, c]:
                cell_hits[patch, r, c] = 0
                cell_visits[patch, r, c] = 0
                means[patch, r, c, :] = EMPTY
        for b in range(hits):
            x, y = placed[b, 0], placed[b, 1]
            column, row = math.floor(x), math.floor(y)
            patch = tables[n, row >> PATCH_SHIFT, column >> PATCH_SHIFT]
            r, c = row & (PATCH_CELLS - 1), column & (PATCH_CELLS - 1)
            if cell_hits[patch, r, c] == 0:
                means[patch, r, c, :] = 0.0
            cell_hits[patch, r, c] += 1
            cell_visits[patch, r, c] += 1
            share = 1.0 / cell_hits[patch, r, c]
            means[patch, r, c, 0] += (x - (column - c) - means[patch, r, c, 0]) * share
            means[patch, r, c, 1] += (y - (row - r) - means[patch, r, c, 1]) * share
