"""``CircleClusters``: adaptive breakpoints cut the scan, and a circle is fitted to each piece.

Borges and Aldon, "Line extraction in 2D range images for mobile robotics", Journal of Intelligent and Robotic
Systems 40 (2004): two neighbouring returns belong together if they are no farther apart than a surface that
the beams meet at an angle of ``incidence_deg`` would put them, plus three deviations of the range.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.detectors.map_subtraction import wall_distances
from midnet_bench.elementary import sin
from midnet_bench.errors import InputError
from midnet_bench.geometry import Scan, lengths, mean_point
from midnet_bench.grid import OccupancyGrid, values_at
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation

Points = npt.NDArray[np.float64]

STRAIGHT = 1e-12
"""A piece is straight where its scatter's determinant is below this share of its trace squared."""


class CircleClusters:
    """Pieces of the scan off the mapped walls, each the upright square around the circle that fits it best.

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
        return [self._boxes(observation.scan) for observation in team]

    def _boxes(self, scan: Scan | None) -> BoxArray:
        boxes = []
        for piece in [] if scan is None else self._pieces(scan):
            off_m = float(np.median(values_at(self._walls.data, self._walls, piece, 0.0)))
            if len(piece) >= self._min_returns and off_m > self._tolerance_m:
                boxes.append(self._box(piece))
        return np.array(boxes, dtype=np.float64).reshape(-1, 4)

    def _pieces(self, scan: Scan) -> list[Points]:
        """The returns within range, cut at the breakpoints; each piece (n, 2), map frame."""
        # what is out of range cuts too: it tells an intruder from the wall beside it
        beams, points = scan.returns(math.inf)
        if not len(beams):
            return []
        ranges_m = scan.ranges_m[beams]
        turn_rad = abs(scan.lidar.angle_increment_rad)
        if self._incidence_rad <= turn_rad:
            beams_deg = math.degrees(turn_rad)
            raise InputError(
                f"detector clusters: incidence_deg: {math.degrees(self._incidence_rad):g} is out of range; "
                f"allowed: above the {beams_deg:g} degrees between two beams"
            )
        widening = sin(turn_rad) / sin(self._incidence_rad - turn_rad)
        gaps_m = lengths(points - np.roll(points, 1, axis=0))
        apart = gaps_m > np.roll(ranges_m, 1) * widening + 3.0 * self._noise_m
        first = int(np.argmax(apart))  # 0 where nothing is apart
        cuts = np.flatnonzero(np.roll(apart, -first))[1:]
        pieces = zip(
            *(np.split(np.roll(one, -first, axis=0), cuts) for one in (points, ranges_m)), strict=True
        )
        return [piece[far <= self._range_m] for piece, far in pieces if (far <= self._range_m).any()]

    def _box(self, piece: Points) -> list[float]:
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
        return [*piece.min(axis=0) - self._noise_m, *piece.max(axis=0) + self._noise_m]
