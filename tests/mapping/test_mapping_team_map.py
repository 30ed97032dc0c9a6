"""Windows that maps are drawn into, teams' maps, and rooms that nobody can enter."""

import math

import numpy as np
import pytest

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.map_score import closed_spaces
from midnet_bench.mapping.merge import by_features, by_known_starts, confidence, refusals
from midnet_bench.mapping.settings import MergeSettings
from midnet_bench.rng import stream
from tests.mapping.drawn_buildings import map_of, rooms, viewpoints

VALUES = {" ": 0, "#": 100, "?": -1}


def grid(picture, resolution=1.0, origin=(0.0, 0.0)):
    """A map drawn as text; the first line has the highest y."""
    rows = [[VALUES[letter] for letter in line] for line in reversed(picture.strip("\n").split("\n"))]
    return OccupancyGrid(np.array(rows, dtype=np.int8), resolution, origin)


def test_maps_in_one_frame_are_laid_over_each_other():
    merged = by_known_starts([grid("?# \n???"), grid("?  \n  ?")])
    assert merged.data.tolist() == grid("?# \n  ?").data.tolist()
    assert math.isnan(confidence({}))


@pytest.mark.slow
def test_maps_of_one_building_find_together_by_features_whatever_the_starts():
    rng = stream(3, "building")
    building = rooms(rng)
    here = Pose2D(0.0, 0.0, 0.0)
    maps = [
        map_of(building, viewpoints(building, rng, low, high), here, rng, 0.0)
        for low, high in ((0.0, 0.8), (0.2, 1.0))
    ]
    starts = [Pose2D(2.0, 3.0, 0.4), Pose2D(6.0, 4.0, -2.0)]
    merged, matches = by_features(maps, starts, MergeSettings())
    assert refusals(matches) == []
    assert confidence(matches) >= 0.7
    # laid over each other by what they show, they agree with the maps laid over each other by their frame
    together = by_known_starts(maps)
    rows, columns = np.nonzero(merged.data == 100)
    walls = {together.cell_at(*merged.center_of(c, r)) for c, r in zip(columns, rows, strict=True)}
    thick = {
        (int(c) + i, int(r) + j)
        for r, c in np.argwhere(together.data == 100)
        for i in (-2, -1, 0, 1, 2)
        for j in (-2, -1, 0, 1, 2)
    }
    assert len(walls & thick) > 0.98 * len(walls)


def test_a_refused_merge_leaves_the_map_that_knows_most():
    square = np.full((60, 60), -1, dtype=np.int8)
    square[10:50, 10:50] = 100
    square[12:48, 12:48] = 0
    small = square.copy()
    small[:, 30:] = -1
    maps = [OccupancyGrid(data, 0.05, (0.0, 0.0)) for data in (small, square)]
    merged, matches = by_features(maps, [Pose2D(1.0, 1.0, 0.0), Pose2D(1.5, 1.0, 2.0)], MergeSettings())
    assert merged.data.tobytes() == square.tobytes()
    (line,) = refusals(matches)
    assert line.startswith("the maps of robots 1 and 2 were not merged: ")
    assert confidence(matches) < 0.7


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
