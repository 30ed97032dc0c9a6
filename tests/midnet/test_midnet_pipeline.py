import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.midnet_settings import Unknown
from midnet_bench.midnet.pipeline import MIDNet, MIDNetSettings, Observation
from tests.midnet.ascii_maps import binary, costs, draw, side_by_side

# a room of 12 x 9 cells of half a metre, its lower left corner at (-3, -2)
ROOM = OccupancyGrid(
    binary(
        """
        ############
        #..........#
        #..........#
        #..........#
        #..........#
        #..........#
        #..........#
        #..........#
        ############
        """
    ),
    0.5,
    (-3.0, -2.0),
)
# cells are wide here, and a robot is one of them
SETTINGS = MIDNetSettings(ally_diameter_m=0.5)


def room_cell(column: int, row: int) -> Pose2D:
    return Pose2D(*ROOM.center_of(column, row), 0.0)


def observe(column: int, row: int, drawing: str) -> Observation:
    """A robot in a cell of the room, and its local grid; where that lies, Eqs. 2 to 4 say."""
    return Observation(room_cell(column, row), OccupancyGrid(costs(drawing), 0.5, (0.0, 0.0)))


SEEN = side_by_side(
    """
    #......   .......   .......   ..#....
    #...##.   .##....   .###...   ..#..##
    #...##.   .##....   .###...   ..#..##
    #......   .......   .......   ..#####
    #######   #######   #######   .......
    """
)
# the robots are in cells (3, 2), (6, 2) twice and (1, 1) of the room, so LEFT begins at cell (0, 0)
PLACES = ((3, 2), (6, 2), (6, 2), (1, 1))
LEFT, RIGHT, LARGER, CORNER = (observe(*at, drawing) for at, drawing in zip(PLACES, SEEN, strict=True))
INTRUDER = Box(-1.0, -1.0, 0.0, 0.0)


def test_intruder_is_boxed_in_metres_and_walls_are_not() -> None:
    frame = MIDNet(ROOM, SETTINGS).update([LEFT])
    assert frame.detections == [INTRUDER]
    assert frame.robots == [0]
    assert frame.explanation is None


def test_every_intermediate_is_there_on_demand() -> None:
    frame = MIDNet(ROOM, SETTINGS).update([CORNER], explain=True)
    assert frame.explanation is not None
    (view,) = frame.explanation.views
    assert view.crop == (2, 1, 7, 5, 0, 0, 5, 4)
    # A, B, C and D
    drawn = """
        #....   #....   #....   .....
        #..##   #....   #....   ...##
        #..##   #....   #....   ...##
        #####   #####   #####   .....
    """
    marked = ((view.a, 0), (view.b, 0), (view.c, 0), (view.d, 255))
    assert ["\n".join(draw(grid.data, mark)) for grid, mark in marked] == side_by_side(drawn)
    for grid in (view.a, view.b, view.c, view.d):
        assert (grid.origin, grid.resolution) == (ROOM.origin, 0.5)
    assert view.found == view.kept == frame.detections == [Box(-1.5, -1.5, -0.5, -0.5)]


def test_grids_of_an_explanation_lie_where_the_crop_is() -> None:
    frame = MIDNet(ROOM, SETTINGS).update([observe(8, 5, ".....\n.....\n.....\n.....\n.....")], explain=True)
    assert frame.explanation is not None
    assert frame.explanation.views[0].d.origin == (0.0, -0.5)  # cell (6, 3)


@pytest.mark.parametrize(
    ("other", "box", "robot"), [(RIGHT, INTRUDER, 0), (LARGER, Box(-1.0, -1.0, 0.5, 0.0), 1)]
)
def test_intruder_that_two_robots_see_is_one_detection(other: Observation, box: Box, robot: int) -> None:
    frame = MIDNet(ROOM, SETTINGS).update([LEFT, other])
    assert (frame.detections, frame.robots) == ([box], [robot])


def test_ally_is_no_intruder() -> None:
    seen, nothing = side_by_side(
        """
        .....   .....
        .....   .....
        ....#   .....
        .....   .....
        #####   #####
        """
    )
    watching, ally, midnet = observe(5, 2, seen), observe(7, 2, nothing), MIDNet(ROOM, SETTINGS)
    assert midnet.update([watching]).detections == [Box(0.5, -1.0, 1.0, -0.5)]
    frame = midnet.update([watching, ally], explain=True)
    assert frame.detections == []
    assert frame.explanation is not None
    (removed,) = frame.explanation.removed
    assert (removed.detection.robot, removed.ally, removed.iou) == (0, 1, 1.0)
    assert frame.explanation.views[0].found == [removed.detection.box]
    assert frame.explanation.views[0].kept == []


def test_robot_far_outside_the_prior_map_sees_nothing_and_the_others_go_on() -> None:
    lost = Observation(Pose2D(400.0, 400.0, 0.0), LEFT.costmap)
    frame = MIDNet(ROOM, SETTINGS).update([lost, LEFT], explain=True)
    assert (frame.detections, frame.robots) == ([INTRUDER], [1])
    assert frame.explanation is not None
    assert frame.explanation.views[0].crop.is_empty
    assert frame.explanation.views[0].d.data.size == 0


def test_no_robots_see_nothing() -> None:
    assert MIDNet(ROOM).update([]).detections == []
    assert MIDNet(ROOM).update([], explain=True).explanation is not None


def test_alignment_by_the_costmaps_origin_follows_the_costmap() -> None:
    moved = Observation(room_cell(4, 2), OccupancyGrid(LEFT.costmap.data, 0.5, ROOM.origin))
    assert MIDNet(ROOM, SETTINGS).update([moved]).detections != [INTRUDER]
    assert MIDNet(ROOM, replace(SETTINGS, align="origin")).update([moved]).detections == [INTRUDER]


def test_settings_reach_their_steps() -> None:
    faint = OccupancyGrid(np.where(LEFT.costmap.data == 100, 60, -1).astype(np.int8), 0.5, (0.0, 0.0))
    seen = [Observation(LEFT.pose, faint)]

    def detections(**changes: object) -> list[Box]:
        return MIDNet(ROOM, replace(SETTINGS, **changes)).update(seen).detections  # type: ignore[arg-type]

    assert detections() == []
    assert detections(thresh_local=60) == [INTRUDER]
    assert detections(thresh_local=60, min_area_cells=5) == []
    assert detections(thresh_local=60, deflate_boxes_m=0.2) == [pytest.approx((-0.8, -0.8, -0.2, -0.2))]
    # all that is unknown is an intruder now: the whole window within the walls
    assert detections(unknown="occupied") == [Box(-2.5, -1.5, 0.5, 0.5)]


def test_each_threshold_has_its_own_step() -> None:
    # one cell of the ally shows in a box of two: IoU 1/2 with its square; the other robot sees half of
    # the intruder: IoU 1/2 again
    left, right = side_by_side(
        """
        .....   .......
        ##...   #......
        ...##   .......
        .....   .......
        #####   #######
        """
    )
    watching, ally = observe(5, 2, left), observe(7, 2, right)
    assert ROOM.center_of(7, 2) == (0.75, -0.75)

    def detections(iou_ally: float, iou_fuse: float) -> list[Box]:
        settings = replace(SETTINGS, iou_ally=iou_ally, iou_fuse=iou_fuse)
        return MIDNet(ROOM, settings).update([watching, ally]).detections

    seen_twice, part, on_the_ally = (
        Box(-1.5, -0.5, -0.5, 0.0),
        Box(-1.0, -0.5, -0.5, 0.0),
        Box(0.0, -1.0, 1.0, -0.5),
    )
    assert detections(0.5, 0.5) == [seen_twice]
    assert detections(0.5, 0.6) == [seen_twice, part]
    assert detections(0.6, 0.5) == [seen_twice, on_the_ally]
    assert detections(0.6, 0.6) == [seen_twice, on_the_ally, part]


def rotated(grid: OccupancyGrid) -> OccupancyGrid:
    """A quarter turn to the left about the origin of the world."""
    x, _, _, top = *grid.origin, grid.extent[2], grid.extent[3]
    # row r, column c goes to row c, column (height - 1 - r)
    turned = np.ascontiguousarray(grid.data.T[:, ::-1])
    return OccupancyGrid(turned, grid.resolution, (-top, x))


def rotated_pose(pose: Pose2D) -> Pose2D:
    return Pose2D(-pose.y, pose.x, pose.yaw)


@pytest.mark.slow
@given(
    hnp.arrays(np.uint8, (9, 12), elements=st.sampled_from([0, 255])),
    st.lists(
        st.tuples(
            st.integers(-3, 14),
            st.integers(-3, 11),
            hnp.arrays(np.int8, (5, 7), elements=st.sampled_from([-1, 0, 100])),
        ),
        min_size=1,
        max_size=3,
    ),
    st.sampled_from(["floor", "origin"]),
)
def test_turning_the_world_turns_the_boxes(
    prior: np.ndarray, robots: list[tuple[int, int, np.ndarray]], align: str
) -> None:
    # odd windows about the middle of a cell, so that Eqs. 2 to 4 have nothing to round
    world = OccupancyGrid(prior, 0.5, (-3.0, -2.0))
    team = []
    for column, row, data in robots:
        pose = Pose2D(*world.center_of(column, row), 0.0)
        team.append(Observation(pose, OccupancyGrid(data, 0.5, (pose.x - 1.75, pose.y - 1.25))))
    turned_team = [Observation(rotated_pose(one.pose), rotated(one.costmap)) for one in team]
    # the lists' order turns too, so no step may depend on it: all matches of an ally go
    settings = MIDNetSettings(ally_diameter_m=0.5, ally_remove="all", align=align)  # type: ignore[arg-type]

    before = MIDNet(world, settings).update(team, explain=True).explanation
    after = MIDNet(rotated(world), settings).update(turned_team, explain=True).explanation
    assert before is not None
    assert after is not None
    for view, turned in zip(before.views, after.views, strict=True):
        np.testing.assert_array_equal(rotated(view.d).data, turned.d.data)
        for boxes, turned_boxes in ((view.found, turned.found), (view.kept, turned.kept)):
            expected = sorted(Box(-b.y_max, b.x_min, -b.y_min, b.x_max) for b in boxes)
            assert sorted(turned_boxes) == expected


@given(
    hnp.arrays(np.uint8, (9, 12), elements=st.sampled_from([0, 255])),
    hnp.arrays(np.int8, (6, 5), elements=st.sampled_from([-1, 0, 98, 99, 100])),
    st.integers(-5, 16),
    st.integers(-6, 13),
    st.sampled_from(["free", "occupied"]),
)
def test_foreground_is_what_is_seen_and_not_on_the_map(
    prior: np.ndarray, local: np.ndarray, column: int, row: int, unknown: Unknown
) -> None:
    world = OccupancyGrid(prior, 0.5, (-3.0, -2.0))
    pose = Pose2D(*world.center_of(column, row), 0.0)
    observation = Observation(pose, OccupancyGrid(local, 0.5, (0.0, 0.0)))
    midnet = MIDNet(world, MIDNetSettings(unknown=unknown))
    explanation = midnet.update([observation], explain=True).explanation
    assert explanation is not None
    (view,) = explanation.views
    found = {
        (view.crop.x1_gmap + int(c), view.crop.y1_gmap + int(r))
        for r, c in zip(*np.nonzero(view.d.data), strict=True)
    }
    expected = {
        (c, r)
        for r in range(9)
        for c in range(12)
        if 0 <= r - row + 3 < 6 and 0 <= c - column + 2 < 5
        if local[r - row + 3, c - column + 2] in ((99, 100) if unknown == "free" else (99, 100, -1))
        if prior[r, c] == 255
    }
    assert found == expected
    # every cell of the foreground is in some box, and explaining changes nothing
    for c, r in found:
        x, y = world.center_of(c, r)
        assert any(box.x_min < x < box.x_max and box.y_min < y < box.y_max for box in view.found)
    assert midnet.update([observation]).detections == view.found


def test_grids_that_may_not_be_written_to_will_do() -> None:
    prior, local = ROOM.data.copy(), LEFT.costmap.data.copy()
    prior.setflags(write=False)
    local.setflags(write=False)
    observation = Observation(LEFT.pose, OccupancyGrid(local, 0.5, (0.0, 0.0)))
    midnet = MIDNet(OccupancyGrid(prior, 0.5, ROOM.origin), SETTINGS)
    for explain in (False, True):
        assert midnet.update([observation, observation], explain).detections == [INTRUDER]


@pytest.mark.parametrize(
    "changes",
    [
        {"thresh_local": 0},
        {"thresh_local": 101},
        {"min_area_cells": 0},
        {"deflate_boxes_m": -0.1},
        {"deflate_boxes_m": float("nan")},
        {"ally_diameter_m": 0.0},
        {"iou_ally": 0.0},
        {"iou_fuse": 1.1},
        {"unknown": "fre"},
        {"align": "origins"},
        {"ally_remove": "none"},
    ],
)
def test_settings_out_of_range_are_refused_by_name(changes: dict[str, Any]) -> None:
    ((name, value),) = changes.items()
    with pytest.raises(InputError, match=f"{name}: .*{re.escape(repr(value))}"):
        MIDNetSettings(**changes)


def test_prior_map_that_is_not_binary_is_refused() -> None:
    for data in (np.zeros((3, 3), np.int8), np.full((3, 3), 100, np.uint8)):
        with pytest.raises(InputError, match="prior map: must be binary"):
            MIDNet(OccupancyGrid(data, 0.05, (0.0, 0.0)))
