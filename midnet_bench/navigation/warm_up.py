"""Compile once, before worker processes start: they then find numba's cache filled."""

import numpy as np

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import STOP
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.navigation.local_planner import LocalPlanner
from midnet_bench.navigation.navigator import Navigator, NavigatorSettings
from midnet_bench.navigation.trajectory_rollout import TrajectoryRolloutSettings
from midnet_bench.robots.burger import LDS_01


def compile_kernels() -> None:
    """Run every compiled loop of this room once, on a few square metres; about 10 s without a cache."""
    geometry = LDS_01
    prior = OccupancyGrid(np.zeros((60, 60), dtype=np.int8), 0.05, (0.0, 0.0))
    pose = Pose2D(1.5, 1.5, 0.0)
    # The planners' own settings differ, their kernels are all of one signature each.
    for settings in (NavigatorSettings(), NavigatorSettings(local_planner=TrajectoryRolloutSettings())):
        navigator = Navigator(prior, settings)
        navigator.set_goal(2.5, 1.5)
        for tick in range(8):
            navigator.observe(pose, np.full(geometry.beams, 2.5), geometry, 0.2 * tick)
            navigator.control(pose, STOP, 0.2 * tick)
        planner: LocalPlanner = navigator.local_planner
        planner.turn_is_legal(navigator.local_costmap, pose, 1.0)
        navigator.local_costmap.published()
        # Shut in on all sides, DWA looks for a way off after two seconds.
        navigator.local_costmap.layer.cells.fill(LETHAL)
        navigator.local_costmap.clear_outside(pose.x, pose.y, 2.0 * navigator.settings.local_costmap.size_m)
        for tick in range(16, 46):
            navigator.control(pose, STOP, 0.1 * tick)
