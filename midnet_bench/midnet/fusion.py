"""Section IV.C: the robots' boxes become the team's: allies are taken out (C.1), lists are fused (C.2).

Boxes are rows of one array for the whole team, robot after robot, and lists hold their indices.

The paper says that the result holds no overlapping boxes and that the order of the robots does not
matter. Neither holds (item 35): IoU >= t is not transitive, a box is compared only up to its first
match, and always with the boxes that the second list held at the start. It is kept as written; the
tests pin an example of each.
"""

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

from midnet_bench.compiled import njit
from midnet_bench.geometry import Indices, Pose2D
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.midnet_settings import AllyRemove, MIDNetSettings

FIRST, BEST, ALL = range(3)
REMOVE: dict[AllyRemove, int] = {"first": FIRST, "best": BEST, "all": ALL}

# metres make boxes of whole cells differ in the last bits; a tie in cells stays a tie (item 37)
ROUNDING = 1e-9
NOTHING: Indices = np.empty((0, 2), np.int64)


class TeamBoxes(NamedTuple):
    """What section IV.C makes of the team's boxes."""

    detections: BoxArray  # fused, (n, 4)
    found_by: Indices  # (n,) for each detection the robot whose box it is
    kept: Indices  # indices of the boxes that are no allies, robot after robot, in their old order
    starts: Indices  # for each robot, where its boxes in ``kept`` begin, and where the last one's end
    removed: Indices  # (k, 2): an ally's index and the box that was taken for it, in the order of removal
    squares: BoxArray  # ``bbox`` of each ally, of the robots first


class Call(NamedTuple):
    """What a call of Algorithm 3 came to."""

    left: list[int]  # indices of the boxes in its list
    lost: list[list[int]]  # [box, the box that stays in its place]


def ally_squares(poses: Sequence[Pose2D], diameter_m: float) -> BoxArray:
    """``bbox`` of Algorithm 2: (n, 4), the upright square of side di about each robot's position."""
    half = diameter_m / 2.0
    return np.array([(x - half, y - half, x + half, y + half) for x, y, _ in poses])


@njit
def area(box: BoxArray) -> float:
    """Of (4,) one box, square metres."""
    return (box[2] - box[0]) * (box[3] - box[1])


@njit
def iou(one: BoxArray, other: BoxArray) -> float:
    """Eq. 7: the area that both cover over the area that either covers; 0 for two that share only an edge."""
    width = min(one[2], other[2]) - max(one[0], other[0])
    height = min(one[3], other[3]) - max(one[1], other[1])
    if not (width > 0.0 and height > 0.0):
        return 0.0
    both = width * height
    return both / (area(one) + area(other) - both)


@njit
def remove_ally_detections(
    boxes: BoxArray, starts: Indices, squares: BoxArray, threshold: float, remove: int
) -> tuple[Indices, Indices]:
    """Algorithm 2, Remove Ally Detections: each robot i is taken out of all other robots' lists j.

    Args:
        boxes: of the whole team, robot after robot.
        starts: for each robot j where its list (``j.d``) begins, and where the last one ends.
        squares: ``bbox`` of each ally i; those behind the robots' have no list.
        threshold: t, 0 < t <= 1; an IoU of t or more is the ally (item 29), but for ROUNDING.
        remove: FIRST in the list, as the paper; BEST IoU; or ALL of t or more.

    ``kept`` and ``removed`` of ``TeamBoxes`` come back.
    """
    gone = np.zeros(len(boxes), np.bool_)
    removed, removals = np.empty((len(boxes), 2), np.int64), 0
    least = threshold * (1.0 - ROUNDING)
    for i in range(len(squares)):
        for j in range(len(starts) - 1):
            if i == j:
                continue
            taken, highest = -1, 0.0
            for k in range(starts[j], starts[j + 1]):
                score = 0.0 if gone[k] else iou(squares[i], boxes[k])
                if score < least or (remove == FIRST and taken >= 0):
                    continue
                if remove == ALL:
                    gone[k] = True
                    removed[removals] = i, k
                    removals += 1
                elif score > highest * (1.0 + ROUNDING):
                    taken, highest = k, score
            if taken >= 0:
                gone[taken] = True
                removed[removals] = i, taken
                removals += 1
    return np.flatnonzero(~gone), removed[:removals]


@njit
def fuse_detections(s1: Indices, s2: Indices, boxes: BoxArray, threshold: float) -> tuple[Indices, Indices]:
    """Algorithm 4, Fuse Detections: ``s2``, with the boxes of ``s1`` in place of smaller ones or behind.

    Each box i of ``s1`` is compared with those of ``s2`` up to the first j with IoU >= t. If i has the
    larger area it takes j's place, else it is dropped; without such a j it is appended. (The paper
    appends to an undefined L; S is meant, item 33.) Boxes are compared with ``s2`` as it came, so a
    second i can push out one that had just taken j's place, though the two may not even touch. The fused list
    comes back, and (k, 2) each box that is lost, with the one that stays in its place.
    """
    fused, length = np.concatenate((s2, s1)), len(s2)
    lost, losses = np.empty((len(s1), 2), np.int64), 0
    for i in s1:
        match = -1
        for place in range(len(s2)):
            if iou(boxes[i], boxes[s2[place]]) >= threshold * (1.0 - ROUNDING):
                match = place
                break
        if match < 0:
            fused[length] = i
            length += 1
            continue
        j = s2[match]
        if area(boxes[i]) > area(boxes[j]) * (1.0 + ROUNDING):
            fused[match] = i
            lost[losses] = j, i
        else:
            lost[losses] = i, j
        losses += 1
    return fused[:length], lost[:losses]


def divide_and_conquer(
    lists: Sequence[Indices],
    left: int,
    right: int,
    boxes: BoxArray,
    threshold: float,
    calls: dict[tuple[int, int], Call] | None = None,
) -> Indices:
    """Algorithm 3, Divide and Conquer: the lists ``left`` to ``right`` fused in pairs, up a binary tree.

    The paper's recursive calls forget t; it is passed on (item 33). A single list is returned as it
    is, never fused with itself (item 34). ``lists`` hold indices of ``boxes``, the whole team's; l is counted
    from 0, r inclusive; ``calls`` takes what each call came to, by (l, r).
    """
    if left == right:
        fused, lost = lists[left], NOTHING
    else:
        middle = (left + right) // 2
        first = divide_and_conquer(lists, left, middle, boxes, threshold, calls)
        second = divide_and_conquer(lists, middle + 1, right, boxes, threshold, calls)
        fused, lost = fuse_detections(second, first, boxes, threshold)
    if calls is not None:
        calls[left, right] = Call(fused.tolist(), lost.tolist())
    return fused


def fuse_team(found: Sequence[BoxArray], squares: BoxArray, settings: MIDNetSettings) -> TeamBoxes:
    """Section IV.C in full, for at least one robot.

    ``found`` has each robot's boxes, ``squares`` each robot's of :func:`ally_squares`, and behind them those
    of further allies.
    """
    boxes, remove = np.concatenate(found), REMOVE[settings.ally_remove]
    # further allies count as robots that find nothing
    counts = [len(own) for own in found] + [0] * (len(squares) - len(found))
    bounds = np.array([*accumulate(counts, initial=0)])
    kept, removed = remove_ally_detections(boxes, bounds, squares, settings.iou_ally, remove)
    starts = np.searchsorted(kept, bounds)
    lists = [kept[begin:end] for begin, end in pairwise(starts.tolist())]
    fused = divide_and_conquer(lists, 0, len(lists) - 1, boxes, settings.iou_fuse)
    found_by = np.searchsorted(bounds[1:], fused, side="right")
    return TeamBoxes(boxes[fused], found_by, kept, starts, removed, squares)
