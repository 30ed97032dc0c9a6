"""Correlative scan matching (Olson 2009): the pose in a window where a scan fits a map of hits best.

The window is searched in full, so no hill keeps the match from the best pose. As in Hess et al. (2016) a
coarse field bounds what a block of poses can score, and blocks that cannot win are not looked into.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import exp
from midnet_bench.geometry import Floats, Indices, Pose2D
from midnet_bench.mapping.grid_slam import hill_climb, rotate

Field = npt.NDArray[np.uint8]

CELL_M = 0.05
FULL = 255  # what a field holds where there is a hit
SIGMA_M = 0.08  # how far a hit's likeness reaches: SICK noise, half a cell, and the roughness of walls
_REACH_CELLS = 5  # beyond three sigma a hit counts nothing
_NEAR_CELLS, _WALL = 6, 200
"""so near its ends a beam passes through nothing; a field from which on there is a hit"""
BLOCK_CELLS = 8  # poses that share one bound lie in a square of so many cells
ANGLE_STEP_RAD = 0.01  # moves a point at 10 m by 0.1 m
_CLIMB_STEP_M, _CLIMB_STEP_RAD, _HALVINGS = 0.025, 0.005, 4
"""the climb from the best pose of the search ends with steps of 1.6 mm and 0.3 mrad"""


class HitField(NamedTuple):
    """How like a hit each place is, from 0 to 255: 255 exp(-d^2 / (2 sigma^2)), d to the nearest hit."""

    fine: Field  # (rows, columns) at the cells' centres
    coarse: Field  # (rows, columns) the greatest fine value of the block of cells that begins here
    corner: Floats  # (2,) x, y of the first cell's corner, metres in the map frame


class Window(NamedTuple):
    """Where to search around a pose."""

    half_m: float
    half_rad: float
    pull_per_m2: float  # what a pose at distance d loses of its score per d^2
    pull_per_rad2: float


class Match(NamedTuple):
    """The best pose of a window."""

    pose: Pose2D  # in the map frame
    score: float  # mean likeness of the points, 0 to 1, without the pulls


def hit_field(hits_m: Floats) -> HitField:
    """The field of (M, 2) hits in the map frame, with a rim on which no hit counts."""
    rim = _REACH_CELLS + BLOCK_CELLS + 1
    low = np.floor(hits_m.min(axis=0) / CELL_M) - rim
    high = np.floor(hits_m.max(axis=0) / CELL_M) + rim + 1
    fine, corner = np.zeros((high - low).astype(np.int64)[::-1], dtype=np.uint8), low * CELL_M
    _smear(fine, (hits_m - corner) / CELL_M)
    coarse, side = fine.copy(), 1
    while side < BLOCK_CELLS:
        coarse[:, :-side] = np.maximum(coarse[:, :-side], coarse[:, side:])
        coarse[:-side] = np.maximum(coarse[:-side], coarse[side:])
        side *= 2
    return HitField(fine, coarse, corner)


@njit
def _smear(field: Field, hits: Floats) -> None:
    """Raise the field around the mean hit of each cell; hits in cells from the corner."""
    counts = np.zeros(field.shape, dtype=np.int32)
    means = np.empty((hits.shape[0], 2))
    numbers = np.empty(field.shape, dtype=np.int32)
    used = 0
    for k in range(hits.shape[0]):
        c, r = math.floor(hits[k, 0]), math.floor(hits[k, 1])
        if counts[r, c] == 0:
            numbers[r, c] = used
            means[used] = 0.0
            used += 1
        counts[r, c] += 1
        number, share = numbers[r, c], 1.0 / counts[r, c]
        means[number, 0] += (hits[k, 0] - means[number, 0]) * share
        means[number, 1] += (hits[k, 1] - means[number, 1]) * share
    spread = 0.5 * CELL_M * CELL_M / (SIGMA_M * SIGMA_M)
    for k in range(used):
        x, y = means[k, 0], means[k, 1]
        for r in range(math.floor(y) - _REACH_CELLS, math.floor(y) + _REACH_CELLS + 1):
            for c in range(math.floor(x) - _REACH_CELLS, math.floor(x) + _REACH_CELLS + 1):
                dx, dy = c + 0.5 - x, r + 0.5 - y
                value = np.uint8(FULL * exp(-spread * (dx * dx + dy * dy)) + 0.5)
                if value > field[r, c]:
                    field[r, c] = value


@njit
def _score(field: Field, turned: Floats, x: float, y: float) -> float:
    """Mean likeness of turned points at (x, y), 0 to 1, bilinear between cell centres; lengths in cells."""
    total = 0.0
    rows, columns = field.shape
    for b in range(turned.shape[0]):
        u, v = x + turned[b, 0] - 0.5, y + turned[b, 1] - 0.5
        c, r = math.floor(u), math.floor(v)
        if 0 <= c < columns - 1 and 0 <= r < rows - 1:
            s, t = u - c, v - r
            low = (1.0 - s) * field[r, c] + s * field[r, c + 1]
            high = (1.0 - s) * field[r + 1, c] + s * field[r + 1, c + 1]
            total += (1.0 - t) * low + t * high
    return total / (FULL * turned.shape[0])


@njit
def _total(field: Field, cells: Indices, column: int, row: int) -> int:
    """Sum of the field over (B, 2) columns and rows, moved by so many."""
    rows, columns = field.shape
    total = 0
    for b in range(cells.shape[0]):
        c, r = cells[b, 0] + column, cells[b, 1] + row
        if 0 <= c < columns and 0 <= r < rows:
            total += int(field[r, c])
    return total


@njit
def _search(field: HitField, points: Floats, guess: Pose2D, window: Window, pull: float) -> Pose2D:
    """The best pose of the window, to a cell and a step of the angle; lengths in cells."""
    count, full = points.shape[0], FULL * points.shape[0]
    half, half_turns = math.ceil(window.half_m / CELL_M), math.ceil(window.half_rad / ANGLE_STEP_RAD)
    turns, blocks = 2 * half_turns + 1, (2 * half) // BLOCK_CELLS + 1
    cells = np.empty((turns, count, 2), dtype=np.int64)
    turn_pulls = np.empty(turns)
    bounds = np.empty((turns, blocks, blocks))  # what the poses of a block, turned in one way, score at most
    for a in range(turns):
        turn = (a - half_turns) * ANGLE_STEP_RAD
        turn_pulls[a] = window.pull_per_rad2 * turn * turn
        turned = rotate(points, guess.yaw + turn)
        for b in range(count):
            cells[a, b, 0] = math.floor(guess.x + turned[b, 0]) - half
            cells[a, b, 1] = math.floor(guess.y + turned[b, 1]) - half
        for j in range(blocks):
            for i in range(blocks):
                total = _total(field.coarse, cells[a], i * BLOCK_CELLS, j * BLOCK_CELLS)
                bounds[a, j, i] = total / full - turn_pulls[a]
    best, best_a, best_i, best_j = -math.inf, half_turns, half, half
    flat = bounds.ravel()
    for k in np.argsort(-flat):
        if flat[k] <= best:
            break
        a, block = k // (blocks * blocks), k % (blocks * blocks)
        low_j, low_i = (block // blocks) * BLOCK_CELLS, (block % blocks) * BLOCK_CELLS
        for j in range(low_j, min(low_j + BLOCK_CELLS, 2 * half + 1)):
            for i in range(low_i, min(low_i + BLOCK_CELLS, 2 * half + 1)):
                dx, dy = i - half, j - half
                total = _total(field.fine, cells[a], i, j)
                score = total / full - pull * (dx * dx + dy * dy) - turn_pulls[a]
                if score > best:
                    best, best_a, best_i, best_j = score, a, i, j
    yaw = guess.yaw + (best_a - half_turns) * ANGLE_STEP_RAD
    return Pose2D(guess.x + best_i - half, guess.y + best_j - half, yaw)


_Climb = tuple[Field, Floats, Pose2D, float, float]
"""fine field, points, the guess in cells, and the pulls per squared cell and radian"""


@njit
def _held_score(args: _Climb, pose: Pose2D, enough: float) -> float:
    """Mean likeness of the points at a pose, less the pulls; lengths in cells."""
    fine, points, guess, pull, turn_pull = args
    dx, dy, turn = pose.x - guess.x, pose.y - guess.y, pose.yaw - guess.yaw
    away = pull * (dx * dx + dy * dy) + turn_pull * turn * turn
    return _score(fine, rotate(points, pose.yaw), pose.x, pose.y) - away


@njit
def match(field: HitField, points_m: Floats, guess: Pose2D, window: Window) -> Match:
    """Where in the window around ``guess`` the points (B, 2), in the sensor's frame, fit best."""
    corner, points = field.corner, points_m / CELL_M
    start = Pose2D((guess.x - corner[0]) / CELL_M, (guess.y - corner[1]) / CELL_M, guess.yaw)
    pull = window.pull_per_m2 * CELL_M * CELL_M
    args = (field.fine, points, start, pull, window.pull_per_rad2)
    found = _search(field, points, start, window, pull)
    found, _ = hill_climb(_held_score, args, found, _CLIMB_STEP_M / CELL_M, _CLIMB_STEP_RAD, _HALVINGS)
    score = _score(field.fine, rotate(points, found.yaw), found.x, found.y)
    return Match(Pose2D(corner[0] + found.x * CELL_M, corner[1] + found.y * CELL_M, found.yaw), score)


@njit
def slid_scores(field: HitField, points_m: Floats, pose: Pose2D, ways_m: Floats) -> Floats:
    """(N,) scores of the points (B, 2), in the sensor's frame, where the pose is moved along (N, 2) ways."""
    turned = rotate(points_m / CELL_M, pose.yaw)
    scores = np.empty(ways_m.shape[0])
    for k in range(ways_m.shape[0]):
        x = (pose.x + ways_m[k, 0] - field.corner[0]) / CELL_M
        y = (pose.y + ways_m[k, 1] - field.corner[1]) / CELL_M
        scores[k] = _score(field.fine, turned, x, y)
    return scores


@njit
def crossed(field: HitField, points_m: Floats, pose: Pose2D) -> float:
    """The share of beams, to points (B, 2) in the sensor's frame, that pass through hits on their way."""
    turned = rotate(points_m / CELL_M, pose.yaw)
    rows, columns = field.fine.shape
    x0, y0 = (pose.x - field.corner[0]) / CELL_M, (pose.y - field.corner[1]) / CELL_M
    through = 0
    for b in range(turned.shape[0]):
        length = math.sqrt(turned[b, 0] * turned[b, 0] + turned[b, 1] * turned[b, 1])
        for step in range(_NEAR_CELLS, math.floor(length) - _NEAR_CELLS):
            c = math.floor(x0 + turned[b, 0] * step / length)
            r = math.floor(y0 + turned[b, 1] * step / length)
            if 0 <= c < columns and 0 <= r < rows and field.fine[r, c] >= _WALL:
                through += 1
                break
    return through / max(turned.shape[0], 1)
