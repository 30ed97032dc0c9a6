"""``RunningMean``: motion detection by a learned background, which the paper's introduction criticises.

What stands still for long becomes background, be it a wall or an intruder.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.elementary import exp
from midnet_bench.geometry import Scan
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation


class RunningMean:
    """A grid of how often each cell was met of late; a return on a cell that seldom was is an intruder's.

    It begins with the prior map, grown by ``tolerance_m``, and each robot has its own.

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
        return [self._boxes(robot, observation.scan) for robot, observation in enumerate(team)]

    def _boxes(self, robot: int, scan: Scan | None) -> BoxArray:
        if scan is None:
            return np.empty((0, 4))
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

    def _marked(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        cells = np.zeros(self._map.data.shape, np.bool_)
        columns, rows = np.floor((points - self._map.origin) / self._map.resolution).astype(np.int64).T
        inside = (columns >= 0) & (columns < self._map.width) & (rows >= 0) & (rows < self._map.height)
        cells[rows[inside], columns[inside]] = True
        return cells
