"""What the referee knows of where errors come from: the evidence, and what is read from it.

Nothing here needs a simulator or a detector: scans, true places and boxes are enough.
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid, cells_of
from midnet_bench.midnet.binary_map import OCCUPIED
from midnet_bench.scoring.frame_counts import TruthObject

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Booleans = npt.NDArray[np.bool_]
Kind = Literal["miss", "false", "fragment"]

WALL, NOTHING = -1, -2
"""what a return came from that is no truth: a wall, or nothing that is known"""
_FIRST_ALLY = -10


def ally(guard: int) -> int:
    """The source of returns from a guard, by its index in the team."""
    return _FIRST_ALLY - guard


def guard_of(source: int) -> int | None:
    """The index of the guard that returns came from; None if from none."""
    return _FIRST_ALLY - source if source <= _FIRST_ALLY else None


def source_name(source: int, truths: Sequence[TruthObject]) -> str:
    """In words: ``guard 2``, an intruder's name, ``a wall``; empty for nothing that is known."""
    guard = guard_of(source)
    if guard is not None:
        return f"guard {guard + 1}"
    return truths[source].name if source >= 0 else "a wall" if source == WALL else ""


class Marks(NamedTuple):
    """m returns of one guard, each in four places: which part of its error came from pose and range."""

    source: Ints
    """(m,) the index of a truth, :func:`ally`, ``WALL`` or ``NOTHING``"""
    age_s: Floats
    """(m,)"""
    is_newest: Booleans
    """(m,) whether it is of the guard's last scan"""
    believed: Floats
    """(m, 2) where the guard put it, map frame, metres"""
    at_true_pose: Floats
    """(m, 2) where it had put it, had it known its pose"""
    at_true_range: Floats
    """(m, 2) where it had put it without the noise of its range"""
    true: Floats
    """(m, 2) what was met"""

    def where(self, chosen: npt.NDArray[np.bool_]) -> "Marks":
        """Those of an (m,) mask."""
        return Marks(
            self.source[chosen],
            self.age_s[chosen],
            self.is_newest[chosen],
            self.believed[chosen],
            self.at_true_pose[chosen],
            self.at_true_range[chosen],
            self.true[chosen],
        )


class SightLines(NamedTuple):
    """What the n beams of one LiDAR would meet at the frame's instant."""

    directions: Floats
    """(n, 2) unit vectors, map frame"""
    ranges_m: Floats
    """(n,) inf for nothing"""
    sources: Ints
    """(n,) as of :class:`Marks`"""


class GuardView(NamedTuple):
    """One guard at the frame's instant: where it truly is, what it marked, and what became of that."""

    guard: int
    """index in the team"""
    sensor: tuple[float, float]
    """(x, y) of its LiDAR as it truly is, map frame, metres"""
    lines: Callable[[], SightLines]
    returns: Callable[[int], tuple[Marks, Booleans]]
    """source -> the returns of its last scan that came from there, and which are within the obstacle range"""
    marks: Callable[[], Marks]
    """the marked cells of its costmap; misses need none of them"""
    shift_m: tuple[float, float]
    """by which the crop moves its cells on the prior map"""
    window: Box
    """its costmap, map frame, metres"""
    reach_m: float
    """how far from a mark a cell has the cost that counts"""
    a: OccupancyGrid | None
    """A of Eq. 1, cropped, 0 where occupied; None if the detector has no such grid"""
    d: OccupancyGrid | None
    """D of Eq. 6, 255 where an intruder is"""
    prior: OccupancyGrid | None
    """B in full, the prior map's binary grid, 0 where occupied"""
    disc: Ints
    """(k, 2) columns and rows from a mark's cell to the cells that have the cost that counts"""
    found: Sequence[Box]
    """the boxes that it found"""
    deflated_m: float
    """what was taken off each side of them as soon as they were found"""
    taken: Sequence[int | None]
    """for each of them the index of the ally that it was removed for"""
    centers_at_scan: Callable[[], Floats]
    """(truths, 2) where the truths were at its last scan; (0, 2) before the first"""


class Cause(NamedTuple):
    """Why one error came about."""

    name: str
    """of ``error_causes``"""
    guard: int | None = None
    """index of the guard that it came about at; None if at none"""
    by: str = ""
    """what else had a part: the robot before it, or the one that left the trail"""
    age_s: float = 0.0
    """of the newest return that has a part"""
    offset_m: float = 0.0
    """by which error of place: of the pose, the crop, the range, or how far an intruder moved"""


def moved(box: Box, by: Sequence[float] | Floats) -> Box:
    """The box elsewhere."""
    x, y = float(by[0]), float(by[1])
    return Box(box.x_min + x, box.y_min + y, box.x_max + x, box.y_max + y)


def touches(box: Box, other: Box) -> bool:
    """Whether they have some area in common, as section V.A asks."""
    return box.intersection_area(other) > 0.0


def cells_left(places: Floats, view: GuardView) -> Floats:
    """(n, 2) centres of the cells that marks at (m, 2) places give once the prior map is subtracted, metres.

    Cells beyond the prior map are not there, as in section IV.B.1. Nothing where there is no prior map.
    """
    prior = view.prior
    if prior is None or not len(places):
        return np.empty((0, 2))
    cells = np.unique((cells_of(prior, places)[:, None] + view.disc[None]).reshape(-1, 2), axis=0)
    columns, rows = cells.T
    on = (columns >= 0) & (rows >= 0) & (columns < prior.width) & (rows < prior.height)
    cells = cells[on]
    cells = cells[prior.data[cells[:, 1], cells[:, 0]] != OCCUPIED]
    return np.asarray(prior.origin + (cells + 0.5) * prior.resolution)


def touch(cells: Floats, resolution: float, box: Box) -> bool:
    """Whether one of the square cells about (n, 2) centres has some area in common with the box."""
    half = resolution / 2.0
    x, y = cells[:, 0], cells[:, 1]
    across = (x + half > box.x_min) & (x - half < box.x_max)
    return bool((across & (y + half > box.y_min) & (y - half < box.y_max)).any())
