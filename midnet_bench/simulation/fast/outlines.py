"""What never moves, as the compiled loops read it: corners and the beams that meet them, sides for bodies."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, hypot, sin
from midnet_bench.geometry import Solid, lengths, mean_point

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

CELL_M = 0.25
_HAIR_M = 1e-6  # A corner this near another solid lies on it.

# Columns of a side: its ends, its unit normal away from the solid, and where its first end is a corner that a
# body can meet, the unit vector along the side before; both zero where it is not.
AX, AY, BX, BY, NX, NY, BEFORE_X, BEFORE_Y = range(8)


class Outlines(NamedTuple):
    """The convex outlines of all solids, one after the other."""

    corners: Floats
    """(k, 3) x, y of each corner, counter-clockwise in each outline, and the length of the side from it"""
    first: Ints  # (s + 1,) where each solid's corners begin, and their number
    circles: Floats  # (s, 3) x, y and radius of a circle about each solid


class SideGrid(NamedTuple):
    """The sides that bodies can touch, and which of them are near each cell of a grid."""

    sides: Floats  # (k, 8) by the columns ``AX`` to ``BEFORE_Y``, metres
    frame: Floats  # (5,) x and y of the grid's lower left corner and a cell's side, metres, columns, rows
    first: Ints  # (cells + 1,) where the sides of each cell begin in ``members``; cells row by row
    members: Ints  # rows of ``sides``


def outlines_of(solids: tuple[Solid, ...]) -> Outlines:
    """The outlines of ``solids``, in their order."""
    outlines = [solid.outline() for solid in solids]
    corners = np.concatenate(outlines)
    after = np.concatenate([part for outline in outlines for part in (outline[1:], outline[:1])])
    centers = [mean_point(outline) for outline in outlines]
    radii = [lengths(outline - center).max() for outline, center in zip(outlines, centers, strict=True)]
    return Outlines(
        np.column_stack((corners, lengths(after - corners))),
        np.cumsum([0, *map(len, outlines)]),
        np.column_stack((centers, radii)),
    )


def side_grid(outlines: Outlines, reach_m: float) -> SideGrid:
    """The sides less what lies inside other solids, and for each cell those within ``reach_m`` of it."""
    sides = exposed_sides(*outlines)
    low = np.minimum(sides[:, (AX, AY)], sides[:, (BX, BY)]).min(axis=0) - reach_m
    high = np.maximum(sides[:, (AX, AY)], sides[:, (BX, BY)]).max(axis=0) + reach_m
    columns, rows = (int(cells) for cells in np.ceil((high - low) / CELL_M))
    frame = np.array([*low, CELL_M, columns, rows])
    first, members = sides_by_cell(sides, frame, reach_m)
    return SideGrid(sides, frame, first, members)


@njit
def exposed_sides(corners: Floats, first: Ints, circles: Floats) -> Floats:
    """(k, 8) the parts of all sides that lie outside every other solid.

    Walls overlap where they meet. A body that slides along one must not catch on the end of the next.
    """
    solids = len(circles)
    enter, leave = np.empty(solids), np.empty(solids)
    sides = np.empty((2 * len(corners), 8))
    count = 0
    for solid in range(solids):
        for k in range(first[solid], first[solid + 1]):
            after = k + 1 if k + 1 < first[solid + 1] else first[solid]
            before = k - 1 if k > first[solid] else first[solid + 1] - 1
            ax, ay, length = corners[k, 0], corners[k, 1], corners[k, 2]
            along_x, along_y = (corners[after, 0] - ax) / length, (corners[after, 1] - ay) / length
            buried = 0
            is_corner = True
            for other in range(solids):
                dx, dy = circles[other, 0] - ax, circles[other, 1] - ay
                if other == solid or hypot(dx, dy) > length + circles[other, 2] + _HAIR_M:
                    continue
                outline = corners[first[other] : first[other + 1]]
                enters, leaves, depth, nearest = _inside(outline, ax, ay, along_x, along_y, length)
                if enters < leaves:
                    enter[buried], leave[buried] = enters, leaves
                    buried += 1
                if depth > -_HAIR_M and nearest > _HAIR_M:
                    is_corner = False
            start = 0.0
            while start < length - _HAIR_M:
                end = length
                for other in range(buried):
                    if enter[other] < start + _HAIR_M and leave[other] > start:
                        start = end = leave[other]
                        break
                    if leave[other] > start:
                        end = min(end, enter[other])
                if end > start:
                    if count == len(sides):
                        sides = np.concatenate((sides, np.empty_like(sides)))
                    row = sides[count]
                    row[AX], row[AY] = ax + start * along_x, ay + start * along_y
                    row[BX], row[BY] = ax + end * along_x, ay + end * along_y
                    row[NX], row[NY] = along_y, -along_x
                    row[BEFORE_X] = row[BEFORE_Y] = 0.0
                    if start == 0.0 and is_corner:
                        row[BEFORE_X] = (ax - corners[before, 0]) / corners[before, 2]
                        row[BEFORE_Y] = (ay - corners[before, 1]) / corners[before, 2]
                    count += 1
                    start = end
    return sides[:count]


@njit
def _inside(
    outline: Floats, x: float, y: float, along_x: float, along_y: float, length: float
) -> tuple[float, float, float, float]:
    """Which part of a line from (x, y) lies inside a convex outline, and how the point lies to it.

    Metres along the line where it enters and leaves (nothing inside unless the first is less), how deep the
    point is, negative outside, and its distance from the nearest corner.
    """
    enter, leave, depth, nearest = 0.0, length, np.inf, np.inf
    for k in range(len(outline)):
        after = (k + 1) % len(outline)
        side_x = (outline[after, 0] - outline[k, 0]) / outline[k, 2]
        side_y = (outline[after, 1] - outline[k, 1]) / outline[k, 2]
        dx, dy = x - outline[k, 0], y - outline[k, 1]
        nearest = min(nearest, hypot(dx, dy))
        inward = side_x * dy - side_y * dx
        depth = min(depth, inward)
        slope = side_x * along_y - side_y * along_x
        if abs(slope) < 1e-12:
            if inward < _HAIR_M:
                leave = -1.0
        elif slope > 0.0:
            enter = max(enter, -inward / slope)
        else:
            leave = min(leave, -inward / slope)
    return enter, leave, depth, nearest


@njit
def sides_by_cell(sides: Floats, frame: Floats, reach_m: float) -> tuple[Ints, Ints]:
    """``first`` and ``members`` of a :class:`SideGrid`."""
    columns, rows = int(frame[3]), int(frame[4])
    within = reach_m + frame[2] * math.sqrt(0.5)
    first = np.zeros(columns * rows + 1, dtype=np.int64)
    members = np.empty(0, dtype=np.int64)
    for filling in range(2):
        place = first.copy()
        for i in range(len(sides)):
            ax, ay, bx, by = sides[i, AX], sides[i, AY], sides[i, BX], sides[i, BY]
            length = hypot(bx - ax, by - ay)
            left = max(0, int((min(ax, bx) - reach_m - frame[0]) / frame[2]))
            right = min(columns - 1, int((max(ax, bx) + reach_m - frame[0]) / frame[2]))
            low = max(0, int((min(ay, by) - reach_m - frame[1]) / frame[2]))
            high = min(rows - 1, int((max(ay, by) + reach_m - frame[1]) / frame[2]))
            for row in range(low, high + 1):
                for column in range(left, right + 1):
                    dx = frame[0] + (column + 0.5) * frame[2] - ax
                    dy = frame[1] + (row + 0.5) * frame[2] - ay
                    along = (dx * (bx - ax) + dy * (by - ay)) / length
                    beyond = max(0.0, -along, along - length)
                    aside = dx * sides[i, NX] + dy * sides[i, NY]
                    if hypot(beyond, aside) > within:
                        continue
                    cell = row * columns + column
                    if filling:
                        members[place[cell]] = i
                        place[cell] += 1
                    else:
                        first[cell + 1] += 1
        if not filling:
            first = np.cumsum(first)
            members = np.empty(first[-1], dtype=np.int64)
    return first, members


@njit
def cast_on_outlines(
    axes: Floats,
    directions: Floats,
    corners: Floats,
    first: Ints,
    circles: Floats,
    near_m: float,
    far_m: float,
) -> Floats:
    """(m, beams) metres to the first side met from ``near_m`` on and before ``far_m``; inf if there is none.

    ``axes`` (m, 2), ``directions`` (m, beams, 2) as of :class:`~midnet_bench.simulation.engine.Beams`,
    the rest an :class:`~midnet_bench.simulation.fast.outlines.Outlines`. A beam that starts inside a solid
    meets its side from within.

    A convex outline that is farther than ``near_m`` shows the sensor one chain of sides, and a beam meets no
    more than one of them. Where the beams are evenly spread over a full turn, those that meet the chain are
    found by its first corner's angle; the sign of cross products decides each hit.
    """
    sensors, beams = directions.shape[:2]
    ranges = np.full((sensors, beams), np.inf)
    spacing = 2.0 * math.pi / max(beams, 1)
    seen = np.empty((len(corners) + 1, 2))
    for i in range(sensors):
        x, y = axes[i, 0], axes[i, 1]
        fan, found = directions[i], ranges[i]
        start_rad = atan2(fan[0, 1], fan[0, 0]) if beams > 0 else 0.0
        is_even = beams >= 8 and _is_even(fan, spacing)
        for solid in range(len(circles)):
            dx, dy = circles[solid, 0] - x, circles[solid, 1] - y
            reach = far_m + circles[solid, 2]
            if dx * dx + dy * dy >= reach * reach:
                continue
            low, high = first[solid], first[solid + 1]
            distance_m, count = _chain(corners[low:high], x, y, seen)
            if distance_m >= far_m:
                continue
            if distance_m < near_m or distance_m <= 0.0 or not is_even:
                _meet_all(fan, corners[low:high], x, y, near_m, far_m, found)
                continue
            turn = (atan2(seen[0, 1], seen[0, 0]) - start_rad) / spacing
            beam = math.floor(turn) % beams
            _meet_chain(fan, seen, count, beam, near_m, far_m, found)
    return ranges


@njit
def _is_even(fan: Floats, spacing_rad: float) -> bool:
    """Whether each beam points ``spacing_rad`` counter-clockwise of the one before, the first of the last."""
    sine = sin(spacing_rad)
    for k in range(len(fan)):
        before = k - 1 if k > 0 else len(fan) - 1
        if abs(fan[before, 0] * fan[k, 1] - fan[before, 1] * fan[k, 0] - sine) > 1e-9:
            return False
    return True


@njit
def _chain(outline: Floats, x: float, y: float, seen: Floats) -> tuple[float, int]:
    """Fills ``seen`` with the corners of the sides that face (x, y), from there, counter-clockwise about it.

    A distance from the outline that is never too large, metres, not above 0 inside; how many corners.
    """
    corners = len(outline)
    distance_m = -np.inf
    last = -1
    faces_before = False
    for step in range(corners + 1):
        k = step if step < corners else 0
        after = k + 1 if k + 1 < corners else 0
        ax, ay = outline[k, 0] - x, outline[k, 1] - y
        height = (ay * (outline[after, 0] - x) - ax * (outline[after, 1] - y)) / outline[k, 2]
        distance_m = max(distance_m, height)
        faces = height > 0.0
        if faces_before and not faces:
            last = k  # where the sides that face end
        faces_before = faces
    count = 0
    if last >= 0:
        seen[0, 0], seen[0, 1] = outline[last, 0] - x, outline[last, 1] - y
        count = 1
        k = last
        while count <= corners:
            k = k - 1 if k > 0 else corners - 1
            ax, ay = outline[k, 0] - x, outline[k, 1] - y
            if ay * seen[count - 1, 0] - ax * seen[count - 1, 1] <= 0.0:
                break
            seen[count, 0], seen[count, 1] = ax, ay
            count += 1
    return distance_m, count


@njit
def _meet_chain(
    fan: Floats, seen: Floats, count: int, beam: int, near_m: float, far_m: float, found: Floats
) -> None:
    """Shortens ``found`` (beams,) where the sides between the first ``count`` of ``seen`` are nearer.

    ``beam``: one at or clockwise of the first corner, at most two beams away.
    """
    beams = len(fan)
    for _ in range(3):
        if fan[beam, 0] * seen[0, 1] - fan[beam, 1] * seen[0, 0] <= 0.0:
            break
        beam = beam + 1 if beam + 1 < beams else 0
    for j in range(count - 1):
        ax, ay, bx, by = seen[j, 0], seen[j, 1], seen[j + 1, 0], seen[j + 1, 1]
        side_x, side_y = bx - ax, by - ay
        area = ax * by - ay * bx
        for _ in range(beams):
            dx, dy = fan[beam, 0], fan[beam, 1]
            if dx * by - dy * bx <= 0.0:
                break
            distance = area / (dx * side_y - dy * side_x)
            if near_m <= distance < far_m and distance < found[beam]:
                found[beam] = distance
            beam = beam + 1 if beam + 1 < beams else 0


@njit
def _meet_all(
    fan: Floats, outline: Floats, x: float, y: float, near_m: float, far_m: float, found: Floats
) -> None:
    """The same for any beams and every side of an outline, whichever way it faces."""
    for k in range(len(outline)):
        after = k + 1 if k + 1 < len(outline) else 0
        ax, ay, bx, by = outline[k, 0] - x, outline[k, 1] - y, outline[after, 0] - x, outline[after, 1] - y
        side_x, side_y = bx - ax, by - ay
        area = ax * by - ay * bx
        for beam in range(len(fan)):
            dx, dy = fan[beam, 0], fan[beam, 1]
            if (dx * ay - dy * ax >= 0.0) == (dx * by - dy * bx >= 0.0):
                continue
            distance = area / (dx * side_y - dy * side_x)
            if near_m <= distance < far_m and distance < found[beam]:
                found[beam] = distance
