"""The time that robots stood, counted from where they truly were."""

import pytest

from midnet_bench.simulation.fleet import Standstill

STANDS = [(0.0, 0.0)]


@pytest.mark.parametrize(
    ("places", "stuck_s"),
    [
        ([(0.02 * step, 0.0) for step in range(200)], 0.0),
        (STANDS * 51, 0.0),  # 5.0 s
        (STANDS * 53, 5.2),
        (STANDS * 101, 10.0),
        ([(0.2 * (step % 2), 0.0) for step in range(101)], 10.0),
        (STANDS * 101 + [(1.0, 0.0)] * 100, 10.0 + 9.9),
    ],
    ids=["under way", "short", "longer than five seconds", "long", "swinging within 0.25 m", "two stands"],
)
def test_a_stand_counts_from_five_seconds_on(places: list[tuple[float, float]], stuck_s: float) -> None:
    stand, idle = Standstill(), Standstill()
    for step, (x, y) in enumerate(places):
        stand.update(x, y, 0.1 * step, True, 1)
        idle.update(x, y, 0.1 * step, False, 1)
    assert stand.stuck_s == pytest.approx(stuck_s)
    assert idle.stuck_s == 0.0, "without a goal"


def test_a_new_goal_begins_anew() -> None:
    busy = Standstill()
    for step in range(90):
        busy.update(0.0, 0.0, 0.1 * step, True, step // 45)
    assert busy.stuck_s == 0.0
