"""The Burgers' IMUs, in the plane."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.rng import standard_normals
from midnet_bench.simulation.noise import NoiseBlocks
from midnet_bench.simulation.settings import ImuSettings

ACCELEROMETER_STDDEV_MPS2, ACCELEROMETER_BIAS_MPS2, ACCELEROMETER_BIAS_STDDEV_MPS2 = 1.7e-2, 0.1, 1e-3

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class ImuSensors:
    """The gyroscopes and forward accelerometers of n robots.

    ``gazebo`` takes the noise and bias that the Burger's description states. Gazebo's ROS 1 plugin read
    another key and published none of it, which is ``none``. A bias may have either sign. Yaw is the true one
    plus the integral of the gyroscope's errors, as of a filter that has nothing else to go by.
    """

    def __init__(self, settings: ImuSettings, rngs: Sequence[np.random.Generator]) -> None:
        """One generator for each robot, which gives its biases first and then its noise."""
        self._noisy = settings.noise == "gazebo"
        self._gyro_stddev_radps = settings.gyro_stddev_radps
        signs = np.array([rng.choice((-1.0, 1.0), size=2) for rng in rngs])
        draws = np.array([standard_normals(rng, (2,)) for rng in rngs])
        means = np.array([settings.gyro_bias_radps, ACCELEROMETER_BIAS_MPS2])
        spreads = np.array([settings.gyro_bias_stddev_radps, ACCELEROMETER_BIAS_STDDEV_MPS2])
        self._biases = signs * (means + spreads * draws)
        self._noise = NoiseBlocks(rngs, 2)
        self._drift_rad = np.zeros(len(rngs))
        self._linear_mps = np.zeros(len(rngs))
        self._readings = np.full((len(rngs), 3), np.nan)

    def read(self, rows: Ints, poses: Floats, velocities: Floats, elapsed_s: float) -> Floats:
        """(n, 3) yaw (rad), yaw rate (rad/s), forward acceleration (m/s2): new in ``rows``, else the last.

        Given the truth now, ``elapsed_s`` after the last reading: (n, 3) poses, (n, 2) forward speeds and yaw
        rates. Robots are taken to have stood still before their first reading. The acceleration is the mean
        over the time elapsed; no filter here reads it.
        """
        used_up = read_imus(
            rows,
            poses,
            velocities,
            elapsed_s,
            self._noisy,
            self._gyro_stddev_radps,
            self._biases,
            self._noise.normals,
            self._noise.used,
            self._drift_rad,
            self._linear_mps,
            self._readings,
        )
        if used_up:
            self._noise.refill()
        return self._readings


@njit
def read_imus(
    rows: Ints,
    poses: Floats,
    velocities: Floats,
    elapsed_s: float,
    noisy: bool,
    gyro_stddev_radps: float,
    biases: Floats,
    normals: Floats,
    used: Ints,
    drift_rad: Floats,
    linear_mps: Floats,
    readings: Floats,
) -> bool:
    """Put the readings of ``rows`` into ``readings``; whether some robot's noise is used up now."""
    used_up = False
    for row in rows:
        acceleration = (velocities[row, 0] - linear_mps[row]) / elapsed_s
        linear_mps[row] = velocities[row, 0]
        readings[row, 0], readings[row, 1], readings[row, 2] = poses[row, 2], velocities[row, 1], acceleration
        if not noisy:
            continue
        gyro, accelerometer = normals[row, used[row]]
        used[row] += 1
        used_up = used_up or used[row] == normals.shape[1]
        rate_error = biases[row, 0] + gyro_stddev_radps * gyro
        drift_rad[row] += rate_error * elapsed_s
        readings[row, 0] = (poses[row, 2] + drift_rad[row] + math.pi) % (2.0 * math.pi) - math.pi
        readings[row, 1] += rate_error
        readings[row, 2] += biases[row, 1] + ACCELEROMETER_STDDEV_MPS2 * accelerometer
    return used_up
