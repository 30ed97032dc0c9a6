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
from midnet_bench.mapping.grid_slam import Floats, Indices, hill_climb, rotate, trace_rays
from midnet_bench.mapping.mapping_settings import GmappingSettings

PartT = TypeVar("PartT")
Means = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

PATCH_CELLS = 32  # side of a patch, cells
PATCH_SHIFT = 5  # a cell's row or column shifted right by this is that of its patch
EMPTY = 1e9  # coordinate that stands for "no hits here": so far away that it is never the nearest
_NONE_SQUARED = EMPTY * EMPTY
_NO_CANDIDATE = 1e12  # cells squared: far above any distance within three cells, far below one to EMPTY
_FULLNESS = 0.1  # hits / visits from which down a cell is no obstacle (GMapping: fullnessThreshold)
_PARTS_PER_THREAD = 4  # some particles climb longer than others; a thread that is done takes the next part


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
    s, cell_m = settings, settings.resolution_m
    cell_m2 = cell_m * cell_m
    pulls = (s.linear_reliability * cell_m2, s.angular_reliability)
    likelihood = (s.likelihood_sigma_m2 / cell_m2, -s.miss_m2 / s.likelihood_sigma_m2)
    steps = (s.linear_step_m / cell_m, s.angular_step_rad, s.iterations)
    return Matching(*steps, s.sigma_m2 / cell_m2, *pulls, s.minimum_score, *likelihood)


@njit
def nearest_hit_squared(means: Means, table: Integers, x: float, y: float) -> float:
    """Squared distance from (x, y) to the nearest mean hit point in the 3 x 3 cells around it, cells^2.

    More than 1e12 if those cells hold no hits. GMapping also wants a cell some way back along the beam to be
    free, but looks at an unrelated cell, so the test never decides anything; it is left out here.
    """
    column, row = math.floor(x), math.floor(y)
    rows, columns = table.shape
    if not (1 <= column < columns * PATCH_CELLS - 1 and 1 <= row < rows * PATCH_CELLS - 1):
        return _NONE_SQUARED
    best = _NONE_SQUARED
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            patch = table[r >> PATCH_SHIFT, c >> PATCH_SHIFT]
            inner_row, inner_column = r & (PATCH_CELLS - 1), c & (PATCH_CELLS - 1)
            dx = means[patch, inner_row, inner_column, 0] - (x - (c - inner_column))
            dy = means[patch, inner_row, inner_column, 1] - (y - (r - inner_row))
            best = min(best, dx * dx + dy * dy)
    return best


@njit
def match_score(
    means: Means, table: Integers, rotated: Floats, x: float, y: float, sigma: float, enough: float
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
    means: Means, table: Integers, rotated: Floats, x: float, y: float, sigma: float, miss: float
) -> float:
    """Sum over the beams of -d^2 / sigma, or ``miss`` for a beam without a candidate (likelihoodAndScore)."""
    total = 0.0
    for b in range(rotated.shape[0]):
        squared = nearest_hit_squared(means, table, x + rotated[b, 0], y + rotated[b, 1])
        total += -squared / sigma if squared < _NO_CANDIDATE else miss
    return total


_Climb = tuple[Means, Integers, Floats, Floats, Floats, Pose2D, Matching]
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


@njit(nogil=True)
def match_particles(
    means: Means, tables: Integers, beams: Floats, poses: Floats, matching: Matching
) -> tuple[Floats, Floats, Floats]:
    """((N, 3) poses, (N,) log-likelihoods, (N,) scores): every particle at its best match.

    A score lies between 0 and the number of beams. A particle whose match scores no more than the minimum
    keeps the pose that its noisy odometry gave it. ``means`` and ``tables``: as ``ParticleMaps`` has them;
    ``beams``: (B, 2) ends of those that hit in the sensor frame, cells; ``poses``: (N, 3), cells and radians.
    """
    m = matching
    matched, rotated = poses.copy(), np.empty_like(beams)
    likelihoods, scores = np.empty(poses.shape[0]), np.empty(poses.shape[0])
    for n in range(poses.shape[0]):
        table, start = tables[n], Pose2D(poses[n, 0], poses[n, 1], poses[n, 2])
        args = (means, table, beams, rotated, np.full(1, np.nan), start, m)
        at, scores[n] = hill_climb(_held_score, args, start, m.linear_step, m.angular_step, m.iterations)
        if scores[n] <= m.minimum_score:
            at = start
        matched[n, 0], matched[n, 1], matched[n, 2] = at.x, at.y, at.yaw
        rotate(beams, at.yaw, rotated)
        likelihoods[n] = log_likelihood(
            means, table, rotated, at.x, at.y, m.likelihood_sigma, m.miss_log_likelihood
        )
    return matched, likelihoods, scores


def cores() -> int:
    """How many threads a process that works alone should take; ``NUMBA_NUM_THREADS`` says it if set."""
    return int(numba().config.NUMBA_NUM_THREADS)


class ParticleThreads:
    """Calls compiled loops that release Python's lock (``nogil``) for parts of the particles at once.

    Each particle is worked on by itself, so the number of threads changes no result.
    """

    def __init__(self, particles: int, threads: int) -> None:
        parts = min(particles, threads * _PARTS_PER_THREAD) if threads > 1 else 1
        ends = [particles * part // parts for part in range(parts + 1)]
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]
        self._map = ThreadPoolExecutor(threads).map if threads > 1 else map

    def over_particles(self, loop: Callable[[slice], PartT]) -> list[PartT]:
        """What ``loop`` gives for each part, in the order of the particles."""
        return list(self._map(loop, self._parts))


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
        self.tables: Integers = np.zeros((particles, 1, 1), dtype=np.int32)
        """(N, rows, columns) patch numbers; patch 0 is empty and never written"""
        self.means: Means = np.full((1, PATCH_CELLS, PATCH_CELLS, 2), EMPTY, dtype=np.float32)
        """(P, 32, 32, 2) mean hit points in cells from their patch's corner; EMPTY where there are no hits"""
        self.counts: Integers = np.zeros((1, PATCH_CELLS, PATCH_CELLS, 2), dtype=np.int32)
        """(P, 32, 32, 2) hits, and visits"""

    def to_cells(self, poses: Floats) -> Floats:
        """(N, 3) poses with x and y in cells from the tables' corner instead of metres in the map frame."""
        cells = poses.copy()
        cells[:, :2] = poses[:, :2] / self.resolution_m - self.origin_cells
        return cells

    def to_metres(self, poses: Floats) -> Floats:
        """The inverse of ``to_cells``."""
        metres = poses.copy()
        metres[:, :2] = (poses[:, :2] + self.origin_cells) * self.resolution_m
        return metres

    def register(self, poses: Floats, ends_m: Floats, hits: int) -> None:
        """Enter a scan (as ``ScanRays``) into every particle's map at (N, 3) poses, metres and radians."""
        reach_m = math.sqrt(float(np.square(ends_m).sum(axis=1).max(initial=0.0)))
        self._grow(poses[:, :2].min(axis=0) - reach_m, poses[:, :2].max(axis=0) + reach_m)
        cells, ends = self.to_cells(poses), ends_m / self.resolution_m
        touched = self._threads.over_particles(
            lambda part: mark_patches(self.tables[part], cells[part], ends, hits)
        )
        self._own(np.concatenate(touched))
        # each particle owns the patches that it writes to
        self._threads.over_particles(
            lambda part: register_rays(self.means, self.counts, self.tables[part], cells[part], ends, hits)
        )

    def resample(self, ancestors: Indices) -> None:
        """Give particle n a copy of the map of particle ``ancestors[n]``."""
        self.tables = self.tables[ancestors]

    def _grow(self, low_m: Floats, high_m: Floats) -> None:
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
            more = (max(len(old) - len(free), len(self.means)), PATCH_CELLS, PATCH_CELLS, 2)
            self.means = np.concatenate([self.means, np.empty(more, np.float32)])
            self.counts = np.concatenate([self.counts, np.empty(more, np.int32)])
            free = np.concatenate([free, np.arange(len(users), len(self.means))])
        new = free[: len(old)]
        self.means[new] = self.means[old]
        self.counts[new] = self.counts[old]
        self.tables[where] = new


@njit(nogil=True)
def mark_patches(tables: Integers, poses: Floats, ends: Floats, hits: int) -> npt.NDArray[np.bool_]:
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
            column, row = math.floor(placed[b, 0]), math.floor(placed[b, 1])
            touched[n, row >> PATCH_SHIFT, column >> PATCH_SHIFT] = True
    return touched


@njit(nogil=True)
def register_rays(
    means: Means, counts: Integers, tables: Integers, poses: Floats, ends: Floats, hits: int
) -> None:
    """Count a scan into patches that ``mark_patches`` found and each particle owns: passes, then hits."""
    for n in range(tables.shape[0]):
        cells, placed = trace_rays(poses[n], ends)
        for k in range(cells.shape[0]):
            patch = tables[n, cells[k, 1] >> PATCH_SHIFT, cells[k, 0] >> PATCH_SHIFT]
            r, c = cells[k, 1] & (PATCH_CELLS - 1), cells[k, 0] & (PATCH_CELLS - 1)
            if counts[patch, r, c, 0] == 0:
                continue
            counts[patch, r, c, 1] += 1
            if counts[patch, r, c, 0] <= _FULLNESS * counts[patch, r, c, 1]:
                counts[patch, r, c, :] = 0
                means[patch, r, c, :] = EMPTY
        for b in range(hits):
            x, y = placed[b, 0], placed[b, 1]
            column, row = math.floor(x), math.floor(y)
            patch = tables[n, row >> PATCH_SHIFT, column >> PATCH_SHIFT]
            r, c = row & (PATCH_CELLS - 1), column & (PATCH_CELLS - 1)
            if counts[patch, r, c, 0] == 0:
                means[patch, r, c, :] = 0.0
            counts[patch, r, c, :] += 1
            share = 1.0 / counts[patch, r, c, 0]
            means[patch, r, c, 0] += (x - (column - c) - means[patch, r, c, 0]) * share
            means[patch, r, c, 1] += (y - (row - r) - means[patch, r, c, 1]) * share
