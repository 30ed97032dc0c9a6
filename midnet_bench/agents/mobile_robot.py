"""The software of one Burger on its own sensors: ``MobileRobot`` (an intruder), and ``Guard``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import STOP, Command, Floats, LidarGeometry, Point, Pose2D, Scan, wrap_angle
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf, UkfTeam
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.navigator import Navigator, Status

GoalSource = Callable[["MobileRobot"], Point | None]
"""Where to next? Asked whenever a robot has no goal; None leaves it standing."""


class GuardState(NamedTuple):
    """What MIDNet knows of a guard that patrols or pursues."""

    place: Point  # its estimated pose, map frame, metres
    goal: Point | None


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
        self.progress = Progress()

    def localize(self, pose: Pose2D, velocity: tuple[float, float]) -> None:
        """Go by a newer pose, map frame, and forward speed (m/s) and yaw rate (rad/s)."""
        self.pose = pose
        self.velocity = velocity

    def observe(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the pose filter and the costmaps; ``ranges_m`` (beams,) metres."""
        if self.ukf is not None and self.scan_to_map is not None:
            matched = self.scan_to_map.match(self.pose, ranges_m, lidar)
            if matched is not None:
                self.pose = self.ukf.correct_pose(*matched)
        self.navigator.observe(self.pose, ranges_m, lidar, time_s)

    def drive_to(self, goal: Point) -> None:
        """Drop the goal at hand for another one, map frame, metres."""
        self.goal = goal
        self.progress.new_goal()
        self.navigator.set_goal(*goal)

    def cancel_goal(self) -> None:
        """Drop the goal at hand; the next control cycle chooses another one."""
        self.goal = None
        self.navigator.cancel()

    def control(self, time_s: float) -> Command:
        """The velocity to drive at until the next cycle."""
        self.progress.update(self.pose.x, self.pose.y, time_s, self.goal is not None)
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
            self.progress.goals_reached += 1
        elif status is Status.ABORTED or self.progress.without_progress_s(time_s) > self.goal_timeout_s:
            self.progress.goals_given_up += 1
        else:
            return
        self.cancel_goal()


class Guard(MobileRobot):
    """A mobile robot that also keeps costmaps for MIDNet, beside those it drives by (II.B and IV.A)."""

    detection_costmaps: Sequence[RollingCostmap] = ()  # map frame; each takes every scan of this robot
    scan: Scan | None = None  # the last one

    @property
    def state(self) -> GuardState:
        """What patrol and pursuit rules receive of it."""
        return GuardState((self.pose.x, self.pose.y), self.goal)

    def observe(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into pose filter, navigator and detection costmaps."""
        super().observe(ranges_m, lidar, time_s)
        self.scan = Scan(ranges_m, lidar, self.pose, time_s)
        for costmap in self.detection_costmaps:
            costmap.update(self.pose, ranges_m, lidar, time_s)


class Localizer:
    """Steps the pose filters of all robots that are due in one compiled call."""

    def __init__(self, robots: Sequence[MobileRobot]) -> None:
        """``robots`` in the order of the rows that ``step`` takes; all have a pose filter, or none."""
        filters = [robot.ukf for robot in robots if robot.ukf is not None]
        self._filters = UkfTeam(filters) if filters else None

    def step(
        self,
        due: Sequence[MobileRobot],
        rows: npt.NDArray[np.int64],
        poses: Floats,
        twists: Floats,
        imus: Floats,
        dt_s: float,
    ) -> None:
        """Let the robots ``due``, of ``rows``, know where they are ``dt_s`` after the last step.

        ``poses``: (n, 3) of odometry, metres and radians, believed as they are by robots without a filter;
        ``twists`` and ``imus``: as for ``UkfTeam.step``.
        """
        if self._filters is None:
            for robot, pose, velocity in zip(due, poses[rows].tolist(), twists[rows].tolist(), strict=True):
                robot.localize(Pose2D(*pose), tuple(velocity))
            return
        self._filters.step(rows, twists, imus, dt_s)
        for robot, state in zip(due, self._filters.states[rows].tolist(), strict=True):
            x, y, yaw, speed, _, turn = state
            robot.localize(Pose2D(x, y, wrap_angle(yaw)), (speed, turn))


class Progress:
    """What one robot achieved, as far as it knows, and since when its goal has come no nearer."""

    RADIUS_M = 0.5

    def __init__(self) -> None:
        self.goals_set = self.goals_reached = self.goals_given_up = 0
        self._dwell = Dwell(self.RADIUS_M)
        self._has_new_goal = True

    def new_goal(self) -> None:
        """Reset the timer: time spent on an earlier goal does not count."""
        self.goals_set += 1
        self._has_new_goal = True

    def update(self, x: float, y: float, time_s: float, has_goal: bool) -> None:
        """Note where the robot believes itself to be, map frame, metres."""
        if self._has_new_goal or not has_goal:
            self._has_new_goal = False
            self._dwell.begin(x, y, time_s)
        self._dwell.update(x, y, time_s)

    def without_progress_s(self, time_s: float) -> float:
        """How long the robot has been after its goal within half a metre of one place, seconds."""
        return time_s - self._dwell.since_s


class Dwell:
    """How long a robot has been within ``radius_m`` of one place."""

    def __init__(self, radius_m: float) -> None:
        self._radius_m = radius_m
        self._place = (math.nan, math.nan)
        self.since_s = 0.0  # when it came there

    def begin(self, x: float, y: float, time_s: float) -> None:
        """Count from here and now."""
        self._place = (x, y)
        self.since_s = time_s

    def update(self, x: float, y: float, time_s: float) -> None:
        """Note where the robot is, metres; leaving the circle begins anew."""
        if not math.hypot(x - self._place[0], y - self._place[1]) < self._radius_m:
            self.begin(x, y, time_s)
