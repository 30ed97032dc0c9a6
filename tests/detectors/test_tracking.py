"""Tracks of boxes: against a filter written out, and by hand; events of boxes that come and go."""

import copy
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.detectors.tracking import (
    BOX_SIGMA_M,
    DRIFT_M2PS3,
    GROUP_M,
    KEPT_S,
    SPEED_SIGMA_MPS,
    Events,
    Tracker,
)
from midnet_bench.geometry import Box


def test_a_moving_box_keeps_its_number_and_a_jump_begins_a_track() -> None:
    tracker = Tracker()
    seen = [tracker.update([(0.044 * k, 0.0)], 0.2 * k) for k in range(20)]
    assert seen == [[0]] * 20
    assert tracker.update([(3.0, 0.0)], 4.0) == [1]


def test_two_that_pass_each_other_are_told_apart_by_their_motion() -> None:
    """They meet in a corridor 0.3 m wide, and boxes come in any order."""
    tracker = Tracker()
    rng = np.random.default_rng(4)
    for k in range(60):
        at = 0.044 * k
        boxes = [(-1.3 + at, 0.15), (1.3 - at, -0.15)]
        order = rng.permutation(2)
        numbers = tracker.update([boxes[i] for i in order], 0.2 * k)
        if k == 0:
            first = {int(i): number for i, number in zip(order, numbers, strict=True)}
        assert {int(i): number for i, number in zip(order, numbers, strict=True)} == first


def test_a_box_that_comes_back_within_reach_is_the_same_track() -> None:
    tracker = Tracker()
    for k in range(10):
        tracker.update([(0.044 * k, 0.0)], 0.2 * k)
    # unseen for two seconds at 0.22 m/s
    assert tracker.update([(0.044 * 20, 0.0)], 4.0) == [0]


def test_a_dropped_track_does_not_come_back() -> None:
    tracker = Tracker()
    assert tracker.update([(0.0, 0.0)], 0.0) == [0]
    tracker.drop(0)
    tracker.drop(7)
    assert tracker.update([(0.0, 0.0)], 0.2) == [1]


def test_most_pairs_come_first() -> None:
    """The middle box is nearest to both tracks, and yet each gets one."""
    tracker = Tracker()
    tracker.update([(0.0, 0.0), (0.3, 0.0)], 0.0)
    assert tracker.update([(0.25, 0.0), (0.55, 0.0)], 0.2) == [0, 1]


def test_the_gate_is_that_of_a_kalman_filter_written_out() -> None:
    """Position and velocity in one axis, by the textbook's matrices, for a box that stands still."""
    state, covariance = np.zeros(2), np.diag([BOX_SIGMA_M**2, SPEED_SIGMA_MPS**2])
    tracker = Tracker()
    tracker.update([(0.0, 0.0)], 0.0)
    step = np.array([[1.0, 0.2], [0.0, 1.0]])
    noise = DRIFT_M2PS3 * np.array([[0.2**3 / 3, 0.2**2 / 2], [0.2**2 / 2, 0.2]])
    for k in range(1, 6):
        state, covariance = step @ state, step @ covariance @ step.T + noise
        if k < 5:
            innovation = covariance[0, 0] + BOX_SIGMA_M**2
            gain = covariance[:, 0] / innovation
            covariance = (np.eye(2) - np.outer(gain, [1.0, 0.0])) @ covariance
            assert tracker.update([(0.0, 0.0)], 0.2 * k) == [0]
    reach = math.sqrt(9.21 * (covariance[0, 0] + BOX_SIGMA_M**2))
    outside = copy.deepcopy(tracker)
    assert tracker.update([(0.6 * (reach - 1e-6), 0.8 * (reach - 1e-6))], 1.0) == [0]
    assert outside.update([(0.6 * (reach + 1e-6), 0.8 * (reach + 1e-6))], 1.0) == [1]


PLACES = st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), max_size=6)


@pytest.mark.slow
@given(st.lists(PLACES, max_size=8))
def test_each_box_has_a_track_of_its_own_and_numbers_count_up(
    frames: list[list[tuple[float, float]]],
) -> None:
    tracker, again, highest = Tracker(), Tracker(), -1
    for k, places in enumerate(frames):
        numbers = tracker.update(places, 0.2 * k)
        assert numbers == again.update(places, 0.2 * k)
        assert len(set(numbers)) == len(numbers) == len(places)
        new = [number for number in numbers if number > highest]
        assert new == list(range(highest + 1, highest + 1 + len(new)))
        highest += len(new)


def test_boxes_far_apart_do_not_overflow() -> None:
    tracker = Tracker()
    tracker.update([(0.0, 0.0)], 0.0)
    assert tracker.update([(1e6, -1e6)], 0.2) == [1]
    assert tracker.update([], 0.4) == []


def at(x: float, y: float = 0.0) -> Box:
    return Box.square(x, y, 0.2)


def test_a_person_of_two_legs_who_walks_past_is_one_event() -> None:
    events = Events()
    for frame in range(50):
        time_s, x = 0.2 * frame, 0.26 * frame
        legs = [at(x), at(x - 0.3, 0.1)] if frame % 7 else [at(x)]
        events.take(legs if frame not in (20, 21, 22) else [], [True] * len(legs), time_s)
    (event,) = events.gathered()
    assert (event.first_s, event.last_s, event.frames) == pytest.approx((0.0, 9.8, 47))
    assert event.share == pytest.approx(47 / 50)
    assert event.speed_mps == pytest.approx(1.3, abs=0.15)
    assert event.is_true
    assert events.false_per_hour == 0.0


def test_a_flicker_is_none_and_what_stays_is_one_that_does_not_move() -> None:
    events = Events()
    for frame in range(60):
        flicker = [at(5.0 + frame, 3.0)] if frame % 10 == 0 else []
        events.take([at(1.0 + 0.02 * (frame % 2)), *flicker], [False] * (1 + len(flicker)), 0.2 * frame)
    (event,) = events.gathered()
    assert event.frames == 60
    assert event.speed_mps < 0.05
    assert not event.is_true
    assert events.false_per_hour == pytest.approx(3600.0 / 11.8)


@pytest.mark.parametrize(("gap_s", "count"), [(KEPT_S - 0.1, 1), (KEPT_S + 0.3, 2)])
def test_who_comes_back_after_a_while_is_a_new_event(gap_s: float, count: int) -> None:
    events = Events()
    times_s = [0.2 * frame for frame in range(10)]
    for time_s in [*times_s, *(times_s[-1] + gap_s + time_s for time_s in times_s)]:
        events.take([at(1.0)], [False], time_s)
    assert len(events.gathered()) == count


def test_two_who_are_apart_are_two_and_nothing_is_none() -> None:
    events = Events()
    assert math.isnan(events.false_per_hour)
    for frame in range(10):
        events.take([at(0.0), at(GROUP_M + 0.5)], [False, True], 0.2 * frame)
    assert [event.is_true for event in events.gathered()] == [False, True]
