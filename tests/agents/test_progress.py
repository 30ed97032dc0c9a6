import pytest

from midnet_bench.agents.mobile_robot import Progress


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


def test_a_stand_counts_from_five_seconds_on() -> None:
    under, over = Progress(), Progress()
    drive(under, [(0.0, 0.0)] * 51)  # 5.0 s
    drive(over, [(0.0, 0.0)] * 53)  # 5.2 s
    assert under.stuck_s == 0.0
    assert over.stuck_s == pytest.approx(5.2)


def test_swinging_within_a_quarter_of_a_metre_is_standing() -> None:
    progress = Progress()
    drive(progress, [(0.2 * (step % 2), 0.0) for step in range(101)])
    assert progress.stuck_s == pytest.approx(10.0)


def test_two_long_stands_add_up() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 101 + [(1.0, 0.0)] * 100)
    assert progress.stuck_s == pytest.approx(10.0 + 9.9)


def test_without_a_goal_nobody_is_stuck() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 200, has_goal=False)
    assert progress.stuck_s == 0.0
    assert progress.without_progress_s(19.9) == pytest.approx(0.0)


def test_a_new_goal_gets_its_own_time() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 301)
    assert progress.without_progress_s(30.0) == pytest.approx(30.0)
    progress.new_goal()
    progress.update(0.0, 0.0, 30.1, True)
    assert progress.without_progress_s(30.2) == pytest.approx(0.1)


def test_shuttling_on_forty_centimetres_is_no_progress_and_a_metre_is() -> None:
    shuttling, crossing = Progress(), Progress()
    drive(shuttling, [(0.4 * (step % 20) / 20, 0.0) for step in range(301)])
    drive(crossing, [(1.0 * (step % 50) / 50, 0.0) for step in range(301)])
    assert shuttling.without_progress_s(30.0) == pytest.approx(30.0)
    assert crossing.without_progress_s(30.0) < 5.0
