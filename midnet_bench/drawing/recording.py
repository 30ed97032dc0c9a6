"""``Recording``: how a map grew, moment by moment, kept small until it is known how long that lasts."""

import zlib
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Point
from midnet_bench.geometry import wrap_angle
from midnet_bench.grid import OccupancyGrid

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moment:
    """A map and the robots that make it at one instant, map frame, metres."""

    clock: float
    """when: simulated seconds of an exploration, or how many scans of a log are done"""
    known: float
    """how much the map knows: of an exploration, the share of the free cells within reach; of a log, m2"""
    grid: OccupancyGrid
    """the map, int8"""
    poses: Floats
    """(n, 3) where the robots truly are; (0, 3) where nobody can tell"""
    believed: Floats
    """(n, 3) where they take themselves to be"""
    goals: list[Point | None]
    ways: list[Floats]
    """of each robot, (k, 2): where it takes itself to have been until now"""


class Recording:
    """Takes moments; between two of them, robots go straight and the map is the earlier one."""

    def __init__(self) -> None:
        self._moments: list[Moment] = []
        self._maps: list[bytes] = []

    def take(self, moment: Moment) -> None:
        """The next moment; without ways, those through the places of all moments so far count."""
        data = moment.grid.data
        # a map of 24 x 24 m has 230 kB; packed, an hour of them fits in memory
        self._maps.append(zlib.compress(data.tobytes(), 1))
        blank = np.broadcast_to(np.int8(-1), data.shape)
        self._moments.append(replace(moment, grid=moment.grid.with_data(blank)))

    @property
    def clocks(self) -> list[float]:
        """When the moments were, in order."""
        return [moment.clock for moment in self._moments]

    def ways(self) -> list[Floats]:
        """Of each robot, (k, 2): where it took itself to be, moment by moment."""
        believed = np.array([moment.believed[:, :2] for moment in self._moments])
        return list(believed.transpose(1, 0, 2))

    def at(self, clock: float) -> Moment:
        """How it was between the first moment and the last."""
        after = bisect_right(self._moments, clock, key=lambda moment: moment.clock)
        earlier = max(after - 1, 0)
        one, two = self._moments[earlier], self._moments[min(after, len(self._moments) - 1)]
        gap = two.clock - one.clock
        share = (clock - one.clock) / gap if gap > 0.0 else 0.0
        believed = _between(one.believed, two.believed, share)
        ways = one.ways or [way[: earlier + 1] for way in self.ways()]
        data = np.frombuffer(zlib.decompress(self._maps[earlier]), dtype=np.int8)
        return replace(
            one,
            clock=clock,
            grid=one.grid.with_data(data.reshape(one.grid.data.shape)),
            poses=_between(one.poses, two.poses, share),
            believed=believed,
            ways=[np.vstack([way, here]) for way, here in zip(ways, believed[:, :2], strict=True)],
        )


def _between(one: Floats, two: Floats, share: float) -> Floats:
    """(n, 3) poses on the way from ``one`` to ``two``, turning the short way round."""
    step = two - one
    step[:, 2] = [wrap_angle(turn) for turn in step[:, 2].tolist()]
    return one + share * step
