"""explore_lite's frontier exploration: where a robot should drive next so that the map grows."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from midnet_bench.compiled import njit
from midnet_bench.geometry import Point, Pose2D, lengths
from midnet_bench.grid import UNKNOWN, OccupancyGrid
from midnet_bench.mapping.settings import FrontierSettings

_OUT_OF_REACH, _SECOND = 1e9, 1e6
"""costs above any other: of a frontier that the robot cannot reach, of one that another robot is sent to"""

_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


class Frontier(NamedTuple):
    """A connected border between what a robot can reach and the unknown; metres, the grid's frame."""

    cost: float
    """the lower the better"""
    size_m: float
    """number of its unknown cells times the resolution"""
    distance_m: float
    """the way from the robot to its nearest cell, over traversable cells"""
    centroid: Point
    """mean of its unknown cells' centres"""
    approaches: npt.NDArray[np.float64]
    """(K, 2) x, y of the reachable cells that touch it, nearest to the centroid first"""


def find_frontiers(costmap: OccupancyGrid, robot: Pose2D, settings: FrontierSettings) -> list[Frontier]:
    """The frontiers that the robot can reach, cheapest first; empty when there is none.

    As in explore_lite: the search starts at the traversable cell nearest to the robot's and spreads over
    4-neighbours; unknown cells beside any traversable cell, reached or not, are frontier cells, 8-neighbours
    of them one frontier, and a frontier counts if it touches what the search reached; cost =
    ``potential_scale`` * distance - ``gain_scale`` * size. Not as in explore_lite, whose slips these are:
    every cell of a frontier counts, towards its centroid too; distance is metres once, not times the
    resolution again, and it is the way along traversable cells (steps in x and y) instead of a straight line
    through walls; any cost below the inscribed radius can be passed, where the package stops at the first
    inflated cell and so finds no frontier in a corridor narrower than two inflation radii.

    Args:
        costmap: int8, -1 unknown, 0 to 100 published costs; not changed.
        robot: in the grid's frame. A robot off the grid starts from the nearest cell on it.
        settings: what counts as a frontier, and its cost.
    """
    padded = np.pad(costmap.data.astype(np.int8, copy=False), 1, constant_values=100)
    traversable = (padded >= 0) & (padded < settings.traversable_below)
    start = _nearest_cell(traversable, *costmap.cell_at(robot.x, robot.y))
    if start is None:
        return []
    steps = _steps_from(traversable, *start)
    reached = steps >= 0

    touches = cv2.dilate(traversable.view(np.uint8), _CROSS)
    border = ((padded == UNKNOWN) & (touches > 0)).view(np.uint8)
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(border, connectivity=8)
    sizes_m = stats[:, cv2.CC_STAT_AREA] * costmap.resolution
    kept = [label for label in range(1, count) if sizes_m[label] >= settings.min_frontier_size_m]
    label_of, cell_of = _touching_pairs(labels, reached, np.isin(np.arange(count), kept))

    frontiers = []
    for label in np.unique(label_of).tolist():  # those that touch what was reached
        rows, columns = np.divmod(cell_of[label_of == label], padded.shape[1])
        column, row = centroids[label]
        order = np.argsort(np.square(columns - column) + np.square(rows - row), kind="stable")
        rows, columns = rows[order], columns[order]
        distance_m = float(steps[rows, columns].min()) * costmap.resolution
        # One cell of padding on either side, and centres half a cell from corners.
        x = costmap.origin[0] + (columns - 0.5) * costmap.resolution
        y = costmap.origin[1] + (rows - 0.5) * costmap.resolution
        cost = settings.potential_scale * distance_m - settings.gain_scale * float(sizes_m[label])
        centroid = costmap.center_of(column - 1, row - 1)
        frontiers.append(
            Frontier(cost, float(sizes_m[label]), distance_m, centroid, np.stack((x, y), axis=1))
        )
    return sorted(frontiers, key=lambda frontier: frontier.cost)


def assign_frontiers(offers: Sequence[Sequence[Frontier]]) -> list[int | None]:
    """For each robot the place in its own list of the frontier that it is sent to; None if its list is empty.

    Robots get different frontiers, so that the sum of their costs is least: the Hungarian method (Kuhn,
    1955), by which Wurm, Stachniss and Burgard (Coordinated Multi-Robot Exploration using a Segmentation of
    the Environment, IROS 2008) send robots to segments of a map. The cost is explore_lite's, way minus gain,
    as ``find_frontiers`` has it. Where there are fewer frontiers than robots, each has its robot before one
    gets a second.

    Args:
        offers: of each robot, found on one grid; frontiers of one centroid are one.
    """
    centroids = sorted({frontier.centroid for own in offers for frontier in own})
    if not centroids:
        return [None] * len(offers)
    costs = np.full((len(offers), len(centroids)), _OUT_OF_REACH)
    place_of = [{frontier.centroid: place for place, frontier in enumerate(own)} for own in offers]
    for robot, own in enumerate(offers):
        for frontier in own:
            costs[robot, centroids.index(frontier.centroid)] = frontier.cost
    rounds = math.ceil(len(offers) / len(centroids))
    _, columns = linear_sum_assignment(np.hstack([costs + _SECOND * k for k in range(rounds)]))
    return [
        places.get(centroids[column % len(centroids)])
        for places, column in zip(place_of, columns.tolist(), strict=True)
    ]


class FrontierExplorer:
    """One robot's exploration: gives a goal, then the next, until no frontier is left.

    As explore_lite's node, with these repairs: the goal is the reachable cell nearest to the frontier's
    centroid, not the centroid, which may lie in a wall or behind it; a frontier is given up piece by
    piece, as only the surroundings of a goal that failed are blacklisted; the blacklist is emptied
    ``second_chances`` times before the exploration counts as done; team mates' goals are left to them.
    """

    def __init__(self, settings: FrontierSettings) -> None:
        """An explorer that has no goal yet."""
        self._settings = settings
        self._blacklist: list[Point] = []
        self._chances = self._settings.second_chances
        self._goal: Point | None = None
        self._least_distance_m = math.inf
        self._progress_time_s = 0.0

    def offers(self, robot: Pose2D, costmap: OccupancyGrid) -> list[Frontier]:
        """The frontiers that the robot can reach and has not given up, cheapest first; or all of them."""
        frontiers = find_frontiers(costmap, robot, self._settings)
        return [frontier for frontier in frontiers if self._is_open(frontier.approaches).any()] or frontiers

    def choose(
        self, frontiers: Sequence[Frontier], time_s: float, taken: Sequence[Point] = ()
    ) -> Point | None:
        """The goal to drive to, (x, y) metres in the map frame; None when nothing is left.

        Call it at a planning rate (the package: 1 Hz, its launch files 0.33 Hz) and after each ``report``. A
        goal near the last one is the same goal: when the way to it has not become shorter for
        ``progress_timeout_s``, it is given up.

        Args:
            frontiers: in the order of preference.
            time_s: now; never less than at the last call.
            taken: goals of the other robots.
        """
        while True:
            choice = self._choose(frontiers, taken)
            if choice is None and frontiers and self._chances > 0:
                self._chances -= 1
                self._blacklist.clear()
                choice = self._choose(frontiers, taken)
            if choice is None:
                self._goal = None
                return None
            goal, distance_m = choice
            same = self._goal is not None and _within(goal, self._goal, self._settings.blacklist_half_width_m)
            if not same or distance_m < self._least_distance_m:
                self._least_distance_m = distance_m
                self._progress_time_s = time_s
            self._goal = goal
            if time_s - self._progress_time_s <= self._settings.progress_timeout_s:
                return goal
            self._blacklist.append(goal)
            self._goal = None

    def report(self, succeeded: bool) -> None:
        """Say how the drive to the last goal ended; one that was aborted is blacklisted."""
        if not succeeded and self._goal is not None:
            self._blacklist.append(self._goal)
            self._goal = None

    def _choose(self, frontiers: Sequence[Frontier], taken: Sequence[Point]) -> tuple[Point, float] | None:
        """(goal, way to its frontier) of the first open frontier, one far from ``taken`` if any."""
        for apart_m in (self._settings.taken_radius_m, 0.0):
            for frontier in frontiers:
                goals = frontier.approaches[self._is_open(frontier.approaches)]
                for point in taken:
                    goals = goals[lengths(goals - point) >= apart_m]
                if len(goals):
                    x, y = goals[0].tolist()
                    return (x, y), frontier.distance_m
        return None

    def _is_open(self, approaches: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """(K,) for each of (K, 2) goals whether none that was given up is near."""
        is_open = np.ones(len(approaches), dtype=np.bool_)
        for point in self._blacklist:
            is_open &= np.abs(approaches - point).max(axis=1) >= self._settings.blacklist_half_width_m
        return is_open


def _within(a: Point, b: Point, half_width_m: float) -> bool:
    return abs(a[0] - b[0]) < half_width_m and abs(a[1] - b[1]) < half_width_m


def _nearest_cell(mask: npt.NDArray[np.bool_], column: int, row: int) -> tuple[int, int] | None:
    """(row, column) in the padded mask of the set cell nearest to the grid's (column, row), if any."""
    row, column = row + 1, column + 1
    if 0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and mask[row, column]:
        return row, column
    rows, columns = np.nonzero(mask)
    if len(rows) == 0:
        return None
    nearest = int(np.argmin(np.square(rows - row) + np.square(columns - column)))
    return int(rows[nearest]), int(columns[nearest])


def _touching_pairs(
    labels: npt.NDArray[np.int32], reached: npt.NDArray[np.bool_], kept: npt.NDArray[np.bool_]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """(label, flat index of a reached 4-neighbour) of the kept labels' cells, each pair once, sorted."""
    flat_labels, flat_reached = labels.ravel(), reached.ravel()
    cells = np.flatnonzero(kept[flat_labels])
    width = labels.shape[1]
    neighbours = np.concatenate([cells + step for step in (-1, 1, -width, width)])
    owners = np.tile(flat_labels[cells].astype(np.int64), 4)
    touching = flat_reached[neighbours]
    pairs = np.unique(owners[touching] * labels.size + neighbours[touching])
    return np.divmod(pairs, labels.size)


@njit
def _steps_from(traversable: npt.NDArray[np.bool_], row: int, column: int) -> npt.NDArray[np.int32]:
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
