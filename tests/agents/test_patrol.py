import math
from collections.abc import Sequence

import numpy as np
import pytest

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.patrol import Patrol, patrol_points, safe_distance
from midnet_bench.errors import InputError
from midnet_bench.geometry import Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import BURGER, WAFFLE


def room(side_m: float) -> OccupancyGrid:
    cells = round(side_m / 0.05)
    data = np.zeros((cells, cells), np.int8)
    data[[0, -1], :] = 100
    data[:, [0, -1]] = 100
    return OccupancyGrid(data, 0.05, (-side_m / 2, -side_m / 2))


def points(side_m: float = 6.0) -> np.ndarray:
    return patrol_points(room(side_m), (0.0, 0.0), (side_m, side_m))


@pytest.mark.parametrize(
    ("diagonal_m", "robots", "z_m"),
    [(20 * math.sqrt(2), 1, 14.14), (20 * math.sqrt(2), 5, 2.83), (6 * math.sqrt(2), 1, 4.24)],
)
def test_z_is_equation_12(diagonal_m: float, robots: int, z_m: float) -> None:
    assert safe_distance(diagonal_m, robots) == pytest.approx(z_m, abs=0.005)


def test_points_keep_forty_centimetres_from_occupied_cells() -> None:
    drawn = points()
    assert np.abs(drawn).max() <= 3.0 - 0.025 - 0.4 + 1e-9
    assert np.abs(drawn).max() > 3.0 - 0.025 - 0.4 - 0.05


def test_guards_too_wide_for_a_door_patrol_on_their_side_of_it() -> None:
    grid = room(6.0)
    grid.data[:, 60] = 100
    grid.data[56:64, 60] = 0  # 0.45 m from jamb to jamb, cell by cell
    ends = {
        reach_m: patrol_points(grid, (-1.0, 0.0), (6.0, 6.0), 0.4, reach_m)[:, 0].max()
        for reach_m in (BURGER.footprint_reach_m, WAFFLE.footprint_reach_m)
    }
    assert [end > 1.0 for end in ends.values()] == [True, False]


def test_a_door_does_not_lead_the_patrol_outside() -> None:
    grid = room(8.0)
    grid.data[20, 20:140] = grid.data[139, 20:140] = 100
    grid.data[20:140, 20] = grid.data[20:60, 139] = grid.data[90:140, 139] = 100
    drawn = patrol_points(grid, (0.0, 0.0), (6.0, 6.0))
    assert np.abs(drawn).max() < 3.0


def test_a_map_of_some_other_place_is_refused() -> None:
    with pytest.raises(InputError, match="prior_map"):
        patrol_points(room(6.0), (40.0, 0.0), (6.0, 6.0))


def drawn(patrol: Patrol, place: Point, goals: Sequence[Point] = ()) -> Point:
    """The next point of a guard at ``place`` whose mates have these goals, one of them none."""
    mates = [GuardState(place, None), *(GuardState((9.0, 9.0), goal) for goal in goals)]
    return patrol.next_point(0, [GuardState(place, (0.1, 0.1)), *mates], 1.0)


def test_conditions_hold_when_they_can_be_met() -> None:
    patrol = Patrol(points(), safe_distance(6 * math.sqrt(2), 5), stream(1, "patrol"))
    others = [(1.0, 1.0), (-1.5, 0.5), (0.0, -2.0)]
    for _ in range(50):
        goal = drawn(patrol, (2.0, 2.0), others)
        assert min(math.dist(goal, other) for other in [(2.0, 2.0), *others]) >= patrol.z_m
    assert patrol.relaxations == 0


def test_a_goal_that_a_mate_pursues_keeps_no_patrol_point_away() -> None:
    z_m, free = 1.0, np.array([[2.0, 2.0]])
    for is_pursuing, relaxed in ((True, False), (False, True)):
        patrol = Patrol(free, z_m, stream(1, "patrol"))
        mate = GuardState((-2.0, 0.0), (2.0, 1.9), is_pursuing)
        assert patrol.next_point(0, [GuardState((-2.0, -2.0), None), mate], 1.0) == (2.0, 2.0)
        assert (patrol.relaxations > 0) == relaxed


def test_one_robot_at_the_centre_has_no_goal_until_z_is_relaxed() -> None:
    patrol = Patrol(points(), safe_distance(6 * math.sqrt(2), 1), stream(1, "patrol"))
    goal = drawn(patrol, (0.0, 0.0))
    # 4.24 m is past the farthest corner (3.64 m): two shrinkings make 3.44 m
    assert patrol.relaxations >= 2
    assert math.hypot(*goal) >= patrol.z_m * 0.9**patrol.relaxations


def test_a_crowd_that_leaves_no_room_still_gets_a_goal() -> None:
    crowd = [(x, y) for x in np.arange(-3, 3, 0.2) for y in np.arange(-3, 3, 0.2)]
    assert drawn(Patrol(points(), 2.0, stream(1, "patrol")), (0.0, 0.0), crowd)


def test_the_seed_decides_the_points() -> None:
    def first(seed: int) -> list[Point]:
        patrol = Patrol(points(), 1.0, stream(seed, "patrol"))
        return [drawn(patrol, (0.0, 0.0)) for _ in range(5)]

    assert first(1) == first(1) != first(2)
