import pytest

from midnet_bench.agents.mobile_robot import Dwell


def drive(places: list[tuple[float, float]], goal: int | None = 1) -> Dwell:
    dwell = Dwell(0.5)
    for step, (x, y) in enumerate(places):
        dwell.update(x, y, 0.1 * step, goal)
    return dwell


def test_without_a_goal_no_time_passes() -> None:
    assert drive([(0.0, 0.0)] * 200, goal=None).since_s == pytest.approx(19.9)


def test_a_new_goal_gets_its_own_time() -> None:
    dwell = drive([(0.0, 0.0)] * 301)
    assert dwell.since_s == 0.0
    dwell.update(0.0, 0.0, 30.1, 2)
    assert dwell.since_s == 30.1


def test_shuttling_on_forty_centimetres_is_no_progress_and_a_metre_is() -> None:
    assert drive([(0.4 * (step % 20) / 20, 0.0) for step in range(301)]).since_s == 0.0
    assert drive([(1.0 * (step % 50) / 50, 0.0) for step in range(301)]).since_s > 25.0
