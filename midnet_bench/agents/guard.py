"""``Guard``: a security robot, whose local costmap is MIDNet's eye (sections II.B and IV.A)."""

from functools import cached_property

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.messages import LidarGeometry
from midnet_bench.navigation.costmap import RollingCostmap


class Guard(MobileRobot):
    """A mobile robot with further costmaps that are for looking, not for driving."""

    @cached_property
    def eyes(self) -> list[RollingCostmap]:
        """The separate costmap_2d instances of section II.B, MIDNet's first; whoever watches adds one."""
        return []

    def observe(self, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, time_s: float) -> None:
        """Take one scan into the navigator's costmaps and into the eyes."""
        super().observe(ranges_m, lidar, time_s)
        sensor_pose = self.pose.compose(lidar.mount)
        for costmap in self.eyes:
            costmap.update(self.pose, sensor_pose, ranges_m, lidar, time_s)
