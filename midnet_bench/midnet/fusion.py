"""Section IV.C: the robots' boxes become the team's: allies are taken out (C.1), lists are fused (C.2).

The paper says that the result holds no overlapping boxes and that the order of the robots does not
matter. Neither holds (item 35): IoU >= t is not transitive, a box is compared only up to its first
match, and always with the boxes that the second list held at the start. It is kept as written; the
tests pin an example of each.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from midnet_bench.geometry import Box, Pose2D

AllyRemove = Literal["first", "best", "all"]

# metres make boxes of whole cells differ in the last bits; a tie in cells stays a tie (item 37)
ROUNDING = 1e-9


class Detection(NamedTuple):
    """One box, map frame, and the robot that found it."""

    box: Box
    robot: int
    """index in the team"""


class RemovedAlly(NamedTuple):
    """A robot's box that was taken for an ally."""

    detection: Detection
    ally: int
    """index of the robot whose pose it matched"""
    iou: float
    """with that ally's square"""


class AllyRemoval(NamedTuple):
    """What Algorithm 2 leaves and what it takes."""

    kept: list[list[Detection]]
    """one list per robot, in their old order"""
    removed: list[RemovedAlly]
    """in the order of removal"""


def ally_box(pose: Pose2D, diameter_m: float) -> Box:
    """``bbox`` of Algorithm 2: the upright square of side di about a robot's position."""
    return Box.square(pose.x, pose.y, diameter_m)


def remove_ally_detections(
    poses: Sequence[Pose2D],
    detections: Sequence[Sequence[Detection]],
    diameter_m: float,
    threshold: float,
    remove: AllyRemove = "first",
) -> AllyRemoval:
    """Algorithm 2, Remove Ally Detections: each ally's box out of the lists of all the others.

    The paper takes out one box per ally and observer and then stops looking, so an ally that is seen
    as two boxes leaves one behind (item 30). The inputs are not changed (item 32).

    Args:
        poses: of each robot as it reports it, map frame (R, ``i.pos``).
        detections: of each robot, in the same order (``j.d``).
        diameter_m: di, the diameter of the circle around a robot (item 27).
        threshold: t, 0 < t <= 1; an IoU of t or more is the ally (item 29).
        remove: ``first`` in the list, as the paper; ``best`` IoU; or ``all`` of t or more.
    """
    kept = [list(own) for own in detections]
    removed = []
    for ally, pose in enumerate(poses):
        square = ally_box(pose, diameter_m)
        for observer, own in enumerate(kept):
            if observer == ally:
                continue
            matches = [
                RemovedAlly(detection, ally, score)
                for detection in own
                if (score := square.iou(detection.box)) >= threshold
            ]
            if not matches:
                continue
            if remove == "first":
                matches = matches[:1]
            elif remove == "best":
                matches = [max(matches, key=lambda match: match.iou)]
            for match in matches:
                own.remove(match.detection)
            removed += matches
    return AllyRemoval(kept, removed)


def divide_and_conquer(
    lists: Sequence[Sequence[Detection]], left: int, right: int, threshold: float
) -> list[Detection]:
    """Algorithm 3, Divide and Conquer: the lists ``left`` to ``right`` fused in pairs, up a binary tree.

    The paper's recursive calls forget t; it is passed on (item 33). A single list is returned as it
    is, never fused with itself (item 34).

    Args:
        lists: the detections of each robot, in index order.
        left: l, the first list's index, counted from 0.
        right: r, the last list's index, inclusive.
        threshold: t, 0 < t <= 1.
    """
    if left == right:
        return list(lists[left])
    middle = (left + right) // 2
    first = divide_and_conquer(lists, left, middle, threshold)
    second = divide_and_conquer(lists, middle + 1, right, threshold)
    return fuse_detections(second, first, threshold)


def fuse_detections(s1: Sequence[Detection], s2: Sequence[Detection], threshold: float) -> list[Detection]:
    """Algorithm 4, Fuse Detections: ``s2``, with the boxes of ``s1`` in place of smaller ones or behind.

    Each box i of ``s1`` is compared with those of ``s2`` up to the first j with IoU >= t. If i has the
    larger area it takes j's place, else it is dropped; without such a j it is appended. (The paper
    appends to an undefined L; S is meant, item 33.) Boxes are compared with ``s2`` as it came, so a
    second i can push out one that had just taken j's place, though the two may not even touch.
    """
    fused = list(s2)
    least = threshold * (1.0 - ROUNDING)
    for i in s1:
        for index, j in enumerate(s2):
            if i.box.iou(j.box) >= least:
                if i.box.area > j.box.area * (1.0 + ROUNDING):
                    fused[index] = i
                break
        else:
            fused.append(i)
    return fused
