"""``Fleet``: all robots of a world, stepped in lockstep on integer ticks; how far and whether they move."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import NamedTuple, Self

import numpy as np

from midnet_bench.agents.mobile_robot import Dwell, MobileRobot
from midnet_bench.arena.layout import Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import hypot
from midnet_bench.geometry import STOP, Booleans, Floats, Indices, Pose2D, wrap_angle
from midnet_bench.localization.ukf import UkfTeam
from midnet_bench.rng import stream
from midnet_bench.simulation.sensors import EncoderOdometers, ImuSensors, LidarSensors
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import SimulationSettings

CONTROL_HZ = 10  # Pose filter and navigator; move_base's controller_frequency in turtlebot3_navigation.
SCAN_HZ = 5  # The LDS-01, and the costmaps it feeds (item 9), unless ``lidar_hz`` says otherwise.


class ScanTicks(NamedTuple):
    """Which ticks carry scans: ``scans`` of every ``ticks``, as evenly as whole ticks allow."""

    scans: int
    ticks: int

    @classmethod
    def of(cls, rate_hz: float, step_hz: int) -> Self:
        """Of a rate in its shortest decimal form, exactly in the mean; at most one scan a tick."""
        share = min(Fraction(str(rate_hz)) / step_hz, Fraction(1))
        return cls(share.numerator, share.denominator)

    @property
    def longest_gap(self) -> int:
        """The most ticks from a scan to the next one."""
        return math.ceil(self.ticks / self.scans)

    def has(self, ticks_since_first: int) -> bool:
        """Whether a scan falls on the tick that is so long after the first one."""
        return ticks_since_first * self.scans % self.ticks < self.scans


ScanCallback = Callable[[Sequence[MobileRobot], Floats], None]
"""Robots that have just taken a scan, and (m, beams) the ranges that they were given, metres."""


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
        self._scan_ticks = ScanTicks.of(settings.lidar.hz, hz)
        self._health_ticks = hz // SCAN_HZ
        names = [robot.name for robot in robots]
        phases = [int(stream(seed, "phase", name).integers(self._health_ticks)) for name in names]
        self._control_phases = phases
        self._scan_phases = self._drawn_scan_phases(phases, names, seed)
        self._scans_when_controlled = (
            self._scan_ticks.scans == 1 and self._scan_ticks.ticks % self._control_ticks == 0
        )
        """whether scans fall into control cycles alone, as the LDS-01's do"""
        self._localized_at = [(phase - 1) % self._control_ticks + 1 - self._control_ticks for phase in phases]
        """the tick at which each robot localised last, unless ``_scans_when_controlled``; at first a period
        before its first control cycle"""
        self._driving = list(robots)
        """those that were neither stopped nor removed"""
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
        filters = [robot.ukf for robot in robots if robot.ukf is not None]
        self._filters = UkfTeam(filters) if filters else None
        """of all robots; None: each believes its odometry"""
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

    def odometry_pose(self, robot: MobileRobot) -> Pose2D:
        """Where a robot's odometry has it: its odometry frame begins as the map frame, and drifts."""
        poses = self.world.poses() if self._odometers is None else self._odometers.poses
        return Pose2D(*poses[robot.index].tolist())

    def step(self) -> Sequence[MobileRobot]:
        """Let one tick pass: physics, then sensors and software; the robots that localised come back.

        A robot localises in each of its control cycles and whenever it scans.
        """
        world = self.world
        world.step()
        due = self._due(self._control_phases, self._control_ticks)
        localized = due
        if self._scans_when_controlled:
            if due:
                rows = _indices(due)
                self._localize(due, rows, 1.0 / CONTROL_HZ)
                self._scan(self._due(self._scan_phases, self._scan_ticks.ticks))
                self._control(due, rows)
        else:
            scanning = [one for one in self._driving if self._scans_now(one)]
            localized = [one for one in self._driving if one in due or one in scanning]
            self._localize_since(localized)
            self._scan(scanning)
            if due:
                self._control(due, _indices(due))
        if world.tick % self._health_ticks == 0:
            self.health.update(world.poses())
        return localized

    def stop(self, robot: MobileRobot) -> None:
        """Let a robot stand where it is, body and all; it senses and drives no more."""
        self.world.drive(robot.index, STOP)
        self._driving.remove(robot)

    def remove(self, robot: MobileRobot) -> None:
        """Take a robot out of the arena for good."""
        self.world.remove(robot.index)
        self._driving.remove(robot)

    def _due(self, phases: Sequence[int], period_ticks: int) -> list[MobileRobot]:
        """The robots whose phase comes at this tick."""
        return [one for one in self._driving if (self.world.tick - phases[one.index]) % period_ticks == 0]

    def _is_last_scan(self, robot: MobileRobot) -> bool:
        """Whether no scan of a robot comes between this tick and its next control cycle, or at that."""
        if self._scan_ticks.ticks >= self._scan_ticks.scans * self._control_ticks:
            return True
        tick, index = self.world.tick, robot.index
        left = (self._control_phases[index] - tick) % self._control_ticks
        after = tick + 1 - self._scan_phases[index]
        return not any(self._scan_ticks.has(since) for since in range(after, after + left))

    def _scans_now(self, robot: MobileRobot) -> bool:
        return self._scan_ticks.has(self.world.tick - self._scan_phases[robot.index])

    def _drawn_scan_phases(self, phases: Sequence[int], names: Sequence[str], seed: int) -> list[int]:
        """The tick of each robot's first scan: a slow LiDAR's may begin in any part of its longer period."""
        period_ticks = self._scan_ticks.longest_gap
        if period_ticks <= self._health_ticks:
            return [phase % period_ticks for phase in phases]
        cycles = math.ceil(period_ticks / self._control_ticks)
        return [
            phase % self._control_ticks
            + self._control_ticks * int(stream(seed, "scan phase", name).integers(cycles))
            for phase, name in zip(phases, names, strict=True)
        ]

    def _localize_since(self, robots: Sequence[MobileRobot]) -> None:
        """Let robots know where they are, each after the time since it last did."""
        tick, last = self.world.tick, self._localized_at
        for ticks in sorted({tick - last[robot.index] for robot in robots}):
            group = [robot for robot in robots if tick - last[robot.index] == ticks]
            self._localize(group, _indices(group), ticks / self.world.step_hz)
        for robot in robots:
            last[robot.index] = tick

    def _localize(self, robots: Sequence[MobileRobot], rows: Indices, elapsed_s: float) -> None:
        """Let the robots due know where they are, ``elapsed_s`` after they last did."""
        poses, velocities = self.world.poses(), self.world.velocities(rows)
        headings = poses
        if self._has_yaw_errors:
            # an IMU counts from where its robot takes itself to look at the start
            headings = poses.copy()
            headings[:, 2] = (poses[:, 2] + self._yaw_errors + np.pi) % (2.0 * np.pi) - np.pi
        imus = self._imus.read(rows, headings, velocities, elapsed_s)
        if self._odometers is not None:
            velocities = self._odometers.update(rows, self.world.wheel_angles(), elapsed_s)
        if self._filters is None:
            states = np.column_stack((poses, velocities))[rows]
            for robot, (x, y, yaw, speed, turn) in zip(robots, states.tolist(), strict=True):
                robot.localize(Pose2D(x, y, yaw), (speed, turn))
            return
        self._filters.step(rows, velocities, imus, elapsed_s)
        for robot, state in zip(robots, self._filters.states[rows].tolist(), strict=True):
            x, y, yaw, speed, _, turn = state
            robot.localize(Pose2D(x, y, wrap_angle(yaw)), (speed, turn))

    def _scan(self, robots: Sequence[MobileRobot]) -> None:
        if not robots:
            return
        lidar, time_s = self.world.robot.lidar, self.time_s
        scans = self._lidars.scan(_indices(robots), self._lidar_noise)
        for robot, ranges in zip(robots, scans, strict=True):
            (robot.observe if self._is_last_scan(robot) else robot.sense)(ranges, lidar, time_s)
        for callback in self.scan_callbacks:
            callback(robots, scans)

    def _control(self, robots: Sequence[MobileRobot], rows: Indices) -> None:
        time_s = self.time_s
        for robot, (x, y, _) in zip(robots, self.world.poses()[rows].tolist(), strict=True):
            self.stands[robot.index].update(x, y, time_s, robot.goal_number)
            self.world.drive(robot.index, robot.control(time_s))


def _indices(robots: Sequence[MobileRobot]) -> Indices:
    return np.array([robot.index for robot in robots], dtype=np.int64)


class HealthTracker:
    """How far each robot has come, and how often its centre went through a surface."""

    def __init__(self, layout: Layout, poses: Floats) -> None:
        self._surfaces = surfaces(layout)
        self._last = poses.copy()
        self.distances_m: Floats = np.zeros(len(poses))
        """(n,) path lengths so far"""
        self.crossings: Indices = np.zeros(len(poses), dtype=np.int64)
        """(n,) surfaces tunnelled through; anything but 0 says that the physics failed"""

    def update(self, poses: Floats) -> None:
        """Take the (n, 3) poses of a later tick, NaN for a robot that is gone. Five a second will do."""
        before, self._last = self._last, poses.copy()
        add_ways(self._surfaces, before, self._last, self.distances_m, self.crossings)


class Standstill:
    """The time that one robot stood although it had a goal, from its true positions; for ``robots.csv``."""

    STUCK_AFTER_S = 5.0

    def __init__(self) -> None:
        self.stuck_s = 0.0
        """seconds with a goal but within 0.25 m of one place, where that lasted longer than 5 s: a Burger
        under way is through such a circle in 2.3 s, and one that swings to and fro never leaves it"""
        self._dwell = Dwell(0.25)
        self._counted_until_s = 0.0

    def update(self, x: float, y: float, time_s: float, goal: int | None) -> None:
        """Note where the robot is, map frame, metres, and its goal, as for ``Dwell``."""
        self._dwell.update(x, y, time_s, goal)
        if time_s - self._dwell.since_s > self.STUCK_AFTER_S:
            # a long stand counts from its beginning
            self.stuck_s += time_s - max(self._dwell.since_s, self._counted_until_s)
            self._counted_until_s = time_s


def surfaces(layout: Layout) -> Floats:
    """(k, 4) the sides of all walls and stationary intruders: x and y of one end, x and y of the other."""
    outlines = [solid.outline for solid in layout.solids]
    ends = [part for outline in outlines for part in (outline[1:], outline[:1])]
    return np.hstack((np.concatenate(outlines), np.concatenate(ends)))


@njit
def crossed_wall(sides: Floats, before: Floats, after: Floats) -> Booleans:
    """(n,) whether the straight way from ``before`` to ``after`` goes through one of ``surfaces``.

    Both are (n, 2) or more, x and y first.

    A robot's centre is never less than 38 mm from a surface that its body only touches, so going through
    even one side means that the body went through. NaN crosses nothing.
    """
    crossed = np.zeros(len(before), dtype=np.bool_)
    for i in range(len(before)):
        x, y, to_x, to_y = before[i, 0], before[i, 1], after[i, 0], after[i, 1]
        for side in sides:
            # above 0 where an end, or a corner of the side, lies to the left of the other line
            first = (to_x - x) * (side[1] - y) - (to_y - y) * (side[0] - x)
            second = (to_x - x) * (side[3] - y) - (to_y - y) * (side[2] - x)
            along_x, along_y = side[2] - side[0], side[3] - side[1]
            start = along_x * (y - side[1]) - along_y * (x - side[0])
            end = along_x * (to_y - side[1]) - along_y * (to_x - side[0])
            if first * second < 0.0 and start * end < 0.0:
                crossed[i] = True
                break
    return crossed


@njit
def add_ways(sides: Floats, before: Floats, after: Floats, distances_m: Floats, crossings: Indices) -> None:
    """Add to n robots' distances and crossings what their ways come to, as for ``crossed_wall``.

    NaN adds nothing.
    """
    crossings += crossed_wall(sides, before, after)
    for i in range(len(before)):
        way_m = hypot(after[i, 0] - before[i, 0], after[i, 1] - before[i, 1])
        if not math.isnan(way_m):
            distances_m[i] += way_m
