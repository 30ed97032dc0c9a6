"""Events of boxes that come and go, by hand."""

import math

import pytest

from midnet_bench.detectors.tracking import GROUP_M, KEPT_S, Events
from midnet_bench.geometry import Box


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
