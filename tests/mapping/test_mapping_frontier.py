import itertools
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping import frontier
from midnet_bench.mapping.frontier import (
    Frontier,
    FrontierExplorer,
    assign_frontiers,
    find_frontiers,
    find_gaps,
    wall_gaps,
)
from tests.mapping.drawn_buildings import grid


def at(column, row):
    return Pose2D(column + 0.5, row + 0.5, 0.0)


ROOM = """
##########
#   ~???##
#   ~???##
#   ######
#    ??###
##########
"""


def test_size_distance_centroid_and_approach_of_each_frontier():
    nearest, far = find_frontiers(grid(ROOM), at(1, 1))
    # the door's single unknown cell that touches free space: every cell counts, the first one too
    assert (nearest.size_m, nearest.distance_m, nearest.centroid) == (1.0, 3.0, (5.5, 1.5))
    assert nearest.cost == pytest.approx(3.0 * 3.0 - 1.0 * 1.0)
    np.testing.assert_allclose(nearest.approaches, [(4.5, 1.5)])
    # two unknown cells behind passable cost; the way there is 3 steps right and 2 up
    assert (far.size_m, far.distance_m, far.centroid) == (2.0, 5.0, (5.5, 4.0))
    np.testing.assert_allclose(sorted(far.approaches.tolist()), [(4.5, 3.5), (4.5, 4.5)])


def test_resolution_and_origin_are_applied_once():
    scaled = grid(ROOM, resolution=0.5, origin=(10.0, -20.0))
    robot = Pose2D(*scaled.center_of(1, 1), 0.0)
    near, far = find_frontiers(scaled, robot)
    assert (near.distance_m, near.size_m, near.centroid) == (1.5, 0.5, (12.75, -19.25))
    assert far.centroid == (12.75, -18.0)
    assert near.cost == pytest.approx(3.0 * 1.5 - 0.5)


def test_frontiers_behind_walls_and_inscribed_cells_do_not_count():
    assert not find_frontiers(grid("#####\n# #?#\n#####"), at(1, 1))
    assert not find_frontiers(grid("#####\n# i?#\n#####"), at(1, 1))
    assert find_frontiers(grid("#####\n# ~?#\n#####"), at(1, 1))


def test_the_way_not_the_straight_line_decides():
    # the right one is two cells off as the crow flies, and five steps around the wall's end
    walled = grid(
        """
#######
#     #
#   # #
#?  #?#
#######
"""
    )
    left, right = find_frontiers(walled, at(3, 1))
    assert (left.centroid, left.distance_m) == ((1.5, 1.5), 1.0)
    assert (right.centroid, right.distance_m) == ((5.5, 1.5), 5.0)


def test_small_frontiers_are_left_out_and_long_ones_are_cheaper():
    two = grid("#########\n#?     ?#\n##     ?#\n##     ?#\n#########")
    assert [frontier.size_m for frontier in find_frontiers(two, at(4, 3))] == [3.0, 1.0]
    (only,) = find_frontiers(OccupancyGrid(two.data, 0.25, two.origin), Pose2D(1.125, 0.875, 0.0))
    assert only.centroid == (1.875, 0.625)


def test_a_frontier_goes_on_where_only_another_room_touches_it():
    """explore_lite asks whether an unknown cell has a free neighbour, not whether the robot can go there."""
    (frontier,) = find_frontiers(grid("#####\n# ?##\n##? #\n#####"), at(1, 2))
    assert (frontier.size_m, frontier.distance_m) == (2.0, 0.0)
    np.testing.assert_allclose(frontier.approaches, [(1.5, 2.5)])


@pytest.mark.parametrize("robot", [at(0, 0), at(-5, 2), Pose2D(1e3, 1e3, 0.0)])
def test_a_robot_in_an_obstacle_or_off_the_grid_starts_from_the_nearest_free_cell(robot):
    (frontier,) = find_frontiers(grid("####\n#  ?\n####"), robot)
    assert frontier.centroid == (3.5, 1.5)


def test_nothing_free_or_nothing_unknown_gives_no_frontier():
    assert find_frontiers(grid("???\n???"), at(1, 1)) == []
    assert find_frontiers(grid("   \n   "), at(1, 1)) == []


def plain_search(data, row, column):
    """({frozenset of cells: least steps}) by dictionaries and queues alone."""
    height, width = data.shape
    around = [(0, 1), (0, -1), (1, 0), (-1, 0)]

    def inside(r, c):
        return 0 <= r < height and 0 <= c < width

    steps, queue = {(row, column): 0}, deque([(row, column)])
    while queue:
        r, c = queue.popleft()
        for dr, dc in around:
            cell = r + dr, c + dc
            if inside(*cell) and 0 <= data[cell] < 99 and cell not in steps:
                steps[cell] = steps[r, c] + 1
                queue.append(cell)
    border = {
        (r, c): min((steps.get((r + dr, c + dc), math.inf) for dr, dc in around), default=math.inf)
        for r in range(height)
        for c in range(width)
        if data[r, c] == -1
        and any(inside(r + dr, c + dc) and 0 <= data[r + dr, c + dc] < 99 for dr, dc in around)
    }
    groups, left = {}, set(border)
    while left:
        group, queue = set(), [left.pop()]
        while queue:
            r, c = queue.pop()
            group.add((r, c))
            near = {(r + dr, c + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)} & left
            left -= near
            queue.extend(near)
        groups[frozenset(group)] = min(border[cell] for cell in group)
    return {group: steps for group, steps in groups.items() if math.isfinite(steps)}


@given(arrays(np.int8, (9, 12), elements=st.sampled_from([0, 0, 0, 40, 99, 100, -1, -1])))
def test_agrees_with_a_plain_search(data):
    data[4, 5] = 0
    before = data.copy()
    found = find_frontiers(OccupancyGrid(data, 1.0, (0.0, 0.0)), at(5, 4))
    expected = sorted(
        (len(group), steps, *(np.mean(list(group), axis=0)[::-1] + 0.5))
        for group, steps in plain_search(data, 4, 5).items()
    )
    np.testing.assert_allclose(sorted((f.size_m, f.distance_m, *f.centroid) for f in found), expected)
    assert [f.cost for f in found] == sorted(f.cost for f in found)
    np.testing.assert_array_equal(data, before)


def plan(explorer, robot, costmap, time_s, taken=()):
    offers = explorer.offers(robot, costmap, costmap, np.empty((0, 2)))
    return explorer.choose(offers, time_s, taken)


CROSSING = grid("#########\n#?     ?#\n#########")


def test_progress_timeout_blacklists_a_goal_that_comes_no_nearer():
    explorer = FrontierExplorer()
    assert plan(explorer, at(3, 1), CROSSING, 0.0) == (2.5, 1.5)
    assert plan(explorer, at(3, 1), CROSSING, 30.0) == (2.5, 1.5)
    assert plan(explorer, at(2, 1), CROSSING, 31.0) == (2.5, 1.5)  # one step nearer: the clock restarts
    assert plan(explorer, at(2, 1), CROSSING, 61.0) == (2.5, 1.5)
    assert plan(explorer, at(2, 1), CROSSING, 61.1) == (6.5, 1.5)
    explorer.report(succeeded=False)
    assert plan(explorer, at(2, 1), CROSSING, 62.0) == (2.5, 1.5)  # the second chance


def test_an_aborted_goal_is_tried_again_only_when_nothing_else_is_left():
    explorer = FrontierExplorer()
    goals = []
    for time_s in range(5):
        goals.append(plan(explorer, at(3, 1), CROSSING, float(time_s)))
        explorer.report(succeeded=False)
    assert goals == [(2.5, 1.5), (6.5, 1.5), (2.5, 1.5), (6.5, 1.5), None]


def test_goals_of_team_mates_are_left_to_them_while_there_are_others():
    explorer = FrontierExplorer()
    assert plan(explorer, at(3, 1), CROSSING, 0.0, taken=[(2.5, 1.5)]) == (6.5, 1.5)
    assert plan(explorer, at(3, 1), CROSSING, 1.0, taken=[(2.5, 1.5), (6.5, 1.5)]) == (2.5, 1.5)


def test_team_mates_share_one_long_frontier():
    wall_of_unknown = grid("\n".join(["#" * 14, *["#     ?#######"] * 12, "#" * 14]))
    explorer = FrontierExplorer()
    first = plan(explorer, at(2, 6), wall_of_unknown, 0.0)
    second = plan(FrontierExplorer(), at(2, 6), wall_of_unknown, 0.0, taken=[first])
    assert first[0] == second[0] == 5.5
    assert abs(first[1] - second[1]) >= frontier.TAKEN_RADIUS_M


def offered(costs):
    """A robot's list: frontiers at x = 0, 1, 2 ... with these costs, cheapest first; None is out of reach."""
    named = [(cost, place) for place, cost in enumerate(costs) if cost is not None]
    return [
        Frontier(cost, 1.0, 1.0, (float(place), 0.0), np.array([[float(place), 0.0]]))
        for cost, place in sorted(named)
    ]


def sent_to(offers):
    """The x of the frontier that each robot is sent to."""
    return [
        None if place is None else own[place].centroid[0]
        for own, place in zip(offers, assign_frontiers(offers), strict=True)
    ]


def test_each_robot_gets_a_frontier_of_its_own_though_all_like_one_best():
    assert sent_to([offered([1.0, 2.0, 9.0]), offered([1.5, 7.0, 9.0])]) == [1.0, 0.0]
    assert sent_to([offered([1.0, None]), offered([None, None])]) == [0.0, None]
    # two frontiers for three robots: both have a robot before one gets a second
    assert sent_to([offered([1.0, 50.0]), offered([1.1, 40.0]), offered([1.2, 60.0])]) == [0.0, 1.0, 0.0]
    assert assign_frontiers([[], []]) == [None, None]


@given(arrays(np.int64, st.tuples(st.integers(1, 4), st.integers(1, 4)), elements=st.integers(-20, 20)))
def test_the_sum_of_costs_is_the_least_of_all_assignments(costs):
    robots, frontiers = costs.shape
    offers = [offered(row.tolist()) for row in costs]
    sent = [int(x) for x in sent_to(offers)]
    most = math.ceil(robots / frontiers)
    possible = [
        chosen
        for chosen in itertools.product(range(frontiers), repeat=robots)
        if len(set(chosen)) == min(robots, frontiers) and max(map(chosen.count, chosen)) <= most
    ]
    assert tuple(sent) in possible
    least = min(sum(costs[i, k] for i, k in enumerate(chosen)) for chosen in possible)
    assert sum(costs[i, k] for i, k in enumerate(sent)) == least


RESOLUTION_M = 0.1


def building():
    """9 x 6 m: two rooms and a corridor between them, doors 1 m wide; True is wall."""
    walls = np.zeros((60, 90), dtype=bool)
    walls[[0, -1], :] = walls[:, [0, -1]] = True
    walls[:, 35] = walls[:, 55] = True
    walls[25:35, 35] = walls[8:18, 55] = False
    return walls


def see(known, walls, column, row):
    """Enter what 360 beams of 3.5 m see from a cell."""
    for angle in np.radians(np.arange(360)):
        along = np.arange(0.0, 3.5 / RESOLUTION_M, 0.5)
        columns = np.floor(column + 0.5 + along * math.cos(angle)).astype(int)
        rows = np.floor(row + 0.5 + along * math.sin(angle)).astype(int)
        hit = np.flatnonzero(walls[rows.clip(0, 59), columns.clip(0, 89)])
        end = hit[0] if len(hit) else len(along)
        known[rows[:end], columns[:end]] = 0
        if len(hit):
            known[rows[end], columns[end]] = 100


@pytest.mark.parametrize("robots", [1, 2])
def test_exploration_of_a_building_ends_when_all_of_it_is_seen(robots):
    walls = building()
    known = np.full(walls.shape, -1, dtype=np.int8)
    explorers = [FrontierExplorer() for _ in range(robots)]
    cells = [(10 + 3 * k, 30) for k in range(robots)]
    goals = [None] * robots
    for tick in range(60):
        for cell in cells:
            see(known, walls, *cell)
        costmap = OccupancyGrid(known, RESOLUTION_M, (-3.0, 2.0))
        for k, cell in enumerate(cells):
            taken = [goal for j, goal in enumerate(goals) if j != k and goal is not None]
            robot = Pose2D(*costmap.center_of(*cell), 0.0)
            goals[k] = plan(explorers[k], robot, costmap, 10.0 * tick, taken)
            if goals[k] is not None:
                cells[k] = costmap.cell_at(*goals[k])
                assert known[cells[k][::-1]] == 0
        if goals == [None] * robots:
            break
    assert goals == [None] * robots
    assert np.mean(known[~walls] == 0) > 0.99
    assert not np.any(known[walls] == 0)


CORNER = """
?########
?#      #
?#      #
?#     ??
?#     ??
?######??
"""


def test_a_missing_corner_is_a_gap_that_is_looked_at_until_a_scan_was_taken_there():
    room, robot = grid(CORNER, resolution=0.25), Pose2D(0.875, 0.875, 0.0)
    (gap,) = wall_gaps(room)
    assert gap == (0.5, (1.875, 0.375))  # the cells beside the free ones
    (seen,) = find_gaps(room, room, robot, np.empty((0, 2)))
    assert (seen.size_m, seen.centroid) == (gap.length_m, gap.place)
    assert 0.5 < np.hypot(*(seen.approaches - gap.place).T).max() <= 1.0
    assert find_gaps(room, room, robot, seen.approaches) == []


def test_closed_walls_have_no_gap_and_a_frontier_without_a_wall_is_none(monkeypatch):
    assert wall_gaps(grid("?####?\n?#  #?\n?####?")) == []
    assert wall_gaps(grid("      \n  ??  \n      ")) == []
    holes_in_a_wall = grid("       \n#######\n#? ??##\n#######\n       ", resolution=0.1)
    assert wall_gaps(holes_in_a_wall) == []
    monkeypatch.setattr(frontier, "MIN_GAP_M", 2.4)  # the corner is no speck then, but too short
    assert wall_gaps(grid(CORNER)) == []


def test_a_gap_behind_a_wall_is_not_seen_and_comes_after_every_frontier():
    behind = grid("#########\n#   #   ?\n#   #####\n#   ??###\n#########")
    explorer = FrontierExplorer()
    offers = explorer.offers(at(1, 2), behind, behind, np.empty((0, 2)))
    assert {offer.centroid for offer in offers} == {(4.5, 1.5)}
    assert [offer.cost for offer in offers] == sorted(offer.cost for offer in offers)
    assert offers[0].cost < offers[-1].cost - 100.0


@pytest.mark.parametrize(
    ("column", "row", "place"), [(4, 3, (6.5, 3.5)), (1, 3, None), (0, 6, None)], ids=["door", "room", "end"]
)
def test_a_robot_parks_where_it_closes_nothing(column, row, place):
    """Two rooms of 4 x 7 cells, a door of one cell between them, whatever the robot's own cell."""
    rooms = grid("\n".join(["    #    "] * 3 + ["         "] + ["    #    "] * 3))
    found = FrontierExplorer().parking_place(at(column, row), rooms, 1.0)
    if place is None:
        assert found is None
    else:
        assert found[0] != 4.5
