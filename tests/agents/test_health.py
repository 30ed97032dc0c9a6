import pytest

from midnet_bench.agents.health import Progress


def drive(progress: Progress, places: list[tuple[float, float]], has_goal: bool = True) -> None:
    for step, (x, y) in enumerate(places):
        progress.update(x, y, 0.1 * step, has_goal)


def test_a_robot_under_way_is_not_stuck() -> None:
    progress = Progress()
    drive(progress, [(0.02 * step, 0.0) for step in range(200)])
    assert progress.stuck_s == 0.0


def test_a_short_stand_does_not_count_and_a_long_one_counts_whole() -> None:
    short, long = Progress(), Progress()
    drive(short, [(0.0, 0.0)] * 50)
    drive(long, [(0.0, 0.0)] * 101)
    assert short.stuck_s == 0.0
    assert long.stuck_s == pytest.approx(10.0)


def test_swinging_within_ten_centimetres_is_standing() -> None:
    progress = Progress()
    drive(progress, [(0.04 * (step % 2), 0.0) for step in range(101)])
    assert progress.stuck_s == pytest.approx(10.0)


def test_two_long_stands_add_up() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 101 + [(1.0, 0.0)] * 100)
    assert progress.stuck_s == pytest.approx(10.0 + 9.9)


def test_without_a_goal_nobody_is_stuck() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 200, has_goal=False)
    assert progress.stuck_s == 0.0
