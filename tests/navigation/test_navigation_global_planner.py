import heapq
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import label

from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.navigation.global_planner import have_gone, potential_to, traversal_costs

Floor = npt.NDArray[np.uint8]


def grid_of(costs: Floor, resolution: float = 1.0) -> OccupancyGrid:
    return OccupancyGrid(costs, resolution, (0.0, 0.0))


def open_floor(height: int, width: int) -> Floor:
    return np.zeros((height, width), dtype=np.uint8)


def random_floor(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Graded costs with a share of blocked cells."""
    height, width = rng.integers(6, 40, size=2)
    costs = rng.integers(0, 200, size=(height, width)).astype(np.uint8)
    costs[rng.random((height, width)) < rng.uniform(0.0, 0.35)] = rng.choice([253, 254])
    return costs


def heap_potential(traversal: npt.NDArray[np.uint8], column: int, row: int) -> npt.NDArray[np.float64]:
    """Cells in the order of their potential, each with navfn's interpolation, from a heap."""
    potential = np.full(traversal.shape, 1e10)
    potential[row, column] = 0.0
    queue = [(0.0, row, column)]
    while queue:
        value, y, x = heapq.heappop(queue)
        if value > potential[y, x]:
            continue
        for j, i in ((y, x - 1), (y, x + 1), (y - 1, x), (y + 1, x)):
            if traversal[j, i] >= 254:
                continue
            h = float(traversal[j, i])
            a = min(potential[j, i - 1], potential[j, i + 1])
            b = min(potential[j - 1, i], potential[j + 1, i])
            ratio = abs(a - b) / h
            rise = h if ratio >= 1.0 else h * (-0.2301 * ratio**2 + 0.5307 * ratio + 0.7040)
            if min(a, b) + rise < potential[j, i] - 1e-9:
                potential[j, i] = min(a, b) + rise
                heapq.heappush(queue, (potential[j, i], j, i))
    return potential


def test_costs_become_traversal_costs_with_a_blocked_border() -> None:
    costs = open_floor(3, 8)
    costs[1, 1:7] = [0, 1, 100, 252, 253, 255]
    assert traversal_costs(costs)[1].tolist() == [254, 50, 50, 130, 251, 254, 253, 254]
    assert (traversal_costs(costs)[[0, 2]] == 254).all()


def test_potentials_by_hand() -> None:
    potential = potential_to((2.5, 2.5), grid_of(open_floor(6, 6)))
    values = potential.values
    assert values[2, 2] == 0.0
    assert values[2, 3] == 50.0
    assert values[2, 4] == 100.0
    # Both neighbours at 50: the plane wave's 0.7040 of a cell.
    assert values[3, 3] == pytest.approx(50.0 + 0.7040 * 50.0)
    assert (values[0] == 1e10).all()


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
@example(325)
def test_potentials_are_nearly_those_of_a_heap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = random_floor(rng)
    height, width = costs.shape
    column, row = int(rng.integers(1, width - 1)), int(rng.integers(1, height - 1))
    costs[row, column] = 0
    potential = potential_to((column + 0.5, row + 0.5), grid_of(costs))
    expected = heap_potential(traversal_costs(costs), column, row)
    reached = expected < 1e10
    assert np.array_equal(potential.values < 1e10, reached)
    # navfn does not pass on an improvement of less than 0.707 of a cell, so it ends a little higher.
    ratio = potential.values[reached] / np.maximum(expected[reached], 1e-9)
    assert ((ratio > 0.99) & (ratio < 1.15) | (expected[reached] == 0.0)).all()
    # 1.5 % in the mean; the tenth is for floors of a few cells, where a single late cell weighs more
    assert np.abs(ratio[expected[reached] > 0.0] - 1.0).sum() <= 0.015 * reached.sum() + 0.1


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
@example(23530280)
def test_a_path_exists_exactly_where_cells_connect_and_avoids_obstacles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = random_floor(rng)
    height, width = costs.shape
    goal, start = ((int(rng.integers(1, width - 1)), int(rng.integers(1, height - 1))) for _ in range(2))
    for column, row in (goal, start):
        costs[row, column] = 0
    at = (start[0] + rng.uniform(0.2, 0.8), start[1] + rng.uniform(0.2, 0.8))
    potential = potential_to((goal[0] + 0.5, goal[1] + 0.5), grid_of(costs))
    islands, _ = label(traversal_costs(costs) < 254)
    if islands[start[1], start[0]] != islands[goal[1], goal[0]]:
        near = islands[max(start[1] - 3, 0) : start[1] + 4, max(start[0] - 3, 0) : start[0] + 4]
        if not (near == islands[goal[1], goal[0]]).any():
            assert potential.path_from(*at) is None
        return
    found = potential.path_from(*at)
    assert found[0] == pytest.approx(at)
    assert found[-1].tolist() == [goal[0] + 0.5, goal[1] + 0.5]
    assert np.hypot(*np.diff(found, axis=0).T).max() <= 2.2
    nearest = np.floor(found).astype(int)
    assert (costs[nearest[:, 1], nearest[:, 0]] < 253).all()


def path(
    costs: Floor,
    goal: tuple[float, float],
    start: tuple[float, float],
    until_m: float = math.inf,
    resolution: float = 1.0,
) -> npt.NDArray[np.float64] | None:
    """The way from ``start`` to ``goal`` over floor that holds both."""
    potential = potential_to(goal, grid_of(costs, resolution))
    return potential.path_from(*start, until_m)


def length(points: npt.NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def test_a_plan_goes_through_cell_centres() -> None:
    costs = np.full((5, 40), 254, dtype=np.uint8)
    costs[2] = 0
    found = path(costs, (0.17625, 0.125), (1.80, 0.125), resolution=0.05)
    assert found[:, 1] == pytest.approx(np.full(len(found), 0.125))


def test_an_obstacle_dead_ahead_is_no_end_of_the_way() -> None:
    costs = open_floor(21, 41)
    costs[7:14, 20] = 254
    found = path(costs, (5.5, 10.5), (35.5, 10.5))
    assert len(found) < 120
    assert (costs[np.floor(found[:, 1]).astype(int), np.floor(found[:, 0]).astype(int)] == 0).all()


def test_a_path_is_nearly_the_shortest_on_an_open_floor_and_can_be_cut_at_a_distance() -> None:
    whole = path(open_floor(60, 60), (5.5, 5.5), (50.0, 33.0))
    assert length(whole) < 1.03 * math.hypot(44.5, 27.5)
    cut = path(open_floor(60, 60), (5.5, 5.5), (50.0, 33.0), until_m=10.0)
    distances = np.hypot(*(cut - (50.0, 33.0)).T)
    assert (distances[:-1] <= 10.0).all()
    assert 10.0 < distances[-1] <= 10.5
    assert np.array_equal(cut, whole[: len(cut)])
    short = path(open_floor(60, 60), (5.5, 5.5), (8.5, 5.5), until_m=10.0)
    assert short[-1].tolist() == [5.5, 5.5]


def test_a_path_longer_than_four_widths_is_found_whole() -> None:
    costs = open_floor(203, 12)
    for k, row in enumerate(range(3, 200, 3)):
        costs[row] = 254
        costs[row, 1 if k % 2 else 10] = 0
    found = path(costs, (5.5, 201.5), (5.5, 1.5))
    assert length(found) > 500.0


def test_a_blocked_goal_gives_way_to_the_nearest_open_cell_within_the_tolerance() -> None:
    costs = open_floor(20, 20)
    costs[8:13, 8:13] = 253
    assert potential_to((10.5, 10.5), grid_of(costs)) is None
    assert potential_to((10.5, 10.5), grid_of(costs), tolerance_m=2.0) is None
    near = potential_to((10.5, 9.5), grid_of(costs), tolerance_m=3.0)
    assert near.goal == (10.5, 7.5)


@pytest.mark.parametrize("goal", [(-1.0, 5.0), (25.0, 5.0), (0.5, 5.0), (19.5, 5.0)])
def test_a_goal_off_the_map_or_on_its_border_gives_none(goal: tuple[float, float]) -> None:
    assert potential_to(goal, grid_of(open_floor(20, 20))) is None


@pytest.mark.parametrize(
    ("cost", "columns", "goal", "start", "is_found"),
    [
        pytest.param(0, (0, 0), (5.5, 5.5), (-0.1, 5.0), False, id="start west of the map"),
        pytest.param(0, (0, 0), (5.5, 5.5), (5.0, 20.1), False, id="start north of the map"),
        pytest.param(253, (8, 11), (15.5, 10.5), (9.5, 10.5), True, id="out of an inflated cell"),
        pytest.param(253, (2, 11), (15.5, 10.5), (4.5, 10.5), False, id="too deep in inflated cells"),
        pytest.param(255, (9, 11), (15.5, 10.5), (3.5, 10.5), True, id="across unknown cells"),
    ],
)
def test_where_a_path_may_begin_and_go(
    cost: int, columns: tuple[int, int], goal: tuple[float, float], start: tuple[float, float], is_found: bool
) -> None:
    costs = open_floor(20, 20)
    costs[:, slice(*columns)] = cost
    assert (path(costs, goal, start) is not None) == is_found


def test_a_wave_that_ends_near_the_robot_gives_the_same_way() -> None:
    rng = np.random.default_rng(11)
    costs = rng.integers(0, 60, size=(150, 150)).astype(np.uint8)
    costs[40:110, 60:63] = 254
    whole = potential_to((20.5, 75.5), grid_of(costs))
    near = potential_to((20.5, 75.5), grid_of(costs), near=(70.0, 75.0))
    assert (near.values < 1e10).sum() < 0.8 * (whole.values < 1e10).sum()
    for start in ((70.0, 75.0), (68.3, 71.9), (30.2, 80.8)):
        there, here = whole.path_from(*start), near.path_from(*start)
        assert np.array_equal(there, here)
    assert near.path_from(145.0, 145.0) is None


@pytest.mark.parametrize(
    ("then", "now", "wall", "has_gone"),
    [
        pytest.param([(5, 5)], [], False, True, id="gone"),
        pytest.param([(0, 9)], [], False, True, id="gone in a corner"),
        pytest.param([(5, 5)], [(5, 5)], False, False, id="there still"),
        pytest.param([], [(5, 5)], False, False, id="come"),
        pytest.param([(5, 5)], [(6, 6)], False, False, id="a surface that noise moves"),
        pytest.param([(5, 5)], [(7, 5)], False, True, id="moved by two cells"),
        pytest.param([(5, 5)], [], True, False, id="a wall of the map"),
        pytest.param([(5, 5), (5, 6), (5, 7)], [(5, 5)], False, True, id="all but an end"),
    ],
)
def test_whether_an_obstacle_has_gone(
    then: list[tuple[int, int]], now: list[tuple[int, int]], wall: bool, has_gone: bool
) -> None:
    grids = [np.zeros((10, 10), np.uint8) for _ in range(3)]
    for grid, cells in zip(grids, (now, then, then if wall else []), strict=True):
        for cell in cells:
            grid[cell] = LETHAL
    assert have_gone(*grids, np.array([0, 0, 10, 10])) is has_gone
    rows, columns = np.nonzero(grids[0] != grids[1])
    if len(rows):
        x1, y1 = columns.max() + 1, rows.max() + 1
        assert have_gone(*grids, np.array([columns.min(), rows.min(), x1, y1])) is has_gone
        assert not have_gone(*grids, np.array([x1, 0, 10, 10]))
        assert not have_gone(*grids, np.array([0, y1, 10, 10]))
