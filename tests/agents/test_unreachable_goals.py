"""A robot in a simulated world whose goal lies inside something that its map does not know."""

import math

import pytest

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.experiments.robot_trial import RobotTrial
from midnet_bench.geometry import Pose2D, Solid
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.simulation.world_settings import SimulationSettings, WorldSettings
from tests.simulation.scenes import ENGINES, scene

BLOCK = Solid("box", Pose2D(1.5, 1.2, 0.3), 1.0, 0.8, 0.3)
"""as large as the largest stationary intruder; a LiDAR sees the near part of its skin"""


def drive(
    engine: str, goal: tuple[float, float], seed: int, stationary=(BLOCK,)
) -> tuple[MobileRobot, float]:
    """The robot after 90 s or the end of its goal, and for how long it was within 1.5 m of it until then."""
    start = Pose2D(-1.5, -1.2, 0.5)
    prior = render_exact(load_arena("empty"), 0.05)
    goals = [goal]
    robot = MobileRobot(
        0, "guard 1", start, Navigator(prior), None, lambda _: goals.pop() if goals else None, 30.0
    )
    near_s = 0.0
    settings = SimulationSettings(world=WorldSettings(engine=engine))
    with RobotTrial(scene([start], stationary=stationary), [robot], settings, seed) as trial:
        while trial.fleet.time_s < 90.0 and (goals or robot.goal):
            trial.fleet.step()
            near_s += (math.dist(robot.pose[:2], goal) < 1.5) / trial.step_hz
    return robot, near_s


FAR, MIDDLE, NEAR = (1.75, 1.4), (1.5, 1.2), (1.2, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_a_goal_inside_a_large_unknown_obstacle_is_given_up_soon(engine: str) -> None:
    for goal in (FAR, MIDDLE, NEAR) if engine == "fast" else (FAR,):
        robot, near_s = drive(engine, goal, seed=2001)
        assert robot.goals_given_up == 1
        without_progress_s, coming_nearer_s = 10.0 + 1.75 / 0.18, 1.5 / 0.09  # at half of the top speed
        assert near_s <= without_progress_s + coming_nearer_s


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_a_goal_just_behind_a_large_unknown_obstacle_is_reached(engine: str) -> None:
    behind = BLOCK.pose.compose(Pose2D(0.0, 0.75, 0.0))
    robot, _ = drive(engine, (behind.x, behind.y), seed=2001)
    assert robot.goals_reached == 1
