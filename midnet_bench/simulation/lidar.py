"""The LDS-01 in the simulated world: what its beams meet, and its noise.

Walls and stationary intruders are met by the simulator's rays. Other robots are discs in the scan plane and
are intersected here: PyBullet's own ray against a round shape errs by up to 9 mm at its edge, disagrees
on hit or miss for one beam in a hundred that passes near it, and costs four times as much as the walls.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.robots.burger import LDS_01

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


_ANGLES_RAD = LDS_01.mount.yaw + LDS_01.angles_rad
_COSINES, _SINES = np.cos(_ANGLES_RAD), np.sin(_ANGLES_RAD)

LidarNoise = Literal["gazebo", "datasheet", "none"]
RobotProfile = Literal["urdf", "disc"]
"""What beams see of a robot (item 28): the LDS-01's housing, all that is in their plane, or a larger disc."""


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
