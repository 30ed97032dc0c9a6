import math

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.gmapping import move_particles, noise_deviations
from midnet_bench.mapping.mapping_settings import RECORDED_LOG, GmappingSettings

SHARES = GmappingSettings(noise_srr=0.1, noise_srt=0.2, noise_str=0.3, noise_stt=0.4)


def test_deviations_by_hand() -> None:
    x, y, yaw = noise_deviations(Pose2D(-2.0, 0.5, -0.25), SHARES)
    assert x == pytest.approx(0.1 * 2.0 + 0.3 * 0.25 + 0.3 * 0.1 * 0.5)
    assert y == pytest.approx(0.1 * 0.5 + 0.3 * 0.25 + 0.3 * 0.1 * 2.0)
    assert yaw == pytest.approx(0.4 * 0.25 + 0.2 * math.hypot(2.0, 0.5))


def test_draws_have_these_deviations_in_the_old_robot_frame() -> None:
    start, increment = Pose2D(3.0, -1.0, 1.1), Pose2D(0.6, -0.2, 0.3)
    poses = np.tile(np.array(start), (200_000, 1))
    moved = move_particles(poses, increment, SHARES, np.random.default_rng(0))
    offset = moved[:, :2] - poses[:, :2]
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    local = np.column_stack([offset @ (cos, sin), offset @ (-sin, cos), moved[:, 2] - poses[:, 2]])
    deviations = noise_deviations(increment, SHARES)
    assert local.mean(axis=0) == pytest.approx(np.array(increment), abs=5e-3)
    assert local.std(axis=0) == pytest.approx(deviations, rel=0.01)
    assert np.corrcoef(local.T) == pytest.approx(np.eye(3), abs=0.01)


def test_a_standing_robot_gets_no_noise() -> None:
    poses = np.array([[1.0, 2.0, 0.5], [-1.0, 0.0, -2.0]])
    moved = move_particles(poses, Pose2D(0.0, 0.0, 0.0), RECORDED_LOG, np.random.default_rng(0))
    assert moved == pytest.approx(poses, abs=1e-15)
