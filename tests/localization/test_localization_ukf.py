import functools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.localization.localization_settings import UkfSettings
from midnet_bench.localization.ukf import (
    ALPHA,
    BETA,
    COVARIANCE_WEIGHTS,
    INITIAL_VARIANCE,
    KAPPA,
    MEAN_WEIGHTS,
    PROCESS_NOISE,
    PlanarUkf,
    UkfTeam,
)
from midnet_bench.rng import stream

DT_S = 0.1
SUBSTEPS = 10


class Odometry(NamedTuple):
    """The pose in the odom frame, velocities in the body frame."""

    pose: Pose2D
    linear_mps: float
    angular_radps: float


class Imu(NamedTuple):
    yaw_rad: float
    yaw_rate_radps: float
    acceleration_x_mps2: float


class Robot:
    """A filter in a team of one."""

    def __init__(self, start, settings):
        self.filter = PlanarUkf(start, settings)
        self.team = UkfTeam([self.filter])
        self.correct_pose = self.filter.correct_pose

    pose = property(lambda self: self.filter.pose)
    covariance = property(lambda self: self.team.covariances[0])
    velocity = property(lambda self: self.team.states[0, [3, 5]])

    def step(self, odometry, imu, dt_s):
        twists = np.array([[odometry.linear_mps, odometry.angular_radps]])
        self.team.step(np.array([0]), twists, np.array([imu]), dt_s)
        return self.pose


class Step(NamedTuple):
    """The truth at the end of a step, and the mean velocities over it."""

    pose: Pose2D
    v: float
    w: float
    mean_v: float
    mean_w: float


def drive(commands):
    """The end of each 0.1 s step of a robot whose velocities ramp at 1 m/s2 and 3 rad/s2."""
    pose, v, w = Pose2D(0.0, 0.0, 0.0), 0.0, 0.0
    dt = DT_S / SUBSTEPS
    for v_goal, w_goal in commands:
        driven = turned = 0.0
        for _ in range(SUBSTEPS):
            v += float(np.clip(v_goal - v, -1.0 * dt, 1.0 * dt))
            w += float(np.clip(w_goal - w, -3.0 * dt, 3.0 * dt))
            middle = pose.yaw + 0.5 * w * dt
            pose = Pose2D(
                pose.x + v * dt * math.cos(middle), pose.y + v * dt * math.sin(middle), pose.yaw + w * dt
            )
            driven, turned = driven + v * dt, turned + w * dt
        yield Step(pose, v, w, driven / DT_S, turned / DT_S)


@functools.cache
def driven_square(laps):
    """The truth of squares of 2 m: straight on, stop, a quarter turn on the spot."""
    side = [(0.2, 0.0)] * 100 + [(0.0, 0.0)] * 5
    turn = [(0.0, math.pi / 4.0)] * 20 + [(0.0, 0.0)] * 5
    return tuple(drive((side + turn) * 4 * laps))


class SlippingWheels:
    """Odometry that integrates two wheels, each with a fixed scale error and noise of its own."""

    SEPARATION_M = 0.16

    def __init__(self, rng):
        self.rng = rng
        self.scale = 1.0 + rng.normal(0.0, 0.02, size=2)
        self.pose = Pose2D(0.0, 0.0, 0.0)

    def read(self, v, w):
        half = 0.5 * self.SEPARATION_M
        rims = np.array([v - half * w, v + half * w])
        left, right = rims * self.scale * (1.0 + self.rng.normal(0.0, 0.05, size=2))
        v_read, w_read = float(left + right) / 2.0, float(right - left) / self.SEPARATION_M
        step = Pose2D(v_read * DT_S, 0.0, w_read * DT_S)
        self.pose = self.pose.compose(step)
        return Odometry(self.pose, v_read, w_read)


def noisy_imu(pose, w, rng):
    return Imu(wrap_angle(pose.yaw + rng.normal(0.0, 0.005)), w + rng.normal(0.0, 0.002), 0.0)


def exact(step, source):
    velocity = (step.v, step.w) if source == "world" else (step.mean_v, step.mean_w)
    return Odometry(step.pose, *velocity), Imu(wrap_angle(step.pose.yaw), step.w, 0.0)


@pytest.mark.parametrize(
    "seed", [*range(2), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))]
)
def test_error_is_under_half_of_raw_odometrys_on_a_driven_square(seed):
    rng = stream(seed, "slip")
    wheels = SlippingWheels(rng)
    ukf = Robot(Pose2D(0.0, 0.0, 0.0), UkfSettings().suited_to("encoder"))
    filtered, raw = [], []
    for step in driven_square(laps=3):
        odometry = wheels.read(step.mean_v, step.mean_w)
        filtered.append(ukf.step(odometry, noisy_imu(step.pose, step.w, rng), DT_S).distance_to(step.pose))
        raw.append(odometry.pose.distance_to(step.pose))
    rms_filtered, rms_raw = (math.sqrt(np.mean(np.square(errors))) for errors in (filtered, raw))
    assert rms_raw > 0.05
    assert rms_filtered < 0.5 * rms_raw


@pytest.mark.parametrize("source", ["world", "encoder"])
def test_noise_free_messages_lead_along_the_truth(source):
    ukf = Robot(Pose2D(0.0, 0.0, 0.0), UkfSettings().suited_to(source))
    for step in driven_square(laps=2):
        estimate = ukf.step(*exact(step, source), DT_S)
        assert estimate.distance_to(step.pose) < 0.006
        assert abs(wrap_angle(estimate.yaw - step.pose.yaw)) < 1e-3
    assert ukf.velocity == pytest.approx((step.v, step.w), abs=1e-3)


@pytest.mark.slow
def test_a_quarter_of_an_hour_stays_finite_and_positive_definite():
    rng = stream(7, "hour")
    wheels = SlippingWheels(rng)
    ukf = Robot(Pose2D(0.0, 0.0, 0.0), UkfSettings().suited_to("encoder"))
    v = w = yaw = 0.0
    for step in range(9_000):
        if step % 50 == 0:
            v, w = float(rng.uniform(-0.1, 0.22)), float(rng.uniform(-1.5, 1.5))
        yaw += w * DT_S
        ukf.step(wheels.read(v, w), noisy_imu(Pose2D(0.0, 0.0, yaw), w, rng), DT_S)
        if step % 20 == 0:
            assert np.linalg.eigvalsh(ukf.covariance)[0] > 0.0
    assert np.all(np.isfinite(ukf.pose))
    assert np.all(np.isfinite(ukf.velocity))
    assert -math.pi <= ukf.pose.yaw < math.pi
    assert abs(wrap_angle(ukf.pose.yaw - yaw)) < 0.05


TRUSTED = UkfSettings((4e-4, 1e-4, 1e-2), imu_yaw_variance=1e-4, imu_yaw_rate_variance=1e-3)


def test_without_a_heading_the_filter_follows_dead_reckoning():
    """Ten minutes with an IMU that says nothing: the heading's variance grows to 36 rad^2 and more."""
    rng = stream(3, "no yaw")
    ukf = Robot(Pose2D(0.0, 0.0, 0.0), UkfSettings().suited_to("encoder"))
    ukf.team._variances[[0, 4]] = 1e12
    reckoned, v, w = Pose2D(0.0, 0.0, 0.0), 0.0, 0.0
    for step in range(6000):
        if step % 50 == 0:
            v, w = float(rng.uniform(0.0, 0.22)), float(rng.uniform(-0.8, 0.8))
        middle = Pose2D(0.0, 0.0, w * DT_S / 2).compose(Pose2D(v * DT_S, 0.0, w * DT_S / 2))
        reckoned = reckoned.compose(middle)
        ukf.step(Odometry(reckoned, v, w), Imu(0.0, 0.0, 0.0), DT_S)
    assert ukf.covariance[2, 2] > 36.0
    assert np.linalg.eigvalsh(ukf.covariance)[0] > 0.0
    assert ukf.pose.distance_to(reckoned) < 0.5


def test_a_firm_pose_correction_takes_over_and_a_vague_one_does_not():
    ukf = Robot(Pose2D(0.0, 0.0, 0.0), UkfSettings())
    for _ in range(50):
        ukf.step(Odometry(Pose2D(0.0, 0.0, 0.0), 0.0, 0.0), Imu(0.0, 0.0, 0.0), DT_S)
    assert ukf.correct_pose(Pose2D(0.3, 0.0, 0.0), 1e6 * np.eye(3)).x == pytest.approx(0.0, abs=1e-3)
    assert ukf.correct_pose(Pose2D(0.3, -0.2, 0.0), 1e-8 * np.eye(3))[:2] == pytest.approx(
        (0.3, -0.2), abs=1e-3
    )
    assert np.linalg.eigvalsh(ukf.covariance)[0] > 0.0


@pytest.mark.parametrize("settings", [TRUSTED, replace(TRUSTED, twist_is_mean=True)])
def test_steps_and_corrections_are_filterpys_own_with_each_reading_apart(settings):
    """The library's filter as it comes, its points moved and measured one by one, estimates the same."""
    lasts_s = DT_S * (1.0 if settings.twist_is_mean else 0.5)

    def moved(state, dt):
        x, y, yaw, vx, vy, vyaw = state
        c, s = math.cos(yaw), math.sin(yaw)
        return np.array(
            [x + (c * vx - s * vy) * dt, y + (s * vx + c * vy) * dt, yaw + vyaw * dt, vx, vy, vyaw]
        )

    def step_noise(yaw):
        turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
        reach = np.vstack([lasts_s * turn, np.eye(3)])
        noise = DT_S * np.array(PROCESS_NOISE)
        return reach @ np.diag(noise[3:]) @ reach.T + np.diag([*noise[:3], 0, 0, 0])

    points = MerweScaledSigmaPoints(6, ALPHA, BETA, KAPPA)
    assert MEAN_WEIGHTS.tobytes() == points.Wm.tobytes()
    assert COVARIANCE_WEIGHTS.tobytes() == points.Wc.tobytes()
    reference = UnscentedKalmanFilter(
        6, 5, DT_S, hx=lambda state: state[[2, 3, 4, 5, 5]], fx=moved, points=points
    )
    reference.P = INITIAL_VARIANCE * np.eye(6)
    reference.R = np.diag(
        [settings.imu_yaw_variance, *settings.twist_variance, settings.imu_yaw_rate_variance]
    )
    ours = Robot(Pose2D(0.0, 0.0, 0.0), settings)
    rng = np.random.default_rng(3)
    covariance = np.array([[0.01, 0.002, 0.0], [0.002, 0.02, 0.001], [0.0, 0.001, 0.005]])
    for number, step in enumerate(drive([(0.2, 0.9)] * 40 + [(0.1, -0.6)] * 40)):
        odometry = Odometry(step.pose, step.v + rng.normal(0, 0.01), step.w + rng.normal(0, 0.1))
        imu = noisy_imu(step.pose, step.w, rng)
        reference.Q = step_noise(reference.x[2])
        reference.predict()
        yaw = reference.x[2] + wrap_angle(imu.yaw_rad - reference.x[2])
        rates = odometry.angular_radps, imu.yaw_rate_radps
        reference.update(np.array([yaw, odometry.linear_mps, 0.0, *rates]))
        ours.step(odometry, imu, DT_S)
        if number % 10 == 0:  # whole turns of a measured pose do not count
            measured = reference.x[:3] + rng.normal(0.0, 0.1, 3)
            reference.sigmas_f = points.sigma_points(reference.x, reference.P)
            reference.update(measured, R=covariance, hx=lambda state: state[:3])
            ours.correct_pose(Pose2D(measured[0], measured[1], measured[2] + 4.0 * math.pi), covariance)
        np.testing.assert_allclose(ours.team.states[0], reference.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(ours.covariance, reference.P, rtol=1e-6, atol=1e-12)


def test_filters_that_are_stepped_together_are_the_bits_of_those_stepped_alone() -> None:
    rng = np.random.default_rng(1)
    settings = UkfSettings().suited_to("encoder")
    starts = [Pose2D(*rng.uniform(-3.0, 3.0, 3)) for _ in range(4)]
    alone = [Robot(start, settings) for start in starts]
    members = [PlanarUkf(start, settings) for start in starts]
    team = UkfTeam(members)
    for _ in range(60):
        rows = np.flatnonzero(rng.random(4) < 0.6)
        twists, imus = rng.normal(0.0, 0.2, (4, 2)), rng.normal(0.0, 3.0, (4, 3))
        team.step(rows, twists, imus, 0.1)
        for row in rows.tolist():
            pose = alone[row].step(Odometry(starts[row], *twists[row]), Imu(*imus[row]), 0.1)
            # a scan that is matched to the map corrects a member as it does a filter of its own
            measured = np.diag([1e-3, 1e-3, 1e-4])
            assert alone[row].correct_pose(pose, measured) == members[row].correct_pose(pose, measured)
    for row, robot in enumerate(alone):
        assert robot.pose == members[row].pose
        assert np.array_equal(robot.covariance, team.covariances[row])
