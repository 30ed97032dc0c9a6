"""Beams cast on what stands still, by PyBullet's ``rayTestBatch``."""

from operator import itemgetter

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.simulation.bullet.engine import bullet
from midnet_bench.simulation.simulator import Beams

Floats = npt.NDArray[np.float64]

_FRACTION = itemgetter(2)
"""of a ray's result, as PyBullet gives it"""
MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""


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


def cast_on_solids(client: int, beams: Beams, near_m: float, far_m: float, height_m: float) -> Floats:
    """(m, beams) distance from the axis to the first solid between near and far; inf if there is none."""
    starts, ends = ray_ends(*beams, near_m, far_m, height_m)
    met = np.empty(len(starts))
    for first in range(0, len(starts), MAX_BATCH):
        batch = slice(first, first + MAX_BATCH)
        met[batch] = ray_fractions(client, starts[batch], ends[batch])
    return np.asarray(distances(met, near_m, far_m).reshape(beams.directions.shape[:2]))


def ray_fractions(client: int, starts: Floats, ends: Floats) -> Floats:
    """(n,) how far along each ray the first solid is, 1 if there is none; (n, 3) starts and ends, metres.

    PyBullet answers with a tuple of tuples; most of what that costs is making them and giving them back.
    """
    hits = bullet.rayTestBatch(starts, ends, numThreads=1, physicsClientId=client)
    fractions = np.fromiter(map(_FRACTION, hits), np.float64, len(hits))
    del hits
    return fractions
