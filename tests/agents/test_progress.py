import pytest

from midnet_bench.agents.mobile_robot import Progress


def drive(progress: Progress, places: list[tuple[float, float]], has_goal: bool = True) -> None:
    for step, (x, y) in enumerate(places):
        progress.update(x, y, 0.1 * step, has_goal)


def test_without_a_goal_no_time_passes() -> None:
    progress = Progress()
    drive(progress, [(0.0, 0.0)] * 200, has_goal=False)
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
