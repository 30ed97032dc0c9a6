"""``MapSubtraction``: a return that is far from every wall of the map is an intruder's."""

from collections.abc import Sequence

import cv2
import numpy as np

from midnet_bench.detectors.detector import extents, groups_of
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, values_at
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation


def wall_distances(prior_map: OccupancyGrid) -> OccupancyGrid:
    """float32 metres from each cell's centre to that of the nearest wall cell of an int8 map."""
    free = (prior_map.data < OCCUPIED_FROM).astype(np.uint8)
    cells = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return prior_map.with_data(cells * np.float32(prior_map.resolution))


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
        return [self._boxes(observation) for observation in team]

    def _boxes(self, observation: Observation) -> BoxArray:
        if observation.scan is None:
            return np.empty((0, 4))
        _, points = observation.scan.returns(self._range_m)
        points = points[values_at(self._walls.data, self._walls, points, 0.0) > self._tolerance_m]
        groups = [group for group in groups_of(points, self._gap_m) if len(group) >= self._min_returns]
        return extents(groups, self._margin_m)
