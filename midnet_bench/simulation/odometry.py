"""What robots believe of their own motion by their wheel encoders."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin
from midnet_bench.rng import standard_normals
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.noise import NoiseBlocks
from midnet_bench.simulation.settings import OdometrySettings

TICK_RAD = 2.0 * math.pi / 4096
"""The least turn of a wheel that its encoder tells apart."""

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class EncoderOdometers:
    """Dead reckoning of n robots from their wheels' angles."""

    def __init__(
        self,
        starts: Floats,
        wheel_angles_rad: Floats,
        settings: OdometrySettings,
        rngs: Sequence[np.random.Generator],
        robot: RobotModel,
    ) -> None:
        """Start at known (n, 3) poses, so that the odometry frames are the map frame; draw the errors.

        ``wheel_angles_rad``: (n, 2) left and right, as ``World.wheel_angles`` gives them.
        """
        self.poses: Floats = np.array(starts, dtype=np.float64)
        """(n, 3) x, y, yaw by dead reckoning, in each robot's odometry frame"""
        self._ticks = np.floor(wheel_angles_rad / TICK_RAD)
        self._slip = settings.slip_m_per_sqrt_m
        draws = np.array([standard_normals(rng, (3,)) for rng in rngs])  # two wheels, then the track
        self._tick_m = TICK_RAD * robot.wheel_radius_m
        self._scales = 1.0 + settings.radius_error * draws[:, :2]
        self._separation_m = robot.wheel_separation_m * (1.0 + settings.separation_error * draws[:, 2])
        self._noise = NoiseBlocks(rngs, 2)
        self._velocities = np.zeros((len(starts), 2))

    def update(self, rows: Ints, wheel_angles_rad: Floats, elapsed_s: float) -> Floats:
        """(n, 2) mean forward speed (m/s) and yaw rate (rad/s) over ``elapsed_s``, new in ``rows``.

        The poses of ``rows`` move along the heading half-way through the turn (midpoint rule).
        """
        used_up = reckon(
            rows,
            wheel_angles_rad,
            elapsed_s,
            self._tick_m,
            self._scales,
            self._separation_m,
            self._slip,
            self._noise.normals,
            self._noise.used,
            self._ticks,
            self.poses,
            self._velocities,
        )
        if used_up:
            self._noise.refill()
        return self._velocities


@njit
def reckon(
    rows: Ints,
    wheel_angles_rad: Floats,
    elapsed_s: float,
    tick_m: float,
    scales: Floats,
    separation_m: Floats,
    slip_m_per_sqrt_m: float,
    normals: Floats,
    used: Ints,
    ticks: Floats,
    poses: Floats,
    velocities: Floats,
) -> bool:
    """Move the odometry of ``rows`` on; whether some robot's noise is used up now."""
    used_up = False
    travel = np.empty(2)
    for row in rows:
        for wheel in range(2):
            now = math.floor(wheel_angles_rad[row, wheel] / TICK_RAD)
            way = (now - ticks[row, wheel]) * tick_m * scales[row, wheel]
            ticks[row, wheel] = now
            travel[wheel] = way + slip_m_per_sqrt_m * math.sqrt(abs(way)) * normals[row, used[row], wheel]
        used[row] += 1
        used_up = used_up or used[row] == normals.shape[1]
        forward, turn = (travel[0] + travel[1]) / 2.0, (travel[1] - travel[0]) / separation_m[row]
        heading = poses[row, 2] + turn / 2.0
        c, s = cos_sin(heading)
        poses[row, 0] += forward * c
        poses[row, 1] += forward * s
        poses[row, 2] = (poses[row, 2] + turn + math.pi) % (2.0 * math.pi) - math.pi
        velocities[row, 0], velocities[row, 1] = forward / elapsed_s, turn / elapsed_s
    return used_up
