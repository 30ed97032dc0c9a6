import math

import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.layout import place, robot_starts
from midnet_bench.errors import InputError
from midnet_bench.geometry import gap_m

SEEDS = range(15)
MAP1, MAP2 = load_arena("map1"), load_arena("map2")


def points(poses) -> np.ndarray:
    return np.array([(pose.x, pose.y) for pose in poses])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arena", "solids", "half_m"), [(MAP1, 3, 3.0), (MAP2, 0, 10.0)], ids=["map1", "map2"]
)
def test_every_seed_leaves_everybody_room(arena: Arena, solids: int, half_m: float) -> None:
    walls = arena.wall_solids()
    for layout in (place(arena, seed, robots=5) for seed in SEEDS):
        assert (len(layout.stationary), len(layout.robots)) == (solids, 5)
        starts, intruders = points(layout.robots), points(layout.intruders)
        for number, solid in enumerate(layout.stationary):
            assert 0.4 <= solid.length_m <= 1.0
            assert 0.4 <= solid.width_m <= 1.0
            others = layout.stationary[:number] + layout.stationary[number + 1 :]
            assert gap_m(solid, walls + others) >= 0.499
            assert solid.distance_to(starts).min() >= 1.0
        assert len(intruders) == arena.mobile_intruders.count
        assert np.abs(intruders).max() < half_m
        assert min(solid.distance_to(intruders).min() for solid in layout.solids) >= 0.3 - 1e-9
        assert (
            np.hypot(*(starts[:, None] - intruders[None]).T).min() >= arena.mobile_intruders.clear_of_robots_m
        )
        assert arena is MAP1 or np.hypot(*intruders.T).min() > 2.5, "nobody starts in the court"
        apart = np.hypot(*(intruders[:, None] - intruders[None]).T)
        assert apart[~np.eye(len(intruders), dtype=bool)].min() >= 0.6


@pytest.mark.slow
@pytest.mark.parametrize("arena", [MAP1, MAP2], ids=["map1", "map2"])
def test_the_team_s_size_changes_no_intruder(arena) -> None:
    for seed in range(4):
        layouts = [place(arena, seed, robots) for robots in range(1, 6)]
        assert len({layout.intruders for layout in layouts}) == 1
        assert len({layout.stationary for layout in layouts}) == 1
        assert [len(layout.robots) for layout in layouts] == [1, 2, 3, 4, 5]


def test_a_seed_repeats_another_differs_and_fewer_intruders_are_the_first_of_more() -> None:
    first, again, other = (place(MAP1, seed, 5) for seed in (7, 7, 8))
    assert first == again
    assert first.stationary != other.stationary
    assert first.intruders != other.intruders
    assert place(MAP1, 7, 5, mobile_intruders=2).intruders == first.intruders[:2]
    assert place(MAP1, 7, 5, mobile_intruders=0).intruders == ()


@pytest.mark.parametrize("robots", [2, 3, 4, 5, 8])
def test_robots_start_on_a_ring_looking_outwards(robots: int) -> None:
    assert robot_starts(MAP1, 1) == ((0.0, 0.0, 0.0),)
    starts = robot_starts(MAP1, robots)
    neighbours = [a.distance_to(b) for a, b in zip(starts, starts[1:] + starts[:1], strict=True)]
    np.testing.assert_allclose(neighbours, 0.6)
    for pose in starts:
        assert math.cos(pose.yaw - math.atan2(pose.y, pose.x)) == pytest.approx(1.0)


@pytest.mark.slow
def test_intruders_come_in_both_shapes_and_all_sizes() -> None:
    solids = [solid for seed in SEEDS for solid in place(MAP1, seed, 1).stationary]
    assert {solid.kind for solid in solids} == {"box", "cylinder"}
    lengths = [solid.length_m for solid in solids]
    assert min(lengths) < 0.5
    assert max(lengths) > 0.9


def test_placed_intruders_come_before_drawn_ones(tmp_path) -> None:
    spec = {"count": 1, "placed": [{"shape": "cylinder", "x_m": 2.0, "y_m": 2.0, "size_m": [0.6, 0.9]}]}
    arena = MAP1.model_validate({**MAP1.model_dump(), "stationary_intruders": spec})
    first, second = place(arena, 1, 5).stationary
    assert (first.kind, first.pose[:2], first.length_m, first.width_m) == ("cylinder", (2.0, 2.0), 0.6, 0.6)
    assert gap_m(second, (first,)) >= 0.499


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "robots", "intruders", "said"),
    [
        ({}, 0, None, "robots: at least 1"),
        ({}, 1, -1, "intruders: must not be negative"),
        ({}, 40, None, "robots: 40 starts"),
        ({}, 20, None, "at most 5 robots"),
        (
            {"stationary_intruders": {"count": 30, "size_m": [5.0, 5.0]}},
            1,
            None,
            "stationary_intruders.count: no room for 30",
        ),
        ({"mobile_intruders": {"clear_of_robots_m": 20.0}}, 1, 1, "mobile_intruders: no room for 1"),
        ({"robots": {"center_m": (2.9, 0.0)}}, 1, 0, "robots: 1 starts"),
    ],
)
def test_what_does_not_fit_is_said(change, robots, intruders, said) -> None:
    arena = MAP1.model_validate({**MAP1.model_dump(), **change})
    with pytest.raises(InputError, match=said):
        place(arena, 1, robots, intruders)
