"""Trajectories on disk, in the TUM format."""

import math
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.io.scan_logs import Trajectory, clock_fault, write_tum


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


def test_poses_can_be_numbered(tmp_path: Path) -> None:
    write_tum(Trajectory(np.zeros(2), np.zeros((2, 3))), tmp_path / "c.tum", [1, 4])
    head, *lines = (tmp_path / "c.tum").read_text().splitlines()
    assert "scan_number" in head
    assert "clock" in head
    assert [line.split()[0] for line in lines] == ["1", "4"]


@pytest.mark.parametrize(
    ("stamps_s", "fault"),
    [
        ([-5.0, 0.0, 1.25, 976052890.244111], None),
        ([976052890.244111, 976052890.244113], None),
        ([3.0], None),
        ([1.0, 2.0, 2.0], (2, "the clock stands still")),
        ([1.0, 1.0000001], (1, "the clock stands still")),
        ([1.0, 3.0, 2.0, 2.0], (2, "the clock runs backwards")),
        ([1.0, 1.6e12], (1, "its stamp 1.6e+12 is no time in seconds")),
        ([1e300, 1e308], (0, "its stamp 1e+300 is no time in seconds")),
        ([-1e308, 1e308], (0, "its stamp -1e+308 is no time in seconds")),
    ],
)
def test_what_is_wrong_with_a_clock(stamps_s: list[float], fault: tuple[int, str] | None) -> None:
    assert clock_fault(np.array(stamps_s)) == fault
