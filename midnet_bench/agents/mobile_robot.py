"""The software of one Burger on its own sensors: ``MobileRobot`` (an intruder), and ``Guard``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from midnet_bench.geometry import STOP, Command, Floats, LidarGeometry, Point, Pose2D, Scan
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.navigator import Navigator, Status

GoalSource = Callable[["MobileRobot"], Point | None]
"""Where to next? Asked whenever a robot has no goal; None leaves it standing."""


class GuardState(NamedTuple):
    """What MIDNet knows of a guard that patrols or pursues."""

    place: Point  # its estimated pose, map frame, metres
    goal: Point | None
    is_pursuing: bool = False  # whether the goal is where a target was, and no point of its patrol


@dataclass(eq=False)
class MobileRobot:
    """Localises, keeps its costmaps and drives from goal to goal, by its sensors alone; at rest at first."""

    index: int  # of its body in the world
    name: str
    pose: Pose2D  # map frame, as it believes
    navigator: Navigator
    ukf: PlanarUkf | None  # None: it believes its odometry, which is its true pose (``localization: truth``)
    next_goal: GoalSource
    goal_timeout_s: float
    scan_to_map: ScanToMap | None = None  # by it scans correct the pose filter (``ukf+map``)

    def __post_init__(self) -> None:
        self.velocity = (0.0, 0.0)
        self.goal: Point | None = None
        self.goals_set = self.goals_reached = self.goals_given_up = 0  # as far as it knows
        self.dwell = Dwell(0.5)

    @property
    def goal_number(self) -> int | None:
        """The number of the goal at hand, counted from 1."""
        return None if self.goal is None else self.goals_set

    def localize(self, pose: Pose2D, velocity: tuple[float, float]) -> None:
        """Go by a newer pose, map frame, and forward speed (m/s) and yaw rate (rad/s)."""
        self.pose = pose
        self.velocity = velocity

    def observe(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan in, also into the costmaps that it drives by; ``ranges_m`` (beams,) metres."""
        self.sense(ranges_m, lidar, time_s)
        self.navigator.observe(self.pose, ranges_m, lidar, time_s)

    def sense(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the pose filter alone: before the next control cycle there comes a newer one.

        Of the scans between two updates costmap_2d's observation buffer keeps the newest, too.
        """
        if self.ukf is not None and self.scan_to_map is not None:
            matched = self.scan_to_map.match(self.pose, ranges_m, lidar)
            if matched is not None:
                self.pose = self.ukf.correct_pose(*matched)

    def drive_to(self, goal: Point) -> None:
        """Drop the goal at hand for another one, map frame, metres."""
        self.goal = goal
        self.goals_set += 1
        self.navigator.set_goal(*goal)

    def cancel_goal(self) -> None:
        """Drop the goal at hand; the next control cycle chooses another one."""
        self.goal = None
        self.navigator.cancel()

    def control(self, time_s: float) -> Command:
        """The velocity to drive at until the next cycle."""
        self.dwell.update(self.pose.x, self.pose.y, time_s, self.goal_number)
        self._settle_goal(time_s)
        self._choose_goal(time_s)
        if self.goal is None:
            return STOP
        return self.navigator.control(self.pose, Command(*self.velocity), time_s)

    def _choose_goal(self, time_s: float) -> None:
        """Drive to the next goal if there is none at hand."""
        if self.goal is None and (goal := self.next_goal(self)) is not None:
            self.drive_to(goal)

    def _settle_goal(self, time_s: float) -> None:
        """Count and drop a goal that was reached, given up, or brought no progress for too long (item 62)."""
        if self.goal is None:
            return
        status = self.navigator.status
        if status is Status.SUCCEEDED:
            self.goals_reached += 1
        elif status is Status.ABORTED or time_s - self.dwell.since_s > self.goal_timeout_s:
            self.goals_given_up += 1
        else:
            return
        self.cancel_goal()


class Guard(MobileRobot):
    """A mobile robot that also keeps costmaps for MIDNet, beside those it drives by (II.B and IV.A)."""

    detection_costmaps: Sequence[RollingCostmap] = ()  # map frame; each takes every scan of this robot
    scan: Scan | None = None  # the last one
    is_pursuing = False

    @property
    def state(self) -> GuardState:
        """What patrol and pursuit rules receive of it."""
        return GuardState((self.pose.x, self.pose.y), self.goal, self.is_pursuing)

    def pursue(self, place: Point) -> None:
        """Drive to where a target is, map frame, metres, instead of patrolling."""
        self.drive_to(place)
        self.is_pursuing = True

    def drive_to(self, goal: Point) -> None:
        """Drop the goal at hand for another one, which is no target's place."""
        super().drive_to(goal)
        self.is_pursuing = False

    def cancel_goal(self) -> None:
        """Drop the goal at hand; the next control cycle chooses a patrol point."""
        super().cancel_goal()
        self.is_pursuing = False

    def sense(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into pose filter and detection costmaps, and keep it."""
        super().sense(ranges_m, lidar, time_s)
        self.scan = Scan(ranges_m, lidar, self.pose, time_s)
        for costmap in self.detection_costmaps:
            costmap.update(self.pose, ranges_m, lidar, time_s)


class Dwell:
    """Since when a robot has been within ``radius_m`` of one place, after one goal."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._place = (math.nan, math.nan)
        self._goal: int | None = None
        self.since_s = 0.0

    def update(self, x: float, y: float, time_s: float, goal: int | None) -> None:
        """Note where the robot is, metres, and the number of its goal, if it has one.

        Another goal, or none, begins anew, and so does leaving the circle: time spent on an earlier goal does
        not count.
        """
        is_near = math.hypot(x - self._place[0], y - self._place[1]) < self._radius_m
        if goal is None or goal != self._goal or not is_near:
            self._place, self.since_s = (x, y), time_s
        self._goal = goal
