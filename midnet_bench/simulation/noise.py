"""``NoiseBlocks``: random numbers of several robots, each from its own stream, drawn many at a time."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.rng import standard_normals

BLOCK = 64
"""readings that are drawn at once, unless told otherwise"""


class NoiseBlocks:
    """Numbers for the readings of n sensors; the same ones, in the same order, as drawn one by one."""

    def __init__(self, rngs: Sequence[np.random.Generator], width: int, block: int = BLOCK) -> None:
        """One generator for each sensor, ``width`` standard normal numbers for each reading.

        ``block``: how many readings are drawn at once.
        """
        self._rngs = rngs
        self.normals: npt.NDArray[np.float64] = np.zeros((len(rngs), block, width))
        """(n, block, width)"""
        self.used: npt.NDArray[np.int64] = np.full(len(rngs), block, dtype=np.int64)
        """(n,) how many readings of its block each sensor has taken; compiled code counts it up"""
        self.refill()

    def refill(self) -> None:
        """Draw another block for every sensor that has used its own up."""
        for sensor in np.flatnonzero(self.used == self.normals.shape[1]).tolist():
            self.normals[sensor] = standard_normals(self._rngs[sensor], self.normals[sensor].shape)
            self.used[sensor] = 0
