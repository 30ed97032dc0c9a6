"""What the fleet counts of each robot: its way, walls that it went through, and the time that it stood."""

import math

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.geometry import Command
from midnet_bench.rng import stream
from midnet_bench.simulation.fleet import HealthTracker, ScanTicks, Standstill, crossed_wall, surfaces
from tests.simulation.scenes import BulletWorld, run, scene


def test_ways_through_walls_and_intruders_are_told_from_ways_past_them() -> None:
    layout = place(load_arena("map1"), 1, 1)
    sides = surfaces(layout)
    solid = layout.stationary[0]
    x, y = solid.pose.x, solid.pose.y
    box = solid.bounding_box()
    ways = [
        ((2.0, 0.0), (3.5, 0.0), True),
        ((2.8, 2.8), (3.2, 3.2), True),
        ((2.0, 2.9), (2.9, 2.9), False),
        ((0.0, 0.0), (0.1, 0.0), False),
        ((box.x_min - 0.01, y), (box.x_max + 0.01, y), True),
        ((box.x_min - 0.01, box.y_max + 0.01), (box.x_max + 0.01, box.y_max + 0.01), False),
        ((x, y), (x, box.y_max + 0.01), True),
        ((2.0, 0.0), (math.nan, math.nan), False),
    ]
    before, after = (np.array([way[end] for way in ways]) for end in (0, 1))
    assert crossed_wall(sides, before, after).tolist() == [way[2] for way in ways]


def test_ways_through_walls_are_those_that_cross_products_tell() -> None:
    """Ways that end on each side of a side's line, where the side has ends on each side of theirs."""
    sides = surfaces(place(load_arena("map2"), 1, 1))
    before, after = stream(1, "ways").uniform(-6.0, 6.0, (2, 500, 2))

    def side_of(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        (x, y), (along_x, along_y) = np.moveaxis(point - start, -1, 0), np.moveaxis(end - start, -1, 0)
        return np.sign(along_x * y - along_y * x)

    here, there = before[:, None], after[:, None]
    first, last = sides[:, :2], sides[:, 2:]
    parts = side_of(first, here, there) * side_of(last, here, there)
    meets = side_of(here, first, last) * side_of(there, first, last)
    expected = ((parts < 0.0) & (meets < 0.0)).any(axis=1)
    assert 100 < np.count_nonzero(expected) < 500
    np.testing.assert_array_equal(crossed_wall(sides, before, after), expected)


def test_distance_is_the_path_and_a_jump_through_a_wall_is_counted() -> None:
    layout = scene([(0.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
    poses = np.array([(0.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
    tracker = HealthTracker(layout, poses)
    for x in (0.5, 1.0, 0.5):
        tracker.update(np.array([(x, 0.0, 0.0), (1.0, 1.0, 2.0)]))
    np.testing.assert_allclose(tracker.distances_m, (1.5, 0.0))
    assert tracker.crossings.tolist() == [0, 0]
    tracker.update(np.array([(3.5, 0.0, 0.0), (math.nan, math.nan, math.nan)]))
    tracker.update(np.array([(3.5, 0.0, 0.0), (math.nan, math.nan, math.nan)]))
    np.testing.assert_allclose(tracker.distances_m, (4.5, 0.0))
    assert tracker.crossings.tolist() == [1, 0]


def test_ten_burgers_that_charge_about_blindly_go_through_nothing() -> None:
    rounds = 8
    layout = place(load_arena("map1"), 6, 5)
    rng = stream(6, "test")
    with BulletWorld(layout) as world:
        tracker = HealthTracker(layout, world.poses())
        for _ in range(rounds):
            for index in range(10):
                world.drive(index, Command(rng.choice((-0.22, 0.22)), rng.uniform(-1.0, 1.0)))
            for _ in range(10):
                run(world, 0.2)
                tracker.update(world.poses())
        assert world.collisions().sum() > rounds / 2
    assert tracker.crossings.sum() == 0
    assert tracker.distances_m.min() > 0.025 * rounds


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
        stand.update(x, y, 0.1 * step, 1)
        idle.update(x, y, 0.1 * step, None)
    assert stand.stuck_s == pytest.approx(stuck_s)
    assert idle.stuck_s == 0.0, "without a goal"


def test_a_new_goal_begins_anew() -> None:
    busy = Standstill()
    for step in range(90):
        busy.update(0.0, 0.0, 0.1 * step, step // 45)
    assert busy.stuck_s == 0.0


@pytest.mark.parametrize("step_hz", [30, 40, 100])
@pytest.mark.parametrize("rate_hz", [0.5, 1, 2, 5, 5.5, 7, 10, 15, 29.97, 30])
def test_scans_come_at_their_mean_rate_exactly_and_evenly(rate_hz: float, step_hz: int) -> None:
    ticks = ScanTicks.of(rate_hz, step_hz)
    seconds = 100
    scans = [tick for tick in range(seconds * step_hz) if ticks.has(tick)]
    assert len(scans) == round(seconds * rate_hz)
    assert scans[0] == 0
    gaps = set(np.diff(scans).tolist())
    assert gaps <= {math.floor(step_hz / rate_hz), math.ceil(step_hz / rate_hz)}
    assert max(gaps) <= ticks.longest_gap


@pytest.mark.parametrize("rate_hz", [1, 2, 5, 10])
def test_whole_periods_keep_their_ticks(rate_hz: int) -> None:
    ticks = ScanTicks.of(rate_hz, 30)
    period = 30 // rate_hz
    assert [tick for tick in range(-60, 60) if ticks.has(tick)] == list(range(-60, 60, period))


def test_a_lidar_that_is_faster_than_the_world_scans_at_every_step() -> None:
    assert ScanTicks.of(40.0, 30) == (1, 1)
    assert ScanTicks.of(5.5, 30) == (11, 60)
