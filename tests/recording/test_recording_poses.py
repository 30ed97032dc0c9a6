"""A pose between two readings: the short way round, the age of the farther one, none before the first."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.recording.files.readings import NS, PoseReading, Transform
from midnet_bench.recording.poses import PoseTrack, stamp_ns


def reading(x: float, y: float, yaw: float, stamp_ns: int = 0) -> PoseReading:
    turn = Transform(x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2.0), math.cos(yaw / 2.0))
    return PoseReading("/pose", stamp_ns + 7, stamp_ns, "map", "", turn)


def track(*poses: tuple[float, Pose2D]) -> PoseTrack:
    """Of (time in seconds, pose) in the order in which they are recorded."""
    made = PoseTrack()
    for time_s, pose in poses:
        made.take(round(time_s * NS), reading(*pose))
    return made


@given(st.floats(-3.1, 3.1), st.floats(-3.1, 3.1), st.floats(0.0, 1.0))
def test_a_pose_between_two_is_turned_the_short_way_round(a: float, b: float, share: float) -> None:
    found = track((0.0, Pose2D(1.0, 2.0, a)), (1.0, Pose2D(3.0, -2.0, b))).at(round(share * NS))
    assert found is not None
    apart = abs(wrap_angle(b - a))
    assert abs(wrap_angle(found.pose.yaw - a)) == pytest.approx(share * apart, abs=1e-6)
    assert abs(wrap_angle(found.pose.yaw - b)) == pytest.approx((1.0 - share) * apart, abs=1e-6)
    assert found.pose.x == pytest.approx(1.0 + 2.0 * share, abs=1e-6)
    assert found.pose.y == pytest.approx(2.0 - 4.0 * share, abs=1e-6)


def test_the_age_is_that_of_the_farther_reading() -> None:
    poses = track((0.0, Pose2D(0.0, 0.0, 0.0)), (1.0, Pose2D(1.0, 0.0, 0.0)))
    assert [found and found.age_s for found in map(poses.at, (NS // 4, NS, 3 * NS))] == [0.75, 0.0, 2.0]
    assert poses.at(-1) is None
    last = poses.latest(NS - 1)
    assert last is not None
    assert (last.pose.x, last.age_s) == (0.0, pytest.approx(1.0))


def test_a_late_pose_takes_its_place_and_a_second_one_of_a_time_replaces_the_first() -> None:
    poses = track(
        (0.0, Pose2D(0.0, 0.0, 0.0)),
        (2.0, Pose2D(2.0, 0.0, 0.0)),
        (1.0, Pose2D(5.0, 0.0, 0.0)),
        (2.0, Pose2D(3.0, 0.0, 0.0)),
    )
    assert [found and found.pose.x for found in map(poses.at, (NS, 2 * NS, 3 * NS // 2))] == [5.0, 3.0, 4.0]
    assert poses.usual_s == pytest.approx(2.0 / 3.0)


def test_what_is_no_pose_is_counted_and_left_out() -> None:
    poses = track((0.0, Pose2D(0.0, 0.0, 0.0)), (1.0, Pose2D(math.nan, 0.0, 0.0)))
    assert (poses.void, poses.first_void_ns, poses.until_ns) == (1, NS, 0)


def test_the_clock_names_the_time_that_is_used() -> None:
    assert [stamp_ns(reading(0.0, 0.0, 0.0, 5), clock) for clock in ("header", "record")] == [5, 12]


def test_many_instants_at_once_are_those_one_by_one_and_ends_stay() -> None:
    poses = track((1.0, Pose2D(1.0, 2.0, 3.0)), (2.0, Pose2D(3.0, 2.0, -3.0)), (4.0, Pose2D(3.0, 0.0, 0.0)))
    times_ns = np.array([NS, 5 * NS // 4, 2 * NS, 3 * NS])
    singly = [found.pose for found in map(poses.at, times_ns.tolist()) if found is not None]
    assert poses.at_times(times_ns).tolist() == [list(pose) for pose in singly]
    ends = poses.at_times(np.array([-NS, 9 * NS]))
    assert ends == pytest.approx(np.array([[1.0, 2.0, 3.0], [3.0, 0.0, 0.0]]))
