"""Section IV.C: the robots' boxes become the team's: allies are taken out (C.1), lists are fused (C.2).

Boxes are rows of one array for the whole team, robot after robot, and the robots' lists hold their indices.
``overlaps`` finds once which of them overlap. The algorithms look at no others, so that their time grows with
the team and not with its square. They are plain loops: numba compiles them, and without its decorator they
give the same.

The paper says that the result holds no overlapping boxes and that the order of the robots does not
matter. Neither holds (item 35): IoU >= t is not transitive, a box is compared only up to its first
match, and always with the boxes that the second list held at the start. It is kept as written; the
tests pin an example of each.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.geometry import Pose2D
from midnet_bench.midnet.detection import BoxArray, Indices
from midnet_bench.midnet.settings import AllyRemove

FIRST, BEST, ALL = range(3)
"""the same as numbers"""
REMOVE: dict[AllyRemove, int] = {"first": FIRST, "best": BEST, "all": ALL}

# metres make boxes of whole cells differ in the last bits; a tie in cells stays a tie (item 37)
ROUNDING = 1e-9


class Overlaps(NamedTuple):
    """Rectangles, and which of them overlap: those with i are ``partners[starts[i] : starts[i + 1]]``."""

    rectangles: BoxArray
    starts: Indices
    """(n + 1,)"""
    partners: Indices
    """indices of rectangles, those of one rectangle ascending"""


class TeamBoxes(NamedTuple):
    """What section IV.C makes of the team's boxes."""

    detections: BoxArray
    """fused, (n, 4)"""
    found_by: Indices
    """(n,) for each detection the robot whose box it is"""
    kept: Indices
    """indices of the boxes that are no allies, robot after robot, in their old order"""
    starts: Indices
    """for each robot, where its boxes in ``kept`` begin, and where the last one's end"""
    removed: Indices
    """(k, 2): an ally's index and the box that was taken for it, in the order of removal"""


def ally_squares(poses: Sequence[Pose2D], diameter_m: float) -> BoxArray:
    """``bbox`` of Algorithm 2: (n, 4), the upright square of side di about each robot's position."""
    half = diameter_m / 2.0
    return np.array([(x - half, y - half, x + half, y + half) for x, y, _ in poses])


@njit
def area(rectangles: BoxArray, i: int) -> float:
    """Square metres."""
    return (rectangles[i, 2] - rectangles[i, 0]) * (rectangles[i, 3] - rectangles[i, 1])


@njit
def iou(rectangles: BoxArray, i: int, j: int) -> float:
    """Eq. 7: the area that both cover over the area that either covers; 0 for two that share only an edge."""
    width = min(rectangles[i, 2], rectangles[j, 2]) - max(rectangles[i, 0], rectangles[j, 0])
    height = min(rectangles[i, 3], rectangles[j, 3]) - max(rectangles[i, 1], rectangles[j, 1])
    if not (width > 0.0 and height > 0.0):
        return 0.0
    both = width * height
    return both / (area(rectangles, i) + area(rectangles, j) - both)


@njit
def overlaps(rectangles: BoxArray) -> Overlaps:
    """All pairs with an IoU above 0, by a sweep: a rectangle can meet those that begin before it ends.

    It goes along the axis on which they are spread wider.
    """
    count, axis = len(rectangles), wider_axis(rectangles)
    first, second = np.empty(8 * count, np.int64), np.empty(8 * count, np.int64)
    pairs = 0
    order = np.argsort(rectangles[:, axis])
    for place in range(count):
        i = order[place]
        end = rectangles[i, axis + 2]
        for later in range(place + 1, count):
            j = order[later]
            if rectangles[j, axis] >= end:
                break
            if iou(rectangles, i, j) > 0.0:
                if pairs == len(first):
                    first, second = np.concatenate((first, first)), np.concatenate((second, second))
                first[pairs], second[pairs] = i, j
                pairs += 1
    starts, partners = both_ways(first[:pairs], second[:pairs], count)
    return Overlaps(rectangles, starts, partners)


@njit
def wider_axis(rectangles: BoxArray) -> int:
    """0 if they begin farther apart in x than in y, else 1."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(len(rectangles)):
        for axis in range(2):
            low[axis] = min(low[axis], rectangles[i, axis])
            high[axis] = max(high[axis], rectangles[i, axis])
    return 0 if high[0] - low[0] >= high[1] - low[1] else 1


@njit
def both_ways(first: Indices, second: Indices, count: int) -> tuple[Indices, Indices]:
    """``starts`` and ``partners`` of ``Overlaps``, from pairs in any order."""
    starts = np.zeros(count + 1, np.int64)
    for pair in range(len(first)):
        starts[first[pair] + 1] += 1
        starts[second[pair] + 1] += 1
    starts = starts.cumsum()
    mixed, partners = np.empty(2 * len(first), np.int64), np.empty(2 * len(first), np.int64)
    filled = starts.copy()
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        mixed[filled[i]], mixed[filled[j]] = j, i
        filled[i] += 1
        filled[j] += 1
    # written the other way round, row after row, each row comes out ascending
    filled = starts.copy()
    for i in range(count):
        for j in mixed[starts[i] : starts[i + 1]]:
            partners[filled[j]] = i
            filled[j] += 1
    return starts, partners


@njit
def remove_ally_detections(
    seen: Overlaps, robots: Indices, team: int, threshold: float, remove: int
) -> tuple[Indices, Indices, Indices]:
    """Algorithm 2, Remove Ally Detections: each ally's box out of the lists of all the others.

    The paper takes out one box per ally and observer and then stops looking, so an ally that is seen
    as two boxes leaves one behind (item 30).

    Args:
        seen: of the boxes and, behind them, the square of each ally (``i.pos``).
        robots: for each box, the index of the robot j in whose list it is, ascending (``j.d``).
        team: the number of robots.
        threshold: t, 0 < t <= 1; an IoU of t or more is the ally (item 29).
        remove: FIRST in the list, as the paper; BEST IoU; or ALL of t or more.

    Returns:
        ``kept``, ``starts`` and ``removed`` of ``TeamBoxes``.
    """
    count = len(robots)
    gone = np.zeros(count, np.bool_)
    removed = np.empty((count, 2), np.int64)
    removals = 0
    for ally in range(team):
        square = count + ally
        matches = seen.partners[seen.starts[square] : seen.starts[square + 1]]
        place = 0
        while place < len(matches) and matches[place] < count:
            observer = robots[matches[place]]
            taken, highest = -1, 0.0
            while place < len(matches) and matches[place] < count and robots[matches[place]] == observer:
                k = matches[place]
                place += 1
                score = iou(seen.rectangles, square, k)
                if observer == ally or gone[k] or score < threshold:
                    continue
                if taken < 0 or remove == ALL or (remove == BEST and score > highest):
                    taken, highest = k, score
                    if remove == ALL:
                        gone[k] = True
                        removed[removals] = ally, k
                        removals += 1
            if taken >= 0 and remove != ALL:
                gone[taken] = True
                removed[removals] = ally, taken
                removals += 1
    kept = np.flatnonzero(~gone)
    starts = np.zeros(team + 1, np.int64)
    for k in kept:
        starts[robots[k] + 1] += 1
    return kept, starts.cumsum(), removed[:removals]


@njit
def fuse_detections(s1: Indices, s2: Indices, seen: Overlaps, threshold: float) -> Indices:
    """Algorithm 4, Fuse Detections: ``s2``, with the boxes of ``s1`` in place of smaller ones or behind.

    Each box i of ``s1`` is compared with those of ``s2`` up to the first j with IoU >= t. If i has the
    larger area it takes j's place, else it is dropped; without such a j it is appended. (The paper
    appends to an undefined L; S is meant, item 33.) Boxes are compared with ``s2`` as it came, so a
    second i can push out one that had just taken j's place, though the two may not even touch.
    """
    fused = np.empty(len(s1) + len(s2), np.int64)
    fused[: len(s2)] = s2
    length = len(s2)
    places = {j: place for place, j in enumerate(s2)}
    for i in s1:
        first = len(s2)
        for j in seen.partners[seen.starts[i] : seen.starts[i + 1]]:
            if (
                j in places
                and places[j] < first
                and iou(seen.rectangles, i, j) >= threshold * (1.0 - ROUNDING)
            ):
                first = places[j]
        if first == len(s2):
            fused[length] = i
            length += 1
        elif area(seen.rectangles, i) > area(seen.rectangles, s2[first]) * (1.0 + ROUNDING):
            fused[first] = i
    return fused[:length]


@njit
def divide_and_conquer(
    lists: Indices, starts: Indices, left: int, right: int, seen: Overlaps, threshold: float
) -> Indices:
    """Algorithm 3, Divide and Conquer: the lists ``left`` to ``right`` fused in pairs, up a binary tree.

    The paper's recursive calls forget t; it is passed on (item 33). A single list is returned as it
    is, never fused with itself (item 34). The calls stand in a list, because numba cannot load a
    function that calls itself from its cache.

    Args:
        lists: the boxes of each robot, robot after robot.
        starts: for each robot where its list begins, and where the last one ends.
        left: l, the first list's index, counted from 0.
        right: r, the last list's index, inclusive.
        seen: which boxes overlap.
        threshold: t, 0 < t <= 1.
    """
    # the first of the calls only tells numba what the list holds
    waiting, calls = [(left, right)], [(left, right)]
    while waiting:
        first, last = waiting.pop()
        calls.append((first, last))
        if first < last:
            middle = (first + last) // 2
            waiting.append((first, middle))
            waiting.append((middle + 1, last))
    fused = [lists[:0]]
    for first, last in calls[:0:-1]:  # both halves come before what they are halves of
        if first == last:
            fused.append(lists[starts[first] : starts[first + 1]])
        else:
            second = fused.pop()
            fused.append(fuse_detections(second, fused.pop(), seen, threshold))
    return fused.pop()


@njit
def fuse_team(
    boxes: BoxArray, robots: Indices, squares: BoxArray, iou_ally: float, remove: int, iou_fuse: float
) -> TeamBoxes:
    """Section IV.C in full.

    Args:
        boxes: of the whole team, robot after robot.
        robots: for each box, the index of the robot that found it.
        squares: of each robot, as :func:`ally_squares` has them.
        iou_ally: t of Algorithm 2.
        remove: as for :func:`remove_ally_detections`.
        iou_fuse: t of Algorithms 3 and 4.
    """
    team = len(squares)
    seen = overlaps(np.concatenate((boxes, squares)))
    kept, starts, removed = remove_ally_detections(seen, robots, team, iou_ally, remove)
    fused = divide_and_conquer(kept, starts, 0, team - 1, seen, iou_fuse)
    return TeamBoxes(boxes[fused], robots[fused], kept, starts, removed)
