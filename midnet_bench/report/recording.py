"""``Recording``: an exploration second by second, kept small until it is known how long it lasts."""

import zlib
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Point
from midnet_bench.experiments.mapping import ExplorationTrial, Snapshot
from midnet_bench.geometry import wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.map_score import reachable_free

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moment:
    """An exploration at one instant, map frame, metres."""

    time_s: float
    coverage: float
    """share of the free cells within reach that the map knows, 0 to 1"""
    grid: OccupancyGrid
    """the team's map, int8"""
    poses: Floats
    """(n, 3) where the robots truly are"""
    believed: Floats
    """(n, 3) where they take themselves to be"""
    goals: list[Point | None]
    ways: list[Floats]
    """of each robot, (k, 2): where it took itself to be until now"""


class Recording:
    """Takes a trial's snapshots; between two of them, robots go straight and the map is the earlier one."""

    def __init__(self, trial: ExplorationTrial) -> None:
        """``trial`` has not begun yet."""
        start = trial.layout.robots[0]
        self._within_reach = reachable_free(trial.truth(), (start.x, start.y))
        self._snapshots: list[Snapshot] = []
        self._maps: list[bytes] = []
        self.coverage: list[float] = []
        """of each snapshot, as in :class:`Moment`"""

    def take(self, snapshot: Snapshot) -> None:
        """The next snapshot."""
        data = snapshot.grid.data
        self.coverage.append(float(np.mean(data[self._within_reach] >= 0)))
        # a map of 24 x 24 m has 230 kB; packed, an hour of them fits in memory
        self._maps.append(zlib.compress(data.tobytes(), 1))
        blank = np.broadcast_to(np.int8(-1), data.shape)
        self._snapshots.append(replace(snapshot, grid=snapshot.grid.with_data(blank)))

    @property
    def begin_s(self) -> float:
        """When the first snapshot was taken, simulated seconds."""
        return self._snapshots[0].time_s

    @property
    def end_s(self) -> float:
        """When the last one was."""
        return self._snapshots[-1].time_s

    def ways(self) -> list[Floats]:
        """Of each robot, (k, 2): where it took itself to be, snapshot by snapshot."""
        believed = np.array([snapshot.believed[:, :2] for snapshot in self._snapshots])
        return list(believed.transpose(1, 0, 2))

    def at(self, time_s: float) -> Moment:
        """The exploration at an instant between its first snapshot and its last."""
        after = bisect_right(self._snapshots, time_s, key=lambda snapshot: snapshot.time_s)
        earlier = max(after - 1, 0)
        one, two = self._snapshots[earlier], self._snapshots[min(after, len(self._snapshots) - 1)]
        gap_s = two.time_s - one.time_s
        share = (time_s - one.time_s) / gap_s if gap_s > 0.0 else 0.0
        believed = _between(one.believed, two.believed, share)
        ways = [
            np.vstack([way[: earlier + 1], here])
            for way, here in zip(self.ways(), believed[:, :2], strict=True)
        ]
        data = np.frombuffer(zlib.decompress(self._maps[earlier]), dtype=np.int8)
        return Moment(
            time_s=time_s,
            coverage=self.coverage[earlier],
            grid=one.grid.with_data(data.reshape(one.grid.data.shape)),
            poses=_between(one.poses, two.poses, share),
            believed=believed,
            goals=one.goals,
            ways=ways,
        )


def _between(one: Floats, two: Floats, share: float) -> Floats:
    """(n, 3) poses on the way from ``one`` to ``two``, turning the short way round."""
    step = two - one
    step[:, 2] = [wrap_angle(turn) for turn in step[:, 2].tolist()]
    return one + share * step
