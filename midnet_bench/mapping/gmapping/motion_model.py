"""GMapping's odometry motion model: an increment of the odometry, made uncertain, added to every particle."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.gmapping.settings import GmappingSettings


def noise_deviations(increment: Pose2D, settings: GmappingSettings) -> npt.NDArray[np.float64]:
    """(3,) standard deviations of the noise on an increment's x, y (metres) and yaw (radians).

    Proportional to the motion, so a standing robot's particles stay where they are. ``str`` weighs
    rotation into translation and ``srt`` translation into rotation, as GMapping's code has it
    (the comments in its ini files say the opposite).
    """
    dx, dy, turn = abs(increment.x), abs(increment.y), abs(increment.yaw)
    s = settings
    return np.array(
        [
            s.noise_srr * dx + s.noise_str * turn + 0.3 * s.noise_srr * dy,
            s.noise_srr * dy + s.noise_str * turn + 0.3 * s.noise_srr * dx,
            s.noise_stt * turn + s.noise_srt * math.hypot(dx, dy),
        ]
    )


def move_particles(
    poses: npt.NDArray[np.float64],
    increment: Pose2D,
    settings: GmappingSettings,
    rng: np.random.Generator,
) -> npt.NDArray[np.float64]:
    """(N, 3) poses after the increment with Gaussian noise of its own for each particle.

    Args:
        poses: (N, 3) float64, x, y (metres) and yaw (radians) in the map frame.
        increment: the odometry's motion in the frame of its previous pose.
        settings: the four noise shares.
        rng: three standard normal draws per particle are taken, also for a standing robot.
    """
    noise = rng.standard_normal(poses.shape) * noise_deviations(increment, settings)
    steps = np.array(increment) + noise
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    yaw = poses[:, 2] + steps[:, 2]
    return np.column_stack(
        [
            poses[:, 0] + cos * steps[:, 0] - sin * steps[:, 1],
            poses[:, 1] + sin * steps[:, 0] + cos * steps[:, 1],
            (yaw + np.pi) % (2.0 * np.pi) - np.pi,
        ]
    )
