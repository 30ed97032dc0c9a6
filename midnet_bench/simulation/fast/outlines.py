"""What never moves, as the compiled loops read it: outlines that beams meet, and sides that bodies touch."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, hypot, sin
from midnet_bench.geometry import Floats, Indices, Solid, lengths

CELL_M = 0.25
_HAIR_M = 1e-6  # A corner this near another solid lies on it.

# Columns of a side, of what stands as of a body's hull: its first end, the unit vector along it, its length,
# and the unit vector along the side before: both 0 where the first end is no corner that a body can meet.
# What it is the side of lies to its left.
X, Y, ALONG_X, ALONG_Y, LENGTH, LAST_X, LAST_Y = range(7)


class Outlines(NamedTuple):
    """The convex outlines of all solids, one after the other."""

    sides: Floats  # (k, 7) by the columns ``X`` to ``LAST_Y``, metres
    first: Indices  # (s + 1,) where each solid's sides begin, and their number
    circles: Floats  # (s, 3) x, y and radius of a circle about each solid


def sides_of(outlines: Sequence[Floats]) -> Floats:
    """(k, 7) the sides of closed outlines, each of (c, 2) corners, by the columns ``X`` to ``LAST_Y``."""
    corners = np.concatenate(outlines)
    ends = np.cumsum([len(outline) for outline in outlines])
    after = np.arange(1, len(corners) + 1)
    after[ends - 1] = [0, *ends[:-1]]
    ways = corners[after] - corners
    lengths_m = lengths(ways)
    along = ways / lengths_m[:, None]
    last = np.empty_like(along)
    last[after] = along
    return np.column_stack((corners, along, lengths_m, last))


def outlines_of(solids: tuple[Solid, ...]) -> Outlines:
    """The outlines of ``solids``, in their order."""
    outlines = [solid.outline for solid in solids]
    counts = [len(outline) for outline in outlines]
    sides, first = sides_of(outlines), np.cumsum([0, *counts])
    centers = np.array([solid.pose[:2] for solid in solids])
    off_m = lengths(sides[:, :2] - np.repeat(centers, counts, axis=0))
    return Outlines(sides, first, np.column_stack((centers, np.maximum.reduceat(off_m, first[:-1]))))


def side_grid(outlines: Outlines, reach_m: float) -> tuple[Floats, Floats, Indices, Indices]:
    """The sides less what lies inside other solids, and for each cell of a grid all those within ``reach_m``.

    Walls overlap where they meet. A body that slides along one must not catch on the end of the next.
    """
    pieces = np.array(exposed_pieces(*outlines)).reshape(-1, 4)
    sides = outlines.sides[pieces[:, 0].astype(np.int64)]
    starts, ends, is_corner = pieces[:, 1:2], pieces[:, 2:3], pieces[:, 3:]
    along = sides[:, ALONG_X : ALONG_Y + 1]
    tails = sides[:, :2] + ends * along
    sides[:, :2] += starts * along
    sides[:, LENGTH] = ((tails - sides[:, :2]) * along).sum(axis=1)
    sides[:, LAST_X:] *= is_corner
    low = np.minimum(sides[:, :2], tails) - reach_m
    high = np.maximum(sides[:, :2], tails) + reach_m
    origin = low.min(axis=0)
    columns, rows = np.ceil((high.max(axis=0) - origin) / CELL_M).astype(np.int64).tolist()
    left, bottom = ((low - origin) / CELL_M).astype(np.int64).T
    right, top = np.minimum(((high - origin) / CELL_M).astype(np.int64), (columns - 1, rows - 1)).T
    wide = right - left + 1
    counts = wide * (top - bottom + 1)
    members = np.repeat(np.arange(len(sides)), counts)
    place = np.arange(len(members)) - np.repeat(np.cumsum(counts) - counts, counts)
    cells = (bottom[members] + place // wide[members]) * columns + left[members] + place % wide[members]
    order = np.argsort(cells, kind="stable")
    first = np.searchsorted(cells[order], np.arange(columns * rows + 1))
    return sides, np.array([*origin, columns, rows]), first, members[order]


@njit
def exposed_pieces(sides: Floats, first: Indices, circles: Floats) -> list[tuple[float, float, float, float]]:
    """The parts of all sides that lie outside every other solid.

    Of each: the side, how far along it the part begins and ends, metres, and whether it begins at a corner.
    """
    pieces = [(0.0, 0.0, 0.0, 0.0) for _ in range(0)]
    for solid in range(len(circles)):
        for k in range(first[solid], first[solid + 1]):
            side, is_corner = sides[k], 1.0
            buried = [(0.0, 0.0) for _ in range(0)]
            for other in range(len(circles)):
                dx, dy = circles[other, 0] - side[X], circles[other, 1] - side[Y]
                if other == solid or hypot(dx, dy) > side[LENGTH] + circles[other, 2] + _HAIR_M:
                    continue
                enter, leave, depth, nearest = _inside(sides[first[other] : first[other + 1]], side)
                if enter < leave:
                    buried.append((enter, leave))
                if depth > -_HAIR_M and nearest > _HAIR_M:
                    is_corner = 0.0
            buried.sort()
            start = 0.0
            for enter, leave in buried:
                if enter >= start + _HAIR_M:
                    pieces.append((float(k), start, enter, is_corner if start == 0.0 else 0.0))
                start = max(start, leave)
            if start < side[LENGTH] - _HAIR_M:
                pieces.append((float(k), start, side[LENGTH], is_corner if start == 0.0 else 0.0))
    return pieces


@njit
def _inside(outline: Floats, line: Floats) -> tuple[float, float, float, float]:
    """Which part of a side lies inside a convex outline, and how its first end lies to it.

    Metres along the side where it enters and leaves (nothing inside unless the first is less), how deep the
    end is, negative outside, and its distance from the nearest corner.
    """
    enter, leave, depth, nearest = 0.0, line[LENGTH], np.inf, np.inf
    for side in outline:
        dx, dy = line[X] - side[X], line[Y] - side[Y]
        nearest = min(nearest, hypot(dx, dy))
        inward = side[ALONG_X] * dy - side[ALONG_Y] * dx
        depth = min(depth, inward)
        slope = side[ALONG_X] * line[ALONG_Y] - side[ALONG_Y] * line[ALONG_X]
        if abs(slope) < 1e-12:
            if inward < _HAIR_M:
                leave = -1.0
        elif slope > 0.0:
            enter = max(enter, -inward / slope)
        else:
            leave = min(leave, -inward / slope)
    return enter, leave, depth, nearest


@njit
def cast_on_outlines(
    axes: Floats, directions: Floats, outlines: tuple[Floats, Indices, Floats], near_m: float, far_m: float
) -> Floats:
    """(m, beams) metres to the first side met from ``near_m`` on and before ``far_m``; inf if there is none.

    ``axes`` (m, 2), ``directions`` (m, beams, 2) as of :class:`~midnet_bench.simulation.engine.Beams`;
    ``outlines``: an :class:`Outlines` without names, by ``[:]``: numba takes it faster. A beam that starts
    inside a solid meets its side from within. Where the beams are evenly spread, counter-clockwise over a
    full turn or less, the first that may meet a side is found by the angle of its end.
    """
    sides, first, circles = outlines
    sensors, beams = directions.shape[:2]
    ranges = np.full((sensors, beams), np.inf)
    turn_rad = 2.0 * math.pi
    for i in range(sensors):
        x, y, fan, found = axes[i, 0], axes[i, 1], directions[i], ranges[i]
        start_rad = atan2(fan[0, 1], fan[0, 0]) if beams > 0 else 0.0
        spacing_rad, half_turn = turn_rad / max(beams, 1), beams // 2 + 3
        is_full = is_even = beams >= 8 and _is_even(fan, spacing_rad, 0)
        if beams >= 8 and not is_full:
            ahead = fan[0, 0] * fan[1, 0] + fan[0, 1] * fan[1, 1]
            spacing_rad = atan2(fan[0, 0] * fan[1, 1] - fan[0, 1] * fan[1, 0], ahead)
            is_even = 0.0 < spacing_rad * beams < turn_rad and _is_even(fan, spacing_rad, 1)
            half_turn = min(beams, int(math.pi / max(spacing_rad, 1e-9)) + 3)
        for solid in range(len(circles)):
            away_m = hypot(circles[solid, 0] - x, circles[solid, 1] - y)
            if away_m - circles[solid, 2] >= far_m:
                continue
            hides_its_back = away_m - circles[solid, 2] >= near_m
            low, high = first[solid], first[solid + 1]
            for k in range(low, high):
                after = k + 1 if k + 1 < high else low
                # from its clockwise to its counter-clockwise end
                bx, by, ax, ay = sides[k, X] - x, sides[k, Y] - y, sides[after, X] - x, sides[after, Y] - y
                area = ax * by - ay * bx
                if abs(area) > far_m * sides[k, LENGTH] or (area <= 0.0 and hides_its_back):
                    continue
                if area < 0.0:
                    ax, ay, bx, by, area = bx, by, ax, ay, -area
                beam, most = 0, beams
                if is_even:
                    off_rad = atan2(ay, ax) - start_rad
                    if is_full:
                        beam = math.floor(off_rad / spacing_rad) % beams
                    else:
                        # behind the last beam the first one is the next
                        beam = math.floor(off_rad % turn_rad / spacing_rad)
                        beam = beam if beam < beams else 0
                    most = half_turn
                for _ in range(most):
                    dx, dy = fan[beam, 0], fan[beam, 1]
                    beam = beam + 1 if beam + 1 < beams else 0
                    if dx * ay - dy * ax > 0.0:
                        continue
                    if dx * by - dy * bx > 0.0:
                        distance = area / (dx * (by - ay) - dy * (bx - ax))
                        if near_m <= distance < far_m and distance < found[beam - 1]:
                            found[beam - 1] = distance
                    elif is_even:
                        break
    return ranges


@njit
def _is_even(fan: Floats, spacing_rad: float, start: int) -> bool:
    """Whether each beam from ``start`` on points ``spacing_rad`` counter-clockwise of the one before.

    Beam 0 comes after the last one.
    """
    sine = sin(spacing_rad)
    for k in range(start, len(fan)):
        before = fan[k - 1]
        if abs(before[0] * fan[k, 1] - before[1] * fan[k, 0] - sine) > 1e-9:
            return False
    return True
