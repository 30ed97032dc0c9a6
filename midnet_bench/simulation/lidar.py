"""The LDS-01 in the simulated world: where its beams start and end, and its noise."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt

from midnet_bench.messages import LidarGeometry, burger_lds_01
from midnet_bench.simulation.engine import bullet

LDS_01: LidarGeometry = burger_lds_01()
BEAM_HEIGHT_M = 0.182
MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""

LidarNoise = Literal["gazebo", "datasheet", "none"]

Floats = npt.NDArray[np.float64]
Hit = tuple[int, int, float, tuple[float, float, float], tuple[float, float, float]]
"""body (-1 for none), link, fraction of the way, place, normal"""


def beam_origins_and_directions(poses: Floats) -> tuple[Floats, Floats]:
    """((m, 2) axes of the sensors, (m, beams, 2) unit vectors of the beams) in the map frame.

    Horizontal, from the robots' yaw alone: the sensor nods with the robot, its beams here do not.
    """
    yaw = poses[:, 2]
    mount = LDS_01.mount
    axes = poses[:, :2] + mount.x * np.column_stack((np.cos(yaw), np.sin(yaw)))
    angles = yaw[:, None] + (mount.yaw + LDS_01.angles_rad)[None, :]
    return axes, np.stack((np.cos(angles), np.sin(angles)), axis=-1)


def cast(
    client: int, axes: Floats, directions: Floats, near_m: float, far_m: float
) -> tuple[Floats, list[Hit]]:
    """(m, beams) distances from axis to first hit between near and far, inf if none; beside them all hits."""
    starts, ends = (_at_beam_height(axes, directions, reach) for reach in (near_m, far_m))
    hits: list[Hit] = []
    for first in range(0, len(starts), MAX_BATCH):
        batch = slice(first, first + MAX_BATCH)
        hits += bullet.rayTestBatch(starts[batch], ends[batch], numThreads=1, physicsClientId=client)
    fractions = np.array([hit[2] for hit in hits]).reshape(directions.shape[:2])
    return np.where(fractions < 1.0, near_m + fractions * (far_m - near_m), np.inf), hits


def _at_beam_height(axes: Floats, directions: Floats, reach_m: float) -> Floats:
    points = np.empty((directions.shape[0] * directions.shape[1], 3))
    points[:, :2] = (axes[:, None, :] + reach_m * directions).reshape(-1, 2)
    points[:, 2] = BEAM_HEIGHT_M
    return points


def add_noise(
    ranges: Floats, noise: LidarNoise, scales: Floats, rngs: Sequence[np.random.Generator]
) -> Floats:
    """Ranges as the sensor reports them; rows are robots. Beams without a return stay inf.

    ``gazebo`` adds a normal error of 10 mm at every range. ``datasheet`` reads the maker's precision
    (10 mm below 0.5 m, 3.5 % above) as three standard deviations, and its accuracy as ``scales``: (m,)
    factors that belong to each sensor. Returns are clamped to the sensor's limits. Each robot's generator
    gives one number per beam whatever the beams meet.
    """
    if noise == "none":
        return ranges
    if noise == "datasheet":
        ranges = ranges * scales[:, None]
        sigma = np.where(ranges < 0.5, 0.010 / 3.0, np.where(np.isinf(ranges), 0.0, ranges) * 0.035 / 3.0)
    else:
        sigma = np.full_like(ranges, 0.010)
    errors = np.stack([rng.standard_normal(ranges.shape[1]) for rng in rngs])
    noisy = np.clip(ranges + sigma * errors, LDS_01.range_min_m, LDS_01.range_max_m)
    return np.where(np.isinf(ranges), np.inf, noisy)


def draw_scale(rng: np.random.Generator) -> float:
    """One sensor's factor of systematic error: the maker's accuracy of 5 % as three standard deviations."""
    return float(np.clip(rng.normal(1.0, 0.05 / 3.0), 0.95, 1.05))
