"""Where a robot should drive next: explore_lite's frontiers, then gaps in walls; and where to park."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from midnet_bench.compiled import njit
from midnet_bench.geometry import Booleans, Floats, Indices, Point, Pose2D, lengths
from midnet_bench.grid import OCCUPIED_FROM, UNKNOWN, OccupancyGrid, values_at

Steps = npt.NDArray[np.int32]

# The parameters of explore_lite (explore_costmap.launch), and those of the repairs made here.
POTENTIAL_SCALE, GAIN_SCALE = 3.0, 1.0
MIN_FRONTIER_SIZE_M = 0.5
PROGRESS_TIMEOUT_S = 30.0
BLACKLIST_HALF_WIDTH_M = 0.5  # explore_lite has 5 cells, 0.25 m
SECOND_CHANCES = 1  # explore_lite never empties its blacklist
TRAVERSABLE_BELOW = 99  # explore_lite's search follows falling costs alone
TAKEN_RADIUS_M = 2.0  # explore_lite knows no other robots
MIN_GAP_M = 0.1  # two cells; a gap of one lies within a cell of walls on both sides
VIEW_M = 1.0  # beams are 1.7 cm apart there, a third of a cell
LOOK_RADIUS_M = 0.5  # as far as a blacklisted goal counts

_OUT_OF_REACH, _SECOND, _GAP = 1e9, 1e6, 1e3
"""costs above any other: of a frontier that the robot cannot reach, of one that another robot is sent to, of
a gap in a wall: while there are frontiers, it may close by itself"""

_LEAST_FREE_M2 = 0.25
"""Five metres of a hole one cell wide, or a square of half a metre: less is no room to drive in."""

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


class Frontier(NamedTuple):
    """A connected border between what a robot can reach and the unknown; metres, the grid's frame."""

    cost: float  # the lower the better
    size_m: float  # number of its unknown cells times the resolution
    distance_m: float  # the way from the robot to its nearest cell, over traversable cells
    centroid: Point  # mean of its unknown cells' centres
    approaches: Floats
    """(K, 2) x, y of the reachable cells that touch it, nearest to the centroid first; or that see a gap"""


class Gap(NamedTuple):
    """A connected border of free cells and unknown ones that touches a wall's end; metres, grid's frame."""

    length_m: float  # number of its unknown cells times the resolution
    place: Point  # centre of its unknown cell nearest to their mean


def wall_gaps(grid: OccupancyGrid) -> list[Gap]:
    """Where walls end though the free space beside them goes on into the unknown, longest first.

    A closed room has none: its walls part each free cell from the unknown. Frontiers that meet no wall are
    left out, and so are specks between beams, unknown areas below a square of ``MIN_GAP_M``, and holes
    between the two faces of a wall, free areas below ``_LEAST_FREE_M2``; here cells join by their sides
    alone. The grid is int8, -1 unknown, 0 to 100, occupied from 65 on; gaps below ``MIN_GAP_M`` are left out.
    """
    unknown, occupied = grid.data == UNKNOWN, grid.data >= OCCUPIED_FROM
    free = _areas_from(~unknown & ~occupied, _LEAST_FREE_M2 / (grid.resolution * grid.resolution))
    unknown = _areas_from(unknown, (MIN_GAP_M / grid.resolution) * (MIN_GAP_M / grid.resolution))
    border, beside_wall = unknown & _dilated(free, _CROSS), _dilated(occupied, np.ones((3, 3)))
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(border.view(np.uint8), connectivity=8)
    gaps = []
    for label in np.unique(labels[border & beside_wall]).tolist():
        length_m = float(stats[label, cv2.CC_STAT_AREA]) * grid.resolution
        if length_m >= MIN_GAP_M - 1e-9:
            column, row = _nearest_first(_cells(labels == label), centroids[label])[0].tolist()
            gaps.append(Gap(length_m, grid.center_of(column, row)))
    return sorted(gaps, key=lambda gap: (-gap.length_m, gap.place))


def find_gaps(costmap: OccupancyGrid, grid: OccupancyGrid, robot: Pose2D, looks: Floats) -> list[Frontier]:
    """The gaps in walls that the robot can see from a place within its reach, cheapest first.

    Their approaches are the reachable cells within ``VIEW_M`` that no wall parts from them, those with the
    most room first; without those near one of ``looks``, (K, 2) x, y of the places at which scans have been
    taken, which have shown what they could. ``grid`` is the map on the costmap's cells, int8, -1 unknown.
    """
    steps = _reach(costmap, robot)[1][1:-1, 1:-1]
    rows, columns = np.nonzero(steps >= 0)
    cells = np.stack((costmap.x_centers[columns], costmap.y_centers[rows]), axis=1)
    costs = costmap.data[rows, columns]
    gaps = []
    for length_m, place in wall_gaps(grid):
        distances_m = lengths(cells - place)
        near = np.flatnonzero(distances_m <= VIEW_M)
        for look in looks[lengths(looks - place) < VIEW_M + LOOK_RADIUS_M]:
            near = near[lengths(cells[near] - look) >= LOOK_RADIUS_M]
        near = near[_see(grid, cells[near], place)]
        if len(near):
            near = near[np.lexsort((distances_m[near], costs[near]))]
            way_m = float(steps[rows[near], columns[near]].min()) * costmap.resolution
            cost = _GAP + POTENTIAL_SCALE * way_m - GAIN_SCALE * length_m
            gaps.append(Frontier(cost, length_m, way_m, place, cells[near]))
    return sorted(gaps, key=lambda gap: gap.cost)


def find_frontiers(costmap: OccupancyGrid, robot: Pose2D) -> list[Frontier]:
    """The frontiers that the robot can reach, cheapest first; empty when there is none.

    As in explore_lite: the search starts at the traversable cell nearest to the robot's and spreads over
    4-neighbours; unknown cells beside any traversable cell, reached or not, are frontier cells, 8-neighbours
    of them one frontier, and a frontier counts if it touches what the search reached; cost =
    ``POTENTIAL_SCALE`` * distance - ``GAIN_SCALE`` * size. Not as in explore_lite, whose slips these are:
    every cell of a frontier counts, towards its centroid too; distance is metres once, not times the
    resolution again, and it is the way along traversable cells (steps in x and y) instead of a straight line
    through walls; any cost below the inscribed radius can be passed, where the package stops at the first
    inflated cell and so finds no frontier in a corridor narrower than two inflation radii.

    ``costmap`` is int8, -1 unknown, 0 to 100 published costs. A robot off it starts from its nearest cell.
    """
    traversable, steps = _reach(costmap, robot)
    border = np.pad(costmap.data == UNKNOWN, 1) & _dilated(traversable, _CROSS)
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(border.view(np.uint8), connectivity=8)
    frontiers = []
    for label in range(1, len(stats)):
        left, low, width, height, count = stats[label].tolist()
        size_m = count * costmap.resolution
        if size_m < MIN_FRONTIER_SIZE_M:
            continue
        around = np.s_[low - 1 : low + height + 1, left - 1 : left + width + 1]
        touching = _cells(_dilated(labels[around] == label, _CROSS) & (steps[around] >= 0))
        if len(touching):
            cells = _nearest_first(touching + np.array([left - 1, low - 1]), centroids[label])
            distance_m = float(steps[cells[:, 1], cells[:, 0]].min()) * costmap.resolution
            cost = POTENTIAL_SCALE * distance_m - GAIN_SCALE * size_m
            column, row = centroids[label].tolist()
            centroid = costmap.center_of(column - 1, row - 1)
            # one cell of padding on either side, and centres half a cell from corners
            approaches = np.asarray(costmap.origin + (cells - 0.5) * costmap.resolution, dtype=np.float64)
            frontiers.append(Frontier(cost, size_m, distance_m, centroid, approaches))
    return sorted(frontiers, key=lambda frontier: frontier.cost)


def assign_frontiers(offers: Sequence[Sequence[Frontier]]) -> list[int | None]:
    """For each robot the place in its own list of the frontier that it is sent to; None if its list is empty.

    Robots get different frontiers, so that the sum of their costs is least: the Hungarian method (Kuhn,
    1955), by which Wurm, Stachniss and Burgard (Coordinated Multi-Robot Exploration using a Segmentation of
    the Environment, IROS 2008) send robots to segments of a map. The cost is explore_lite's, way minus gain,
    as ``find_frontiers`` has it. Where there are fewer frontiers than robots, each has its robot before one
    gets a second. The offers are found on one grid: frontiers of one centroid are one.
    """
    centroids = sorted({frontier.centroid for own in offers for frontier in own})
    if not centroids:
        return [None] * len(offers)
    costs = np.full((len(offers), len(centroids)), _OUT_OF_REACH)
    for robot, own in enumerate(offers):
        for frontier in own:
            costs[robot, centroids.index(frontier.centroid)] = frontier.cost
    rounds = math.ceil(len(offers) / len(centroids))
    _, columns = linear_sum_assignment(np.hstack([costs + _SECOND * k for k in range(rounds)]))
    places = [{frontier.centroid: place for place, frontier in enumerate(own)} for own in offers]
    sent_to = [centroids[column % len(centroids)] for column in columns.tolist()]
    return [own.get(centroid) for own, centroid in zip(places, sent_to, strict=True)]


class FrontierExplorer:
    """One robot's exploration: gives a goal, then the next, until no frontier is left.

    As explore_lite's node, with these repairs: where no frontier is left, gaps in walls are looked at; the
    goal is the reachable cell nearest to the frontier's centroid, not the centroid, which may lie in a wall
    or behind it; a frontier is given up piece by piece, as only the surroundings of a goal that failed are
    blacklisted; the blacklist is emptied ``SECOND_CHANCES`` times before the exploration counts as done; team
    mates' goals are left to them.
    """

    def __init__(self) -> None:
        """An explorer that has no goal yet."""
        self._blacklist: list[Point] = []
        self._chances = SECOND_CHANCES
        self._goal: Point | None = None
        self._least_distance_m = math.inf
        self._progress_time_s = 0.0

    def offers(
        self, robot: Pose2D, costmap: OccupancyGrid, grid: OccupancyGrid, looks: Floats
    ) -> list[Frontier]:
        """The frontiers that the robot can reach and has not given up, cheapest first, then gaps; or all."""
        frontiers = find_frontiers(costmap, robot) + find_gaps(costmap, grid, robot, looks)
        return [frontier for frontier in frontiers if self._is_open(frontier.approaches).any()] or frontiers

    def parking_place(self, robot: Pose2D, costmap: OccupancyGrid, radius_m: float) -> Point | None:
        """The nearest place at which a robot is in no other's way; None if it stands at one or there is none.

        A robot closes a disc of ``radius_m`` to the others' centres. It is in the way where the disc parts
        what can be driven on round it, within another ``radius_m``.
        """
        steps = _reach(costmap, robot)[1]
        reach = math.ceil(2.0 * radius_m / costmap.resolution)
        open_cells = np.pad(steps >= 0, reach)
        squares = np.square(np.arange(-reach, reach + 1) * costmap.resolution)
        disc = squares[:, None] + squares <= radius_m * radius_m
        rows, columns = np.nonzero(steps >= 0)
        order = np.argsort(steps[rows, columns], kind="stable")
        for k in order[:: max(1, reach // 4)].tolist():
            row, column = int(rows[k]), int(columns[k])
            around = open_cells[row : row + 2 * reach + 1, column : column + 2 * reach + 1]
            _, labels = cv2.connectedComponents(around.view(np.uint8), connectivity=4)
            left = (labels == labels[reach, reach]) & ~disc
            count, _ = cv2.connectedComponents(left.view(np.uint8), connectivity=4)
            if count <= 2:  # the disc's surroundings, beside the background, are one piece
                return None if k == order[0] else costmap.center_of(column - 1, row - 1)
        return None

    def choose(
        self, frontiers: Sequence[Frontier], time_s: float, taken: Sequence[Point] = ()
    ) -> Point | None:
        """The goal to drive to, (x, y) metres in the map frame; None when nothing is left.

        Call it at a planning rate (the package: 1 Hz, its launch files 0.33 Hz) and after each ``report``. A
        goal near the last one is the same goal: when the way to it has not become shorter for
        ``PROGRESS_TIMEOUT_S``, it is given up. ``frontiers``: in the order of preference; ``time_s``: now,
        never less than at the last call; ``taken``: goals of the other robots.
        """
        while (choice := self._choose(frontiers, taken)) or (frontiers and self._chances > 0):
            if choice is None:
                self._chances -= 1
                self._blacklist.clear()
                continue
            goal, distance_m = choice
            is_same = self._goal is not None and not _is_apart(np.array(goal), self._goal)
            if not is_same or distance_m < self._least_distance_m:
                self._least_distance_m, self._progress_time_s = distance_m, time_s
            self._goal = goal
            if time_s - self._progress_time_s <= PROGRESS_TIMEOUT_S:
                return goal
            self.report(succeeded=False)
        self._goal = None
        return None

    def report(self, succeeded: bool) -> None:
        """Say how the drive to the last goal ended; one that was aborted is blacklisted."""
        if not succeeded and self._goal is not None:
            self._blacklist.append(self._goal)
            self._goal = None

    def _choose(self, frontiers: Sequence[Frontier], taken: Sequence[Point]) -> tuple[Point, float] | None:
        """(goal, way to its frontier) of the first open frontier, one far from ``taken`` if any."""
        for apart_m in (TAKEN_RADIUS_M, 0.0):
            for frontier in frontiers:
                goals = frontier.approaches[self._is_open(frontier.approaches)]
                for point in taken:
                    goals = goals[lengths(goals - point) >= apart_m]
                if len(goals):
                    x, y = goals[0].tolist()
                    return (x, y), frontier.distance_m
        return None

    def _is_open(self, approaches: Floats) -> Booleans:
        """(K,) for each of (K, 2) goals whether none that was given up is near."""
        is_open = np.ones(len(approaches), dtype=np.bool_)
        for point in self._blacklist:
            is_open &= _is_apart(approaches, point)
        return is_open


def _is_apart(goals: Floats, point: Point) -> Booleans:
    """(...) for each of (..., 2) goals whether it is another than a point."""
    return np.asarray(np.abs(goals - point).max(axis=-1) >= BLACKLIST_HALF_WIDTH_M)


def _reach(costmap: OccupancyGrid, robot: Pose2D) -> tuple[Booleans, Steps]:
    """Which cells can be driven on, and 4-neighbour steps from the robot, -1 for none; padded by one cell."""
    traversable = np.pad((costmap.data >= 0) & (costmap.data < TRAVERSABLE_BELOW), 1)
    cells = _cells(traversable)
    if len(cells) == 0:
        return traversable, np.full(traversable.shape, -1, dtype=np.int32)
    here = np.add(costmap.cell_at(robot.x, robot.y), 1)
    column, row = cells[np.argmin(np.square(cells - here).sum(axis=1))].tolist()
    return traversable, _spread(traversable, row, column)


def _cells(mask: Booleans) -> Indices:
    """(K, 2) columns and rows of the set cells, row after row."""
    return np.argwhere(mask)[:, ::-1]


def _nearest_first(cells: Indices, place: Floats) -> Indices:
    """(K, 2) cells, those nearest to a place (column, row) first."""
    return cells[np.argsort(np.square(cells - place).sum(axis=1), kind="stable")]


def _see(grid: OccupancyGrid, points: Floats, place: Point) -> Booleans:
    """(N,) for each of (N, 2) points whether no occupied cell of the map parts it from a place."""
    samples = 2 * math.ceil(lengths(points - place).max(initial=0.0) / grid.resolution) + 1
    along = np.linspace(0.0, 1.0, samples)[:, None, None]
    cells = values_at(grid.data, grid, (points + along * (place - points)).reshape(-1, 2), outside=-1)
    return np.asarray((cells < OCCUPIED_FROM).reshape(samples, -1).all(axis=0))


def _dilated(cells: Booleans, kernel: npt.NDArray[Any]) -> Booleans:
    return np.asarray(cv2.dilate(cells.view(np.uint8), kernel) > 0)


def _areas_from(cells: Booleans, least_cells: float) -> Booleans:
    """(H, W) the set cells that with 4-neighbours are at least so many, but for rounding."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.view(np.uint8), connectivity=4)
    return np.asarray(cells & (stats[:, cv2.CC_STAT_AREA] >= least_cells - 1e-6)[labels])


@njit
def _spread(traversable: Booleans, row: int, column: int) -> Steps:
    """(H, W) int32: 4-neighbour steps from a cell, -1 where none lead; the mask's border is False."""
    height, width = traversable.shape
    steps = np.full(height * width, -1, dtype=np.int32)
    open_cell = traversable.ravel()
    queue = np.empty(height * width, dtype=np.int32)
    queue[0] = row * width + column
    steps[queue[0]] = 0
    head, tail = 0, 1
    while head < tail:
        cell = queue[head]
        head += 1
        for neighbour in (cell - 1, cell + 1, cell - width, cell + width):
            if open_cell[neighbour] and steps[neighbour] < 0:
                steps[neighbour] = steps[cell] + 1
                queue[tail] = neighbour
                tail += 1
    return steps.reshape(height, width)
