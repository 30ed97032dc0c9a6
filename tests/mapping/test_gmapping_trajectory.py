"""The error of a trajectory by hand-checked relations."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.relations import Relation, read_dense_odometry, read_relations, relations_error
from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import Trajectory

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


@pytest.mark.slow
def test_the_first_of_equal_stamps_counts() -> None:
    odometry = Trajectory(np.array([0.0, 1.0, 1.0, 2.0]), ODOMETRY.poses[:4])
    poses = np.array([[0.0, 0, 0], [1.2, 0, 0], [2.7, 0, 0], [3.3, 0, 0]])
    estimated = Trajectory(odometry.stamps_s, poses)
    at_one, between = Relation(0.0, 1.0, Pose2D(1.0, 0, 0)), Relation(0.5, 2.0, Pose2D(3.0, 0, 0))
    assert relations_error([at_one], estimated, odometry).mean_m == pytest.approx(0.2)
    assert relations_error([between], estimated, odometry).mean_m == pytest.approx(
        0.3
    )  # 0.5 is 0 as well as 1
    # with no estimate at 2.0, odometry leads there from the estimate at the first 1.0
    part = Trajectory(np.array([0.0, 1.0, 1.0, 5.0]), poses)
    later = Trajectory(np.array([0.0, 1.0, 1.0, 2.0, 5.0]), ODOMETRY.poses)
    assert relations_error([Relation(0.0, 2.0, Pose2D(3.0, 0, 0))], part, later).mean_m == pytest.approx(0.2)


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
