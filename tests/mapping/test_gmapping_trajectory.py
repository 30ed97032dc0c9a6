"""Trajectories on disk, and their error by hand-checked relations."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks.relations import (
    Relation,
    read_dense_odometry,
    read_relations,
    relations_error,
)
from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.trajectory import Trajectory, read_tum, write_tum


def test_a_tum_line_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    write_tum(Trajectory(np.array([976052890.244111]), np.array([[1.5, -2.0, math.pi / 2]])), path)
    values = [float(word) for word in path.read_text(encoding="utf-8").splitlines()[-1].split()]
    assert values == pytest.approx([976052890.244111, 1.5, -2.0, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)])


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(poses=arrays(np.float64, (4, 3), elements=st.floats(-3.1, 3.1)))
def test_a_tum_file_comes_back(tmp_path: Path, poses: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    path = tmp_path / "b.tum"
    written = Trajectory(np.array([0.0, 1.25, 1.5, 976052890.244111]), poses)
    write_tum(written, path)
    read = read_tum(path)
    assert read.stamps_s == pytest.approx(written.stamps_s, abs=1e-6)
    assert read.poses == pytest.approx(written.poses, abs=1e-8)


@pytest.mark.parametrize("line", ["1 2 3", "1 2 3 0 0 0 nan 1", "1 2 3 0 0 0 zero 1", "1 2 3 0 0 0 0 1 9"])
def test_a_bad_tum_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "c.tum"
    path.write_text(f"# header\n1 2 3 0 0 0 0 1\n{line}\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"c\.tum:3: "):
        read_tum(path)


ODOMETRY = Trajectory(
    np.array([0.0, 1.0, 2.0, 3.0, 4.0]),
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0], [4.0, 0.0, 0.0]]),
)


def test_relations_that_hold_have_no_error() -> None:
    turned = Pose2D(5.0, 5.0, 1.0)
    poses = np.array([turned.compose(ODOMETRY.pose(k)) for k in range(5)])
    relations = [Relation(0.0, 3.0, Pose2D(3.0, 0.0, 0.0)), Relation(4.0, 1.0, Pose2D(-3.0, 0.0, 0.0))]
    error = relations_error(relations, Trajectory(ODOMETRY.stamps_s, poses), ODOMETRY)
    assert error.mean_m == pytest.approx(0.0, abs=1e-12)
    assert error.relations == 2


def test_between_scans_the_odometry_since_counts() -> None:
    """Scans at 0 and 2 s alone; the one at 2 s is estimated 0.5 m to the left, turned by a quarter."""
    trajectory = Trajectory(
        np.array([0.0, 2.0, 4.0]), np.array([[0, 0, 0], [2, 0.5, math.pi / 2], [0, 0, 0.0]])
    )
    relations = [
        Relation(0.0, 1.0, Pose2D(1.0, 0.0, 0.0)),  # right by odometry alone
        Relation(0.0, 3.0, Pose2D(3.0, 0.0, 0.0)),  # estimated (2, 1.5)
    ]
    error = relations_error(relations, trajectory, ODOMETRY)
    assert error.mean_m == pytest.approx(math.hypot(1.0, 1.5) / 2.0)


def test_driving_order_decides_where_a_clock_jumps_back() -> None:
    odometry = Trajectory(np.array([0.0, 2.0, 1.0, 3.0]), ODOMETRY.poses[:4])
    trajectory = Trajectory(np.array([0.0, 2.0, 3.0]), np.array([[0, 0, 0], [1, 7, 0], [3, 0, 0.0]]))
    error = relations_error([Relation(0.0, 1.0, Pose2D(2.0, 7.0, 0.0))], trajectory, odometry)
    assert error.mean_m == pytest.approx(0.0, abs=1e-12)  # the reading stamped 1.0 was driven after 2.0


def test_relations_outside_the_trajectory_are_left_out() -> None:
    part = Trajectory(ODOMETRY.stamps_s[:3], ODOMETRY.poses[:3])
    outside = [Relation(0.0, 4.0, Pose2D(9.0, 0.0, 0.0))]
    assert relations_error(outside, part, ODOMETRY).relations == 0
    assert math.isnan(relations_error(outside, part, ODOMETRY).mean_m)


def test_relation_and_odometry_files(tmp_path: Path) -> None:
    relations, odometry = tmp_path / "r", tmp_path / "o"
    relations.write_text("1.5 2.5 0.1 0.2 0 0 0 0.3\n", encoding="utf-8")
    odometry.write_text("# stamp x y theta index\n1.5 0.1 0.2 0.3 -1\n", encoding="utf-8")
    assert read_relations(relations) == [Relation(1.5, 2.5, Pose2D(0.1, 0.2, 0.3))]
    assert read_dense_odometry(odometry).pose(0) == Pose2D(0.1, 0.2, 0.3)
    with pytest.raises(InputError, match=r"o:2: 5 numbers where 'stamp1"):
        read_relations(odometry)
