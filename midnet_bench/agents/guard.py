"""``Guard``: a security robot, whose local costmap is MIDNet's eye (sections II.B and IV.A)."""

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import GoalSource, MobileRobot
from midnet_bench.geometry import Pose2D
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.messages import LidarGeometry
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.navigator import Navigator


class Guard(MobileRobot):
    """A mobile robot with further costmaps that are for looking, not for driving."""

    def __init__(
        self,
        index: int,
        name: str,
        start: Pose2D,
        navigator: Navigator,
        ukf: PlanarUkf | None,
        next_goal: GoalSource,
        goal_timeout_s: float,
    ) -> None:
        """A guard without eyes; whoever watches through it adds a costmap to ``eyes``."""
        super().__init__(index, name, start, navigator, ukf, next_goal, goal_timeout_s)
        self.eyes: list[RollingCostmap] = []
        """the separate instances of costmap_2d that section II.B spawns: MIDNet's, first of all"""

    def observe(self, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the navigator's costmaps and into the eyes."""
        super().observe(ranges_m, lidar, time_s)
        sensor_pose = self.pose.compose(lidar.mount)
        for costmap in self.eyes:
            costmap.update(self.pose, sensor_pose, ranges_m, lidar, time_s)
