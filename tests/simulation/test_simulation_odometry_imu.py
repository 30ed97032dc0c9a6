import math

import numpy as np
import pytest

from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.sensors import TICK_RAD, EncoderOdometers, ImuSensors
from midnet_bench.simulation.world_settings import ImuSettings, OdometrySettings

RADIUS_M, SEPARATION_M = BURGER.wheel_radius_m, BURGER.wheel_separation_m
ONE = np.zeros(1, dtype=np.int64)  # the row of a robot that is alone
PERFECT = OdometrySettings(radius_error=0.0, separation_error=0.0, slip_m_per_sqrt_m=0.0)


def test_midpoint_rule_on_a_circle_by_hand() -> None:
    odometer = EncoderOdometers(np.zeros((1, 3)), np.zeros((1, 2)), PERFECT, [stream(1, "a")], BURGER)
    radius, steps = 0.5, 90
    for step in range(1, steps + 1):
        turned = math.pi / 2 * step / steps
        wheels = turned * (radius + np.array([-0.5, 0.5]) * SEPARATION_M) / RADIUS_M
        ((linear, angular),) = odometer.update(ONE, wheels[None], 0.1)
    np.testing.assert_allclose(odometer.poses[0], (radius, radius, math.pi / 2), atol=1e-3)
    assert angular == pytest.approx(math.pi / 2 / steps / 0.1, rel=0.05)
    assert linear == pytest.approx(radius * math.pi / 2 / steps / 0.1, rel=0.05)


def test_less_than_a_tick_is_not_seen_and_never_lost() -> None:
    odometer = EncoderOdometers(np.zeros((1, 3)), np.zeros((1, 2)), PERFECT, [stream(1, "a")], BURGER)
    odometer.update(ONE, np.full((1, 2), 0.9 * TICK_RAD), 0.1)
    assert odometer.poses[0, 0] == 0.0
    odometer.update(ONE, np.full((1, 2), 1.8 * TICK_RAD), 0.1)
    assert odometer.poses[0, 0] == pytest.approx(TICK_RAD * RADIUS_M)
    for number in range(3, 1001):
        odometer.update(ONE, np.full((1, 2), 0.9 * number * TICK_RAD), 0.1)
    assert odometer.poses[0, 0] == pytest.approx(900 * TICK_RAD * RADIUS_M, abs=TICK_RAD * RADIUS_M)


def test_slip_grows_with_the_root_of_the_travel_whatever_the_rate() -> None:
    settings = OdometrySettings(radius_error=0.0, separation_error=0.0, slip_m_per_sqrt_m=0.01)
    for step_m in (0.01, 0.05):
        noise = [stream(number, "slip") for number in range(200)]
        odometers = EncoderOdometers(np.zeros((200, 3)), np.zeros((200, 2)), settings, noise, BURGER)
        turn = step_m / RADIUS_M
        for step in range(1, round(1.0 / step_m) + 1):
            odometers.update(np.arange(200), np.full((200, 2), step * turn), 0.1)
        ends = odometers.poses[:, 2]
        expected = 0.01 * math.sqrt(2.0) / SEPARATION_M
        assert np.std(ends) == pytest.approx(expected, rel=0.2)


def test_wheels_and_tracks_differ_from_robot_to_robot_as_set() -> None:
    """A metre ahead, and a turn on the spot; of wheels that do not slip."""
    settings = OdometrySettings(radius_error=0.01, separation_error=0.02, slip_m_per_sqrt_m=0.0)
    rngs = [stream(number, "odometry") for number in range(2000)]
    odometers = EncoderOdometers(np.zeros((2000, 3)), np.zeros((2000, 2)), settings, rngs, BURGER)
    ahead = odometers.update(np.arange(2000), np.full((2000, 2), 1.0 / RADIUS_M), 1.0).copy()
    assert ahead[:, 0].mean() == pytest.approx(1.0, abs=1e-3)
    assert ahead[:, 0].std() == pytest.approx(0.01 / math.sqrt(2.0), rel=0.05)
    assert ahead[:, 1].std() == pytest.approx(0.01 * math.sqrt(2.0) / SEPARATION_M, rel=0.05)
    wheels = (np.array([-0.5, 0.5]) * SEPARATION_M + 1.0) / RADIUS_M
    turned = odometers.update(np.arange(2000), np.tile(wheels, (2000, 1)), 1.0)[:, 1]
    assert turned.std() == pytest.approx(math.hypot(0.01 / math.sqrt(2.0), 0.02), rel=0.05)


def test_the_imu_follows_the_facts(monkeypatch) -> None:
    monkeypatch.setattr("midnet_bench.simulation.sensors.GYRO_BIAS_RADPS", 0.1)
    monkeypatch.setattr("midnet_bench.simulation.sensors.GYRO_BIAS_STDDEV_RADPS", 1e-3)
    sensors = ImuSensors(ImuSettings(), [stream(number, "imu") for number in range(200)])
    still = np.zeros((200, 3)), np.zeros((200, 2))
    readings = np.array([sensors.read(np.arange(200), *still, 0.1).copy() for _ in range(100)])
    yaw, rate = readings.T
    biases = rate.mean(axis=1)
    assert np.abs(biases).mean() == pytest.approx(0.1, abs=4e-4)
    assert np.abs(biases).std() == pytest.approx(1e-3, rel=0.2)
    assert (biases > 0).any()
    assert (biases < 0).any()
    assert (rate - biases[:, None]).std() == pytest.approx(2e-4, rel=0.03)
    np.testing.assert_allclose(yaw[:, -1], rate.sum(axis=1) * 0.1, atol=1e-12)


def test_the_imu_of_ros_1_is_exact() -> None:
    sensor = ImuSensors(ImuSettings(noise="none"), [stream(1, "imu")])
    said = sensor.read(ONE, np.array([[1.0, 2.0, 0.5]]), np.array([[0.2, -0.3]]), 0.1)
    assert said.tolist() == [[0.5, -0.3]]


def test_what_a_sensor_says_does_not_depend_on_who_is_read_with_it() -> None:
    poses, velocities = np.zeros((3, 3)), np.full((3, 2), 0.1)
    names = ["guard 1", "guard 2", "intruder 1"]

    def imu_and_odometry(team: list[str], order: list[int]) -> dict[str, list[np.ndarray]]:
        imus = ImuSensors(ImuSettings(), [stream(1, "imu", name) for name in team])
        rngs = [stream(1, "odometry", name) for name in team]
        odometers = EncoderOdometers(
            poses[: len(team)], np.zeros((len(team), 2)), OdometrySettings(), rngs, BURGER
        )
        said: dict[str, list[np.ndarray]] = {name: [] for name in team}
        for cycle in range(1, 150):
            for rows in ([order[0]], order[1:]):
                due = np.array(rows, dtype=np.int64)
                readings = imus.read(due, poses, velocities, 0.1)
                moves = odometers.update(due, np.full((len(team), 2), 0.3 * cycle), 0.1)
                for row in rows:
                    said[team[row]].append(np.hstack((readings[row], moves[row], odometers.poses[row])))
        return said

    together = imu_and_odometry(names, [2, 0, 1])
    alone = imu_and_odometry(["intruder 1"], [0])
    assert np.array_equal(together["intruder 1"], alone["intruder 1"])
    assert not np.array_equal(together["guard 1"], together["guard 2"])
