"""Beams against the outlines of what stands still."""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, sin

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


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
