import math

import numpy as np
import pytest

from midnet_bench.geometry import Command, Pose2D
from midnet_bench.rng import stream
from midnet_bench.robots.burger import BURGER
from midnet_bench.simulation.sensors import TICK_RAD, EncoderOdometers, ImuSensors
from midnet_bench.simulation.world_settings import ImuSettings, OdometrySettings
from tests.simulation.scenes import BulletWorld, run, scene

RADIUS_M, SEPARATION_M = BURGER.wheel_radius_m, BURGER.wheel_separation_m
ONE = np.zeros(1, dtype=np.int64)  # the row of a robot that is alone
PERFECT = OdometrySettings(radius_error=0.0, separation_error=0.0, slip_m_per_sqrt_m=0.0)


def around_a_square(settings: OdometrySettings, seed: int) -> tuple[float, float]:
    """Distance driven, and how far encoder odometry ends from the truth, metres."""
    with BulletWorld(scene([(-1.0, -1.0, 0.0)])) as world:
        odometer = EncoderOdometers(
            world.poses(), world.wheel_angles(), settings, [stream(seed, "odometry", 0)], BURGER
        )
        driven, last = 0.0, Pose2D(*world.poses()[0])
        for _ in range(4):
            for command, seconds in ((Command(0.22, 0.0), 8.0), (Command(0.0, 0.8), math.pi / 2 / 0.8)):
                world.drive(0, command)
                for _ in range(round(seconds * 10)):
                    run(world, 0.1)
                    encoder = odometer.update(ONE, world.wheel_angles(), 0.1)[0]
                    now = Pose2D(*world.poses()[0])
                    driven, last = driven + last.distance_to(now), now
        truth = Pose2D(*world.poses()[0])
        assert encoder[1] == pytest.approx(0.8, rel=0.1)
        assert world.velocities()[0, 1] == pytest.approx(0.8, rel=0.02)
    return driven, Pose2D(*odometer.poses[0]).distance_to(truth)


@pytest.mark.slow
def test_encoders_drift_each_in_its_own_way() -> None:
    ends = [around_a_square(OdometrySettings(), seed) for seed in range(4)]
    for driven, encoder in ends:
        assert driven == pytest.approx(7.0, rel=0.05)
        assert 0.01 < encoder < 0.15 * driven
    assert len({encoder for _, encoder in ends}) == 4, "each robot errs in its own way"
    _, perfect = around_a_square(PERFECT, 0)
    assert perfect < 0.01 * 7.0, "what is left is the slip that the physics itself has"


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


def test_the_imu_follows_the_facts() -> None:
    sensors = ImuSensors(ImuSettings(), [stream(number, "imu") for number in range(200)])
    still = np.zeros((200, 3)), np.zeros((200, 2))
    readings = np.array([sensors.read(np.arange(200), *still, 0.1).copy() for _ in range(100)])
    yaw, rate, acceleration = readings.T
    assert rate.std() == pytest.approx(2e-4, rel=0.03)
    assert abs(rate.mean()) < 4 * (2e-4 / math.sqrt(rate.size) + 7.5e-6 / math.sqrt(200))
    biases = acceleration.mean(axis=1)
    assert np.abs(biases).mean() == pytest.approx(0.1, abs=0.002)
    assert (biases > 0).any()
    assert (biases < 0).any()
    assert (acceleration - biases[:, None]).std() == pytest.approx(1.7e-2, rel=0.03)
    np.testing.assert_allclose(yaw[:, -1], rate.sum(axis=1) * 0.1, atol=1e-12)


def test_the_imu_of_ros_1_is_exact_and_feels_a_robot_start() -> None:
    sensor = ImuSensors(ImuSettings(noise="none"), [stream(1, "imu")])
    with BulletWorld(scene([(0.0, 0.0, 0.5)])) as world:
        world.drive(0, Command(0.2, 0.0))
        felt = []
        for _ in range(6):
            run(world, 0.1)
            ((yaw, rate, acceleration),) = sensor.read(ONE, world.poses(), world.velocities(), 0.1)
            assert (yaw, rate) == (world.poses()[0, 2], world.velocities()[0, 1])
            felt.append(acceleration)
    assert felt[0] == pytest.approx(1.0, abs=0.1)
    assert sum(felt) * 0.1 == pytest.approx(0.2, rel=0.01)
    assert abs(felt[-1]) < 0.02


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
