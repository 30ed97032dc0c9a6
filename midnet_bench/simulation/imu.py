"""The Burger's IMU, in the plane."""

import numpy as np

from midnet_bench.geometry import wrap_angle
from midnet_bench.messages import Imu
from midnet_bench.simulation.settings import ImuSettings

ACCELEROMETER_STDDEV_MPS2, ACCELEROMETER_BIAS_MPS2, ACCELEROMETER_BIAS_STDDEV_MPS2 = 1.7e-2, 0.1, 1e-3


class ImuSensor:
    """One robot's gyroscope and forward accelerometer.

    ``gazebo`` takes the noise and bias that the Burger's description states. Gazebo's ROS 1 plugin read
    another key and published none of it, which is ``none``. A bias may have either sign. Yaw is the true one
    plus the integral of the gyroscope's errors, as of a filter that has nothing else to go by.
    """

    def __init__(self, settings: ImuSettings, rng: np.random.Generator) -> None:
        self._noisy = settings.noise == "gazebo"
        self._gyro_stddev_radps = settings.gyro_stddev_radps
        self._rng = rng
        signs = rng.choice((-1.0, 1.0), size=2)
        draws = rng.standard_normal(2)
        self._gyro_bias = float(
            signs[0] * (settings.gyro_bias_radps + settings.gyro_bias_stddev_radps * draws[0])
        )
        self._accelerometer_bias = float(
            signs[1] * (ACCELEROMETER_BIAS_MPS2 + ACCELEROMETER_BIAS_STDDEV_MPS2 * draws[1])
        )
        self._drift_rad = 0.0
        self._linear_mps = 0.0

    def read(self, yaw_rad: float, yaw_rate_radps: float, linear_mps: float, elapsed_s: float) -> Imu:
        """What the sensor says, given the truth now, ``elapsed_s`` after the last reading.

        The robot is taken to have stood still before the first one. The acceleration is the mean over the
        time elapsed.
        """
        acceleration = (linear_mps - self._linear_mps) / elapsed_s
        self._linear_mps = linear_mps
        if not self._noisy:
            return Imu(yaw_rad, yaw_rate_radps, acceleration)
        gyro, accelerometer = self._rng.standard_normal(2).tolist()
        rate_error = self._gyro_bias + self._gyro_stddev_radps * gyro
        self._drift_rad += rate_error * elapsed_s
        return Imu(
            wrap_angle(yaw_rad + self._drift_rad),
            yaw_rate_radps + rate_error,
            acceleration + self._accelerometer_bias + ACCELEROMETER_STDDEV_MPS2 * accelerometer,
        )
