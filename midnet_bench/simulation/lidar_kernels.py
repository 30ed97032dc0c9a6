"""The compiled loops of the LiDAR: where its beams go, and which robots they meet."""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NOTHING, SOLID = -1, -2
"""What a beam met that was no robot: nothing, a wall or a stationary intruder."""


@njit(cache=True)
def beam_directions(poses: Floats, ahead_m: float, cosines: Floats, sines: Floats) -> tuple[Floats, Floats]:
    """(m, 2) axes ``ahead_m`` before (m, 3) poses and (m, beams, 2) unit vectors, in the poses' frame.

    ``cosines``, ``sines``: (beams,) of the beams' angles in the robot's frame.
    """
    axes = np.empty((len(poses), 2))
    directions = np.empty((len(poses), len(cosines), 2))
    for i in range(len(poses)):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        axes[i, 0] = poses[i, 0] + ahead_m * c
        axes[i, 1] = poses[i, 1] + ahead_m * s
        for k in range(len(cosines)):
            directions[i, k, 0] = c * cosines[k] - s * sines[k]
            directions[i, k, 1] = s * cosines[k] + c * sines[k]
    return axes, directions


@njit(cache=True)
def reported(
    ranges: Floats,
    errors: Floats,
    scales: Floats,
    sigma_m: float,
    sigma_share: float,
    near_m: float,
    limits_m: tuple[float, float],
) -> Floats:
    """(m, beams) ranges with noise, clamped to the sensor's limits; inf stays inf.

    ``errors``: (m, beams) standard normal; ``scales``: (m,) factors, applied first. The standard deviation is
    ``sigma_m`` below ``near_m`` and ``sigma_share`` of the range from there on.
    """
    noisy = np.empty_like(ranges)
    for i in range(ranges.shape[0]):
        for k in range(ranges.shape[1]):
            scaled = ranges[i, k] * scales[i]
            if scaled == np.inf:
                noisy[i, k] = np.inf
                continue
            sigma = sigma_m if scaled < near_m else sigma_share * scaled
            noisy[i, k] = min(max(scaled + sigma * errors[i, k], limits_m[0]), limits_m[1])
    return noisy


@njit(cache=True)
def ray_ends(
    axes: Floats, directions: Floats, near_m: float, far_m: float, height_m: float
) -> tuple[Floats, Floats]:
    """Two of (m * beams, 3): the points ``near_m`` and ``far_m`` along every beam, at a height."""
    sensors, beams = directions.shape[:2]
    starts, ends = np.empty((sensors * beams, 3)), np.empty((sensors * beams, 3))
    for i in range(sensors):
        for k in range(beams):
            start, end = starts[i * beams + k], ends[i * beams + k]
            for axis in range(2):
                start[axis] = axes[i, axis] + near_m * directions[i, k, axis]
                end[axis] = axes[i, axis] + far_m * directions[i, k, axis]
            start[2] = end[2] = height_m
    return starts, ends


@njit(cache=True)
def distances(met: Floats, near_m: float, far_m: float) -> Floats:
    """(n,) metres, of what is met at a share ``met`` of the way from near to far; inf where that is 1."""
    found = np.empty_like(met)
    for i in range(len(met)):
        found[i] = near_m + met[i] * (far_m - near_m) if met[i] < 1.0 else np.inf
    return found


@njit(cache=True)
def hide_behind_discs(
    ranges: Floats,
    axes: Floats,
    directions: Floats,
    poses: Floats,
    ahead_m: float,
    radius_m: float,
    own: Ints,
    far_m: float,
) -> Ints:
    """(m, beams) what each beam meets first: a disc's number, ``SOLID`` or ``NOTHING``.

    ``ranges``: (m, beams) to the nearest solid, inf for none; shortened where a disc within ``far_m`` is
    nearer. The discs lie ``ahead_m`` before the (n, 3) poses, NaN for one that is not there; sensor i does
    not see disc ``own[i]``. The solid, then the lower number wins a tie.
    """
    sensors, beams = directions.shape[:2]
    met = np.empty((sensors, beams), dtype=np.int64)
    centers = np.empty((len(poses), 2))
    for disc in range(len(poses)):
        centers[disc, 0] = poses[disc, 0] + ahead_m * math.cos(poses[disc, 2])
        centers[disc, 1] = poses[disc, 1] + ahead_m * math.sin(poses[disc, 2])
    for i in range(sensors):
        for k in range(beams):
            met[i, k] = NOTHING if ranges[i, k] == np.inf else SOLID
        for disc in range(len(poses)):
            dx, dy = centers[disc, 0] - axes[i, 0], centers[disc, 1] - axes[i, 1]
            if disc == own[i] or not math.hypot(dx, dy) < far_m + radius_m:
                continue
            beside = radius_m * radius_m - dx * dx - dy * dy
            for k in range(beams):
                along = dx * directions[i, k, 0] + dy * directions[i, k, 1]
                under_root = along * along + beside
                if along > 0.0 and under_root > 0.0:
                    distance = along - math.sqrt(under_root)
                    if distance < far_m and distance < ranges[i, k]:
                        ranges[i, k] = distance
                        met[i, k] = disc
    return met
