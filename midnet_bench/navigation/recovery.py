"""What a navigator does when it is stuck: forget distant obstacles, look around."""

import math

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.messages import Command
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.footprint import Footprint, corner_array
from midnet_bench.navigation.rollout_kernels import turn_is_free

_ACCELERATION_RADPS2 = 3.2
_FASTEST_RADPS = 1.0
_SLOWEST_RADPS = 0.4
_TOLERANCE_RAD = 0.10


class RotateRecovery:
    """One full turn to the left on the spot (rotate_recovery, with the limits of TrajectoryPlannerROS).

    The turn is measured by adding up heading changes. The original waits to find itself within 0.1 rad of the
    opposite heading and then of the first one, which a robot that turns fast between two looks can miss.
    """

    def __init__(self, footprint: Footprint, resolution: float, yaw: float) -> None:
        self._footprint_cells = corner_array(footprint) / resolution
        self._yaw = yaw
        self._turned_rad = 0.0

    def command(self, costmap: RollingCostmap, pose: Pose2D) -> Command | None:
        """The velocity to go on turning with; None when the turn is done or its rest would hit something."""
        self._turned_rad += wrap_angle(pose.yaw - self._yaw)
        self._yaw = pose.yaw
        left = 2.0 * math.pi - self._turned_rad
        if left <= _TOLERANCE_RAD:
            return None
        x, y = costmap.layer.to_cells(pose.x, pose.y)
        if not turn_is_free(costmap.costs, x, y, float(pose.yaw), left, self._footprint_cells):
            return None
        speed = math.sqrt(2.0 * _ACCELERATION_RADPS2 * left)
        return Command(0.0, min(max(speed, _SLOWEST_RADPS), _FASTEST_RADPS))
