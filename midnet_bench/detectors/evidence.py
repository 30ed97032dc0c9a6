"""``WallEvidence``: how much each return of a scan says against the mapped walls."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Scan
from midnet_bench.grid import OCCUPIED_FROM, OccupancyGrid, cells_to_unset, values_at

MARGIN_M = 0.08  # about a wall whose returns lie on it: a cell and a half of 5 cm
PER_MEDIAN = 1.5
"""added to the margin for each metre by which half of the wall returns about are off their walls"""
ABOUT_RAD = math.radians(45.0)  # to either side, the angle of so many beams in a row: the wall returns about
SAMPLES = 45  # of them to either side, evenly taken, at most
WALL_M = 0.4  # a return farther from any wall is no wall's
DEPTH_M = 0.15  # beyond the margin, from which on a return says no more
WIDTH_M = 0.03  # from which on the distance to the next beam says no more: far beams are few, not sure
STEPS = 1024
"""shares are rounded down to whole parts of so many, so that any order of adding them gives the same"""


def wall_distances(prior_map: OccupancyGrid) -> OccupancyGrid:
    """float32 metres from each cell's centre to that of the nearest wall cell of an int8 map."""
    cells = cells_to_unset(prior_map.data < OCCUPIED_FROM)
    return prior_map.with_data(cells * np.float32(prior_map.resolution))


class WallEvidence:
    """The margin about a wall grows where the wall returns about are off, by pose, map or range."""

    def __init__(self, prior_map: OccupancyGrid, area_m2: float) -> None:
        """``area_m2``: from which on a return counts as one: its width times its depth beyond the margin."""
        self._walls, self._area_m2 = wall_distances(prior_map), area_m2

    def shares(self, scan: Scan) -> npt.NDArray[np.float64]:
        """(n,) of 0 to 1, one for each of ``scan.returns(inf)``."""
        beams, points = scan.returns(math.inf)
        turn_rad = max(abs(scan.lidar.angle_increment_rad), 1e-9)
        off_m = values_at(self._walls.data, self._walls, points, 0.0).astype(np.float64)
        margin_m = np.zeros(len(beams))
        walls = np.flatnonzero(off_m < WALL_M)
        if len(walls):
            half = min(round(ABOUT_RAD / turn_rad), (len(walls) - 1) // 2)
            steps = np.arange(-half, half + 1, max(1, half // SAMPLES))
            about = off_m[walls[(np.arange(len(walls))[:, None] + steps) % len(walls)]]
            middle = len(steps) // 2
            margin_m[walls] = MARGIN_M + PER_MEDIAN * np.partition(about, middle, axis=1)[:, middle]
        widths_m = np.minimum(scan.ranges_m[beams] * turn_rad, WIDTH_M)
        areas_m2 = widths_m * np.clip(off_m - margin_m, 0.0, DEPTH_M)
        return np.asarray(np.floor(np.minimum(areas_m2 / self._area_m2, 1.0) * STEPS) / STEPS)
