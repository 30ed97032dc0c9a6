"""Where bodies are close to sides and to each other, and what their wheels can do about it.

A body is the convex hull of its contour. In the plane two convex shapes always meet corner to side or corner
to corner, so contacts are looked for as such pairs: corners of bodies before sides of walls, corners of walls
before bodies, corners of bodies before bodies. A pair counts only where each corner points at the other
shape, so that what slides along a wall does not catch on the far ends of its sides.

Obstacles are what moves by itself, people above all: boxes, and discs, each a corner with a radius. No body
moves them. One that has moved into a body pushes it out, and where a wall or another body is in the way of
that, the body stays in the obstacle.
"""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, hypot
from midnet_bench.geometry import lengths
from midnet_bench.simulation.fast.outlines import AX, AY, BEFORE_X, BEFORE_Y, BX, BY, NX, NY, SideGrid

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

OBSTACLE = -2  # in ``pairs``: what moves by itself
GRAVITY_MPS2 = 9.81
WHEEL_FRICTION, WALL_FRICTION, BODY_FRICTION = 1.0, 0.5, 0.25
"""Coulomb's coefficients of wheels on the floor, bodies on walls and bodies on bodies, as in PyBullet"""
SKIN_M = 1e-4  # Bodies stop this far from what they touch, so that a rounding is no penetration.
DEEP_M = 0.02  # A corner that is farther behind a side was never before it.
PUSHED_MPS = 0.3  # How fast an obstacle pushes a body out of itself, about as in PyBullet.
_TILT = 0.3
"""How far, as a sine, a corner may point past the other shape: both ends of a side that lies flat count."""

# Columns of a body's hull: a corner, the unit vector and the length of the side from it, the unit vector of
# the side before it.
X, Y, ALONG_X, ALONG_Y, LENGTH, LAST_X, LAST_Y = range(7)
_SQUARE = np.array(
    [
        (-1.0, -1.0, 1.0, 0.0, 0.0, 0.0, -1.0),
        (1.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        (1.0, 1.0, -1.0, 0.0, 0.0, 0.0, 1.0),
        (-1.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0),
    ]
)
"""the hull of a square of side 2 m, its lengths left out"""

# Columns of a contact: the unit normal towards the first body, the gap, the point as seen from both bodies'
# base frames (map axes), and the impulses so far along normal and tangent, per mass.
NORMAL_X, NORMAL_Y, GAP, ARM_X, ARM_Y, OTHER_X, OTHER_Y, NORMAL, TANGENTIAL = range(9)
PER_BODY = 48  # contacts that there is room for


class Body(NamedTuple):
    """What all bodies are."""

    hull: Floats  # (h, 7) by the columns ``X`` to ``LAST_Y``, base frame, metres
    reach_m: float  # of the hull from the base frame
    gyration2_m2: float  # inertia over mass


class ContactBuffer(NamedTuple):
    """Where what is found of n bodies is written."""

    hulls: Floats  # (n, h, 7) the hulls in the map frame
    rows: Floats  # (c, 9) contacts by the columns ``NORMAL_X`` to ``TANGENTIAL``
    pairs: Ints  # (c, 2) bodies that each contact's normal points to and from; -1 for walls, or ``OBSTACLE``


class Scene(NamedTuple):
    """What contacts are looked for among."""

    body: Body
    ground: SideGrid  # what never moves; its reach is no less than that of a body and the widest gap together
    room: ContactBuffer


def hull_of(contour: tuple[tuple[float, float], ...]) -> Floats:
    """(h, 7) the convex hull of a contour, counter-clockwise, by the columns ``X`` to ``LAST_Y``; metres."""
    points = np.array(sorted(set(contour)))
    order = cv2.convexHull(points.astype(np.float32), returnPoints=False).ravel()
    corners = points[np.roll(order, -int(order.argmin()))]
    sides = np.roll(corners, -1, axis=0) - corners
    lengths_m = lengths(sides)
    along = sides / lengths_m[:, None]
    return np.column_stack((corners, along, lengths_m, np.roll(along, 1, axis=0)))


@njit
def find_contacts(
    poses: Floats, present: npt.NDArray[np.bool_], margin_m: float, solids: Floats, scene: Scene
) -> int:
    """Writes the contacts of bodies at (n, 3) ``poses`` into the scene's buffer; how many there are.

    Those with obstacles come first: in each of the solver's rounds walls and bodies have the last word.

    Args:
        poses: of the base frames, map frame.
        present: (n,) which bodies are there.
        margin_m: the widest gap that counts.
        solids: (k, 6) obstacles: x, y and yaw, metres and radians, length, width, and whether it is a disc.
        scene: the bodies, what never moves, and the buffer.
    """
    body, ground, room = scene
    reach_m, hulls = body.reach_m, room.hulls
    is_placed = np.zeros(len(poses), dtype=np.bool_)
    count = 0
    for i in range(len(poses)):
        for solid in solids:
            x, y = poses[i, 0], poses[i, 1]
            solid_m = solid[3] / 2.0 if solid[5] else hypot(solid[3], solid[4]) / 2.0
            if not present[i] or hypot(x - solid[0], y - solid[1]) > reach_m + margin_m + solid_m:
                continue
            if not is_placed[i]:
                _place(body.hull, poses[i], hulls[i])
                is_placed[i] = True
            count = _against_obstacle(i, hulls[i], x, y, solid, margin_m, room, count)
    for i in range(len(poses)):
        if not present[i]:
            continue
        x, y = poses[i, 0], poses[i, 1]
        for member in _sides_near(ground, x, y):
            side = ground.sides[member]
            if not _may_touch(side, x, y, reach_m + margin_m):
                continue
            if not is_placed[i]:
                _place(body.hull, poses[i], hulls[i])
                is_placed[i] = True
            count = _against_side(i, hulls[i], x, y, side, margin_m, room, count)
        for j in range(i):
            dx, dy = x - poses[j, 0], y - poses[j, 1]
            apart = 2.0 * reach_m + margin_m
            if not present[j] or dx * dx + dy * dy > apart * apart:
                continue
            for one in (i, j):
                if not is_placed[one]:
                    _place(body.hull, poses[one], hulls[one])
                    is_placed[one] = True
            count = _against_body(i, j, poses, margin_m, False, room, count)
            count = _against_body(j, i, poses, margin_m, True, room, count)
    return count


@njit
def _sides_near(ground: SideGrid, x: float, y: float) -> Ints:
    """The sides that a body at (x, y) may touch, by their rows."""
    frame = ground.frame
    column, line = int((x - frame[0]) / frame[2]), int((y - frame[1]) / frame[2])
    if x >= frame[0] and y >= frame[1] and column < frame[3] and line < frame[4]:
        cell = line * int(frame[3]) + column
        return ground.members[ground.first[cell] : ground.first[cell + 1]]
    return ground.members[:0]


@njit
def _against_obstacle(
    i: int, body: Floats, x: float, y: float, solid: Floats, margin_m: float, room: ContactBuffer, count: int
) -> int:
    """Adds the contacts of body i, placed, with an obstacle, deep ones too.

    An obstacle of 2 m/s may come far into a body before it has pushed it out. A box that lies across a body,
    no corner of the one before a side of the other, has no contact: the body drives on until one has.
    """
    rows = room.rows
    if solid[5]:
        before, radius_m = count, solid[3] / 2.0
        corner = (solid[0], solid[1], 0.0, 0.0, 0.0, 0.0)
        count = _meet(i, OBSTACLE, corner, body, x, y, margin_m + radius_m, False, np.inf, room, count)
        rows[before:count, GAP] -= radius_m
        return count
    hull, placed = _SQUARE.copy(), np.empty((4, 7))
    hull[:, X] *= solid[3] / 2.0
    hull[:, Y] *= solid[4] / 2.0
    hull[0::2, LENGTH], hull[1::2, LENGTH] = solid[3], solid[4]
    _place(hull, solid, placed)
    for k in range(len(placed)):
        count = _meet(i, OBSTACLE, _corner(placed[k]), body, x, y, margin_m, False, np.inf, room, count)
    for k in range(len(body)):
        before = count
        count = _meet(i, OBSTACLE, _corner(body[k]), placed, x, y, margin_m, True, np.inf, room, count)
        for row in rows[before:count]:
            row[NORMAL_X], row[NORMAL_Y] = -row[NORMAL_X], -row[NORMAL_Y]
            row[ARM_X], row[ARM_Y] = body[k, X] - x, body[k, Y] - y
    return count


@njit
def _meet(
    a: int,
    b: int,
    corner: tuple[float, ...],
    hull: Floats,
    x: float,
    y: float,
    margin_m: float,
    sides_only: bool,
    deep_m: float,
    room: ContactBuffer,
    count: int,
) -> int:
    """Adds the contact of a corner of b with the placed hull of body a, at (x, y), if there is one.

    The rest as for :func:`_corner_before_body`.
    """
    if count < len(room.rows):
        row = room.rows[count]
        if _corner_before_body(corner, hull, margin_m, sides_only, row, deep_m):
            row[ARM_X], row[ARM_Y], row[OTHER_X], row[OTHER_Y] = row[ARM_X] - x, row[ARM_Y] - y, 0.0, 0.0
            room.pairs[count, 0], room.pairs[count, 1] = a, b
            count += 1
    return count


@njit
def _place(hull: Floats, pose: Floats, placed: Floats) -> None:
    c, s = cos_sin(pose[2])
    for k in range(len(hull)):
        placed[k, X] = pose[0] + c * hull[k, X] - s * hull[k, Y]
        placed[k, Y] = pose[1] + s * hull[k, X] + c * hull[k, Y]
        placed[k, ALONG_X] = c * hull[k, ALONG_X] - s * hull[k, ALONG_Y]
        placed[k, ALONG_Y] = s * hull[k, ALONG_X] + c * hull[k, ALONG_Y]
        placed[k, LENGTH] = hull[k, LENGTH]
        placed[k, LAST_X] = c * hull[k, LAST_X] - s * hull[k, LAST_Y]
        placed[k, LAST_Y] = s * hull[k, LAST_X] + c * hull[k, LAST_Y]


@njit
def _may_touch(side: Floats, x: float, y: float, within_m: float) -> bool:
    dx, dy = x - side[AX], y - side[AY]
    aside = dx * side[NX] + dy * side[NY]
    if aside > within_m or aside < -within_m:
        return False
    along = dy * side[NX] - dx * side[NY]
    length = (side[BY] - side[AY]) * side[NX] - (side[BX] - side[AX]) * side[NY]
    return -within_m < along < length + within_m


@njit
def _against_side(
    i: int, body: Floats, x: float, y: float, side: Floats, margin_m: float, room: ContactBuffer, count: int
) -> int:
    """Adds the contacts of body i, placed, with one side and with the corner at its first end."""
    _, rows, pairs = room
    nx, ny = side[NX], side[NY]
    along_x, along_y = -ny, nx
    length = (side[BX] - side[AX]) * along_x + (side[BY] - side[AY]) * along_y
    for k in range(len(body)):
        dx, dy = body[k, X] - side[AX], body[k, Y] - side[AY]
        gap = dx * nx + dy * ny
        along = dx * along_x + dy * along_y
        if not (-DEEP_M < gap < margin_m and 0.0 <= along <= length):
            continue
        ahead = body[k, ALONG_X] * nx + body[k, ALONG_Y] * ny
        behind = body[k, LAST_X] * nx + body[k, LAST_Y] * ny
        if ahead >= -_TILT and behind <= _TILT and count < len(rows):
            row = rows[count]
            row[NORMAL_X], row[NORMAL_Y], row[GAP] = nx, ny, gap
            row[ARM_X], row[ARM_Y], row[OTHER_X], row[OTHER_Y] = body[k, X] - x, body[k, Y] - y, 0.0, 0.0
            pairs[count, 0], pairs[count, 1] = i, -1
            count += 1
    if side[BEFORE_X] != 0.0 or side[BEFORE_Y] != 0.0:
        corner = (side[AX], side[AY], along_x, along_y, side[BEFORE_X], side[BEFORE_Y])
        count = _meet(i, -1, corner, body, x, y, margin_m, False, DEEP_M, room, count)
    return count


@njit
def _against_body(
    i: int, j: int, poses: Floats, margin_m: float, sides_only: bool, room: ContactBuffer, count: int
) -> int:
    """Adds the contacts of body i's corners with body j."""
    body, hull, x, y = room.hulls[i], room.hulls[j], poses[j, 0], poses[j, 1]
    for k in range(len(body)):
        before = count
        count = _meet(j, i, _corner(body[k]), hull, x, y, margin_m, sides_only, DEEP_M, room, count)
        for row in room.rows[before:count]:
            row[OTHER_X], row[OTHER_Y] = body[k, X] - poses[i, 0], body[k, Y] - poses[i, 1]
    return count


@njit
def _corner(row: Floats) -> tuple[float, ...]:
    """X and y of a hull's corner, and the unit vectors of the side from it and of the one before."""
    return row[X], row[Y], row[ALONG_X], row[ALONG_Y], row[LAST_X], row[LAST_Y]


@njit
def _corner_before_body(
    corner: tuple[float, ...], body: Floats, margin_m: float, sides_only: bool, row: Floats, deep_m: float
) -> bool:
    """Whether a corner is in contact with a body; fills normal, gap and the body's point, map frame.

    ``corner``: as :func:`_corner` has it. The normal points into the body. ``sides_only``: leave out where it
    is nearest to one of the body's corners. ``deep_m``: a corner that is deeper inside is in no contact.
    """
    px, py, along_x, along_y, before_x, before_y = corner
    sides = len(body)
    best, outermost = -np.inf, 0
    for k in range(sides):
        gap = (px - body[k, X]) * body[k, ALONG_Y] - (py - body[k, Y]) * body[k, ALONG_X]
        if gap > margin_m:
            return False
        if gap > best:
            best, outermost = gap, k
    at_side, at_corner, gap = outermost, -1, best
    if best > 0.0:
        nearest = np.inf
        for k in range(sides):
            dx, dy = px - body[k, X], py - body[k, Y]
            aside = dx * body[k, ALONG_Y] - dy * body[k, ALONG_X]
            along = dx * body[k, ALONG_X] + dy * body[k, ALONG_Y]
            if aside <= 0.0 or along > body[k, LENGTH]:
                continue
            distance = aside if along >= 0.0 else hypot(dx, dy)
            if distance < nearest:
                nearest = distance
                at_side, at_corner = k, -1 if along >= 0.0 else k
        for k in range(sides):  # beyond the end of the one side and before the begin of the next
            dx, dy = px - body[k, X], py - body[k, Y]
            distance = hypot(dx, dy)
            if distance < nearest:
                nearest = distance
                at_corner = k
        gap = nearest
    if gap > margin_m or gap < -deep_m or (sides_only and at_corner >= 0):
        return False
    if at_corner >= 0 and gap > 1e-9:
        nx, ny = (body[at_corner, X] - px) / gap, (body[at_corner, Y] - py) / gap
        tilt = 0.0
        qx, qy = body[at_corner, X], body[at_corner, Y]
    else:
        nx, ny = -body[at_side, ALONG_Y], body[at_side, ALONG_X]
        tilt = _TILT
        qx, qy = px + gap * nx, py + gap * ny
    if along_x * nx + along_y * ny > tilt or before_x * nx + before_y * ny < -tilt:
        return False
    row[NORMAL_X], row[NORMAL_Y], row[GAP], row[ARM_X], row[ARM_Y] = nx, ny, gap, qx, qy
    return True


@njit
def islands(count: int, pairs: Ints, n: int) -> Ints:
    """(n,) for each body the least number among those that contacts join it with, one by the next."""
    label = np.arange(n)
    changed = True
    while changed:
        changed = False
        for c in range(count):
            a, b = pairs[c, 0], pairs[c, 1]
            if b >= 0 and label[a] != label[b]:
                label[a] = label[b] = min(label[a], label[b])
                changed = True
    return label


@njit
def least_speed(gap_m: float, b: int, step_s: float) -> float:
    """How fast two points have to part at least, m/s: no gap closes within a step, and obstacles push."""
    if b == OBSTACLE and gap_m < SKIN_M:
        return min((SKIN_M - gap_m) / step_s, PUSHED_MPS)
    return -max(gap_m - SKIN_M, 0.0) / step_s


@njit
def parting_speed(row: Floats, a: int, b: int, nx: float, ny: float, moves: Floats) -> float:
    """How fast body ``a`` moves off ``b`` along (nx, ny) at a contact, m/s.

    ``moves``: (n, 3) velocities in the map frame and yaw rates.
    """
    x = moves[a, 0] - moves[a, 2] * row[ARM_Y]
    y = moves[a, 1] + moves[a, 2] * row[ARM_X]
    if b >= 0:
        x -= moves[b, 0] - moves[b, 2] * row[OTHER_Y]
        y -= moves[b, 1] + moves[b, 2] * row[OTHER_X]
    return x * nx + y * ny


@njit
def apply_impulse(row: Floats, a: int, b: int, px: float, py: float, gyration2: float, moves: Floats) -> None:
    """Let an impulse per mass (px, py) act on body ``a`` at a contact, and its opposite on ``b``."""
    moves[a, 0] += px
    moves[a, 1] += py
    moves[a, 2] += (row[ARM_X] * py - row[ARM_Y] * px) / gyration2
    if b >= 0:
        moves[b, 0] -= px
        moves[b, 1] -= py
        moves[b, 2] -= (row[OTHER_X] * py - row[OTHER_Y] * px) / gyration2


@njit
def inverse_mass(row: Floats, b: int, nx: float, ny: float, gyration2: float) -> float:
    """What speed along (nx, ny) a unit impulse per mass gives the points of a contact."""
    lever = row[ARM_X] * ny - row[ARM_Y] * nx
    found = 1.0 + lever * lever / gyration2
    if b >= 0:
        lever = row[OTHER_X] * ny - row[OTHER_Y] * nx
        found += 1.0 + lever * lever / gyration2
    return found


@njit
def solve_contacts(
    island: int,
    label: Ints,
    count: int,
    rows: Floats,
    pairs: Ints,
    step_s: float,
    gyration2: float,
    moves: Floats,
) -> float:
    """One round over an island's contacts: no gap closes within a step, and what touches rubs.

    Gives the largest change of an impulse per mass, m/s.
    """
    change = 0.0
    for c in range(count):
        a, b = pairs[c, 0], pairs[c, 1]
        if label[a] != island:
            continue
        row = rows[c]
        nx, ny = row[NORMAL_X], row[NORMAL_Y]
        least = least_speed(row[GAP], b, step_s)
        missing = (least - parting_speed(row, a, b, nx, ny, moves)) / inverse_mass(row, b, nx, ny, gyration2)
        more = max(row[NORMAL] + missing, 0.0) - row[NORMAL]
        row[NORMAL] += more
        apply_impulse(row, a, b, more * nx, more * ny, gyration2, moves)
        sliding = parting_speed(row, a, b, -ny, nx, moves) / inverse_mass(row, b, -ny, nx, gyration2)
        most = (WALL_FRICTION if b < 0 else BODY_FRICTION) * row[NORMAL]
        rub = min(max(row[TANGENTIAL] - sliding, -most), most) - row[TANGENTIAL]
        row[TANGENTIAL] += rub
        apply_impulse(row, a, b, -rub * ny, rub * nx, gyration2, moves)
        change = max(change, abs(more), abs(rub))
    return change


@njit
def depenetrate(count: int, rows: Floats, pairs: Ints, gyration2: float, poses: Floats) -> bool:
    """Moves bodies that overlap apart by half of what is needed; whether any did."""
    found = False
    for c in range(count):
        a, b = pairs[c, 0], pairs[c, 1]
        if rows[c, GAP] >= -1e-6:
            continue
        row = rows[c]
        nx, ny = row[NORMAL_X], row[NORMAL_Y]
        share = 0.5 * (SKIN_M - row[GAP]) / inverse_mass(row, b, nx, ny, gyration2)
        apply_impulse(row, a, b, share * nx, share * ny, gyration2, poses)
        found = True
    return found


@njit
def penetrates(i: int, poses: Floats, present: npt.NDArray[np.bool_], depth_m: float, scene: Scene) -> bool:
    """Whether body i reaches more than ``depth_m`` into a side of what never moves, or into another body.

    A check by another way than contacts are found by: the hull less a rim of that depth is cut with sides,
    and with bodies it has no line between. It writes hulls into the buffer and nothing else.
    """
    body, ground, room = scene
    x, y = poses[i, 0], poses[i, 1]
    _place(body.hull, poses[i], room.hulls[i])
    hull = room.hulls[i]
    for member in _sides_near(ground, x, y):
        side = ground.sides[member]
        if _may_touch(side, x, y, body.reach_m) and _cuts(side, hull, depth_m):
            return True
    for j in range(len(poses)):
        dx, dy = x - poses[j, 0], y - poses[j, 1]
        if j == i or not present[j] or dx * dx + dy * dy > 4.0 * body.reach_m * body.reach_m:
            continue
        _place(body.hull, poses[j], room.hulls[j])
        if not _is_parted(hull, room.hulls[j], depth_m) and not _is_parted(room.hulls[j], hull, depth_m):
            return True
    return False


@njit
def _cuts(side: Floats, hull: Floats, depth_m: float) -> bool:
    """Whether a side has points more than ``depth_m`` inside a placed hull."""
    enter, leave = 0.0, 1.0
    for k in range(len(hull)):
        from_a = (side[AY] - hull[k, Y]) * hull[k, ALONG_X] - (side[AX] - hull[k, X]) * hull[k, ALONG_Y]
        from_b = (side[BY] - hull[k, Y]) * hull[k, ALONG_X] - (side[BX] - hull[k, X]) * hull[k, ALONG_Y]
        a, b = from_a - depth_m, from_b - depth_m
        if a <= 0.0 and b <= 0.0:
            return False
        if a < 0.0:
            enter = max(enter, a / (a - b))
        elif b < 0.0:
            leave = min(leave, a / (a - b))
    return enter < leave


@njit
def _is_parted(one: Floats, other: Floats, depth_m: float) -> bool:
    """Whether all corners of the other lie beyond a side of one, or less than ``depth_m`` inside of it."""
    for k in range(len(one)):
        deepest = -np.inf
        for m in range(len(other)):
            dx, dy = other[m, X] - one[k, X], other[m, Y] - one[k, Y]
            deepest = max(deepest, dy * one[k, ALONG_X] - dx * one[k, ALONG_Y])
        if deepest <= depth_m:
            return True
    return False
