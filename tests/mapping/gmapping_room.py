"""A small world for the GMapping tests: walls as segments, a kinematic robot, noisy wheels, a ray caster."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import LidarGeometry, Pose2D

Segments = npt.NDArray[np.float64]


def box(x_min: float, y_min: float, x_max: float, y_max: float) -> list[tuple[float, float, float, float]]:
    return [
        (x_min, y_min, x_max, y_min),
        (x_max, y_min, x_max, y_max),
        (x_max, y_max, x_min, y_max),
        (x_min, y_max, x_min, y_min),
    ]


def cast(segments: Segments, pose: Pose2D, angles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(B,) distances along the rays to the nearest of the (S, 4) segments x1 y1 x2 y2; inf if none is met."""
    directions = np.column_stack([np.cos(pose.yaw + angles), np.sin(pose.yaw + angles)])
    edge = segments[:, 2:] - segments[:, :2]
    start = segments[:, :2] - (pose.x, pose.y)
    cross = directions[:, :1] * edge[:, 1] - directions[:, 1:] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ray = (start[:, 0] * edge[:, 1] - start[:, 1] * edge[:, 0]) / cross
        along_edge = (start[:, 0] * directions[:, 1:] - start[:, 1] * directions[:, :1]) / cross
    met = (along_ray > 0.0) & (along_edge >= 0.0) & (along_edge <= 1.0)
    return np.where(met, along_ray, np.inf).min(axis=1)


class Drive(NamedTuple):
    """What a robot did and sensed: one entry per scan, all in step."""

    stamps_s: npt.NDArray[np.float64]
    truth: list[Pose2D]
    odometry: list[Pose2D]
    ranges_m: npt.NDArray[np.float64]


def drive(
    segments: Segments,
    geometry: LidarGeometry,
    start: Pose2D,
    corners: list[tuple[float, float]],
    rng: np.random.Generator,
) -> Drive:
    """A Burger's way past the corners: 0.2 m/s, turns on the spot, scans at 5 Hz with 1 cm noise.

    Its wheels report 5 % too much distance and 3 % too much turning, both with noise.
    """
    period_s = 0.2
    truth, odometry, pose, wheels = [start], [start], start, start
    for x, y in corners:
        bearing = math.atan2(y - pose.y, x - pose.x)
        turn = (bearing - pose.yaw + math.pi) % (2.0 * math.pi) - math.pi
        length = math.hypot(x - pose.x, y - pose.y)
        turns, moves = (math.ceil(abs(turn) / (0.8 * period_s)), math.ceil(length / (0.2 * period_s)))
        steps = [Pose2D(0.0, 0.0, turn / turns)] * turns if turns else []
        steps += [Pose2D(length / moves, 0.0, 0.0)] * moves
        for step in steps:
            pose = pose.compose(step)
            noise = rng.standard_normal(2)
            driven_m, turned_rad = step.x * (1.05 + 0.05 * noise[0]), step.yaw * 1.03 + 0.002 * noise[1]
            wheels = wheels.compose(Pose2D(driven_m, 0.0, turned_rad))
            truth.append(pose)
            odometry.append(wheels)
    angles = geometry.angles_rad
    ranges = np.array([cast(segments, pose.compose(geometry.mount), angles) for pose in truth])
    ranges += 0.01 * rng.standard_normal(ranges.shape)
    ranges[ranges > geometry.range_max_m] = np.inf
    return Drive(period_s * np.arange(len(truth)), truth, odometry, ranges)


ROOM = np.array(
    box(0.0, 0.0, 8.0, 6.0)
    + box(3.0, 2.5, 4.0, 3.5)
    + [(5.5, 0.0, 5.5, 2.0), (0.0, 4.2, 1.6, 4.2), (6.6, 4.0, 8.0, 4.0)]
)
"""8 x 6 m with a pillar and three stub walls, so that no two views are alike"""

ROUND_TRIP = [(4.7, 1.0), (4.7, 2.6), (6.4, 2.6), (6.6, 1.0), (6.4, 2.8), (5.4, 5.1), (2.2, 5.2), (2.2, 1.2)]
"""corners of a way round the pillar and behind the stub walls, clear of all of them from (1, 1) on"""
