"""GMapping: a Rao-Blackwellised particle filter in which every particle carries a map of its own.

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
from midnet_bench.elementary import directions, exp, exponentials, standard_normals
from midnet_bench.geometry import Floats, Indices, LidarGeometry, Pose2D, wrap_angle
from midnet_bench.grid import FAR_CELLS
from midnet_bench.mapping.grid_slam import ORIGIN, GridSlam, ScanRays, hill_climb, rotate, trace_rays
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


class GMapping(GridSlam):
    """The filter as openslam_gmapping releases it (``gridslamprocessor``), for one planar LiDAR.

    As released, a particle is put *on* the maximum of its scan match; the improved proposal of the papers
    (Grisetti et al. 2007) is not in that code, nor here. The best particle is the one with the largest
    log-likelihood summed over its whole lineage. Departures: the docstrings of ``scan_rays``,
    ``nearest_hit_squared``, ``ParticleMaps`` and ``VisitMap``.

    ``initial``: the robot's pose in the map frame when the first scan arrives; the filter moves the sensor's.
    ``threads``: that the particles are shared between; any number gives the same bytes.
    """

    def __init__(
        self,
        geometry: LidarGeometry,
        settings: GmappingSettings,
        initial: Pose2D,
        rng: np.random.Generator,
        threads: int = 1,
    ) -> None:
        usable_m = math.inf if settings.max_usable_range_m is None else settings.max_usable_range_m
        update = (settings.linear_update_m, settings.angular_update_rad, settings.temporal_update_s)
        super().__init__(geometry, usable_m, update, settings.resolution_m, settings.occupied_threshold)
        self.settings = settings
        self._rng = rng
        self._matching = matching_in_cells(settings)
        self._poses = np.tile(np.array(initial.compose(geometry.mount)), (settings.particles, 1))
        self._weights = np.zeros(settings.particles)  # log-likelihoods since the last resampling
        self._weight_sums = np.zeros(settings.particles)  # and since the first scan
        self._maps = ParticleMaps(settings.particles, settings.resolution_m, threads)
        self._correction = initial
        self._odometry = ORIGIN
        self._history: list[Floats] = []
        self._ancestors: list[Indices] = []

    @property
    def correction(self) -> Pose2D:
        """The odometry frame in the map frame (map -> odom), as of the last integrated scan."""
        return self._correction._replace(yaw=wrap_angle(self._correction.yaw))

    @property
    def best_pose(self) -> Pose2D:
        """The robot's base in the map frame: the last odometry pose, corrected."""
        pose = self._correction.compose(self._odometry)
        return pose._replace(yaw=wrap_angle(pose.yaw))

    @property
    def _best(self) -> int:
        return int(np.argmax(self._weight_sums))

    def _move(self, odometry_pose: Pose2D) -> Pose2D:
        step, mount = ORIGIN, self.geometry.mount
        if self._scans:
            step = odometry_pose.compose(mount).relative_to(self._odometry.compose(mount))
            self._poses = move_particles(self._poses, step, self.settings, self._rng)
        self._odometry = odometry_pose
        return step

    def _integrate(self, rays: ScanRays) -> None:
        score, ancestors = math.nan, np.arange(self.settings.particles)
        if self._scans:
            score = self._match(rays)
            ancestors = self._resample(ancestors)
        self.scores.append(score)
        self._maps.register(self._poses, *rays)
        self._history.append(self._poses)
        self._ancestors.append(ancestors)
        self._correction = self._base_pose(self._poses[self._best]).compose(self._odometry.inverse())

    def _match(self, rays: ScanRays) -> float:
        """Put every particle on its match and weigh it by that; the best one's score per beam that hit."""
        maps, poses = self._maps, self._maps.to_cells(self._poses)
        beams = rays.ends_m[: rays.hits] / self.settings.resolution_m
        parts = maps.over_particles(
            lambda part: match_particles(maps.means, maps.tables[part], beams, poses[part], self._matching)
        )
        matched, likelihoods, scores = (np.concatenate(both) for both in zip(*parts, strict=True))
        self._poses = self._maps.to_metres(matched)
        self._weights = self._weights + likelihoods
        self._weight_sums = self._weight_sums + likelihoods
        return float(scores[self._best]) / rays.hits if rays.hits else math.nan

    def _resample(self, ancestors: Indices) -> Indices:
        """The ancestors of the particles after resampling, or as they were when none was needed."""
        weights = normalized_weights(self._weights, self.settings.likelihood_gain)
        if effective_particles(weights) >= self.settings.resample_threshold * len(weights):
            return ancestors
        ancestors = systematic_resample(weights, self._rng.random())
        self._poses = self._poses[ancestors]
        self._weight_sums = self._weight_sums[ancestors]
        self._weights = np.zeros(len(weights))
        self._maps.resample(ancestors)
        return ancestors

    def _sensor_poses(self) -> Floats:
        """(N, 3) of the best particle's ancestor at each integrated scan."""
        poses = np.empty((len(self._history), 3))
        particle = self._best
        for k in reversed(range(len(poses))):
            poses[k] = self._history[k][particle]
            particle = int(self._ancestors[k][particle])
        return poses


def noise_deviations(increment: Pose2D, settings: GmappingSettings) -> Floats:
    """(3,) standard deviations of the noise on an increment's x, y (metres) and yaw (radians).

    Proportional to the motion, so a standing robot's particles stay where they are. ``str`` weighs
    rotation into translation and ``srt`` translation into rotation, as GMapping's code has it
    (the comments in its ini files say the opposite).
    """
    dx, dy, turn = abs(increment.x), abs(increment.y), abs(increment.yaw)
    s = settings
    along_x = s.noise_srr * dx + s.noise_str * turn + 0.3 * s.noise_srr * dy
    along_y = s.noise_srr * dy + s.noise_str * turn + 0.3 * s.noise_srr * dx
    return np.array([along_x, along_y, s.noise_stt * turn + s.noise_srt * math.hypot(dx, dy)])


def move_particles(
    poses: Floats, increment: Pose2D, settings: GmappingSettings, rng: np.random.Generator
) -> Floats:
    """(N, 3) poses, map frame, moved by the odometry's increment with Gaussian noise for each particle.

    Three standard normal draws per particle are taken, also for a standing robot.
    """
    steps = np.array(increment) + standard_normals(rng, poses.shape) * noise_deviations(increment, settings)
    cos, sin = directions(poses[:, 2]).T
    yaw = poses[:, 2] + steps[:, 2]
    return np.column_stack(
        [
            poses[:, 0] + cos * steps[:, 0] - sin * steps[:, 1],
            poses[:, 1] + sin * steps[:, 0] + cos * steps[:, 1],
            (yaw + np.pi) % (2.0 * np.pi) - np.pi,
        ]
    )


def normalized_weights(log_weights: Floats, gain: float) -> Floats:
    """(N,) weights that sum to 1 from summed log-likelihoods: proportional to exp(l / (gain * N)).

    The division by N is GMapping's (``gridslamprocessor.hxx``, normalize).
    """
    flattened = exponentials((log_weights - log_weights.max()) / (gain * len(log_weights)))
    return flattened / math.fsum(flattened.tolist())


def effective_particles(weights: Floats) -> float:
    """Neff = 1 / sum of w^2: N for equal weights, 1 when one particle has all."""
    return 1.0 / math.fsum((weights * weights).tolist())


def systematic_resample(weights: Floats, offset: float) -> Indices:
    """(N,) indices of the particles that live on, ascending: one at each of N equally spaced places.

    ``weights`` (N,) sum to 1; ``offset`` in [0, 1) says where the first place lies in its interval of 1 / N.
    """
    places = (np.arange(len(weights)) + offset) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), places, side="right"), len(weights) - 1)


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


_Climb = tuple[Means, Integers, Floats, Pose2D, Matching]  # map, beams, the first pose, and the parameters


@njit
def _held_score(args: _Climb, pose: Pose2D, enough: float) -> float:
    """The score of a pose, times exp(-odometry_pull * d^2 - heading_pull * t^2) at d and t from the first."""
    means, table, beams, start, matching = args
    dx, dy, turn = pose.x - start.x, pose.y - start.y, pose.yaw - start.yaw
    pull = exp(-matching.odometry_pull * (dx * dx + dy * dy) - matching.heading_pull * (turn * turn))
    if pull == 0.0:  # too far from odometry for any match
        return 0.0
    rotated = rotate(beams, pose.yaw)
    return pull * match_score(means, table, rotated, pose.x, pose.y, matching.sigma, enough / pull)


@njit
def match_particles(
    means: Means, tables: Integers, beams: Floats, poses: Floats, matching: Matching
) -> tuple[Floats, Floats, Floats]:
    """((N, 3) poses, (N,) log-likelihoods, (N,) scores): every particle at its best match.

    A score lies between 0 and the number of beams. A particle whose match scores no more than the minimum
    keeps the pose that its noisy odometry gave it. ``means`` and ``tables``: as ``ParticleMaps`` has them;
    ``beams``: (B, 2) ends of those that hit in the sensor frame, cells; ``poses``: (N, 3), cells and radians.
    """
    m = matching
    matched, likelihoods, scores = poses.copy(), np.empty(poses.shape[0]), np.empty(poses.shape[0])
    for n in range(poses.shape[0]):
        table, start = tables[n], Pose2D(poses[n, 0], poses[n, 1], poses[n, 2])
        args = (means, table, beams, start, m)
        at, scores[n] = hill_climb(_held_score, args, start, m.linear_step, m.angular_step, m.iterations)
        if scores[n] <= m.minimum_score:
            at = start
        matched[n, 0], matched[n, 1], matched[n, 2] = at.x, at.y, at.yaw
        rotated = rotate(beams, at.yaw)
        likelihoods[n] = log_likelihood(
            means, table, rotated, at.x, at.y, m.likelihood_sigma, m.miss_log_likelihood
        )
    return matched, likelihoods, scores


def cores() -> int:
    """How many threads a process that works alone should take; ``NUMBA_NUM_THREADS`` says it if set."""
    return int(numba().config.NUMBA_NUM_THREADS)


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

    def __init__(self, particles: int, resolution_m: float, threads: int = 1) -> None:
        self.resolution_m = resolution_m
        parts = min(particles, threads * _PARTS_PER_THREAD) if threads > 1 else 1
        ends = [particles * part // parts for part in range(parts + 1)]
        self._parts = [slice(begin, end) for begin, end in pairwise(ends)]
        self._map = ThreadPoolExecutor(threads).map if threads > 1 else map
        self.origin_cells = np.zeros(2, dtype=np.int64)
        """(column, row) of the tables' first cell on the lattice through the map frame's origin"""
        self.tables: Integers = np.zeros((particles, 1, 1), dtype=np.int32)
        """(N, rows, columns) patch numbers; patch 0 is empty and never written"""
        self.means: Means = np.full((1, PATCH_CELLS, PATCH_CELLS, 2), EMPTY, dtype=np.float32)
        """(P, 32, 32, 2) mean hit points in cells from their patch's corner; EMPTY where there are no hits"""
        self.counts: Integers = np.zeros((1, PATCH_CELLS, PATCH_CELLS, 2), dtype=np.int32)
        """(P, 32, 32, 2) hits, and visits"""

    def over_particles(self, loop: Callable[[slice], PartT]) -> list[PartT]:
        """What a compiled loop gives for each part of the particles, in their order; threads share the parts.

        Each particle is worked on by itself, so the number of threads changes no result.
        """
        return list(self._map(loop, self._parts))

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
        touched = self.over_particles(lambda part: mark_patches(self.tables[part], cells[part], ends, hits))
        self._own(np.concatenate(touched))
        # each particle owns the patches that it writes to
        self.over_particles(
            lambda part: register_rays(self.means, self.counts, self.tables[part], cells[part], ends, hits)
        )

    def resample(self, ancestors: Indices) -> None:
        """Give particle n a copy of the map of particle ``ancestors[n]``."""
        self.tables = self.tables[ancestors]

    def _grow(self, low_m: Floats, high_m: Floats) -> None:
        """Let the tables cover the rectangle and a cell around it."""
        if self.tables.shape[1:] == (1, 1) and not self.tables.any():
            first = np.floor(low_m / self.resolution_m).astype(np.int64)
            self.origin_cells = np.where(np.abs(first) > FAR_CELLS, first, 0)
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


@njit
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


@njit
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
