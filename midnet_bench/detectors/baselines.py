"""``Detector``: what makes boxes in the place of sections IV.A and IV.B; and three to compare MIDNet with."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.elementary import exp, sin
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Indices, Scan, lengths, mean_point
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, cells_of, cells_to_unset, values_at
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.settings import option

STRAIGHT = 1e-12
"""A piece is straight where its scatter's determinant is below this share of its trace squared."""


class Detector(Protocol):
    """A class of these is made anew for each trial, and may remember what it saw.

    It is made of ``(prior_map, range_m)`` and its own options, which have defaults: the map, int8, 100
    occupied, 0 free, -1 unknown, and the distance up to which an intruder has to be found, metres.
    """

    def detect(self, team: Sequence[Observation]) -> Sequence[npt.ArrayLike]:
        """For each robot the boxes of what it sees that the map has not.

        Args:
            team: what each robot tells: its pose, its costmap and its last scan, which must stay as they are.

        Returns:
            As many lists of boxes as robots, each (n, 4) or empty: x_min, y_min, x_max, y_max, map frame,
            metres. Allies may be among them.
        """


@dataclass(eq=False)
class _ScanDetector(ABC):
    """A detector that looks at each robot's last scan alone."""

    prior_map: OccupancyGrid
    range_m: float

    @cached_property
    def _to_wall_m(self) -> npt.NDArray[np.float32]:
        return cells_to_unset(self.prior_map.data < OCCUPIED_FROM) * np.float32(self.prior_map.resolution)

    def _off_m(self, points: Floats) -> npt.NDArray[np.float32]:
        """(n,) from each of (n, 2) points to the nearest mapped wall, metres; 0 beyond the map."""
        return values_at(self._to_wall_m, self.prior_map, points, 0.0)

    def detect(self, team: Sequence[Observation]) -> list[BoxArray]:
        """For each robot (n, 4) boxes, map frame, metres, of its last scan."""
        found = [[] if one.scan is None else self._boxes(robot, one.scan) for robot, one in enumerate(team)]
        return [np.array(boxes, dtype=np.float64).reshape(-1, 4) for boxes in found]

    @abstractmethod
    def _boxes(self, robot: int, scan: Scan) -> Sequence[Sequence[float]]:
        """Boxes of the scan of the robot of this number in the team: x_min, y_min, x_max, y_max, metres."""


@dataclass(eq=False)
class MapSubtraction(_ScanDetector):
    """Returns more than ``tolerance_m`` from a mapped wall, grouped where neighbours are within ``gap_m``.

    What lies beyond the map is no intruder.
    """

    tolerance_m: float = option(0.15, "A return that is nearer to a mapped wall is the wall's.", ge=0, le=100)
    gap_m: float = option(0.2, "Neighbours farther apart are of two groups.", ge=0, le=100)
    min_returns: int = option(1, "A group of fewer is dropped.", ge=1, le=10_000)
    margin_m: float = option(0.05, "A box reaches so far beyond its returns.", ge=0, le=10)

    def _boxes(self, robot: int, scan: Scan) -> list[list[float]]:
        _, points = scan.returns(self.range_m)
        points = points[self._off_m(points) > self.tolerance_m]
        apart = lengths(points - np.roll(points, 1, axis=0)) > self.gap_m
        apart[:1] |= not scan.lidar.is_full_turn
        groups = [points[group] for group in cut_around(apart) if len(group) >= self.min_returns]
        return [extent(group, self.margin_m) for group in groups]


@dataclass(eq=False)
class CircleClusters(_ScanDetector):
    """Pieces of the scan off the mapped walls, each the upright square around the circle that fits it best.

    Adaptive breakpoints cut the scan (Borges and Aldon, "Line extraction in 2D range images for mobile
    robotics", Journal of Intelligent and Robotic Systems 40, 2004): two neighbouring returns belong together
    if they are no farther apart than a surface that the beams meet at an angle of ``incidence_deg`` would put
    them, plus three deviations of the range.
    """

    incidence_deg: float = option(10.0, "Lambda; more than the angle between two beams.", gt=0, le=90)
    noise_m: float = option(0.01, "Standard deviation of a range.", ge=0, le=10)
    tolerance_m: float = option(0.15, "A piece is a wall's if its median return is nearer.", ge=0, le=100)
    max_radius_m: float = option(0.3, "A piece with a larger circle gets its extent.", ge=0, le=100)
    min_returns: int = option(2, "A piece of fewer is dropped.", ge=1, le=10_000)

    def _boxes(self, robot: int, scan: Scan) -> list[list[float]]:
        # what is out of range cuts too: it tells an intruder from the wall beside it
        beams, points = scan.returns(math.inf)
        ranges_m = scan.ranges_m[beams]
        if not len(beams):
            return []
        turn_rad, incidence_rad = abs(scan.lidar.angle_increment_rad), math.radians(self.incidence_deg)
        if incidence_rad <= turn_rad:
            raise InputError(
                f"detector clusters: incidence_deg: {self.incidence_deg:g} is out of range; "
                f"allowed: above the {math.degrees(turn_rad):g} degrees between two beams"
            )
        widening = sin(turn_rad) / sin(incidence_rad - turn_rad)
        gaps_m = lengths(points - np.roll(points, 1, axis=0))
        apart = gaps_m > np.roll(ranges_m, 1) * widening + 3.0 * self.noise_m
        apart[:1] |= not scan.lidar.is_full_turn
        boxes = []
        for group in cut_around(apart):
            piece = points[group[ranges_m[group] <= self.range_m]]
            is_long = len(piece) >= max(1, self.min_returns)
            if is_long and float(np.median(self._off_m(piece))) > self.tolerance_m:
                boxes.append(self._box(piece))
        return boxes

    def _box(self, piece: Floats) -> list[float]:
        """Around the least-squares circle (Kasa), or around the returns where that is no good."""
        middle = mean_point(piece)
        x, y = (piece - middle).T
        square = x * x + y * y
        products = (x * x, x * y, y * y, x * square / 2.0, y * square / 2.0)
        xx, xy, yy, to_x, to_y = (math.fsum(each.tolist()) for each in products)
        spread = xx * yy - xy * xy  # 0 of a straight piece
        if spread > STRAIGHT * (xx + yy) * (xx + yy):
            off_x, off_y = (to_x * yy - to_y * xy) / spread, (to_y * xx - to_x * xy) / spread
            radius_m = math.sqrt(math.fsum(square.tolist()) / len(piece) + off_x * off_x + off_y * off_y)
            if radius_m <= self.max_radius_m:
                center = middle + np.array([off_x, off_y])
                return [*center - radius_m, *center + radius_m]
        return extent(piece, self.noise_m)


@dataclass(eq=False)
class RunningMean(_ScanDetector):
    """A grid of how often each cell was met of late; a return on a cell that seldom was is an intruder's.

    Motion detection by a learned background, which the paper's introduction criticises: what stands still
    for long becomes background. The grid begins with the prior map, grown by ``tolerance_m``; each robot has
    its own.
    """

    memory_s: float = option(10.0, "What is new is background after 0.69 of this time.", gt=0, le=1e6)
    tolerance_m: float = option(0.15, "A return may be so far off a cell of the background.", ge=0, le=2)
    min_cells: int = option(1, "A blob of fewer cells is dropped.", ge=1, le=1_000_000)
    _means: dict[int, npt.NDArray[np.float32]] = field(default_factory=dict, init=False)
    _stamps_s: dict[int, float] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        cells = math.ceil(self.tolerance_m / self.prior_map.resolution - 1e-9)
        self._reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * cells + 1, 2 * cells + 1))

    def _boxes(self, robot: int, scan: Scan) -> Any:
        hit, passed = self._cells(scan)
        start = (self.prior_map.data >= OCCUPIED_FROM).astype(np.float32)
        mean = self._means.setdefault(robot, start)
        elapsed_s = scan.stamp_s - self._stamps_s.get(robot, -math.inf)
        background = cv2.dilate((mean >= 0.5).astype(np.uint8), self._reach)
        if elapsed_s > 0.0:  # a frame may come before the next scan
            self._stamps_s[robot] = scan.stamp_s
            weight = np.float32(1.0 - exp(-min(elapsed_s, 1.0) / self.memory_s))
            mean[passed] *= 1.0 - weight
            mean[hit] += weight * (1.0 - mean[hit])
        moved = (hit & (background == 0)).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(moved, connectivity=8)
        blobs = stats[1:][stats[1:, cv2.CC_STAT_AREA] >= self.min_cells].astype(np.float64)
        corners = np.column_stack((blobs[:, :2], blobs[:, :2] + blobs[:, 2:4]))
        return corners * self.prior_map.resolution + np.tile(self.prior_map.origin, 2)

    def _cells(self, scan: Scan) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """(H, W) each: cells with a return within range, and those that beams passed through before that."""
        sensor = scan.pose.compose(scan.lidar.mount)
        ranges_m = np.where(np.isnan(scan.ranges_m), 0.0, scan.ranges_m)
        steps_m = np.arange(scan.lidar.range_min_m, self.range_m, self.prior_map.resolution)
        ends = scan.lidar.directions[:, None] * steps_m[None, :, None]
        before = steps_m[None] < ranges_m[:, None] - self.prior_map.resolution
        hit = self._marked(scan.returns(self.range_m)[1])
        return hit, self._marked(sensor.transform(ends[before])) & ~hit

    def _marked(self, points: Floats) -> npt.NDArray[np.bool_]:
        grid = self.prior_map
        cells = np.zeros(grid.data.shape, np.bool_)
        columns, rows = cells_of(grid, points).T
        inside = (columns >= 0) & (columns < grid.width) & (rows >= 0) & (rows < grid.height)
        cells[rows[inside], columns[inside]] = True
        return cells


def cut_around(apart: npt.NDArray[np.bool_]) -> list[Indices]:
    """Indices of returns in the beams' order, cut before each that is apart from the one before.

    The last group goes on in the first unless the first return is apart, too: beams of a full turn go round.
    """
    if not len(apart):
        return []
    first = int(np.argmax(apart))  # 0 where nothing is apart
    indices, cuts = np.roll(np.arange(len(apart)), -first), np.flatnonzero(np.roll(apart, -first))
    return np.split(indices, cuts[1:])


def extent(points: Floats, margin_m: float) -> list[float]:
    """The box around points, grown by ``margin_m`` on every side."""
    return [*points.min(axis=0) - margin_m, *points.max(axis=0) + margin_m]
