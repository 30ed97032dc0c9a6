"""``Explorer``: a Burger that maps an unknown place by driving where its map ends (section II.A)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.elementary import directions
from midnet_bench.geometry import Floats, LidarGeometry, Point, Pose2D, lengths, wrap_angle
from midnet_bench.grid import MapWindow, OccupancyGrid
from midnet_bench.mapping.frontier import Frontier, FrontierExplorer, assign_frontiers
from midnet_bench.mapping.gmapping import GMapping

MATE_RADIUS_M = 0.3
"""A return this near to where a mate says it is comes from that mate: its body and both poses' errors."""
_BODIES = 7.0
"""A robot that is done leaves this many inscribed radii round it free for mates: three bodies' width."""


@dataclass(eq=False, kw_only=True)
class Explorer(MobileRobot):
    """UKF (odometry frame), GMapping (map -> odom), move_base on a growing map, explore_lite over it.

    Its pose, its goals and its costmaps are in the map frame, which is the arena's because start poses are
    known; where GMapping moves the odometry frame, the pose jumps with it. ``ukf`` and ``slam`` begin at
    ``pose``, so that the odometry frame begins as the map frame. The ``navigator`` has an unknown map that
    covers ``area``; frontiers outside it are left alone.
    """

    slam: GMapping
    area: MapWindow

    def __post_init__(self) -> None:
        super().__post_init__()
        self.mates: Sequence[Explorer] = ()
        """the explorers that share this one's frame: their goals are left to them, they are no walls"""
        self.is_done = False
        """whether its newest map has no frontier and no gap left for it; it drives out of the way then"""
        self._odometry_pose = self.pose
        self._correction = Pose2D(0.0, 0.0, 0.0)  # map -> odom: none until a scan says otherwise
        self._frontiers = FrontierExplorer()
        self._map = self.area.empty()
        self._has_map = self._has_new_map = False
        self._looks = False  # whether it has come to its goal and waits for a scan from there
        self._has_parked = False  # whether it has been sent out of the way since its last frontier

    def localize(self, pose: Pose2D, velocity: tuple[float, float]) -> None:
        """Go by the pose filter's newest pose, odometry frame; the map frame's follows by the correction."""
        super().localize(pose, velocity)
        self._odometry_pose = self.pose
        self._correct()

    def observe(self, ranges_m: Floats, lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the navigator's costmaps and, without what team mates reflect, into GMapping."""
        if self.slam.process(self._odometry_pose, self._without_mates(ranges_m, lidar), time_s):
            self._correction = self.slam.correction
            self._correct()
        self._looks = False
        super().observe(ranges_m, lidar, time_s)

    def take_map(self, grid: OccupancyGrid) -> None:
        """Go by a newer map, the team's or the robot's own: int8, map frame."""
        self._map = self.area.cut(grid)
        self.navigator.set_static(self._map)
        self._has_map = self._has_new_map = True
        self.is_done = False

    def _choose_goal(self, time_s: float) -> None:
        """A new map or the end of a drive calls for a plan."""
        has_arrived = self._has_map and self.goal is None and not self.is_done and not self._looks
        if self._has_new_map or has_arrived:
            frontiers = self.offers(self.navigator.global_costmap.published())
            taken = [mate.goal for mate in self.mates if mate.goal is not None and not mate.is_done]
            self.explore(frontiers, time_s, taken)

    def offers(self, costmap: OccupancyGrid) -> list[Frontier]:
        """The frontiers and gaps of ``costmap`` that it can reach and has not given up, cheapest first."""
        looks = np.concatenate([each.slam.trajectory.poses[:, :2] for each in (self, *self.mates)])
        return self._frontiers.offers(self.pose, costmap, self._map, looks)

    def explore(self, frontiers: Sequence[Frontier], time_s: float, taken: Sequence[Point]) -> None:
        """Drive to the first of ``frontiers`` that is left to it, or be done; ``taken`` are mates' goals."""
        self._has_new_map = False
        goal = self._frontiers.choose(frontiers, time_s, taken)
        if goal is None:
            self._park()
        else:
            self.is_done = self._has_parked = False
            if goal != self.goal:
                self.drive_to(goal)

    def _park(self) -> None:
        """Be done: go where no mate needs to pass, once, or stay."""
        if self._has_parked:
            self.is_done = True
            return
        self.cancel_goal()
        self.is_done = self._has_parked = True
        radius_m = _BODIES * self.navigator.settings.global_costmap.inscribed_radius_m
        place = self._frontiers.parking_place(self.pose, self.navigator.global_costmap.published(), radius_m)
        if place is not None:
            self.drive_to(place)

    def _settle_goal(self, time_s: float) -> None:
        had_goal, given_up = self.goal is not None, self.goals_given_up
        super()._settle_goal(time_s)
        if had_goal and self.goal is None and not self.is_done:
            succeeded = self.goals_given_up == given_up
            self._frontiers.report(succeeded)
            if succeeded:
                self._looks = True
                self.slam.take_next()

    def _without_mates(self, ranges_m: Floats, lidar: LidarGeometry) -> Floats:
        """The scan with NaN where it met a mate; one that stands there for long would become a wall."""
        if not self.mates:
            return ranges_m
        sensor = self.pose.compose(lidar.mount)
        bearings = sensor.yaw + lidar.angles_rad
        lengths_m = np.minimum(ranges_m, lidar.range_max_m)
        ends = (sensor.x, sensor.y) + lengths_m[:, None] * directions(bearings)
        scan = ranges_m.copy()
        for mate in self.mates:
            scan[lengths(ends - mate.pose[:2]) < MATE_RADIUS_M] = np.nan
        return scan

    def _correct(self) -> None:
        pose = self._correction.compose(self._odometry_pose)
        self.pose = pose._replace(yaw=wrap_angle(pose.yaw))


def hand_out_frontiers(team: Sequence[Explorer], time_s: float) -> None:
    """Send each explorer to a frontier of its own, as the central program can that hears all of them.

    It lays their global costmaps over each other, a cell free where it is to any of them, and knows their
    estimated poses. Between two maps an explorer that has arrived chooses by itself.
    """
    costmaps = [explorer.navigator.global_costmap.published() for explorer in team]
    least = np.minimum.reduce([costmap.data.view(np.uint8) for costmap in costmaps])  # unknown is 255
    costmap = costmaps[0].with_data(least.view(np.int8))
    offers = [explorer.offers(costmap) for explorer in team]
    taken: list[Point] = []
    for explorer, own, place in zip(team, offers, assign_frontiers(offers), strict=True):
        preferred = own if place is None else [own[place], *own[:place], *own[place + 1 :]]
        explorer.explore(preferred, time_s, taken)
        if explorer.goal is not None and not explorer.is_done:
            taken.append(explorer.goal)
