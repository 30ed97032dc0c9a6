"""The maps that particles match scans against: patches of cells, shared until one is written to."""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit, numba
from midnet_bench.mapping.gmapping.scan_matcher import (
    EMPTY,
    PATCH_CELLS,
    PATCH_SHIFT,
    FloatArray,
    IndexArray,
    MeanArray,
)
from midnet_bench.mapping.scans import trace_rays

PartT = TypeVar("PartT")
PARTS_PER_THREAD = 4
"""some particles climb longer than others; a thread that is done takes the next part"""
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
