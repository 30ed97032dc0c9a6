"""``RobotTrial``: what every trial with robots in it has: a world, a fleet, and how each robot did."""

from collections.abc import Sequence
from typing import Self

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.arena.layout import Layout
from midnet_bench.campaign.trial import Row
from midnet_bench.simulation.fleet import Fleet
from midnet_bench.simulation.sensors import LidarSensors
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import SimulationSettings


class RobotTrial:
    """A world of its own with robots in motion. A context manager.

    What a trial holds refers back to it by ``weakref.proxy`` alone, and explorers to their mates. So its
    memory is free as soon as it is dropped: a cycle would keep its costmaps until a garbage collection.
    """

    def __init__(
        self, layout: Layout, robots: Sequence[MobileRobot], settings: SimulationSettings, seed: int
    ) -> None:
        """Let ``robots`` stand where ``layout`` has them; time is 0."""
        self.world = World(layout, settings.world, settings.robot_model)
        self.crowd = self.world.crowd
        self.lidars = LidarSensors(self.world, settings.lidar)
        self.fleet = Fleet(self.world, self.lidars, robots, settings, seed)
        self.step_hz = self.world.step_hz

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.world.close()

    def rows_of_robots(self) -> list[Row]:
        """``robots.csv``: one row per robot, what each did so far; metres and seconds."""
        health, collisions = self.fleet.health, self.world.collisions()
        return [
            {
                "robot": robot.name,
                "distance_m": float(health.distances_m[robot.index]),
                "goals_reached": robot.goals_reached,
                "goals_given_up": robot.goals_given_up,
                "stuck_s": self.fleet.stands[robot.index].stuck_s,
                "collisions": int(collisions[robot.index]),
                "walls_crossed": int(health.crossings[robot.index]),
                "recoveries": robot.navigator.recoveries,
                "pose_error_m": robot.pose.distance_to(self.world.pose(robot.index)),
            }
            for robot in self.fleet.robots
        ]
