"""``Detector``: what makes boxes in the place of sections IV.A and IV.B; and three to compare MIDNet with."""

import math
from collections.abc import Sequence
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.detectors.evidence import wall_distances
from midnet_bench.elementary import exp, sin
from midnet_bench.errors import InputError
from midnet_bench.geometry import Scan, lengths, mean_point
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, values_at
from midnet_bench.midnet.detection import BoxArray, Floats
from midnet_bench.midnet.pipeline import Observation

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
            team: what each robot tells: its pose, its costmap and its last scan. Others' data must stay as
                they are.

        Returns:
            As many lists of boxes as robots, each (n, 4) or empty: x_min, y_min, x_max, y_max, map frame,
            metres. Allies may be among them.
        """


class MapSubtraction:
    """Returns more than ``tolerance_m`` from a mapped wall, grouped where neighbours are within ``gap_m``.

    A group of fewer than ``min_returns`` is dropped. A box has ``margin_m`` around its returns. What lies
    beyond the map is no intruder.
    """

    def __init__(
        self,
        prior_map: OccupancyGrid,
        range_m: float,
        tolerance_m: float = 0.15,
        gap_m: float = 0.2,
        min_returns: int = 1,
        margin_m: float = 0.05,
    ) -> None:
        self._walls = wall_distances(prior_map)
        self._range_m, self._tolerance_m, self._gap_m = range_m, tolerance_m, gap_m
        self._min_returns, self._margin_m = min_returns, margin_m

    def detect(self, team: Sequence[Observation]) -> list[BoxArray]:
        """For each robot (n, 4) boxes, map frame, metres, of its last scan."""
        return [box_rows([] if one.scan is None else self._boxes(one.scan)) for one in team]

    def _boxes(self, scan: Scan) -> list[list[float]]:
        _, points = scan.returns(self._range_m)
        points = points[values_at(self._walls.data, self._walls, points, 0.0) > self._tolerance_m]
        apart = lengths(points - np.roll(points, 1, axis=0)) > self._gap_m
        groups = [points[group] for group in cut_around(apart) if len(group) >= self._min_returns]
        return [extent(group, self._margin_m) for group in groups]


class CircleClusters:
    """Pieces of the scan off the mapped walls, each the upright square around the circle that fits it best.

    Adaptive breakpoints cut the scan (Borges and Aldon, "Line extraction in 2D range images for mobile
    robotics", Journal of Intelligent and Robotic Systems 40, 2004): two neighbouring returns belong together
    if they are no farther apart than a surface that the beams meet at an angle of ``incidence_deg`` would put
    them, plus three deviations of the range.

    Args beside those of every detector:
        incidence_deg: lambda of the breakpoints, more than the angle between two beams.
        noise_m: deviation of a range.
        tolerance_m: a piece whose median return is nearer to a mapped wall is the wall.
        max_radius_m: a circle that comes out larger is not believed; the piece's extent is taken.
        min_returns: a piece of fewer is dropped.
    """

    def __init__(
        self,
        prior_map: OccupancyGrid,
        range_m: float,
        incidence_deg: float = 10.0,
        noise_m: float = 0.01,
        tolerance_m: float = 0.15,
        max_radius_m: float = 0.3,
        min_returns: int = 2,
    ) -> None:
        self._walls = wall_distances(prior_map)
        self._range_m, self._incidence_rad = range_m, math.radians(incidence_deg)
        self._noise_m, self._tolerance_m = noise_m, tolerance_m
        self._max_radius_m, self._min_returns = max_radius_m, min_returns

    def detect(self, team: Sequence[Observation]) -> list[BoxArray]:
        """For each robot (n, 4) boxes, map frame, metres, of its last scan."""
        return [box_rows([] if one.scan is None else self._boxes(one.scan)) for one in team]

    def _boxes(self, scan: Scan) -> list[list[float]]:
        # what is out of range cuts too: it tells an intruder from the wall beside it
        beams, points = scan.returns(math.inf)
        ranges_m = scan.ranges_m[beams]
        turn_rad = abs(scan.lidar.angle_increment_rad)
        if len(beams) and self._incidence_rad <= turn_rad:
            beams_deg = math.degrees(turn_rad)
            raise InputError(
                f"detector clusters: incidence_deg: {math.degrees(self._incidence_rad):g} is out of range; "
                f"allowed: above the {beams_deg:g} degrees between two beams"
            )
        widening = sin(turn_rad) / sin(self._incidence_rad - turn_rad) if len(beams) else 0.0
        gaps_m = lengths(points - np.roll(points, 1, axis=0))
        apart = gaps_m > np.roll(ranges_m, 1) * widening + 3.0 * self._noise_m
        boxes = []
        for group in cut_around(apart):
            piece = points[group[ranges_m[group] <= self._range_m]]
            if len(piece) >= max(1, self._min_returns):
                off_m = float(np.median(values_at(self._walls.data, self._walls, piece, 0.0)))
                if off_m > self._tolerance_m:
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
            if radius_m <= self._max_radius_m:
                center = middle + np.array([off_x, off_y])
                return [*center - radius_m, *center + radius_m]
        return extent(piece, self._noise_m)


class RunningMean:
    """A grid of how often each cell was met of late; a return on a cell that seldom was is an intruder's.

    Motion detection by a learned background, which the paper's introduction criticises: what stands still
    for long becomes background. The grid begins with the prior map, grown by ``tolerance_m``; each robot has
    its own.

    Args beside those of every detector:
        memory_s: time constant of the running mean. A cell that was free for long is background after 0.69 of
            it.
        tolerance_m: how far a return may be off a cell of the background.
        min_cells: a blob of fewer cells is dropped.
    """

    def __init__(
        self,
        prior_map: OccupancyGrid,
        range_m: float,
        memory_s: float = 10.0,
        tolerance_m: float = 0.15,
        min_cells: int = 1,
    ) -> None:
        self._map = prior_map
        self._range_m, self._memory_s, self._min_cells = range_m, memory_s, min_cells
        cells = math.ceil(tolerance_m / prior_map.resolution - 1e-9)
        self._reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * cells + 1, 2 * cells + 1))
        self._means: list[npt.NDArray[np.float32]] = []
        self._stamps_s: list[float] = []

    def detect(self, team: Sequence[Observation]) -> list[BoxArray]:
        """For each robot (n, 4) boxes, map frame, metres, of its last scan."""
        if not self._means:
            start = (self._map.data >= OCCUPIED_FROM).astype(np.float32)
            self._means = [start.copy() for _ in team]
            self._stamps_s = [-math.inf] * len(team)
        return [
            box_rows([]) if one.scan is None else self._boxes(robot, one.scan)
            for robot, one in enumerate(team)
        ]

    def _boxes(self, robot: int, scan: Scan) -> BoxArray:
        hit, passed = self._cells(scan)
        mean, elapsed_s = self._means[robot], scan.stamp_s - self._stamps_s[robot]
        background = cv2.dilate((mean >= 0.5).astype(np.uint8), self._reach)
        if elapsed_s > 0.0:  # a frame may come before the next scan
            self._stamps_s[robot] = scan.stamp_s
            weight = np.float32(1.0 - exp(-min(elapsed_s, 1.0) / self._memory_s))
            mean[passed] *= 1.0 - weight
            mean[hit] += weight * (1.0 - mean[hit])
        moved = (hit & (background == 0)).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(moved, connectivity=8)
        blobs = stats[1:][stats[1:, cv2.CC_STAT_AREA] >= self._min_cells].astype(np.float64)
        corners = np.column_stack((blobs[:, :2], blobs[:, :2] + blobs[:, 2:4]))
        return corners * self._map.resolution + np.tile(self._map.origin, 2)

    def _cells(self, scan: Scan) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """(H, W) each: cells with a return within range, and those that beams passed through before that."""
        sensor = scan.pose.compose(scan.lidar.mount)
        ranges_m = np.where(np.isnan(scan.ranges_m), 0.0, scan.ranges_m)
        steps_m = np.arange(scan.lidar.range_min_m, self._range_m, self._map.resolution)
        ends = scan.lidar.directions[:, None] * steps_m[None, :, None]
        before = steps_m[None] < ranges_m[:, None] - self._map.resolution
        hit = self._marked(scan.returns(self._range_m)[1])
        return hit, self._marked(sensor.transform(ends[before])) & ~hit

    def _marked(self, points: Floats) -> npt.NDArray[np.bool_]:
        cells = np.zeros(self._map.data.shape, np.bool_)
        columns, rows = np.floor((points - self._map.origin) / self._map.resolution).astype(np.int64).T
        inside = (columns >= 0) & (columns < self._map.width) & (rows >= 0) & (rows < self._map.height)
        cells[rows[inside], columns[inside]] = True
        return cells


def cut_around(apart: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.int64]]:
    """Indices of returns in the beams' order, cut before each that is apart from the one before.

    The last group goes on in the first, as beams go round.
    """
    if not len(apart):
        return []
    first = int(np.argmax(apart))  # 0 where nothing is apart
    indices, cuts = np.roll(np.arange(len(apart)), -first), np.flatnonzero(np.roll(apart, -first))
    return np.split(indices, cuts[1:])


def extent(points: Floats, margin_m: float) -> list[float]:
    """The box around points, grown by ``margin_m`` on every side."""
    return [*points.min(axis=0) - margin_m, *points.max(axis=0) + margin_m]


def box_rows(boxes: Sequence[Sequence[float]]) -> BoxArray:
    """(n, 4), also of no boxes."""
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)
