"""What the navigator asks of a local planner, whichever it is."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.costmap_kernels import clear_polygon, placed
from midnet_bench.navigation.limits import LocalPlannerLimits
from midnet_bench.navigation.map_grid import local_grids

Plan = npt.NDArray[np.float64]
"""(N, 2) points in the costmap's frame, metres, from the robot to where the plan leaves the window or ends"""


class LocalPlanner(Protocol):
    """Turns a plan into velocities, ten times a second."""

    @property
    def limits(self) -> LocalPlannerLimits:
        """What the robot may do."""

    def forget(self) -> None:
        """Drop what was remembered against oscillation: there is a new goal or another way to it."""

    def command(self, costmap: RollingCostmap, plan: Plan, pose: Pose2D, velocity: Command) -> Command | None:
        """The velocity to drive now; None when no motion is legal."""

    def turn_is_legal(self, costmap: RollingCostmap, pose: Pose2D, turn_radps: float) -> bool:
        """Whether turning on the spot at this rate for the planner's horizon hits nothing."""


class LocalGoalGrids:
    """The distance grids of the newest plan in the newest local costmap, made once for both.

    A plan or costmap that is the same object as before gives the grids of before.
    """

    def __init__(self) -> None:
        self._costs: npt.NDArray[np.uint8] | None = None
        self._plan: Plan | None = None
        self._grids: npt.NDArray[np.int32] | None = None

    def grids(
        self,
        costmap: RollingCostmap,
        plan: Plan,
        pose: Pose2D,
        forward_m: float,
        freed: npt.NDArray[np.float64] | None = None,
    ) -> npt.NDArray[np.int32]:
        """``map_grid.local_grids``: for the third, the plan's end is pushed ahead by ``forward_m``.

        Cells under ``freed``, a footprint in cells, count as free where the robot stands.
        """
        if self._grids is None or costmap.costs is not self._costs or plan is not self._plan:
            costs = costmap.costs
            if freed is not None:
                costs = costs.copy()
                clear_polygon(costs, placed(freed, (*costmap.layer.to_cells(pose.x, pose.y), pose.yaw)))
            self._grids = np.asarray(
                local_grids(
                    costs,
                    plan,
                    costmap.origin,
                    costmap.settings.resolution,
                    (pose.x, pose.y),
                    forward_m,
                )
            )
            self._costs, self._plan = costmap.costs, plan
        return self._grids
