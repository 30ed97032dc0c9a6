"""Trajectories on disk, in the TUM format."""

import math
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.io.trajectory import Trajectory, write_tum


def test_a_tum_line_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    write_tum(Trajectory(np.array([976052890.244111]), np.array([[1.5, -2.0, math.pi / 2]])), path)
    values = [float(word) for word in path.read_text(encoding="utf-8").splitlines()[-1].split()]
    assert values == pytest.approx([976052890.244111, 1.5, -2.0, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)])


def test_another_reader_finds_every_pose(tmp_path: Path) -> None:
    stamps = np.array([0.0, 1.25, 1.5, 976052890.244111])
    poses = np.random.default_rng(1).uniform(-3.1, 3.1, (4, 3))
    write_tum(Trajectory(stamps, poses), tmp_path / "b.tum")
    read = np.loadtxt(tmp_path / "b.tum")
    assert read[:, 0] == pytest.approx(stamps, abs=1e-6)
    assert read[:, 1:3] == pytest.approx(poses[:, :2], abs=1e-8)
    assert not read[:, 3:6].any()
    assert 2.0 * np.arctan2(read[:, 6], read[:, 7]) == pytest.approx(poses[:, 2], abs=1e-8)
