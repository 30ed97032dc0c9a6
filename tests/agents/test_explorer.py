import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.agents.explorer import Explorer, hand_out_frontiers
from midnet_bench.geometry import STOP, Box, Pose2D
from midnet_bench.grid import MapWindow
from midnet_bench.localization.localization_settings import UkfSettings
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.mapping.gmapping import GMapping
from midnet_bench.mapping.mapping_settings import BURGER_UKF
from midnet_bench.navigation.navigation_settings import BURGER_COSTMAP, NavigatorSettings
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.navigation.planar_world import World

LIDAR = LDS_01
AREA = MapWindow.around_origin(8.0, 4.0, 0.05)
HALF_M = 1.5  # of the square room that everybody here stands in


def explorer(start: Pose2D, number: int = 1) -> Explorer:
    costmap = replace(BURGER_COSTMAP, track_unknown=True)
    return Explorer(
        number - 1,
        f"explorer {number}",
        start,
        Navigator(AREA.empty(), NavigatorSettings(global_costmap=costmap)),
        PlanarUkf(start, UkfSettings().suited_to("encoder")),
        lambda robot: None,
        30.0,
        slam=GMapping(LIDAR, replace(BURGER_UKF, particles=3), start, stream(1, "gmapping", number)),
        area=AREA,
    )


def stay(robot: Explorer, place: Pose2D) -> None:
    """One step of a robot that believes it stands still at ``place``."""
    robot.localize(place, (0.0, 0.0))


def room_scan(pose: Pose2D, door: bool = False, mates: Sequence[Pose2D] = ()) -> npt.NDArray[np.float64]:
    """(360,) what the LiDAR at ``pose`` sees of the room, of a door in its east wall and of mates."""
    near, far = HALF_M, HALF_M + 0.1
    walls = [Box(-far, -far, far, -near), Box(-far, near, far, far), Box(-far, -far, -near, far)]
    walls += [Box(near, -far, far, -0.6), Box(near, 0.6, far, far)]
    if not door:
        walls.append(Box(near, -0.6, far, 0.6))
    return World(walls, Box(-far, -far, far, far)).scan(pose, list(mates), LIDAR)


@pytest.mark.slow
def test_before_its_first_scan_it_believes_its_odometry_and_then_gmapping_too() -> None:
    start = Pose2D(0.5, -0.3, 1.0)
    robot = explorer(start)
    stay(robot, start)
    assert math.dist(robot.pose, start) < 1e-3
    robot.observe(room_scan(start), LIDAR, 0.1)
    assert math.dist(robot.pose, start) < 1e-3
    assert math.dist(robot.pose, robot.slam.best_pose) < 1e-9


def test_a_closed_room_is_done_at_once_and_a_door_is_a_reason_to_go_on() -> None:
    start = Pose2D(0.0, 0.0, 0.0)
    robot = explorer(start)
    stay(robot, start)
    robot.observe(room_scan(start), LIDAR, 0.1)
    assert robot.control(0.1) == STOP
    assert not robot.is_done  # there is no map yet that could be whole
    robot.take_map(robot.slam.occupancy())
    assert robot.control(0.2) == STOP
    assert robot.is_done
    assert robot.goal is None

    other = explorer(start)
    stay(other, start)
    other.observe(room_scan(start, door=True), LIDAR, 0.1)
    other.take_map(other.slam.occupancy())
    other.control(0.2)
    assert not other.is_done
    assert other.goal is not None
    assert 1.4 < other.goal[0] < 4.0
    assert abs(other.goal[1]) < 2.0


def test_a_mate_that_stands_in_the_room_does_not_become_a_wall() -> None:
    start, place = Pose2D(-0.5, 0.0, 0.0), Pose2D(0.5, 0.2, 0.0)
    alone, robot, mate = explorer(start), explorer(start), explorer(place, 2)
    robot.mates = [mate]
    scan = room_scan(start, mates=[place])
    occupied = []
    for each in (alone, robot):
        stay(each, start)
        each.observe(scan, LIDAR, 0.1)
        grid = AREA.cut(each.slam.occupancy())
        column, row = grid.cell_at(place.x, place.y)
        occupied.append(int((grid.data[row - 4 : row + 5, column - 4 : column + 5] == 100).sum()))
    assert occupied[0] > 0
    assert occupied[1] == 0
    # the navigator has to keep clear of it all the same
    column, row = (math.floor(v) for v in robot.navigator.global_costmap.to_cells(place.x, place.y))
    assert (robot.navigator.global_costmap.costs[row - 4 : row + 5, column - 4 : column + 5] == 254).any()


def test_a_drive_without_progress_is_given_up_and_blacklisted() -> None:
    start = Pose2D(0.0, 0.0, 0.0)
    robot = explorer(start)
    stay(robot, start)
    robot.observe(room_scan(start, door=True), LIDAR, 0.1)
    robot.take_map(robot.slam.occupancy())
    robot.control(0.2)
    first = robot.goal
    assert first is not None
    for tick in range(400):  # its wheels do not turn
        time_s = 0.3 + 0.1 * tick
        robot.dwell.update(0.0, 0.0, time_s, robot.goal_number)
        robot.control(time_s)
        if robot.goals_given_up:
            break
    assert robot.goals_given_up == 1
    assert robot.goal is None or max(abs(robot.goal[0] - first[0]), abs(robot.goal[1] - first[1])) >= 0.5


def test_two_explorers_between_two_doors_are_sent_to_one_each() -> None:
    """Both stand nearer to the east door; what only one of them has seen counts for both."""
    team = [explorer(Pose2D(0.2, 0.3, 0.0), 1), explorer(Pose2D(0.5, -0.3, 0.0), 2)]
    grid = AREA.empty()
    inside = np.abs(grid.x_centers) < HALF_M
    grid.data[np.ix_(np.abs(grid.y_centers) < HALF_M, inside)] = 0
    wall = np.ix_(
        np.abs(grid.y_centers) < HALF_M + 0.05, np.abs(np.abs(grid.x_centers) - HALF_M - 0.025) < 0.04
    )
    grid.data[wall] = 100
    grid.data[np.ix_(np.abs(np.abs(grid.y_centers) - HALF_M - 0.025) < 0.04, inside)] = 100
    door = np.ix_(np.abs(grid.y_centers) < 0.6, np.abs(np.abs(grid.x_centers) - HALF_M - 0.025) < 0.04)
    grid.data[door] = 0
    for robot in team:
        stay(robot, robot.pose)
        robot.mates = [mate for mate in team if mate is not robot]
        robot.take_map(grid)
    hand_out_frontiers(team, 0.1)
    goals = [robot.goal for robot in team]
    assert goals[0] is not None
    assert goals[1] is not None
    assert goals[0][0] < -1.3
    assert goals[1][0] > 1.3
    for robot in team:  # at their next control cycles they keep to it
        robot.control(0.2)
    assert [robot.goal for robot in team] == goals


def test_a_finished_explorer_leaves_the_middle_of_a_doorway_once_and_stays_where_it_closes_nothing() -> None:
    grid = AREA.empty()
    grid.data[1:-1, 1:-1] = 0
    grid.data[[0, -1]] = grid.data[:, [0, -1]] = 100
    grid.data[np.ix_(np.abs(grid.y_centers) > 0.35, np.abs(grid.x_centers) < 0.1)] = 100
    places = {}
    for name, start in {"door": Pose2D(0.0, 0.0, 0.0), "room": Pose2D(2.0, 0.0, 0.0)}.items():
        robot = explorer(start)
        stay(robot, start)
        robot.observe(np.full(LIDAR.beams, np.inf), LIDAR, 0.1)
        robot.take_map(grid)
        robot.control(0.2)
        assert robot.is_done
        places[name] = robot.goal
        robot.take_map(grid)  # the next map changes nothing
        robot.control(0.3)
        assert robot.is_done
        assert robot.goal == places[name]
    assert places["room"] is None
    assert places["door"] is not None
    assert math.dist(places["door"], (0.0, 0.0)) > 0.3
