import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.recording.fitting.poses import PoseTrack


def track(*rows):
    table = np.array(rows, dtype=np.float64)
    return PoseTrack(table[:, 0], table[:, 1:])


def test_between_two_poses_the_way_is_straight_and_the_turn_short():
    turning = track((10.0, 0.0, 0.0, 3.0), (12.0, 4.0, -2.0, -3.0))
    middle = turning.at(11.0)
    assert middle[:2] == (2.0, -1.0)
    assert abs(wrap_angle(middle.yaw - math.pi)) < 1e-12  # not 0, the long way
    quarter = turning.at(10.5)
    assert quarter.yaw == pytest.approx(3.0 + (2.0 * math.pi - 6.0) / 4.0)


def test_before_the_first_and_after_the_last_the_pose_stays():
    two = track((1.0, 1.0, 2.0, 0.5), (2.0, 3.0, 2.0, 0.5))
    assert two.at(0.0) == Pose2D(1.0, 2.0, 0.5)
    assert two.at(9.0) == Pose2D(3.0, 2.0, 0.5)
    assert track((1.0, 1.0, 2.0, 0.5)).at(7.0) == Pose2D(1.0, 2.0, 0.5)


def test_of_two_poses_with_one_stamp_the_later_counts_from_there_on():
    jump = track((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), (1.0, 5.0, 0.0, 0.0), (2.0, 6.0, 0.0, 0.0))
    assert jump.at(1.0).x == 5.0
    assert jump.at(0.5).x == 0.5
    assert jump.at(1.5).x == 5.5


def test_neighbours_say_how_old_they_are():
    two = track((1.0, 0.0, 0.0, 0.0), (4.0, 0.0, 0.0, 0.0))
    assert two.neighbours(2.0) == (1.0, 2.0)
    assert two.neighbours(2.0).age_s == 2.0
    assert two.neighbours(4.0).age_s == 0.0
    assert two.neighbours(0.5) == (math.inf, 0.5)
    assert two.neighbours(0.5).age_s == 0.5
    assert two.neighbours(6.5) == (2.5, math.inf)
    assert two.neighbours(6.5).age_s == 2.5


@given(
    st.lists(st.tuples(*[st.floats(-9.0, 9.0)] * 3), min_size=1, max_size=8),
    st.lists(st.floats(-1.0, 9.0), min_size=2, max_size=2).map(sorted),
    st.floats(0.0, 1.0),
)
def test_a_part_of_a_track_gives_the_same_poses(poses, ends, share):
    whole = PoseTrack(np.arange(float(len(poses))), np.array(poses))
    start_s, end_s = ends
    time_s = min(max(start_s + share * (end_s - start_s), start_s), end_s)
    part = whole.between(start_s, end_s)
    assert part.at(time_s) == whole.at(time_s)
    assert len(part.times_s) <= end_s - start_s + 3
