"""The LDS-01 in the simulated world: what its beams meet, and its noise.

Walls and stationary intruders are met by PyBullet's rays. Other robots are discs in the scan plane and
are intersected here: PyBullet's own ray against a round shape errs by up to 9 mm at its edge, disagrees
on hit or miss for one beam in a hundred that passes near it, and costs four times as much as the walls.
"""

import math
from collections.abc import Sequence
from operator import itemgetter
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.messages import LidarGeometry, burger_lds_01
from midnet_bench.simulation.engine import bullet
from midnet_bench.simulation.lidar_kernels import (
    beam_directions,
    distances,
    hide_behind_discs,
    ray_ends,
    reported,
)

LDS_01: LidarGeometry = burger_lds_01()
_ANGLES_RAD = LDS_01.mount.yaw + LDS_01.angles_rad
_COSINES, _SINES = np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)
_FRACTION = itemgetter(2)
"""of a ray's result, as PyBullet gives it"""
BEAM_HEIGHT_M = 0.182
MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""

LidarNoise = Literal["gazebo", "datasheet", "none"]
RobotProfile = Literal["urdf", "disc"]
"""What beams see of a robot (item 28): the LDS-01's housing, all that is in their plane, or a larger disc."""

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Profile(NamedTuple):
    """A disc in the scan plane."""

    radius_m: float
    offset_x_m: float
    """its centre ahead of the axle"""


PROFILES: dict[str, Profile] = {"urdf": Profile(0.055, -0.017), "disc": Profile(0.105, 0.0)}


class Beams(NamedTuple):
    """The beams of m sensors in the map frame."""

    axes: Floats
    """(m, 2) where they meet"""
    directions: Floats
    """(m, beams, 2) unit vectors"""


def beams_from(poses: Floats) -> Beams:
    """The beams of robots at (m, 3) poses.

    Horizontal, from yaw alone: the sensor nods with its robot by a fraction of a degree, these do not.
    """
    return Beams(*beam_directions(poses, LDS_01.mount.x, _COSINES, _SINES))


def cast_on_solids(client: int, beams: Beams, near_m: float, far_m: float) -> Floats:
    """(m, beams) distance from the axis to the first solid between near and far; inf if there is none."""
    starts, ends = ray_ends(*beams, near_m, far_m, BEAM_HEIGHT_M)
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


def hide_behind_robots(
    ranges: Floats, beams: Beams, poses: Floats, profile: Profile, own: Sequence[int], far_m: float
) -> Ints:
    """(m, beams) what each beam meets first: a robot's number, ``SOLID`` or ``NOTHING``.

    ``ranges``: (m, beams), those of ``cast_on_solids``; shortened where a robot's disc is nearer. ``poses``:
    (n, 3) of all robots, NaN for one that is gone; ``own[i]`` is the robot that sensor i sits on.
    """
    numbers = np.asarray(own, dtype=np.int64)
    return np.asarray(
        hide_behind_discs(ranges, *beams, poses, profile.offset_x_m, profile.radius_m, numbers, far_m)
    )


def add_noise(
    ranges: Floats, noise: LidarNoise, scales: Floats, rngs: Sequence[np.random.Generator]
) -> Floats:
    """Ranges as the sensor reports them; rows are robots. Beams without a return stay inf.

    ``gazebo`` adds a normal error of 10 mm at every range. ``datasheet`` reads the maker's precision
    (10 mm below 0.5 m, 3.5 % above) as three standard deviations, and its accuracy as ``scales``: (m,)
    factors that belong to each sensor. Returns are clamped to the sensor's limits. Each robot's generator
    gives one number per beam, whatever the beams meet.
    """
    if noise == "none":
        return ranges
    errors = np.array([rng.standard_normal(ranges.shape[1]) for rng in rngs]).reshape(ranges.shape)
    limits_m = (LDS_01.range_min_m, LDS_01.range_max_m)
    if noise == "gazebo":
        return np.asarray(reported(ranges, errors, np.ones(len(ranges)), 0.010, 0.0, math.inf, limits_m))
    return np.asarray(reported(ranges, errors, scales, 0.010 / 3.0, 0.035 / 3.0, 0.5, limits_m))


def draw_scale(rng: np.random.Generator) -> float:
    """One sensor's factor of systematic error: the maker's accuracy of 5 % as three standard deviations."""
    return float(np.clip(rng.normal(1.0, 0.05 / 3.0), 0.95, 1.05))
