"""Whether the robots moved, and only where bodies can."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import Dwell
from midnet_bench.arena.layout import Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import hypot

Floats = npt.NDArray[np.float64]


class HealthTracker:
    """How far each robot has come, and how often its centre went through a surface."""

    def __init__(self, layout: Layout, poses: Floats) -> None:
        self._surfaces = surfaces(layout)
        self._last = poses.copy()
        self.distances_m: Floats = np.zeros(len(poses))
        """(n,) path lengths so far"""
        self.crossings: npt.NDArray[np.int64] = np.zeros(len(poses), dtype=np.int64)
        """(n,) surfaces tunnelled through; anything but 0 says that the physics failed"""

    def update(self, poses: Floats) -> None:
        """Take the (n, 3) poses of a later tick, NaN for a robot that is gone. Five a second will do."""
        note_moves(self._surfaces, self._last, poses, self.distances_m, self.crossings)


class Standstill:
    """The time that one robot stood although it had a goal, from its true positions; for ``robots.csv``."""

    RADIUS_M = 0.25
    STUCK_AFTER_S = 5.0

    def __init__(self) -> None:
        self.stuck_s = 0.0
        """seconds with a goal but within 0.25 m of one place, where that lasted longer than 5 s: a Burger
        under way is through such a circle in 2.3 s, and one that swings to and fro never leaves it"""
        self._dwell = Dwell(self.RADIUS_M)
        self._counted_until_s = 0.0
        self._goal = -1

    def update(self, x: float, y: float, time_s: float, has_goal: bool, goal: int) -> None:
        """Note where the robot is, map frame, metres, and its goal, by number; a new one begins anew."""
        if goal != self._goal or not has_goal:
            self._goal = goal
            self._dwell.begin(x, y, time_s)
        self._dwell.update(x, y, time_s)
        if time_s - self._dwell.since_s > self.STUCK_AFTER_S:
            # a long stand counts from its beginning
            self.stuck_s += time_s - max(self._dwell.since_s, self._counted_until_s)
            self._counted_until_s = time_s


def surfaces(layout: Layout) -> Floats:
    """(k, 4) the sides of all walls and stationary intruders: x and y of one end, x and y of the other."""
    outlines = [solid.outline() for solid in layout.solids]
    ends = [part for outline in outlines for part in (outline[1:], outline[:1])]
    return np.hstack((np.concatenate(outlines), np.concatenate(ends)))


@njit
def note_moves(
    sides: Floats, last: Floats, now: Floats, distances_m: Floats, crossings: npt.NDArray[np.int64]
) -> None:
    """Add the straight ways from (n, 3) poses to later ones, and what they go through; then they are last."""
    crossed = crossed_wall(sides, last, now)
    for i in range(len(now)):
        way_m = hypot(now[i, 0] - last[i, 0], now[i, 1] - last[i, 1])
        if not math.isnan(way_m):
            distances_m[i] += way_m
        if crossed[i]:
            crossings[i] += 1
        last[i] = now[i]


@njit
def crossed_wall(sides: Floats, before: Floats, after: Floats) -> npt.NDArray[np.bool_]:
    """(n,) whether the straight way from ``before`` to ``after`` goes through one of ``surfaces``.

    Both are (n, 2) or more, x and y first.

    A robot's centre is never less than 38 mm from a surface that its body only touches, so going through
    even one side means that the body went through. NaN crosses nothing.
    """
    crossed = np.zeros(len(before), dtype=np.bool_)
    for i in range(len(before)):
        xa, ya, xb, yb = before[i, 0], before[i, 1], after[i, 0], after[i, 1]
        along_x, along_y = xb - xa, yb - ya
        for k in range(len(sides)):
            x1, y1, x2, y2 = sides[k, 0], sides[k, 1], sides[k, 2], sides[k, 3]
            side_x, side_y = x2 - x1, y2 - y1
            ends = (along_x * (y1 - ya) - along_y * (x1 - xa)) * (along_x * (y2 - ya) - along_y * (x2 - xa))
            way = (side_x * (ya - y1) - side_y * (xa - x1)) * (side_x * (yb - y1) - side_y * (xb - x1))
            if ends < 0.0 and way < 0.0:
                crossed[i] = True
    return crossed
