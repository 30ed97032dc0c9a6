"""Where bodies are close to sides and to each other, and what they do to each other there.

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

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, hypot
from midnet_bench.geometry import Booleans, Floats, Indices, Point
from midnet_bench.simulation.fast.outlines import (
    ALONG_X,
    ALONG_Y,
    CELL_M,
    LAST_X,
    LAST_Y,
    LENGTH,
    X,
    Y,
    sides_of,
)

OBSTACLE = -2  # in ``pairs``: what moves by itself
WALL_FRICTION, BODY_FRICTION = 0.5, 0.25  # Coulomb's coefficients, as in PyBullet
SKIN_M = 1e-4  # Bodies stop this far from what they touch, so that a rounding is no penetration.
DEEP_M = 0.02  # A corner that is farther behind a side was never before it.
PUSHED_MPS = 0.3  # How fast an obstacle pushes a body out of itself, about as in PyBullet.
_TILT = 0.3
"""How far, as a sine, a corner may point past the other shape: both ends of a side that lies flat count."""

_SQUARE = sides_of([np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])])

# Columns of a contact: the unit normal towards the first body, the gap, the point as seen from both bodies'
# base frames (map axes), and the impulses so far along normal and tangent, per mass.
NORMAL_X, NORMAL_Y, GAP, ARM_X, ARM_Y, OTHER_X, OTHER_Y, NORMAL, TANGENTIAL = range(9)
PER_BODY = 48  # contacts that there is room for


class Scene(NamedTuple):
    """What all bodies are, what stands about them, how time passes, and room for what is found of them."""

    hull: Floats  # (h, 7) by the columns ``X`` to ``LAST_Y``, base frame, metres
    sides: Floats  # (k, 7) those that bodies can touch, by the same columns, map frame
    frame: Floats  # (4,) x and y of a grid's lower left corner, metres, columns, rows
    first: Indices  # (cells + 1,) where the sides near each cell begin in ``members``; cells row by row
    members: Indices  # rows of ``sides``, as far from a cell as a body and the widest gap reach
    hulls: Floats  # (n, h, 7) the hulls in the map frame
    rows: Floats  # (c, 9) contacts by the columns ``NORMAL_X`` to ``TANGENTIAL``
    pairs: Indices  # (c, 2) bodies that a contact's normal points to and from; -1 for walls, or ``OBSTACLE``
    found: Indices  # (1,) how many contacts are written
    step_s: float  # a tick
    ramp_mps: float  # by how much a rim's speed changes in a tick
    separation_m: float  # of the wheels
    wheel_m: float  # radius
    most_m: float  # how far any point of a body may come in a tick
    reach_m: float  # of the hull from the base frame
    gyration2_m2: float  # inertia over mass


def hull_of(contour: tuple[tuple[float, float], ...]) -> Floats:
    """(h, 7) the convex hull of a contour, counter-clockwise, by the columns ``X`` to ``LAST_Y``; metres."""
    points = np.array(sorted(set(contour)))
    order = cv2.convexHull(points.astype(np.float32), returnPoints=False).ravel()
    return sides_of([points[np.roll(order, -int(order.argmin()))]])


@njit
def find_contacts(poses: Floats, present: Booleans, margin_m: float, solids: Floats, scene: Scene) -> int:
    """Writes the contacts of bodies at (n, 3) ``poses`` into the scene; how many there are.

    Those with obstacles come first: in each of the solver's rounds walls and bodies have the last word.

    Args:
        poses: of the base frames, map frame.
        present: (n,) which bodies are there.
        margin_m: the widest gap that counts.
        solids: (k, 6) obstacles: x, y and yaw, metres and radians, length, width, and whether it is a disc.
        scene: bodies, walls, and room for contacts.
    """
    reach_m, hulls = scene.reach_m, scene.hulls
    scene.found[0] = 0
    for i in range(len(poses)):
        if present[i]:
            _place(scene.hull, poses[i], hulls[i])
            for solid in solids:
                _against_obstacle(i, poses[i], solid, margin_m, scene)
    apart_m = 2.0 * reach_m + margin_m
    for i in range(len(poses)):
        if not present[i]:
            continue
        for member in _sides_near(poses[i], scene):
            side = scene.sides[member]
            if _may_touch(side, poses[i], reach_m + margin_m):
                _against_side(i, poses, side, margin_m, scene)
        for j in range(i):
            dx, dy = poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]
            if present[j] and dx * dx + dy * dy <= apart_m * apart_m:
                _meet(j, i, hulls[i], poses, margin_m, False, scene)
                _meet(i, j, hulls[j], poses, margin_m, True, scene)
    return scene.found[0]


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
def _sides_near(pose: Floats, scene: Scene) -> Indices:
    """The sides that a body at that pose may touch, by their rows."""
    left, low, columns, lines = scene.frame
    column, line = int((pose[0] - left) / CELL_M), int((pose[1] - low) / CELL_M)
    if pose[0] >= left and pose[1] >= low and column < columns and line < lines:
        cell = line * int(columns) + column
        return scene.members[scene.first[cell] : scene.first[cell + 1]]
    return scene.members[:0]


@njit
def _may_touch(side: Floats, pose: Floats, within_m: float) -> bool:
    dx, dy = pose[0] - side[X], pose[1] - side[Y]
    aside = dx * side[ALONG_Y] - dy * side[ALONG_X]
    along = dy * side[ALONG_Y] + dx * side[ALONG_X]
    return -within_m <= aside <= within_m and -within_m < along < side[LENGTH] + within_m


@njit
def _add(a: int, b: int, normal: tuple[float, float, float], arm: Point, other: Point, scene: Scene) -> None:
    """Adds a contact, if there is room: its normal and gap, and its point as seen from both."""
    count = scene.found[0]
    if count == len(scene.rows):
        return
    row = scene.rows[count]
    row[NORMAL_X], row[NORMAL_Y], row[GAP] = normal
    row[ARM_X], row[ARM_Y] = arm
    row[OTHER_X], row[OTHER_Y] = other
    scene.pairs[count, 0], scene.pairs[count, 1] = a, b
    scene.found[0] += 1


@njit
def _against_obstacle(i: int, pose: Floats, solid: Floats, margin_m: float, scene: Scene) -> None:
    """Adds the contacts of body i with an obstacle, deep ones too.

    An obstacle of 2 m/s may come far into a body before it has pushed it out. A box that lies across a body,
    no corner of the one before a side of the other, has no contact: the body drives on until one has.
    """
    hull, x, y = scene.hulls[i], pose[0], pose[1]
    radius_m = solid[3] / 2.0 if solid[5] else hypot(solid[3], solid[4]) / 2.0
    if hypot(x - solid[0], y - solid[1]) > scene.reach_m + margin_m + radius_m:
        return
    if solid[5]:
        corners = np.zeros((1, 7))
        corners[0, X], corners[0, Y] = solid[0], solid[1]
    else:
        radius_m = 0.0
        square, corners = _SQUARE.copy(), np.empty_like(_SQUARE)
        square[:, X] *= solid[3]
        square[:, Y] *= solid[4]
        square[0::2, LENGTH], square[1::2, LENGTH] = solid[3], solid[4]
        _place(square, solid, corners)
    for corner in corners:
        is_met, (nx, ny, gap), (qx, qy) = _before(corner, hull, margin_m + radius_m, False, np.inf)
        if is_met:
            _add(i, OBSTACLE, (nx, ny, gap - radius_m), (qx - x, qy - y), (0.0, 0.0), scene)
    if not solid[5]:
        for corner in hull:
            is_met, (nx, ny, gap), _ = _before(corner, corners, margin_m, True, np.inf)
            if is_met:
                _add(i, OBSTACLE, (-nx, -ny, gap), (corner[X] - x, corner[Y] - y), (0.0, 0.0), scene)


@njit
def _against_side(i: int, poses: Floats, side: Floats, margin_m: float, scene: Scene) -> None:
    """Adds the contacts of body i with one side and with the corner at its first end."""
    nx, ny = side[ALONG_Y], -side[ALONG_X]
    for corner in scene.hulls[i]:
        dx, dy = corner[X] - side[X], corner[Y] - side[Y]
        gap = dx * nx + dy * ny
        along = dx * side[ALONG_X] + dy * side[ALONG_Y]
        if -DEEP_M < gap < margin_m and 0.0 <= along <= side[LENGTH]:
            ahead = corner[ALONG_X] * nx + corner[ALONG_Y] * ny
            behind = corner[LAST_X] * nx + corner[LAST_Y] * ny
            if ahead >= -_TILT and behind <= _TILT:
                arm = corner[X] - poses[i, 0], corner[Y] - poses[i, 1]
                _add(i, -1, (nx, ny, gap), arm, (0.0, 0.0), scene)
    if side[LAST_X] != 0.0 or side[LAST_Y] != 0.0:
        _meet(i, -1, side.reshape(1, 7), poses, margin_m, False, scene)


@njit
def _meet(
    a: int, b: int, corners: Floats, poses: Floats, margin_m: float, sides_only: bool, scene: Scene
) -> None:
    """Adds the contacts of corners of b, a body or what stands, with body a."""
    for corner in corners:
        is_met, normal, (qx, qy) = _before(corner, scene.hulls[a], margin_m, sides_only, DEEP_M)
        if is_met:
            arm, other = (qx - poses[a, 0], qy - poses[a, 1]), (0.0, 0.0)
            if b >= 0:
                other = corner[X] - poses[b, 0], corner[Y] - poses[b, 1]
            _add(a, b, normal, arm, other, scene)


@njit
def _before(
    corner: Floats, hull: Floats, margin_m: float, sides_only: bool, deep_m: float
) -> tuple[bool, tuple[float, float, float], tuple[float, float]]:
    """Whether a corner is in contact with a hull; the normal into the hull and the gap; the hull's point.

    ``sides_only``: leave out where it is nearest to one of the hull's corners. ``deep_m``: a corner that is
    deeper inside is in no contact.
    """
    px, py = corner[X], corner[Y]
    gap, at_side, at_corner = -np.inf, 0, -1
    nothing = False, (0.0, 0.0, 0.0), (0.0, 0.0)
    for k in range(len(hull)):
        aside = (px - hull[k, X]) * hull[k, ALONG_Y] - (py - hull[k, Y]) * hull[k, ALONG_X]
        if aside > margin_m:
            return nothing
        if aside > gap:
            gap, at_side = aside, k
    if gap > 0.0:
        gap = np.inf
        for k in range(len(hull)):
            dx, dy = px - hull[k, X], py - hull[k, Y]
            aside = dx * hull[k, ALONG_Y] - dy * hull[k, ALONG_X]
            along = dx * hull[k, ALONG_X] + dy * hull[k, ALONG_Y]
            if 0.0 < aside < gap and 0.0 <= along <= hull[k, LENGTH]:
                gap, at_side = aside, k
        for k in range(len(hull)):
            distance = hypot(px - hull[k, X], py - hull[k, Y])
            if distance < gap:
                gap, at_corner = distance, k
    if gap > margin_m or gap < -deep_m or (sides_only and at_corner >= 0):
        return nothing
    if at_corner >= 0 and gap > 1e-9:
        qx, qy, tilt = hull[at_corner, X], hull[at_corner, Y], 0.0
        nx, ny = (qx - px) / gap, (qy - py) / gap
    else:
        nx, ny, tilt = -hull[at_side, ALONG_Y], hull[at_side, ALONG_X], _TILT
        qx, qy = px + gap * nx, py + gap * ny
    ahead = corner[ALONG_X] * nx + corner[ALONG_Y] * ny
    behind = corner[LAST_X] * nx + corner[LAST_Y] * ny
    if ahead > tilt or behind < -tilt:
        return nothing
    return True, (nx, ny, gap), (qx, qy)


@njit
def islands(count: int, pairs: Indices, n: int) -> Indices:
    """(n,) for each body the least number among those that contacts join it with, one by the next."""
    label = np.arange(n)
    changed = True
    while changed:
        changed = False
        for a, b in pairs[:count]:
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
def _apply(row: Floats, a: int, b: int, px: float, py: float, gyration2: float, moves: Floats) -> None:
    """Let an impulse per mass (px, py) act on body ``a`` at a contact, and its opposite on ``b``."""
    moves[a, 0] += px
    moves[a, 1] += py
    moves[a, 2] += (row[ARM_X] * py - row[ARM_Y] * px) / gyration2
    if b >= 0:
        moves[b, 0] -= px
        moves[b, 1] -= py
        moves[b, 2] -= (row[OTHER_X] * py - row[OTHER_Y] * px) / gyration2


@njit
def _inverse_mass(row: Floats, b: int, nx: float, ny: float, gyration2: float) -> float:
    """What speed along (nx, ny) a unit impulse per mass gives the points of a contact."""
    lever = row[ARM_X] * ny - row[ARM_Y] * nx
    found = 1.0 + lever * lever / gyration2
    if b >= 0:
        lever = row[OTHER_X] * ny - row[OTHER_Y] * nx
        found += 1.0 + lever * lever / gyration2
    return found


@njit
def solve_contacts(island: int, label: Indices, count: int, scene: Scene, moves: Floats) -> float:
    """One round over an island's contacts: no gap closes within a step, and what touches rubs.

    Gives the largest change of an impulse per mass, m/s.
    """
    change, gyration2 = 0.0, scene.gyration2_m2
    for c in range(count):
        a, b = scene.pairs[c]
        if label[a] != island:
            continue
        row = scene.rows[c]
        nx, ny = row[NORMAL_X], row[NORMAL_Y]
        least = least_speed(row[GAP], b, scene.step_s)
        missing = (least - parting_speed(row, a, b, nx, ny, moves)) / _inverse_mass(row, b, nx, ny, gyration2)
        more = max(row[NORMAL] + missing, 0.0) - row[NORMAL]
        row[NORMAL] += more
        _apply(row, a, b, more * nx, more * ny, gyration2, moves)
        sliding = parting_speed(row, a, b, -ny, nx, moves) / _inverse_mass(row, b, -ny, nx, gyration2)
        most = (WALL_FRICTION if b < 0 else BODY_FRICTION) * row[NORMAL]
        rub = min(max(row[TANGENTIAL] - sliding, -most), most) - row[TANGENTIAL]
        row[TANGENTIAL] += rub
        _apply(row, a, b, -rub * ny, rub * nx, gyration2, moves)
        change = max(change, abs(more), abs(rub))
    return change


@njit
def part_overlapping(count: int, scene: Scene, poses: Floats) -> bool:
    """Moves bodies that overlap apart by half of what is needed; whether any did."""
    found = False
    for c in range(count):
        row = scene.rows[c]
        if row[GAP] < -1e-6:
            a, b = scene.pairs[c]
            nx, ny = row[NORMAL_X], row[NORMAL_Y]
            share = 0.5 * (SKIN_M - row[GAP]) / _inverse_mass(row, b, nx, ny, scene.gyration2_m2)
            _apply(row, a, b, share * nx, share * ny, scene.gyration2_m2, poses)
            found = True
    return found


@njit
def penetrates(i: int, poses: Floats, present: Booleans, depth_m: float, scene: Scene) -> bool:
    """Whether body i reaches more than ``depth_m`` into a side of what never moves, or into another body.

    A check by another way than contacts are found by: the hull less a rim of that depth is cut with sides,
    and with bodies it has no line between. It writes hulls into the scene and nothing else.
    """
    hull, reach_m = scene.hulls[i], scene.reach_m
    _place(scene.hull, poses[i], hull)
    for member in _sides_near(poses[i], scene):
        side = scene.sides[member]
        if _may_touch(side, poses[i], reach_m) and _cuts(side, hull, depth_m):
            return True
    for j in range(len(poses)):
        dx, dy = poses[i, 0] - poses[j, 0], poses[i, 1] - poses[j, 1]
        if j == i or not present[j] or dx * dx + dy * dy > 4.0 * reach_m * reach_m:
            continue
        other = scene.hulls[j]
        _place(scene.hull, poses[j], other)
        if not _is_parted(hull, other, depth_m) and not _is_parted(other, hull, depth_m):
            return True
    return False


@njit
def _depth(x: float, y: float, side: Floats) -> float:
    """How far a point lies to the left of a side, metres."""
    return (y - side[Y]) * side[ALONG_X] - (x - side[X]) * side[ALONG_Y]


@njit
def _cuts(side: Floats, hull: Floats, depth_m: float) -> bool:
    """Whether a side has points more than ``depth_m`` inside a placed hull."""
    enter, leave = 0.0, 1.0
    end_x, end_y = side[X] + side[LENGTH] * side[ALONG_X], side[Y] + side[LENGTH] * side[ALONG_Y]
    for edge in hull:
        a, b = _depth(side[X], side[Y], edge) - depth_m, _depth(end_x, end_y, edge) - depth_m
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
    for side in one:
        deepest = -np.inf
        for corner in other:
            deepest = max(deepest, _depth(corner[X], corner[Y], side))
        if deepest <= depth_m:
            return True
    return False
