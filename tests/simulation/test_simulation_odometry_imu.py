import math

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.rng import stream
from midnet_bench.robots.burger import BURGER
from midnet_bench.simulation.bullet.world import World
from midnet_bench.simulation.imu import ImuSensor
from midnet_bench.simulation.odometry import TICK_RAD, EncoderOdometer
from midnet_bench.simulation.settings import ImuSettings, OdometrySettings
from tests.simulation.scenes import run, scene

RADIUS_M, SEPARATION_M = BURGER.wheel_radius_m, BURGER.wheel_separation_m
PERFECT = OdometrySettings(radius_error=0.0, separation_error=0.0, slip_m_per_sqrt_m=0.0)


def around_a_square(settings: OdometrySettings, seed: int) -> tuple[float, float]:
    """Distance driven, and how far encoder odometry ends from the truth, metres."""
    with World(scene([(-1.0, -1.0, 0.0)])) as world:
        start = Pose2D(*world.poses()[0])
        odometer = EncoderOdometer(start, world.wheel_angles(0), settings, stream(seed, "odometry", 0))
        driven, last = 0.0, start
        for _ in range(4):
            for command, seconds in ((Command(0.22, 0.0), 8.0), (Command(0.0, 0.8), math.pi / 2 / 0.8)):
                world.drive(0, command)
                for _ in range(round(seconds * 10)):
                    run(world, 0.1)
                    encoder = odometer.update(world.wheel_angles(0), 0.1)
                    now = Pose2D(*world.poses()[0])
                    driven, last = driven + last.distance_to(now), now
        truth = Pose2D(*world.poses()[0])
        assert encoder.angular_radps == pytest.approx(0.8, rel=0.1)
        assert world.odometry(0)[2] == pytest.approx(0.8, rel=0.02)
    return driven, encoder.pose.distance_to(truth)


def test_encoders_drift_each_in_its_own_way() -> None:
    ends = [around_a_square(OdometrySettings(), seed) for seed in range(4)]
    for driven, encoder in ends:
        assert driven == pytest.approx(7.0, rel=0.05)
        assert 0.01 < encoder < 0.15 * driven
    assert len({encoder for _, encoder in ends}) == 4, "each robot errs in its own way"
    _, perfect = around_a_square(PERFECT, 0)
    assert perfect < 0.01 * 7.0, "what is left is the slip that the physics itself has"


def test_midpoint_rule_on_a_circle_by_hand() -> None:
    odometer = EncoderOdometer(Pose2D(0.0, 0.0, 0.0), np.zeros(2), PERFECT, stream(1, "a"))
    radius, steps = 0.5, 90
    for step in range(1, steps + 1):
        turned = math.pi / 2 * step / steps
        wheels = turned * (radius + np.array([-0.5, 0.5]) * SEPARATION_M) / RADIUS_M
        odometry = odometer.update(wheels, 0.1)
    np.testing.assert_allclose(odometry.pose, (radius, radius, math.pi / 2), atol=1e-3)
    assert odometry.angular_radps == pytest.approx(math.pi / 2 / steps / 0.1, rel=0.05)
    assert odometry.linear_mps == pytest.approx(radius * math.pi / 2 / steps / 0.1, rel=0.05)


def test_less_than_a_tick_is_not_seen_and_never_lost() -> None:
    odometer = EncoderOdometer(Pose2D(0.0, 0.0, 0.0), np.zeros(2), PERFECT, stream(1, "a"))
    assert odometer.update(np.full(2, 0.9 * TICK_RAD), 0.1).pose.x == 0.0
    assert odometer.update(np.full(2, 1.8 * TICK_RAD), 0.1).pose.x == pytest.approx(TICK_RAD * RADIUS_M)
    for number in range(3, 1001):
        pose = odometer.update(np.full(2, 0.9 * number * TICK_RAD), 0.1).pose
    assert pose.x == pytest.approx(900 * TICK_RAD * RADIUS_M, abs=TICK_RAD * RADIUS_M)


def test_slip_grows_with_the_root_of_the_travel_whatever_the_rate() -> None:
    settings = OdometrySettings(radius_error=0.0, separation_error=0.0, slip_m_per_sqrt_m=0.01)
    for step_m in (0.01, 0.05):
        ends = []
        for number in range(200):
            odometer = EncoderOdometer(Pose2D(0, 0, 0), np.zeros(2), settings, stream(number, "slip"))
            turn = step_m / RADIUS_M
            for step in range(1, round(1.0 / step_m) + 1):
                pose = odometer.update(np.full(2, step * turn), 0.1).pose
            ends.append(pose.yaw)
        expected = 0.01 * math.sqrt(2.0) / SEPARATION_M
        assert np.std(ends) == pytest.approx(expected, rel=0.2)


def test_the_imu_follows_the_facts() -> None:
    sensors = [ImuSensor(ImuSettings(), stream(number, "imu")) for number in range(200)]
    readings = np.array([[sensor.read(0.0, 0.0, 0.0, 0.1) for _ in range(100)] for sensor in sensors])
    yaw, rate, acceleration = np.moveaxis(readings, 2, 0)
    assert rate.std() == pytest.approx(2e-4, rel=0.03)
    assert abs(rate.mean()) < 4 * (2e-4 / math.sqrt(rate.size) + 7.5e-6 / math.sqrt(200))
    biases = acceleration.mean(axis=1)
    assert np.abs(biases).mean() == pytest.approx(0.1, abs=0.002)
    assert (biases > 0).any()
    assert (biases < 0).any()
    assert (acceleration - biases[:, None]).std() == pytest.approx(1.7e-2, rel=0.03)
    np.testing.assert_allclose(yaw[:, -1], rate.sum(axis=1) * 0.1, atol=1e-12)


def test_the_imu_of_ros_1_is_exact_and_feels_a_robot_start() -> None:
    sensor = ImuSensor(ImuSettings(noise="none"), stream(1, "imu"))
    with World(scene([(0.0, 0.0, 0.5)])) as world:
        world.drive(0, Command(0.2, 0.0))
        felt = []
        for _ in range(6):
            run(world, 0.1)
            (_, _, yaw), (linear, angular) = world.poses()[0], world.odometry(0)[1:]
            imu = sensor.read(yaw, angular, linear, 0.1)
            assert (imu.yaw_rad, imu.yaw_rate_radps) == (yaw, angular)
            felt.append(imu.acceleration_x_mps2)
    assert felt[0] == pytest.approx(1.0, abs=0.1)
    assert sum(felt) * 0.1 == pytest.approx(0.2, rel=0.01)
    assert abs(felt[-1]) < 0.02
