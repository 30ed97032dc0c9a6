"""The time that robots stood, counted from where they truly were."""

import pytest

from midnet_bench.simulation.fleet import Standstill


def drive(stand: Standstill, places: list[tuple[float, float]], has_goal: bool = True, goal: int = 1) -> None:
    for step, (x, y) in enumerate(places):
        stand.update(x, y, 0.1 * step, has_goal, goal)


def test_a_robot_under_way_is_not_stuck() -> None:
    stand = Standstill()
    drive(stand, [(0.02 * step, 0.0) for step in range(200)])
    assert stand.stuck_s == 0.0


def test_a_short_stand_does_not_count_and_a_long_one_counts_whole() -> None:
    short, long = Standstill(), Standstill()
    drive(short, [(0.0, 0.0)] * 50)
    drive(long, [(0.0, 0.0)] * 101)
    assert short.stuck_s == 0.0
    assert long.stuck_s == pytest.approx(10.0)


def test_a_stand_counts_from_five_seconds_on() -> None:
    under, over = Standstill(), Standstill()
    drive(under, [(0.0, 0.0)] * 51)  # 5.0 s
    drive(over, [(0.0, 0.0)] * 53)  # 5.2 s
    assert under.stuck_s == 0.0
    assert over.stuck_s == pytest.approx(5.2)


def test_swinging_within_a_quarter_of_a_metre_is_standing() -> None:
    stand = Standstill()
    drive(stand, [(0.2 * (step % 2), 0.0) for step in range(101)])
    assert stand.stuck_s == pytest.approx(10.0)


def test_two_long_stands_add_up() -> None:
    stand = Standstill()
    drive(stand, [(0.0, 0.0)] * 101 + [(1.0, 0.0)] * 100)
    assert stand.stuck_s == pytest.approx(10.0 + 9.9)


def test_without_a_goal_nobody_is_stuck_and_a_new_goal_begins_anew() -> None:
    idle, busy = Standstill(), Standstill()
    drive(idle, [(0.0, 0.0)] * 200, has_goal=False)
    assert idle.stuck_s == 0.0
    for step in range(90):
        busy.update(0.0, 0.0, 0.1 * step, True, step // 45)
    assert busy.stuck_s == 0.0
