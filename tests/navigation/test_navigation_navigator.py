import dataclasses
import math
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import STOP, Box, Command, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation import global_planner
from midnet_bench.navigation.navigation_settings import BURGER_COSTMAP, NavigatorSettings
from midnet_bench.navigation.navigator import Navigator, RotateRecovery, Status
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.navigation.planar_world import Robot, World, drive, moved


def enclosure(size_m: float, *inside: Box) -> World:
    """Walls 0.1 m thick round a square floor from (0, 0), and half a metre of nothing beyond."""
    far, t = size_m, 0.1
    walls = [
        Box(-t, -t, far + t, 0.0),
        Box(-t, far, far + t, far + t),
        Box(-t, 0.0, 0.0, far),
        Box(far, 0.0, far + t, far),
    ]
    return World([*walls, *inside], Box(-0.5, -0.5, far + 0.5, far + 0.5))


MAZE = enclosure(5.0, Box(0.0, 1.6, 3.7, 1.7), Box(1.3, 3.2, 5.0, 3.3))
"""Two walls that leave a doorway of 1.3 m each, at opposite ends."""


@pytest.fixture
def potentials(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Takes every potential that the global planner computes."""
    computed: list[object] = []
    compute = global_planner.potential_to

    def noted(*args: object, **named: object) -> object:
        computed.append(compute(*args, **named))
        return computed[-1]

    monkeypatch.setattr(global_planner, "potential_to", noted)
    return computed


def driven(
    world: World,
    start: tuple[float, float],
    goal: tuple[float, ...],
    seconds: float = 60.0,
    prior: World | None = None,
    settings: NavigatorSettings | None = None,
    others: list[Pose2D] | None = None,
    on_tick: Callable[[float], object] | None = None,
) -> Robot:
    """The robot after its goal, with ``prior`` for its map; it touched nothing."""
    robot = Robot(Navigator((prior or world).occupancy(), settings), Pose2D(*start, 0.0))
    robot.navigator.set_goal(*goal)
    drive(world, [robot], seconds, sigma_m=0.01, others=others, on_tick=on_tick)
    assert robot.hits == 0
    return robot


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "start"),
    [(NavigatorSettings(), (0.6, 0.7)), (NavigatorSettings(controller="trajectory_rollout"), (3.6, 2.4))],
    ids=["dwa", "rollout"],
)
def test_a_maze_is_driven_to_the_goal(
    settings: NavigatorSettings, start: tuple[float, float], potentials: list[object]
) -> None:
    robot = driven(MAZE, start, (0.8, 4.2), 90.0, settings=settings)
    assert robot.navigator.status is Status.SUCCEEDED
    tolerance = robot.navigator.local_planner.limits.xy_goal_tolerance_m
    assert math.hypot(robot.pose.x - 0.8, robot.pose.y - 4.2) < tolerance + 0.05
    assert robot.travelled_m < 13.0
    assert len(potentials) < 8


@pytest.mark.parametrize(("goal", "yaw"), [((2.0, 0.8, 2.5), 2.5), ((2.0, 0.8), 0.0)])
def test_a_goal_is_reached_in_its_heading_which_is_zero_unless_given(
    goal: tuple[float, ...], yaw: float
) -> None:
    robot = driven(MAZE, (0.6, 0.7), goal)
    assert robot.navigator.status is Status.SUCCEEDED
    assert abs(math.remainder(robot.pose.yaw - yaw, 2 * math.pi)) < 0.3
    assert math.hypot(robot.pose.x - 2.0, robot.pose.y - 0.8) < 0.1


@pytest.mark.parametrize(
    ("side_m", "start", "most_s"),
    [
        (0.3, (0.9, 3.0), 35.0),
        pytest.param(2.8, (0.6, 0.6), 150.0, marks=pytest.mark.slow),
    ],
)
def test_a_goal_inside_an_unmapped_obstacle_is_approached_and_given_up(
    side_m: float, start: tuple[float, float], most_s: float
) -> None:
    world = enclosure(6.0, Box.square(3.0, 3.0, side_m))
    robot = driven(world, start, (3.0, 3.0), most_s, prior=enclosure(6.0))
    assert robot.navigator.status is Status.ABORTED
    assert robot.travelled_m > 1.2


def test_an_obstacle_that_is_not_on_the_map_is_driven_round(potentials: list[object]) -> None:
    world = enclosure(4.0, Box(1.6, 0.5, 2.1, 2.6))
    robot = driven(world, (0.7, 1.6), (3.3, 1.6), prior=enclosure(4.0))
    assert robot.navigator.status is Status.SUCCEEDED
    assert len(potentials) >= 2
    assert robot.travelled_m > 3.0


def held(prior: World, then: World, gone_s: float, seconds: float, goal: tuple[float, float]) -> Navigator:
    """The navigator of a robot that is held at (1.5, 2.0) and saw ``then`` before and ``prior`` after."""
    navigator, pose = Navigator(prior.occupancy()), Pose2D(1.5, 2.0, 0.0)
    navigator.set_goal(*goal)
    for k in range(round(10 * seconds)):
        now = k / 10
        if k % 2 == 0:
            world = then if now < gone_s else prior
            navigator.observe(pose, world.scan(pose, [], LDS_01), LDS_01, now)
        navigator.control(pose, STOP, now)
    return navigator


def length(navigator: Navigator) -> float:
    plan = navigator.plan()
    assert plan is not None
    return float(np.hypot(*np.diff(plan, axis=0).T).sum())


DOORS = enclosure(12.0, Box(3.0, 0.0, 3.1, 1.5), Box(3.0, 2.5, 3.1, 9.0), Box(3.0, 10.0, 3.1, 12.0))
"""A wall with a door of a metre near the robot that is held, and another one 7.5 m farther up."""
SHUT = enclosure(12.0, Box(3.0, 0.0, 3.1, 9.0), Box(3.0, 10.0, 3.1, 12.0))


@pytest.mark.parametrize(
    ("prior", "then", "gone_s", "least_m", "most_m"),
    [
        pytest.param(DOORS, SHUT, 2.0, 14.0, 3.3, id="a door"),
        pytest.param(enclosure(12.0), enclosure(12.0, Box(2.5, 0.4, 2.6, 3.6)), 1.0, 4.0, 3.1, id="a screen"),
    ],
)
def test_the_short_way_is_taken_again_within_two_seconds_after_what_closed_it_has_gone(
    prior: World, then: World, gone_s: float, least_m: float, most_m: float
) -> None:
    goal = (4.5, 2.0)
    assert length(held(prior, then, gone_s, gone_s, goal)) > least_m
    navigator = held(prior, then, gone_s, gone_s + 2.5, goal)
    assert length(navigator) < most_m


def test_a_plan_is_kept_for_as_long_as_no_way_opens(potentials: list[object]) -> None:
    """A standing obstacle, seen with and without an end of it that noise takes away, frees nothing."""
    prior = enclosure(12.0)
    held(prior, enclosure(12.0, Box(2.5, 1.0, 2.6, 3.0)), 20.0, 20.0, (4.5, 2.0))
    assert len(potentials) <= 3


@pytest.mark.parametrize(
    ("goal_x", "held_s", "leg"),
    [(4.6, 12.0, False), (4.6, 12.5, True), (4.6, 19.0, False), (5.5, 12.0, False)],
)
def test_a_goal_is_not_given_up_on_the_way_to_it(goal_x: float, held_s: float, leg: bool) -> None:
    """The robot is held, before a leg or on an open floor, and is then free."""
    navigator = Navigator(OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, (0.0, 0.0)))
    pose, velocity = Pose2D(3.0, 4.0, 0.0), STOP
    navigator.set_goal(goal_x, 4.0)
    for k in range(700):
        if k % 2 == 0:
            ranges = np.full(360, np.inf)
            if leg and 0.1 * k < held_s:
                ranges[:20] = ranges[-20:] = 0.45
            navigator.observe(pose, ranges, LDS_01, 0.1 * k)
        command = navigator.control(pose, velocity, 0.1 * k)
        if navigator.status is not Status.ACTIVE:
            break
        velocity = command if 0.1 * k >= held_s else STOP
        pose = moved(pose, velocity, 0.1)
    assert navigator.status is Status.SUCCEEDED


def test_robots_that_meet_head_on_pass_each_other() -> None:
    world = enclosure(4.0, Box(0.0, 0.0, 4.0, 1.4), Box(0.0, 2.6, 4.0, 4.0))  # a corridor of 1.2 m
    prior = world.occupancy()
    robots = [
        Robot(Navigator(prior), Pose2D(0.5, 2.0, 0.0)),
        Robot(Navigator(prior), Pose2D(3.5, 2.0, math.pi)),
    ]
    robots[0].navigator.set_goal(3.4, 2.0)
    robots[1].navigator.set_goal(0.6, 2.0)
    drive(world, robots, 60.0, sigma_m=0.01)
    assert [robot.navigator.status for robot in robots] == [Status.SUCCEEDED] * 2
    assert [robot.hits for robot in robots] == [0, 0]


def test_a_ghost_that_closes_the_way_is_cleared() -> None:
    world = enclosure(4.0, Box(1.9, 0.0, 2.0, 1.4), Box(1.9, 2.6, 2.0, 4.0))
    robot = Robot(Navigator(world.occupancy()), Pose2D(0.6, 0.6, 0.0))
    costmap = robot.navigator.global_costmap
    row0, row1 = (int(costmap.to_cells(0.0, y)[1]) for y in (1.4, 2.6))
    column = int(costmap.to_cells(1.95, 0.0)[0])
    robot.navigator.set_goal(3.4, 0.6)
    # Marks right across the only doorway, of something that is gone.
    costmap.marks[row0:row1, column : column + 2] = 254
    robot.navigator.global_costmap.clear_outside(2.0, 2.0, 9.0)
    drive(world, [robot], 60.0, sigma_m=0.01)
    assert robot.navigator.status is Status.SUCCEEDED
    assert robot.hits == 0


@pytest.mark.parametrize(
    ("world", "goal"),
    [
        pytest.param(MAZE, (1.0, 1.65), id="in a wall"),
        pytest.param(MAZE, (1.0, 1.73), id="at a wall"),
        pytest.param(MAZE, (-0.2, 1.0), id="outside"),
        pytest.param(MAZE, (9.0, 1.0), id="off the map"),
        pytest.param(enclosure(5.0, Box(3.4, 0.0, 3.5, 5.0)), (4.2, 3.0), id="in a closed room"),
    ],
)
def test_a_goal_that_the_map_rules_out_is_aborted_at_once(world: World, goal: tuple[float, float]) -> None:
    navigator = Navigator(world.occupancy())
    robot = Robot(navigator, Pose2D(0.6, 0.7, 0.0))
    navigator.set_goal(*goal)
    assert drive(world, [robot], 5.0) <= 0.2
    assert navigator.status is Status.ABORTED
    assert robot.travelled_m == 0.0


def test_a_goal_that_another_robot_leaves_is_reached() -> None:
    other = [Pose2D(2.5, 2.0, 0.0)]

    def leave(now: float) -> None:
        other[0] = Pose2D(2.5, min(2.0 + 0.2 * max(now - 12.0, 0.0), 3.5), math.pi / 2)

    robot = driven(enclosure(4.0), (0.6, 2.0), (2.5, 2.0), others=other, on_tick=leave)
    assert robot.navigator.status is Status.SUCCEEDED


def test_a_robot_shut_in_recovers_in_order_and_then_aborts() -> None:
    """Unmapped walls close round the robot: plans fail, four recoveries run, the goal is given up."""
    sides = [(2.5, 2.5, 3.5, 2.6), (2.5, 3.4, 3.5, 3.5), (2.5, 2.6, 2.6, 3.4), (3.4, 2.6, 3.5, 3.4)]
    world = enclosure(6.0, *(Box(*side) for side in sides))
    robot = Robot(Navigator(enclosure(6.0).occupancy()), Pose2D(3.0, 3.0, 0.0))
    robot.navigator.set_goal(5.0, 5.0)
    turns: list[float] = []
    drive(world, [robot], 120.0, on_tick=lambda now: turns.append(robot.velocity.angular_radps))
    assert robot.navigator.status is Status.ABORTED
    assert robot.navigator.recoveries == 4
    assert robot.hits == 0
    # Two full turns on the spot, a tenth of a second each.
    assert 0.1 * sum(turns) == pytest.approx(4 * math.pi, abs=0.5)


def test_a_turn_recovery_ends_after_one_turn_or_before_a_collision() -> None:
    navigator = Navigator(enclosure(4.0).occupancy())
    geometry = LDS_01
    pose = Pose2D(2.0, 2.0, 3.0)
    navigator.observe(pose, np.full(geometry.beams, 1.0), geometry, 0.0)
    recovery = RotateRecovery(navigator.local_planner, pose.yaw)
    turned = 0.0
    while (command := recovery.command(navigator.local_costmap, pose)) is not None:
        assert 0.4 <= command.angular_radps <= 1.0
        turned += 0.1 * command.angular_radps
        pose = pose._replace(yaw=math.remainder(pose.yaw + 0.1 * command.angular_radps, 2 * math.pi))
    assert turned == pytest.approx(2 * math.pi, abs=0.11)
    column, row = (int(value) for value in navigator.local_costmap.to_cells(2.0 - 0.135, 2.0))
    navigator.local_costmap.marks[row, column] = 254
    navigator.local_costmap.clear_outside(2.0, 2.0, 9.0)
    turn = RotateRecovery(navigator.local_planner, math.pi / 2)
    assert turn.command(navigator.local_costmap, Pose2D(2.0, 2.0, math.pi / 2)) is None


def test_nothing_moves_without_goal_or_scan() -> None:
    navigator = Navigator(MAZE.occupancy())
    pose = Pose2D(0.6, 0.7, 0.0)
    geometry = LDS_01
    assert navigator.status is Status.IDLE
    navigator.set_goal(2.0, 0.8)
    assert navigator.control(pose, STOP, 0.0) == STOP
    assert navigator.plan() is None
    navigator.observe(pose, MAZE.scan(pose, [], geometry), geometry, 0.1)
    assert navigator.control(pose, STOP, 0.1) != STOP
    plan = navigator.plan()
    assert plan[-1].tolist() == [2.0, 0.8]
    navigator.cancel()
    assert navigator.status is Status.IDLE
    assert navigator.control(pose, Command(0.2, 0.0), 0.2) == STOP


def test_a_map_under_construction_can_be_exchanged_while_driving() -> None:
    known = enclosure(4.0)
    grid = known.occupancy()
    partly = grid.data.copy()
    partly[:, grid.cell_at(2.0, 0.0)[0] :] = -1
    settings = NavigatorSettings(global_costmap=dataclasses.replace(BURGER_COSTMAP, track_unknown=True))
    robot = Robot(Navigator(grid.with_data(partly), settings), Pose2D(0.6, 2.0, 0.0))
    robot.navigator.set_goal(3.2, 2.0)

    def grow(now: float) -> None:
        if now == 5.0:
            robot.navigator.set_static(grid)

    drive(known, [robot], 40.0, on_tick=grow)
    assert robot.navigator.status is Status.SUCCEEDED


def test_a_map_of_another_resolution_is_refused() -> None:
    grid = World([], Box(0.0, 0.0, 2.0, 2.0), resolution=0.1).occupancy()
    with pytest.raises(InputError, match="resolution"):
        Navigator(grid)


@pytest.mark.slow
def test_warming_up_compiles_every_kernel_once_for_good() -> None:
    code = """
import importlib, pkgutil
import midnet_bench.navigation as room
from midnet_bench.navigation.navigator import compile_kernels
compile_kernels()
for module in pkgutil.iter_modules(room.__path__):
    for name, found in vars(importlib.import_module(room.__name__ + "." + module.name)).items():
        if hasattr(found, "py_func"):
            print(name, len(found.signatures))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    signatures = dict(line.split() for line in run.stdout.splitlines())
    # Those that others call have none of their own when they come from the cache.
    assert set(signatures.values()) <= {"0", "1"}
    called = "best_velocity changed_near clear_footprint distance_grids have_gone inflate inflate_around"
    called += " path_down propagate roll_out search_rollouts take_scan turn_is_free"
    assert [name for name in called.split() if signatures[name] != "1"] == []
