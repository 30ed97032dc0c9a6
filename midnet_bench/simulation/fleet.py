"""``Fleet``: every robot of one world, stepped in lockstep on integer ticks."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Localizer, MobileRobot
from midnet_bench.messages import STOP
from midnet_bench.rng import stream
from midnet_bench.simulation.imu import ImuSensors
from midnet_bench.simulation.integrity import HealthTracker, Standstill
from midnet_bench.simulation.lidar import LidarSensors
from midnet_bench.simulation.odometry import EncoderOdometers
from midnet_bench.simulation.settings import SimulationSettings
from midnet_bench.simulation.world import World

CONTROL_HZ = 10
"""Pose filter and navigator; move_base's controller_frequency in turtlebot3_navigation."""
SCAN_HZ = 5
"""The LDS-01, and the costmaps it feeds (item 9), unless ``lidar_hz`` says otherwise."""


ScanCallback = Callable[[Sequence[MobileRobot], npt.NDArray[np.float64]], None]
"""Robots that have just taken a scan, and (m, beams) the ranges that they were given, metres."""


class _Due(NamedTuple):
    """Robots of which something is due at one tick of a period."""

    robots: list[MobileRobot]
    rows: npt.NDArray[np.int64]
    """their indices"""


class Fleet:
    """Drives a world's robots by their own software; robot i of the list is body i of the world."""

    def __init__(
        self,
        world: World,
        lidars: LidarSensors,
        robots: Sequence[MobileRobot],
        settings: SimulationSettings,
        seed: int,
    ) -> None:
        """Each robot senses and controls with a phase of its own, drawn from ``seed`` (item 9).

        Its streams go by its name, not by its index: an intruder's noise does not depend on the team's size.
        """
        self.world = world
        self._lidars = lidars
        self.robots = robots
        self.health = HealthTracker(world.layout, world.poses())
        self.stands = [Standstill() for _ in robots]
        hz = world.step_hz
        self._control_ticks = hz // CONTROL_HZ
        self._scan_ticks = hz // settings.lidar.hz
        self._health_ticks = hz // SCAN_HZ
        names = [robot.name for robot in robots]
        phases = [int(stream(seed, "phase", name).integers(self._health_ticks)) for name in names]
        self._controlling = _schedule(robots, phases, self._control_ticks)
        self._scanning = _schedule(robots, self._scan_phases(phases, names, seed), self._scan_ticks)
        self._lidar_noise = lidars.noise([stream(seed, "lidar", name) for name in names])
        self._imus = ImuSensors(settings.imu, [stream(seed, "imu", name) for name in names])
        self._odometers = (
            EncoderOdometers(
                np.array([robot.pose for robot in robots]),
                world.wheel_angles(),
                settings.odometry,
                [stream(seed, "odometry", name) for name in names],
                world.robot,
            )
            if settings.odometry.source == "encoder"
            else None
        )
        self._localizer = Localizer(robots)
        self.scan_callbacks: list[ScanCallback] = []
        """called with each scan once the robots have it"""
        starts = [*world.layout.robots, *world.layout.intruders]
        self._yaw_errors = np.array(
            [robot.pose.yaw - at.yaw for robot, at in zip(robots, starts, strict=True)]
        )
        self._has_yaw_errors = bool(self._yaw_errors.any())

    @property
    def time_s(self) -> float:
        """Seconds since the trial's start."""
        return self.world.tick / self.world.step_hz

    def step(self) -> Sequence[MobileRobot]:
        """Let one tick pass: physics, then sensors and software of the robots due, which come back."""
        world = self.world
        world.step()
        due = self._controlling[world.tick % self._control_ticks]
        if due.robots:
            self._localize(due)
            self._scan(self._scanning[world.tick % self._scan_ticks])
            self._control(due)
        if world.tick % self._health_ticks == 0:
            self.health.update(world.poses())
        return due.robots

    def stop(self, robot: MobileRobot) -> None:
        """Let a robot stand where it is, body and all; it senses and drives no more."""
        self.world.drive(robot.index, STOP)
        self._unschedule(robot)

    def remove(self, robot: MobileRobot) -> None:
        """Take a robot out of the arena for good."""
        self.world.remove(robot.index)
        self._unschedule(robot)

    def _unschedule(self, robot: MobileRobot) -> None:
        # Lists of their own: a robot may be caught while the fleet goes through the old ones.
        self._controlling, self._scanning = (
            [_due([other for other in due.robots if other is not robot]) for due in schedule]
            for schedule in (self._controlling, self._scanning)
        )

    def _scan_phases(self, phases: Sequence[int], names: Sequence[str], seed: int) -> list[int]:
        """The tick of each robot's first scan: a slow LiDAR's may begin in any part of its longer period."""
        if self._scan_ticks <= self._health_ticks:
            return [phase % self._scan_ticks for phase in phases]
        cycles = self._scan_ticks // self._control_ticks
        return [
            phase % self._control_ticks
            + self._control_ticks * int(stream(seed, "scan phase", name).integers(cycles))
            for phase, name in zip(phases, names, strict=True)
        ]

    def _localize(self, due: _Due) -> None:
        elapsed_s = 1.0 / CONTROL_HZ
        robots, rows = due
        poses, velocities = self.world.poses(), self.world.velocities(rows)
        headings = poses
        if self._has_yaw_errors:
            # an IMU counts from where its robot takes itself to look at the start
            headings = poses.copy()
            headings[:, 2] = (poses[:, 2] + self._yaw_errors + np.pi) % (2.0 * np.pi) - np.pi
        imus = self._imus.read(rows, headings, velocities, elapsed_s)
        if self._odometers is not None:
            velocities = self._odometers.update(rows, self.world.wheel_angles(), elapsed_s)
        self._localizer.step(robots, rows, poses, velocities, imus, elapsed_s)

    def _scan(self, scanning: _Due) -> None:
        robots, rows = scanning
        if not robots:
            return
        lidar, time_s = self.world.robot.lidar, self.time_s
        scans = self._lidars.scan(rows, self._lidar_noise)
        for robot, ranges in zip(robots, scans, strict=True):
            robot.observe(ranges, lidar, time_s)
        for callback in self.scan_callbacks:
            callback(robots, scans)

    def _control(self, due: _Due) -> None:
        time_s = self.time_s
        places = self.world.poses()[due.rows, :2].tolist()
        for robot, (x, y) in zip(due.robots, places, strict=True):
            self.stands[robot.index].update(x, y, time_s, robot.goal is not None, robot.progress.goals_set)
            self.world.drive(robot.index, robot.control(time_s))


def _schedule(robots: Sequence[MobileRobot], phases: Sequence[int], period_ticks: int) -> list[_Due]:
    """For each tick of a period, which of the robots are due."""
    return [
        _due([robot for robot, phase in zip(robots, phases, strict=True) if phase % period_ticks == tick])
        for tick in range(period_ticks)
    ]


def _due(robots: list[MobileRobot]) -> _Due:
    return _Due(robots, np.array([robot.index for robot in robots], dtype=np.int64))
