"""``Guard``: a security robot, whose local costmap is MIDNet's eye (sections II.B and IV.A)."""

from typing import Any

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.messages import LidarGeometry
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.navigation.costmap import RollingCostmap


class Guard(MobileRobot):
    """A mobile robot with a second costmap that is for looking, not for driving."""

    def __init__(self, *args: Any, eyes: RollingCostmap, **kwargs: Any) -> None:
        """``eyes``: the separate instance of costmap_2d that section II.B spawns for each robot."""
        super().__init__(*args, **kwargs)
        self.eyes = eyes

    def observe(self, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the navigator's costmaps and into the eyes."""
        super().observe(ranges_m, lidar, time_s)
        self.eyes.update(self.pose, self.pose.compose(lidar.mount), ranges_m, lidar, time_s)

    def observation(self) -> Observation:
        """What MIDNet is told: the latest pose and the costmap of the last scan."""
        return Observation(self.pose, self.eyes.published())
