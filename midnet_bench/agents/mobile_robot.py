"""``MobileRobot``: the software of one Burger, guard or intruder, on its own sensors."""

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.progress import Progress
from midnet_bench.geometry import Pose2D
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.messages import STOP, Command, Imu, LidarGeometry, Odometry
from midnet_bench.navigation.navigator import Navigator, Status

Point = tuple[float, float]
GoalSource = Callable[["MobileRobot"], Point | None]
"""Where to next? Asked whenever a robot has no goal; None leaves it standing."""


class MobileRobot:
    """Localises, keeps its costmaps, drives from goal to goal; knows the world by its sensors alone."""

    def __init__(
        self,
        index: int,
        name: str,
        start: Pose2D,
        navigator: Navigator,
        ukf: PlanarUkf | None,
        next_goal: GoalSource,
        goal_timeout_s: float,
        scan_to_map: ScanToMap | None = None,
    ) -> None:
        """A robot at rest at ``start``, body ``index`` of its world.

        Without a ``ukf`` it believes its odometry as it is, which is its true pose (``localization: truth``).
        With ``scan_to_map`` its scans correct the pose filter (``ukf+map``).
        """
        self.index = index
        self.name = name
        self.pose = start
        self.velocity = (0.0, 0.0)
        self.goal: Point | None = None
        self.progress = Progress()
        self.navigator = navigator
        self.next_goal = next_goal
        self._ukf = ukf
        self._scan_to_map = scan_to_map
        self._goal_timeout_s = goal_timeout_s

    def localize(self, odometry: Odometry, imu: Imu, dt_s: float) -> None:
        """Take one step of the pose filter; under ``truth`` ``odometry`` is believed as it is."""
        if self._ukf is None:
            self.pose = odometry.pose
            self.velocity = (odometry.linear_mps, odometry.angular_radps)
        else:
            self.pose = self._ukf.step(odometry, imu, dt_s)
            self.velocity = self._ukf.velocity

    def observe(self, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the pose filter and the costmaps; ``ranges_m`` (beams,) metres."""
        self._correct_pose(ranges_m, lidar)
        self.navigator.observe(self.pose, ranges_m, lidar, time_s)

    def _correct_pose(self, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry) -> None:
        if self._ukf is None or self._scan_to_map is None:
            return
        matched = self._scan_to_map.match(self.pose, ranges_m, lidar)
        if matched is not None:
            self.pose = self._ukf.correct_pose(*matched)

    def drive_to(self, goal: Point) -> None:
        """Drop the goal at hand for another one, map frame, metres."""
        self.goal = goal
        self.progress.new_goal()
        self.navigator.set_goal(*goal)

    def stand(self) -> None:
        """Drop the goal at hand; the next one is asked for at the next control cycle."""
        self.goal = None
        self.navigator.cancel()

    def control(self, time_s: float) -> Command:
        """The velocity to drive at until the next cycle."""
        self._settle_goal(time_s)
        if self.goal is None:
            goal = self.next_goal(self)
            if goal is None:
                return STOP
            self.drive_to(goal)
        return self.navigator.control(self.pose, Command(*self.velocity), time_s)

    def _settle_goal(self, time_s: float) -> None:
        """Count and drop a goal that was reached, given up, or brought no progress for too long (item 62)."""
        if self.goal is None:
            return
        status = self.navigator.status
        if status is Status.SUCCEEDED:
            self.progress.goals_reached += 1
        elif status is Status.ABORTED or self.progress.without_progress_s(time_s) > self._goal_timeout_s:
            self.progress.goals_given_up += 1
        else:
            return
        self.stand()
