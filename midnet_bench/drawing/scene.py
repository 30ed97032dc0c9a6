"""``Scene``: what a picture shows of a trial at one instant, whoever draws it."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Guard, MobileRobot, Point
from midnet_bench.arena.arena import Arena
from midnet_bench.arena.layout import Layout
from midnet_bench.experiments.guarded.arena import FRAME_HZ, GuardedArena
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.robots.burger import LDS_01

Floats = npt.NDArray[np.float64]

_BURGER: Floats = np.array(
    # half of it, from front to back; the collision boxes of burger.urdf: the base, and the wheels beside it
    [(0.038, 0.070), (0.030, 0.070), (0.030, 0.089), (-0.030, 0.089), (-0.030, 0.070), (-0.102, 0.070)]
)
BURGER_OUTLINE: Floats = np.vstack((_BURGER, _BURGER[::-1] * (1.0, -1.0)))
"""(12, 2) a Burger's body from above in its base frame, x ahead, metres"""

_FRONT = Pose2D(0.038, 0.0, 0.0)
_LIDAR_MOUNT = LDS_01.mount


def burger_at(pose: Pose2D, enlarged: float = 1.0) -> Floats:
    """(12, 2) a Burger's body from above, so many times as large as it is, map frame."""
    return pose.transform(BURGER_OUTLINE * enlarged)


class Stage(Protocol):
    """What a picture needs to know of a trial that stands still: a guarded arena, or one that is explored."""

    @property
    def seed(self) -> int:
        """The trial's seed."""

    @property
    def arena(self) -> Arena:
        """The place."""

    @property
    def layout(self) -> Layout:
        """What stands where."""


@dataclass(frozen=True)
class RobotMark:
    """A robot that is in the arena."""

    number: int
    """counted from 1 among its kind"""
    is_guard: bool
    pose: Pose2D
    """as it truly is"""
    believed: Pose2D
    """as it takes it to be"""
    goal: Point | None
    plan: Floats | None
    """(n, 2) its way to the goal"""

    @property
    def outline(self) -> Floats:
        """(12, 2) its body from above, map frame, metres."""
        return burger_at(self.pose)

    @property
    def front(self) -> Point:
        """(x, y) of the middle of its front edge."""
        return self.pose.compose(_FRONT)[:2]

    @property
    def sensor(self) -> Point:
        """(x, y) of its LiDAR."""
        return self.pose.compose(_LIDAR_MOUNT)[:2]


@dataclass(frozen=True)
class DetectionMark:
    """One fused detection."""

    box: Box
    robot: int
    """number of the robot whose box it is, from 1"""
    is_false: bool
    """whether it touches nobody who is there now"""


@dataclass(frozen=True)
class Scene:
    """Everybody at one instant, map frame, metres. Who was caught or escaped is not in it."""

    time_s: float
    robots: list[RobotMark]
    """guards first"""
    detections: list[DetectionMark]

    @property
    def guards(self) -> list[RobotMark]:
        """The security robots."""
        return [robot for robot in self.robots if robot.is_guard]

    @property
    def intruders(self) -> list[RobotMark]:
        """The mobile intruders that are at large."""
        return [robot for robot in self.robots if not robot.is_guard]

    @property
    def frame_number(self) -> int:
        """Of the MIDNet frame at this instant, from 1."""
        return round(self.time_s * FRAME_HZ)


def scene_of(trial: GuardedArena, frame: Frame) -> Scene:
    """The trial as it is now, with the detections of its newest frame."""
    active = trial.world.active
    poses = trial.world.poses()
    robots = [robot for robot in trial.fleet.robots if active[robot.index]]
    targets = [solid.bounding_box() for solid in trial.layout.stationary]
    targets += [trial.lidars.outline(robot.index) for robot in trial.intruders if active[robot.index]]
    return Scene(
        trial.fleet.time_s,
        [_mark(robot, Pose2D(*poses[robot.index].tolist()), len(trial.guards)) for robot in robots],
        [
            DetectionMark(box, robot + 1, not any(box.intersection_area(target) > 0.0 for target in targets))
            for box, robot in zip(frame.detections, frame.robots, strict=True)
        ],
    )


def title_of(trial: Stage) -> str:
    """Which trial it is, in a line."""
    return f"{trial.arena.name}, seed {trial.seed}"


def enclosure_of(trial: Stage) -> Box:
    """The walled region, from wall centre to wall centre."""
    width_m, height_m = trial.arena.enclosure_m
    return Box(-width_m / 2.0, -height_m / 2.0, width_m / 2.0, height_m / 2.0)


def view_of(trial: Stage, margin_m: float) -> Box:
    """What a picture from above must show: all walls and the enclosure, and ``margin_m`` around them."""
    corners = np.array([enclosure_of(trial), *(solid.bounding_box() for solid in trial.layout.solids)])
    return Box(*corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist()).shrunk(-margin_m)


def _mark(robot: MobileRobot, pose: Pose2D, guards: int) -> RobotMark:
    is_guard = isinstance(robot, Guard)
    number = robot.index + 1 if is_guard else robot.index - guards + 1
    return RobotMark(number, is_guard, pose, robot.pose, robot.goal, robot.navigator.plan())
