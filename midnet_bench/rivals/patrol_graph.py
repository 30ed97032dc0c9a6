"""``PatrolGraph``: a few places that stand for all, and the ways between them."""

import math

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from midnet_bench.geometry import Point, lengths


class PatrolGraph:
    """Some of the points, about evenly apart, and how far it is from one to another around the walls."""

    COARSE_M = 0.25
    """side of the cells that ways are measured on, in steps to eight neighbours"""

    def __init__(self, points: npt.NDArray[np.float64], spacing_m: float) -> None:
        """``points``: (n, 2), metres, where a guard may be sent, each within reach of the others."""
        cells, first = np.unique(np.floor(points / self.COARSE_M).astype(np.int64), axis=0, return_index=True)
        places = points[first]
        chosen: list[int] = []
        for i, place in enumerate(places):
            if not chosen or lengths(places[chosen] - place).min() >= spacing_m:
                chosen.append(i)
        self.nodes = places[chosen]
        """(k, 2) metres"""
        self.ways_m = dijkstra(_steps(cells), indices=chosen)[:, chosen] * self.COARSE_M
        """(k, k) from node to node; inf where no way was found"""
        straight = lengths(self.nodes[:, None] - self.nodes[None])
        # thin passages may be lost on coarse cells
        self.ways_m = np.where(np.isinf(self.ways_m), 10.0 * straight, np.maximum(self.ways_m, straight))

    def nearest(self, place: Point) -> int:
        """The node that is nearest to ``place`` in a straight line."""
        return int(lengths(self.nodes - place).argmin())


def _steps(cells: npt.NDArray[np.int64]) -> coo_matrix:
    """The graph of neighbouring cells, (n, n), weights 1 and sqrt 2."""
    number = {tuple(cell): i for i, cell in enumerate(cells.tolist())}
    rows, columns, weights = [], [], []
    for (x, y), i in number.items():
        for dx, dy in ((1, 0), (0, 1), (1, 1), (1, -1)):
            j = number.get((x + dx, y + dy))
            if j is not None:
                rows += [i, j]
                columns += [j, i]
                weights += [math.hypot(dx, dy)] * 2
    return coo_matrix((weights, (rows, columns)), shape=(len(number), len(number)))
