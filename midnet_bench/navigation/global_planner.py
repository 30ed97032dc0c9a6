"""The global plan to one goal, kept up to date at the least cost."""

import numpy as np
from numba import njit

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import (
    INSCRIBED,
    LETHAL,
    NO_INFORMATION,
    Cells,
    GlobalCostmap,
    inflation_costs,
    reach_cells,
)
from midnet_bench.navigation.local_planner import Plan
from midnet_bench.navigation.navfn import UNREACHED, Potential, potential_to
from midnet_bench.navigation.settings import CostmapSettings, radii

_POCKET_M2 = 1.0
"""A goal from which the potential reaches less floor than this is closed in."""


class GlobalPlanner:
    """Plans to one goal over a global costmap.

    One potential serves until there is a reason for another: none yet, no way down from where the robot is,
    or an obstacle that came or went near the plan ahead, away from the walls of the static map (whose noise
    changes all the time and never matters). So a robot has a plan from where it is at planner rate, as under
    move_base, at the price of a trace each time and a potential once in several seconds.
    """

    def __init__(
        self,
        costmap: GlobalCostmap,
        allow_unknown: bool,
        goal_tolerance_m: float,
        wave_period_s: float,
        change_radius_m: float,
    ) -> None:
        self._costmap = costmap
        self._allow_unknown = allow_unknown
        self._goal_tolerance_m = goal_tolerance_m
        self._period_s = wave_period_s
        self._change_cells = reach_cells(change_radius_m, costmap.settings.resolution)
        self._tight_cost = _cost_at(costmap.settings, radii(costmap.settings.footprint)[1])
        self._potential: Potential | None = None
        self._obstacles_then = costmap.layer.cells
        self._computed_at_s: float | None = None
        self._doubted = False
        self.is_covered = False
        """whether, at the newest potential, obstacles that are not on the map left no room at the goal"""

    def reset(self) -> None:
        """Start anew: another goal, or costs that changed by more than scans."""
        self._potential = None
        self._computed_at_s = None
        self.is_covered = False

    def doubt(self) -> None:
        """Ask for another potential as soon as ``wave_period_s`` allows: the plan could not be followed."""
        self._doubted = True

    def plan(self, goal: tuple[float, float], pose: Pose2D, time_s: float, until_m: float) -> Plan | None:
        """The way from the robot up to its first point farther than ``until_m``; None when there is none."""
        path = self._potential.path_from(pose.x, pose.y, until_m) if self._potential else None
        if path is not None and not self._doubted and not self._changed_near(path):
            return path
        if self._computed_at_s is not None and time_s - self._computed_at_s < self._period_s:
            return path
        self._compute_potential(goal, pose, time_s)
        return self._potential.path_from(pose.x, pose.y, until_m) if self._potential else None

    def is_blocked(self, goal: tuple[float, float], costs: Cells) -> bool:
        """Whether no plan can end in the goal's own cell: off the map, on its border, or in collision."""
        x, y = self._costmap.layer.to_cells(*goal)
        height, width = costs.shape
        if not (1.0 <= x < width - 1 and 1.0 <= y < height - 1):
            return True
        cost = int(costs[int(y), int(x)])
        return cost >= INSCRIBED and not (cost == NO_INFORMATION and self._allow_unknown)

    def is_walled_off(self, goal: tuple[float, float], pose: Pose2D) -> bool:
        """Whether the static map alone, without any obstacle layer, has no way from the robot to the goal."""
        costs = OccupancyGrid(
            self._costmap.static_costs, self._costmap.settings.resolution, self._costmap.origin
        )
        potential = potential_to(goal, costs, near=(pose.x, pose.y), allow_unknown=self._allow_unknown)
        return potential is None or potential.path_from(pose.x, pose.y) is None

    def whole_plan(self, pose: Pose2D) -> Plan | None:
        """The way from the robot to the goal by the newest potential; for drawing."""
        return self._potential.path_from(pose.x, pose.y) if self._potential else None

    def _compute_potential(self, goal: tuple[float, float], pose: Pose2D, time_s: float) -> None:
        costmap = self._costmap
        costs = OccupancyGrid(costmap.costs, costmap.settings.resolution, costmap.origin)
        self._potential = potential_to(
            goal,
            costs,
            near=(pose.x, pose.y),
            allow_unknown=self._allow_unknown,
            tolerance_m=self._goal_tolerance_m,
        )
        self._obstacles_then = costmap.layer.cells.copy()
        self._computed_at_s = time_s
        self.is_covered = self._has_no_room_at(goal)
        # A goal that plans end beside is looked at again as often as the period allows.
        self._doubted = self._potential is not None and self._potential.goal != goal

    def _has_no_room_at(self, goal: tuple[float, float]) -> bool:
        """Whether a scanned obstacle lies within the circumscribed radius of the goal, or all round it.

        A LiDAR sees an obstacle's skin only, so what stands on a goal may leave free cells inside.
        """
        x, y = self._costmap.layer.to_cells(*goal)
        height, width = self._costmap.static_costs.shape
        if self._potential is None or not (0.0 <= x < width and 0.0 <= y < height):
            return self.is_blocked(goal, self._costmap.costs)
        cell = int(y), int(x)
        if self._costmap.costs[cell] >= self._tight_cost > self._costmap.static_costs[cell]:
            return True
        reached = np.count_nonzero(self._potential.values < UNREACHED)
        return bool(reached * self._costmap.settings.resolution**2 < _POCKET_M2)

    def _changed_near(self, path: Plan) -> bool:
        now, then = self._costmap.layer.cells, self._obstacles_then
        if now.shape != then.shape:
            return True
        return bool(
            changed_near(
                now,
                then,
                self._costmap.static_costs,
                path,
                self._costmap.origin,
                self._costmap.settings.resolution,
                self._change_cells,
            )
        )


def _cost_at(settings: CostmapSettings, distance_m: float) -> int:
    """The inflated cost at about a distance from an obstacle."""
    cells = reach_cells(distance_m, settings.resolution)
    table = inflation_costs(
        cells, settings.resolution, settings.inscribed_radius_m, settings.cost_scaling_factor
    )
    return max(1, int(table[-1]))


@njit(cache=True)
def changed_near(
    now: Cells,
    then: Cells,
    static_costs: Cells,
    path: Plan,
    origin: tuple[float, float],
    resolution: float,
    radius: int,
) -> bool:
    """Whether any cell within a square of ``radius`` cells around a path began or ceased to be lethal.

    Cells whose static cost is 253 or more do not count: they are walls, or next to one. Nor does a cell
    whose neighbour was lethal before it came or is after it went: a surface that noise moves by a cell is
    where it was. ``path``: (N, 2) metres, half a cell apart; every fourth point is looked at.
    """
    height, width = now.shape
    for i in range(0, len(path), 4):
        column = int((path[i, 0] - origin[0]) / resolution)
        row = int((path[i, 1] - origin[1]) / resolution)
        for y in range(max(row - radius, 0), min(row + radius + 1, height)):
            for x in range(max(column - radius, 0), min(column + radius + 1, width)):
                is_lethal, was_lethal = now[y, x] == LETHAL, then[y, x] == LETHAL
                if is_lethal == was_lethal or static_costs[y, x] >= INSCRIBED:
                    continue
                if not _lethal_beside(then if is_lethal else now, x, y):
                    return True
    return False


@njit(cache=True)
def _lethal_beside(cells: Cells, column: int, row: int) -> bool:
    height, width = cells.shape
    for y in range(max(row - 1, 0), min(row + 2, height)):
        for x in range(max(column - 1, 0), min(column + 2, width)):
            if cells[y, x] == LETHAL:
                return True
    return False
