import math

import numpy as np
import pytest

from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.map_score import closed_spaces, reachable_free, score_map
from tests.mapping.drawn_buildings import grid

TRUTH = grid(
    """
########
########
##    ##
##    ##
##    ##
########
########
"""
)
START = (3.5, 3.5)


def score(built):
    return score_map(built, TRUTH, START, robot_radius_m=0.4)


def test_the_truth_scores_perfectly_against_itself():
    assert score(TRUTH) == (1.0, 1.0, 1.0, 0.0)


def test_counts_by_hand():
    built = grid(
        """
????????
????????
??    ??
??   ?#?
??   ???
?##### #
???????#
"""
    )
    covered, precision, recall, error = score(built)
    assert covered == pytest.approx(10 / 12)
    assert precision == 1.0
    assert error == 0.0
    # the cells around the room, each against the eight cells that the map calls occupied
    near = {(column, row) for column in range(8) for row in range(7)}
    found = [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (7, 1), (7, 0), (6, 3)]
    faces = {(c, r) for c, r in near if 1 <= c <= 6 and 1 <= r <= 5} - {
        (c, r) for c in range(2, 6) for r in range(2, 5)
    }
    hit = [face for face in faces if any(max(abs(face[0] - c), abs(face[1] - r)) <= 1 for c, r in found)]
    assert recall == pytest.approx(len(hit) / 18)


def test_a_wall_in_the_open_costs_precision_and_its_distance():
    room = grid(
        """
#########
#       #
#       #
#       #
#       #
#       #
#########
"""
    )
    data = room.data.copy()
    data[3, 4] = 100
    result = score_map(room.with_data(data), room, (2.5, 2.5), robot_radius_m=0.4)
    walls = 2 * 9 + 2 * 5
    assert result.occupied_precision == pytest.approx(walls / (walls + 1))
    assert result.wall_error_m == pytest.approx(3.0 / (walls + 1))
    assert result.free_covered == 1.0


def test_a_map_shifted_by_one_cell_is_within_one_cell_and_by_two_is_not():
    by_one = OccupancyGrid(TRUTH.data, 1.0, (1.0, 0.0))
    by_two = OccupancyGrid(TRUTH.data, 1.0, (2.0, 0.0))
    assert score(by_one).occupied_recall == 1.0
    assert score(by_two).occupied_recall < 1.0
    assert score(by_one).wall_error_m < score(by_two).wall_error_m


def test_a_map_of_another_resolution_is_scored_in_metres():
    fine = OccupancyGrid(np.kron(TRUTH.data, np.ones((2, 2), dtype=np.int8)), 0.5, (0.0, 0.0))
    result = score(fine)
    assert result[:3] == (1.0, 1.0, 1.0)
    assert 0.0 < result.wall_error_m < 0.5


def test_an_empty_map_covers_nothing_and_has_no_precision():
    empty = TRUTH.with_data(np.full_like(TRUTH.data, -1))
    covered, precision, recall, error = score(empty)
    assert (covered, recall) == (0.0, 0.0)
    assert math.isnan(precision)
    assert math.isnan(error)


def test_rooms_behind_a_gap_too_narrow_for_the_robot_do_not_count():
    two_rooms = grid(
        """
###########
#    #    #
#         #
#    #    #
###########
""",
        resolution=0.1,
    )
    start = two_rooms.center_of(2, 2)
    through = reachable_free(two_rooms, start, robot_radius_m=0.04)
    kept_out = reachable_free(two_rooms, start, robot_radius_m=0.1)
    assert through.sum() == 25
    assert kept_out[:, 6:].sum() == 0
    assert kept_out[:, 1:5].sum() == 12


def test_the_corner_that_a_disc_cannot_fill_is_not_reachable():
    room = OccupancyGrid(np.pad(np.zeros((20, 20), dtype=np.int8), 1, constant_values=100), 0.05, (0.0, 0.0))
    reachable = reachable_free(room, (0.55, 0.55), robot_radius_m=0.3)
    assert not reachable[1, 1]
    assert reachable[10, 1]
    assert reachable[10, 10]


@pytest.mark.parametrize("start", [(0.5, 0.5), (-3.0, 2.0)])
def test_a_start_where_no_robot_fits_is_an_error(start):
    with pytest.raises(ValueError, match="fits"):
        reachable_free(TRUTH, start, 0.4)


ROOMS = """
################
#      #       #
#      #       #
#      #########
#        #     #
#      # #     #
#      #       #
#      # #     #
################
"""


def test_a_room_without_a_door_and_one_behind_a_slit_are_closed():
    closed = closed_spaces(grid(ROOMS, resolution=0.1), (0.35, 0.45), robot_radius_m=0.15)
    cells = {(int(c), 8 - int(r)) for r, c in np.argwhere(closed)}
    assert {(10, 1), (14, 2)} <= cells
    assert {(12, 5), (10, 7), (8, 6)} <= cells
    # the room the robot stands in is not, nor are its corners, which no disc can cover
    assert not {(x, y) for x, y in cells if x < 7}
