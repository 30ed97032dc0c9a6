"""The global plan to one goal: navfn's potential and the paths down it, computed anew only when need be."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import hypot
from midnet_bench.geometry import Floats, Indices, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import (
    INSCRIBED,
    LETHAL,
    NO_INFORMATION,
    NOWHERE,
    SINCE_PLAN,
    Cells,
    GlobalCostmap,
    inflation_costs,
    reach_cells,
)
from midnet_bench.navigation.local_planner import Plan
from midnet_bench.navigation.navigation_settings import radii

Potentials = npt.NDArray[np.float32]

UNREACHED = np.float32(1e10)  # potential of a cell that the wave did not reach
NEUTRAL = 50  # traversal cost of a free cell
UNSEEN = 253  # traversal cost of unknown cells where they are allowed: very dear, not blocked
BLOCKED = 254  # traversal cost of a cell that the wave does not enter

_ESCAPE_CELLS = 3
"""how far a start without potential (a robot that touches an inflated obstacle) looks for one"""
_REPLAN_PERIOD_S = 1.0  # Least time between two potentials.
_GREATEST_AGE_S = 2.0
"""A potential older than this is made anew once an obstacle has gone, wherever that was: a shorter way may
have opened. move_base makes one at planner_frequency, 5 Hz, whether anything changed or not; ours is an
economy."""
_CHANGE_RADIUS_M = 0.3  # An obstacle so near to the plan that comes or goes calls for another potential.
_MARGIN_M = 2.0  # A robot may go so much farther from its goal before the potential has to be made anew.
_POCKET_M2 = 1.0  # A goal from which the potential reaches less floor than this is closed in.


class GlobalPlanner:
    """Plans to one goal over a global costmap.

    One potential serves until there is a reason for another: none yet, no way down from where the robot is,
    an obstacle that came or went near the plan ahead, or, once it is two seconds old, one that has gone
    anywhere; all away from the static map's walls, whose noise never matters. So a robot has a plan from
    where it is at planner rate, as under move_base, at the price of a trace each time and a potential every
    few seconds; it takes a shorter way up to two seconds later. The wave starts at the goal, navfn's at the
    robot.
    """

    def __init__(self, costmap: GlobalCostmap, goal_tolerance_m: float) -> None:
        self._costmap = costmap
        self._goal_tolerance_m = goal_tolerance_m
        self._change_cells = reach_cells(_CHANGE_RADIUS_M, costmap.settings.resolution)
        tight_m = radii(costmap.settings.footprint)[1]
        self._tight_cost = max(1, int(inflation_costs(costmap.settings, tight_m)[-1]))
        """the inflated cost at about the circumscribed radius from an obstacle"""
        self._potential: Potential | None = None
        self._obstacles_then = costmap.marks
        self._computed_at_s = -math.inf
        self._doubted = False
        self.is_covered = False
        """whether, at the newest potential, obstacles that are not on the map left no room at the goal"""

    def reset(self) -> None:
        """Start anew: another goal, or costs that changed by more than scans."""
        self._potential = None
        self._computed_at_s = -math.inf
        self.is_covered = False

    def invalidate_plan(self) -> None:
        """Ask for another potential as soon as the period allows: the plan could not be followed."""
        self._doubted = True

    def plan(self, goal: Point, pose: Pose2D, time_s: float, until_m: float) -> Plan | None:
        """The way from the robot up to its first point farther than ``until_m``; None when there is none."""
        costmap, then = self._costmap, self._obstacles_then
        path = self._potential.path_from(pose.x, pose.y, until_m) if self._potential else None
        if path is not None and not self._doubted and costmap.marks.shape == then.shape:
            place = costmap.origin, costmap.settings.resolution, self._change_cells
            is_old = time_s - self._computed_at_s > _GREATEST_AGE_S
            if not changed_near(costmap.marks, then, costmap.static_costs, path, *place) and not (
                is_old and have_gone(costmap.marks, then, costmap.static_costs, costmap.touched[SINCE_PLAN])
            ):
                return path
        if time_s - self._computed_at_s < _REPLAN_PERIOD_S:
            return path
        costs = self._grid(costmap.costs)
        self._potential = potential_to(goal, costs, near=(pose.x, pose.y), tolerance_m=self._goal_tolerance_m)
        self._obstacles_then = costmap.marks.copy()
        costmap.touched[SINCE_PLAN] = NOWHERE
        self._computed_at_s = time_s
        self.is_covered = self._has_no_room_at(goal)
        # A goal that plans end beside is looked at again as often as the period allows.
        self._doubted = self._potential is not None and self._potential.goal != goal
        return self._potential.path_from(pose.x, pose.y, until_m) if self._potential else None

    def is_blocked(self, goal: Point, costs: Cells) -> bool:
        """Whether no plan can end in the goal's own cell: off the map, on its border, or in collision."""
        x, y = self._costmap.to_cells(*goal)
        height, width = costs.shape
        if not (1.0 <= x < width - 1 and 1.0 <= y < height - 1):
            return True
        return int(costs[int(y), int(x)]) in (INSCRIBED, LETHAL)

    def is_walled_off(self, goal: Point, pose: Pose2D) -> bool:
        """Whether the static map alone, without any obstacle layer, has no way from the robot to the goal."""
        potential = potential_to(goal, self._grid(self._costmap.static_costs), near=(pose.x, pose.y))
        return potential is None or potential.path_from(pose.x, pose.y) is None

    def whole_plan(self, pose: Pose2D) -> Plan | None:
        """The way from the robot to the goal by the newest potential."""
        return self._potential.path_from(pose.x, pose.y) if self._potential else None

    def _grid(self, costs: Cells) -> OccupancyGrid:
        return OccupancyGrid(costs, self._costmap.settings.resolution, self._costmap.origin)

    def _has_no_room_at(self, goal: Point) -> bool:
        """Whether a scanned obstacle lies within the circumscribed radius of the goal, or all round it.

        A LiDAR sees an obstacle's skin only, so what stands on a goal may leave free cells inside.
        """
        x, y = self._costmap.to_cells(*goal)
        height, width = self._costmap.static_costs.shape
        if self._potential is None or not (0.0 <= x < width and 0.0 <= y < height):
            return self.is_blocked(goal, self._costmap.costs)
        cell = int(y), int(x)
        if self._costmap.costs[cell] >= self._tight_cost > self._costmap.static_costs[cell]:
            return True
        cell_m = self._costmap.settings.resolution
        return self._potential.reached * cell_m * cell_m < _POCKET_M2


@dataclass(frozen=True, eq=False)
class Potential:
    """The cost of the way to ``goal`` from every cell that matters."""

    values: Potentials  # (H, W), 1e10 where the wave did not come
    resolution: float
    origin: Point
    goal: Point
    settled_below: float  # potentials below this are final; a robot beyond it needs another wave
    reached: int  # how many cells the wave came to

    def path_from(self, x: float, y: float, until_m: float = math.inf) -> Floats | None:
        """(N, 2) points to the goal exactly, or to the first farther than ``until_m``, metres; or None.

        Unlike navfn's, the potential belongs to cell centres (no half cell to the lower left), a path that
        could not be finished is None rather than a stump, its length is bounded by the map's area rather than
        by 4 widths, and where the descent vanishes (an obstacle dead ahead) the lowest neighbour is taken.
        """
        place = self.origin, self.resolution
        points, found = path_down(self.values, (x, y), self.goal, *place, self.settled_below, until_m)
        return np.asarray(points) if found else None


def potential_to(
    goal: Point, costs: OccupancyGrid, near: Point | None = None, tolerance_m: float = 0.0
) -> Potential | None:
    """The potential of ``goal`` over a costmap's costs (uint8); None when the goal's cell is blocked.

    With ``near`` (the robot) the wave ends once everything is settled that lies up to ``_MARGIN_M`` of free
    driving farther than it; without, the whole map is covered. With ``tolerance_m`` a blocked goal gives way
    to the centre of the nearest cell within that distance that is not; the potential's ``goal`` tells.
    """
    column, row = costs.cell_at(*goal)
    if not (0 < column < costs.width - 1 and 0 < row < costs.height - 1):
        return None
    traversal = traversal_costs(costs.data)
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
            margin = _MARGIN_M / costs.resolution * NEUTRAL
    values, settled_below, reached = propagate(traversal, goal_cell, start_cell, margin)
    return Potential(np.asarray(values), costs.resolution, costs.origin, goal, settled_below, reached)


def _nearest_open(traversal: Cells, column: int, row: int, radius: int) -> tuple[int, int] | None:
    """(column, row) of the nearest cell within ``radius`` cells that the wave may enter; first in a tie."""
    x0, y0 = max(column - radius, 0), max(row - radius, 0)
    rows, columns = np.nonzero(traversal[y0 : row + radius + 1, x0 : column + radius + 1] < BLOCKED)
    squared = np.square(rows + y0 - row) + np.square(columns + x0 - column)
    if not len(squared) or squared.min() > radius * radius:
        return None
    nearest = int(np.argmin(squared))
    return int(columns[nearest]) + x0, int(rows[nearest]) + y0


_TRAVERSAL = np.full(256, BLOCKED, dtype=np.uint8)  # (256,) what a cell of each cost takes to traverse
_TRAVERSAL[:INSCRIBED] = NEUTRAL + 4 * np.arange(INSCRIBED) // 5
_TRAVERSAL[NO_INFORMATION] = UNSEEN  # navfn, allow_unknown


def traversal_costs(costs: Cells) -> Cells:
    """(H, W) uint8 cost of entering each cell: 50 to 251, 254 where blocked, as the outer ring is."""
    traversal = np.asarray(cv2.LUT(costs, _TRAVERSAL), dtype=np.uint8)
    traversal[0] = traversal[-1] = BLOCKED
    traversal[:, 0] = traversal[:, -1] = BLOCKED
    return traversal


@njit
def propagate(traversal: Cells, goal: int, start: int, margin: float) -> tuple[Potentials, float, int]:
    """(H, W) float32 potential, 0 in the goal cell; the settled bound; how many cells the wave came to.

    The potential is 1e10 where the wave did not come.

    ``traversal``: (H, W) uint8 whose outer border is blocked. ``goal`` and ``start`` are flat cell indices.
    The wave stops once everything up to ``margin`` above the potential of ``start`` is settled; potentials
    below the returned bound are final. Cells are taken in bands of potential 100 wide, not from a heap, and
    may be improved several times within their band. Arithmetic is in single precision, as navfn's own.
    """
    width = traversal.shape[1]
    cost = traversal.reshape(-1)
    potential = np.full(cost.size, UNREACHED, dtype=np.float32)
    # Unsigned, so that no index is asked whether it counts from the end; steps back wrap round.
    left, right = np.uint32(np.int64(-1)), np.uint32(1)
    down, up = np.uint32(np.int64(-width)), np.uint32(width)
    entry = cost.copy()  # what a cell costs to enter, or BLOCKED while it waits its turn already
    # one more than there are cells: what is not queued is written too, behind the last
    current = np.empty(cost.size + 1, dtype=np.uint32)
    following = np.empty(cost.size + 1, dtype=np.uint32)
    overflow = np.empty(cost.size + 1, dtype=np.uint32)
    n_current, n_following, n_overflow = 0, np.uint32(0), np.uint32(0)
    potential[goal] = 0.0
    reached = 1
    for step in (left, right, down, up):
        other = np.uint32(np.uint32(goal) + step)
        if cost[other] < BLOCKED:
            entry[other] = BLOCKED
            current[n_current] = other
            n_current += 1
    threshold = np.float32(BLOCKED)
    while n_current > 0:
        for i in range(n_current):
            entry[current[i]] = cost[current[i]]
        for i in range(n_current):
            cell = current[i]
            h = np.float32(cost[cell])
            west, east = np.uint32(cell + left), np.uint32(cell + right)
            south, north = np.uint32(cell + down), np.uint32(cell + up)
            a = min(potential[west], potential[east])
            b = min(potential[south], potential[north])
            x = np.float32(abs(a - b) / h)
            rise = h * (np.float32(0.7040) + x * (np.float32(0.5307) - np.float32(0.2301) * x))
            value = np.float32(min(a, b) + (h if x >= np.float32(1.0) else rise))
            if value >= potential[cell]:
                continue
            reached += potential[cell] == UNREACHED
            potential[cell] = value
            # Each neighbour is written behind the queue's end, which moves on if it is to stay: no branch,
            # which the processor would guess wrong half the time.
            is_in_band = value < threshold
            queue, end = (following, n_following) if is_in_band else (overflow, n_overflow)
            for other in (west, east, south, north):
                dear = entry[other]
                stays = (dear < BLOCKED) & (
                    potential[other] > value + np.float32(0.70710678) * np.float32(dear)
                )
                queue[end] = other
                end += np.uint32(stays)
                entry[other] = np.uint8(BLOCKED) if stays else dear
            if is_in_band:
                n_following = end
            else:
                n_overflow = end
        current, following = following, current
        n_current, n_following = int(n_following), np.uint32(0)
        if n_current == 0:
            if threshold > potential[start] + margin:
                return potential.reshape(traversal.shape), float(threshold), reached
            threshold += np.float32(2 * NEUTRAL)
            current, overflow = overflow, current
            n_current, n_overflow = int(n_overflow), np.uint32(0)
    return potential.reshape(traversal.shape), float(UNREACHED), reached


@njit
def path_down(
    potential: Potentials,
    start: Point,
    goal: Point,
    origin: Point,
    resolution: float,
    settled_below: float,
    until_m: float,
) -> tuple[Floats, bool]:
    """(N, 2) points in metres from ``start`` to ``goal`` or to the first one farther than ``until_m``.

    Beside it whether there is such a way; there is none from off the map, nor from where the wave was cut off
    (``settled_below``), whence it might be a detour.

    Steps are half a cell along the bilinearly interpolated descent; where a potential is missing around the
    point, or the descent vanishes or swings to and fro, the step goes to the lowest neighbour instead. Where
    the descent goes round in a wider circle, the path begins anew and takes such steps alone. A start
    without any potential around it is first moved to the lowest cell within ``_ESCAPE_CELLS``.
    """
    height, width = potential.shape
    # in cells, with cell centres at whole numbers
    start_x = (start[0] - origin[0]) / resolution - 0.5
    start_y = (start[1] - origin[1]) / resolution - 0.5
    limit = height * width // 2 + 2
    points = np.empty((limit + 1, 2), dtype=np.float64)
    if not (-0.5 <= start_x < width - 0.5 and -0.5 <= start_y < height - 0.5):
        return points[:0].copy(), False
    x, y = math.floor(start_x), math.floor(start_y)
    offset_x, offset_y = start_x - x, start_y - y
    search, count, found, is_smooth = 1, 0, False, True
    while count < limit or is_smooth:
        if count == limit:
            count, is_smooth = 0, False
            x, y = math.floor(start_x), math.floor(start_y)
            offset_x, offset_y = start_x - x, start_y - y
        if not (1 <= x <= width - 2 and 1 <= y <= height - 2):
            # The outermost ring never carries a potential.
            if count == 0:
                points[0, 0], points[0, 1] = start_x, start_y
                count = 1
            x = min(max(x + (offset_x >= 0.5), 1), width - 2)
            y = min(max(y + (offset_y >= 0.5), 1), height - 2)
            offset_x, offset_y = 0.0, 0.0
        points[count, 0], points[count, 1] = x + offset_x, y + offset_y
        count += 1
        near_x, near_y = x + (offset_x >= 0.5), y + (offset_y >= 0.5)
        way = hypot(x + offset_x - start_x, y + offset_y - start_y)
        found = way > until_m / resolution or potential[near_y, near_x] < NEUTRAL
        if found:
            break
        swings = (
            count > 2
            and points[count - 1, 0] == points[count - 3, 0]
            and points[count - 1, 1] == points[count - 3, 1]
        )
        if is_smooth and not swings and potential[y - 1 : y + 2, x - 1 : x + 2].max() < UNREACHED:
            a, b = _descent(potential, x, y), _descent(potential, x + 1, y)
            c, d = _descent(potential, x, y + 1), _descent(potential, x + 1, y + 1)
            down_x = _between(a[0], b[0], c[0], d[0], offset_x, offset_y)
            down_y = _between(a[1], b[1], c[1], d[1], offset_x, offset_y)
            norm = hypot(down_x, down_y)
            if norm > 0.0:
                offset_x += 0.5 * down_x / norm
                offset_y += 0.5 * down_y / norm
                shift_x, shift_y = math.floor(offset_x), math.floor(offset_y)
                x, y = x + shift_x, y + shift_y
                offset_x, offset_y = offset_x - shift_x, offset_y - shift_y
                continue
        if count == 1 and potential[near_y, near_x] >= UNREACHED:
            search = _ESCAPE_CELLS
        x, y = _lowest_beside(potential, near_x, near_y, search)
        search = 1
        offset_x, offset_y = 0.0, 0.0
        if x == near_x and y == near_y:
            break
    first = min(1, count - 1)
    if not found or potential[round(points[first, 1]), round(points[first, 0])] >= settled_below:
        return points[:0].copy(), False
    points[:count] = (points[:count] + 0.5) * resolution + np.array(origin)
    if not hypot(points[count - 1, 0] - start[0], points[count - 1, 1] - start[1]) > until_m:
        points[count, 0], points[count, 1] = goal
        count += 1
    return points[:count].copy(), True


@njit
def _between(a: float, b: float, c: float, d: float, x: float, y: float) -> float:
    """The bilinear interpolation of lower left, lower right, upper left and upper right."""
    return (1.0 - y) * ((1.0 - x) * a + x * b) + y * ((1.0 - x) * c + x * d)


@njit
def _lowest_beside(potential: Potentials, column: int, row: int, radius: int) -> tuple[int, int]:
    """(column, row) of the lowest other cell within a square; the cell itself where none has a potential."""
    height, width = potential.shape
    lowest = UNREACHED
    x, y = column, row
    for j in range(max(row - radius, 1), min(row + radius + 1, height - 1)):
        for i in range(max(column - radius, 1), min(column + radius + 1, width - 1)):
            if (i != column or j != row) and potential[j, i] < lowest:
                lowest = potential[j, i]
                x, y = i, j
    return x, y


@njit
def _descent(potential: Potentials, x: int, y: int) -> tuple[float, float]:
    """The unit vector downhill at a cell, from differences to those neighbours that have a potential."""
    here = np.float64(potential[y, x])
    dx, dy = 0.0, 0.0
    if potential[y, x - 1] < UNREACHED:
        dx += potential[y, x - 1] - here
    if potential[y, x + 1] < UNREACHED:
        dx += here - potential[y, x + 1]
    if potential[y - 1, x] < UNREACHED:
        dy += potential[y - 1, x] - here
    if potential[y + 1, x] < UNREACHED:
        dy += here - potential[y + 1, x]
    norm = hypot(dx, dy)
    return (dx / norm, dy / norm) if norm > 0.0 else (0.0, 0.0)


@njit
def changed_near(
    now: Cells, then: Cells, static_costs: Cells, path: Plan, origin: Point, resolution: float, radius: int
) -> bool:
    """Whether any cell within a square of ``radius`` cells around a path began or ceased to be lethal.

    Cells whose static cost is 253 or more do not count: they are walls, or next to one. Nor does a cell
    whose neighbour was lethal before it came or is after it went: a surface that noise moves by a cell is
    where it was. ``path``: (N, 2) metres, half a cell apart; every fourth point is looked at.
    """
    height, width = now.shape
    column = row = -2 * radius - 1
    for i in range(0, len(path), 4):
        before, under = column, row
        column = int((path[i, 0] - origin[0]) / resolution)
        row = int((path[i, 1] - origin[1]) / resolution)
        for y in range(max(row - radius, 0), min(row + radius + 1, height)):
            first, last = max(column - radius, 0), min(column + radius + 1, width)
            if abs(y - under) <= radius:  # a row of the square before: what lies beside that is new
                if column >= before:
                    first = max(first, before + radius + 1)
                else:
                    last = min(last, before - radius)
            for x in range(first, last):
                is_lethal, was_lethal = now[y, x] == LETHAL, then[y, x] == LETHAL
                if is_lethal == was_lethal or static_costs[y, x] >= INSCRIBED:
                    continue
                without = then if is_lethal else now
                beside = without[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
                if not (beside == LETHAL).any():
                    return True
    return False


@njit
def have_gone(now: Cells, then: Cells, static_costs: Cells, within: Indices) -> bool:
    """Whether any cell of a rectangle ceased to be lethal, by the rule of ``changed_near``.

    ``within``: (4,) x0, y0, x1, y1 in cells.
    """
    x0, y0, x1, y1 = within
    for y in range(y0, y1):
        if not _has_gone(now[y, x0:x1], then[y, x0:x1], static_costs[y, x0:x1]):
            continue
        for x in range(x0, x1):
            if then[y, x] != LETHAL or now[y, x] == LETHAL or static_costs[y, x] >= INSCRIBED:
                continue
            if not (now[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2] == LETHAL).any():
                return True
    return False


@njit
def _has_gone(now: Cells, then: Cells, static_costs: Cells) -> bool:
    """Whether any cell of a row ceased to be lethal, away from the map's walls."""
    found = 0
    for x in range(len(now)):  # without a branch: the compiler takes many cells at once
        found |= (then[x] == LETHAL) & (now[x] != LETHAL) & (static_costs[x] < INSCRIBED)
    return found != 0
