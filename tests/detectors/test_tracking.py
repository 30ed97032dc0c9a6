"""Tracks of boxes: against a filter written out, and by hand."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.detectors.tracking import BOX_SIGMA_M, DRIFT_M2PS3, SPEED_SIGMA_MPS, Tracker


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
    assert tracker.update([(0.6 * (reach - 1e-6), 0.8 * (reach - 1e-6))], 1.0) == [0]
    outside = Tracker()
    for k in range(5):
        outside.update([(0.0, 0.0)], 0.2 * k)
    assert outside.update([(0.6 * (reach + 1e-6), 0.8 * (reach + 1e-6))], 1.0) == [1]


PLACES = st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), max_size=6)


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
