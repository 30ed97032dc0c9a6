"""PyBullet's rays against what stands still, and where each of them may begin and end.

What ``rayTestBatch`` takes grows with the number of its rays and with their length. ``reaches`` tells from
the solids' sides between which two distances a beam can meet anything first. Only that piece of it is cast,
and a beam that can meet nothing is not cast. The bounds err to the safe side by more than PyBullet's mesh.
"""

import math
from operator import itemgetter

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.arena.layout import Layout
from midnet_bench.simulation.bullet.engine import bullet, give_back, take_client
from midnet_bench.simulation.bullet.stage import add_solids
from midnet_bench.simulation.integrity import surfaces
from midnet_bench.simulation.simulator import Beams

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""
SECTORS = 180
"""of the full circle about a sensor, for each of which there is one pair of bounds"""
MARGIN_M = 0.01
"""PyBullet's mesh is met up to 0.3 mm beside the edges of the solids that it was made of."""
SLIVER = 1e-3
"""of a sector: a side that is seen so narrow, end on, is taken to be all where its nearer end is"""

_FRACTION = itemgetter(2)
"""of a ray's result, as PyBullet gives it"""


class Rays:
    """Beams against all walls and stationary intruders, in a PyBullet client that holds nothing else.

    Beside floor and robots, which no beam meets, a ray would take a third longer.
    """

    def __init__(self, layout: Layout, height_m: float) -> None:
        """The scan plane lies ``height_m`` above the floor."""
        self._client = take_client()
        add_solids(self._client, layout.solids)
        self._sides = surfaces(layout)
        self._height_m = height_m

    def close(self) -> None:
        """Give the client back; more than once does no harm."""
        if self._client >= 0:
            give_back(self._client)
            self._client = -1

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        starts, ends, spans, places = pieces(*beams, self._sides, near_m, far_m, self._height_m)
        ranges = np.full(beams.directions.shape[:2], np.inf)
        if len(places):
            meet(ranges.reshape(-1), places, spans, self.fractions(starts, ends))
        return ranges

    def fractions(self, starts: Floats, ends: Floats) -> Floats:
        """(n,) how far along each ray from (n, 3) starts to ends the first solid is; 1 if none."""
        return ray_fractions(self._client, starts, ends)


def ray_fractions(client: int, starts: Floats, ends: Floats) -> Floats:
    """(n,) how far along each ray the first solid is, 1 if there is none; (n, 3) starts and ends, metres.

    PyBullet answers with a tuple of tuples; most of what that costs is making them and giving them back.
    """
    fractions = np.empty(len(starts))
    for first in range(0, len(starts), MAX_BATCH):
        batch = slice(first, first + MAX_BATCH)
        hits = bullet.rayTestBatch(starts[batch], ends[batch], numThreads=1, physicsClientId=client)
        fractions[batch] = np.fromiter(map(_FRACTION, hits), np.float64, len(hits))
    return fractions


@njit(cache=True)
def pieces(
    axes: Floats, directions: Floats, sides: Floats, near_m: float, far_m: float, height_m: float
) -> tuple[Floats, Floats, Floats, Ints]:
    """Of the n beams that may meet a solid, the piece in which they do so.

    Returns its start and its end, (n, 3) each; (n, 2) how far from the axis these are; and (n,) the beam's
    place among all beams, counted sensor by sensor.
    """
    sensors, beams = directions.shape[:2]
    starts, ends = np.empty((sensors * beams, 3)), np.empty((sensors * beams, 3))
    spans = np.empty((sensors * beams, 2))
    places = np.empty(sensors * beams, dtype=np.int64)
    n = 0
    for i in range(sensors):
        nearest, farthest = reaches(axes[i, 0], axes[i, 1], sides, near_m, far_m)
        for k in range(beams):
            x, y = directions[i, k, 0], directions[i, k, 1]
            sector = int((math.atan2(y, x) + math.pi) * (SECTORS / (2.0 * math.pi))) % SECTORS
            start, end = max(near_m, nearest[sector]), min(far_m, farthest[sector])
            if start >= end:
                continue
            for axis in range(2):
                starts[n, axis] = axes[i, axis] + start * directions[i, k, axis]
                ends[n, axis] = axes[i, axis] + end * directions[i, k, axis]
            starts[n, 2] = ends[n, 2] = height_m
            spans[n, 0], spans[n, 1] = start, end
            places[n] = i * beams + k
            n += 1
    return starts[:n], ends[:n], spans[:n], places[:n]


@njit(cache=True)
def reaches(x: float, y: float, sides: Floats, near_m: float, far_m: float) -> tuple[Floats, Floats]:
    """Two of (SECTORS,): no beam from (x, y) meets a side before the first, each beam does by the second.

    Sector k holds the directions from -pi + 2 pi k / SECTORS up to the next. The first is inf where no side
    up to ``far_m`` reaches into it; the second where none beyond ``near_m`` covers all of it.
    """
    nearest, farthest = np.full(SECTORS, np.inf), np.full(SECTORS, np.inf)
    width = 2.0 * math.pi / SECTORS
    for side in range(len(sides)):
        ax, ay, bx, by = sides[side, 0] - x, sides[side, 1] - y, sides[side, 2] - x, sides[side, 3] - y
        reach_m = far_m + MARGIN_M
        if min(ax, bx) > reach_m or max(ax, bx) < -reach_m or min(ay, by) > reach_m or max(ay, by) < -reach_m:
            continue
        along_x, along_y = bx - ax, by - ay
        if ax * by - ay * bx < 0.0:
            ax, ay, bx, by, along_x, along_y = bx, by, ax, ay, -along_x, -along_y
        across = ax * by - ay * bx
        if across > reach_m * math.hypot(along_x, along_y):
            continue
        first_m, last_m = math.hypot(ax, ay), math.hypot(bx, by)
        # both directions as sectors, fractions of one included, from the right end to the left one
        first = (math.atan2(ay, ax) + math.pi) / width
        last = first + math.atan2(across, ax * bx + ay * by) / width
        # by so much a beam may pass an end and still meet the mesh, or meet the end and pass the mesh
        slack_first = MARGIN_M / (first_m + MARGIN_M) / width
        slack_last = MARGIN_M / (last_m + MARGIN_M) / width
        if last - first < SLIVER:
            first_m = last_m = min(first_m, last_m)
        left_m = first_m
        for k in range(math.floor(first - slack_first), math.floor(last + slack_last) + 1):
            right_m, left_m = left_m, last_m
            if k + 1 < last and last - first >= SLIVER:
                if k + 1 > first:
                    angle = (k + 1) * width - math.pi
                    left_m = across / (math.cos(angle) * along_y - math.sin(angle) * along_x)
                else:
                    left_m = first_m
            sector = k % SECTORS
            least_m = min(right_m, left_m) * math.cos(width) - MARGIN_M
            nearest[sector] = min(nearest[sector], least_m)
            if least_m > near_m and k >= first + slack_first and k + 1 <= last - slack_last:
                farthest[sector] = min(farthest[sector], max(right_m, left_m) + MARGIN_M)
    return nearest, farthest


@njit(cache=True)
def meet(ranges: Floats, places: Ints, spans: Floats, met: Floats) -> None:
    """Put into ``ranges``, (all beams,), where each piece meets something: at its share ``met`` below 1."""
    for i in range(len(met)):
        if met[i] < 1.0:
            ranges[places[i]] = spans[i, 0] + met[i] * (spans[i, 1] - spans[i, 0])
