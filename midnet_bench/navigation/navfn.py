"""navfn: a potential that grows with the cost of the way from a goal, and paths down it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.cost_values import INSCRIBED, NO_INFORMATION
from midnet_bench.navigation.navfn_kernels import BLOCKED, NEUTRAL, UNREACHED, path_down, propagate

_UNKNOWN = 253
"""traversal cost of unknown cells where they are allowed: very dear, not blocked"""

_ESCAPE_CELLS = 3
"""how far a start without potential (a robot that touches an inflated obstacle) looks for one"""


@dataclass(frozen=True, eq=False)
class Potential:
    """The cost of the way to ``goal`` from every cell that matters.

    navfn sends its wave from the robot and traces back from the goal, anew for every plan. Here the wave
    starts at the goal, so that one potential serves every later position of the robot for as long as the
    costs hold: planning again is only tracing again, which has the effect of planning at that rate.
    """

    values: npt.NDArray[np.float32]
    """(H, W), 1e10 where the wave did not come"""
    resolution: float
    origin: tuple[float, float]
    goal: tuple[float, float]
    settled_below: float
    """potentials below this are final; a robot beyond it needs another wave"""

    def path_from(self, x: float, y: float, until_m: float = math.inf) -> npt.NDArray[np.float64] | None:
        """(N, 2) points from (x, y) to the goal exactly, metres, half a cell apart; None without a way.

        With ``until_m`` the path ends at its first point farther than that from (x, y). Unlike navfn's, the
        potential belongs to cell centres (no half cell to the lower left), a path that could not be finished
        is None rather than a stump, its length is bounded by the map's area rather than by 4 widths, and
        where the descent vanishes (an obstacle dead ahead) the lowest neighbour is taken.
        """
        points, found = path_down(
            self.values,
            (x, y),
            self.origin,
            self.resolution,
            self.goal,
            self.settled_below,
            _ESCAPE_CELLS,
            until_m,
        )
        return np.asarray(points) if found else None


def traversal_costs(costs: npt.NDArray[np.uint8], allow_unknown: bool = True) -> npt.NDArray[np.uint8]:
    """(H, W) uint8 cost of entering each cell: 50 to 251, 254 where blocked, as the outer ring is."""
    traversal = np.asarray(cv2.LUT(costs, _TRAVERSAL[allow_unknown]), dtype=np.uint8)
    traversal[0] = traversal[-1] = BLOCKED
    traversal[:, 0] = traversal[:, -1] = BLOCKED
    return traversal


def potential_to(
    goal: tuple[float, float],
    costs: OccupancyGrid,
    near: tuple[float, float] | None = None,
    margin_m: float = 2.0,
    allow_unknown: bool = True,
    tolerance_m: float = 0.0,
) -> Potential | None:
    """The potential of ``goal`` over a costmap's costs (uint8); None when the goal's cell is blocked.

    With ``near`` (the robot) the wave ends once everything is settled that lies up to ``margin_m`` of free
    driving farther than it; without, the whole map is covered. With ``tolerance_m`` a blocked goal gives way
    to the centre of the nearest cell within that distance that is not; the potential's ``goal`` tells.
    """
    column, row = costs.cell_at(*goal)
    if not (0 < column < costs.width - 1 and 0 < row < costs.height - 1):
        return None
    traversal = traversal_costs(costs.data, allow_unknown)
    if traversal[row, column] >= BLOCKED:
        found = _nearest_open(traversal, column, row, int(tolerance_m / costs.resolution))
        if found is None:
            return None
        column, row = found
        goal = costs.center_of(column, row)
    goal_cell, start_cell, margin = row * costs.width + column, 0, float(UNREACHED)
    if near is not None:
        near_column, near_row = costs.cell_at(*near)
        if costs.contains_cell(near_column, near_row):
            start_cell = near_row * costs.width + near_column
            margin = margin_m / costs.resolution * NEUTRAL
    values, settled_below = propagate(traversal, goal_cell, start_cell, margin)
    return Potential(np.asarray(values), costs.resolution, costs.origin, goal, float(settled_below))


def _nearest_open(
    traversal: npt.NDArray[np.uint8], column: int, row: int, radius: int
) -> tuple[int, int] | None:
    """(column, row) of the nearest cell within ``radius`` cells that the wave may enter; first in a tie."""
    x0, y0 = max(column - radius, 0), max(row - radius, 0)
    rows, columns = np.nonzero(traversal[y0 : row + radius + 1, x0 : column + radius + 1] < BLOCKED)
    squared = (rows + y0 - row) ** 2 + (columns + x0 - column) ** 2
    if not len(squared) or squared.min() > radius * radius:
        return None
    nearest = int(np.argmin(squared))
    return int(columns[nearest]) + x0, int(rows[nearest]) + y0


def _traversal_table(allow_unknown: bool) -> npt.NDArray[np.uint8]:
    cost = np.arange(256)
    table = np.where(cost < INSCRIBED, NEUTRAL + 4 * cost // 5, BLOCKED).astype(np.uint8)
    if allow_unknown:
        table[NO_INFORMATION] = _UNKNOWN
    return table


_TRAVERSAL = {allowed: _traversal_table(allowed) for allowed in (False, True)}
