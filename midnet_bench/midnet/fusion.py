"""Section IV.C.2: the robots' lists of boxes become one.

The paper says that the result holds no overlapping boxes and that the order of the robots does not
matter. Neither holds (item 35): IoU >= t is not transitive, a box is compared only up to its first
match, and always with the boxes that the second list held at the start. It is kept as written; the
tests pin an example of each.
"""

from collections.abc import Sequence
from typing import NamedTuple

from midnet_bench.midnet.allies import iou
from midnet_bench.midnet.boxes import Sighting

# metres make boxes of whole cells differ in the last bits; a tie in cells stays a tie (item 37)
ROUNDING = 1e-9


class FusionEvent(NamedTuple):
    """One box that a fusion dropped, and why."""

    dropped: Sighting
    kept: Sighting
    """what stands in the list in its stead"""
    compared: tuple[Sighting, Sighting]
    """(i, j) of Algorithm 4; ``kept`` and ``dropped`` unless j had been replaced before"""
    iou: float
    """of the two compared"""


class Fusion(NamedTuple):
    """One list out of several, and how it came about."""

    sightings: list[Sighting]
    events: list[FusionEvent]
    """in the order they happened; each input box is in ``sightings`` or dropped by one event"""


def divide_and_conquer(
    lists: Sequence[Sequence[Sighting]], left: int, right: int, threshold: float
) -> Fusion:
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
        return Fusion(list(lists[left]), [])
    middle = (left + right) // 2
    first = divide_and_conquer(lists, left, middle, threshold)
    second = divide_and_conquer(lists, middle + 1, right, threshold)
    fused = fuse_detections(second.sightings, first.sightings, threshold)
    return Fusion(fused.sightings, first.events + second.events + fused.events)


def fuse_detections(s1: Sequence[Sighting], s2: Sequence[Sighting], threshold: float) -> Fusion:
    """Algorithm 4, Fuse Detections: ``s2``, with the boxes of ``s1`` in place of smaller ones or behind.

    Each box i of ``s1`` is compared with those of ``s2`` up to the first j with IoU >= t. If i has the
    larger area it takes j's place, else it is dropped; without such a j it is appended. (The paper
    appends to an undefined L; S is meant, item 33.) Boxes are compared with ``s2`` as it came, so a
    second i can push out one that had just taken j's place, though the two may not even touch.
    """
    fused = list(s2)
    events = []
    least = threshold * (1.0 - ROUNDING)
    for i in s1:
        for index, j in enumerate(s2):
            score = iou(i.box, j.box)
            if score >= least:
                standing = fused[index]
                if i.box.area > j.box.area * (1.0 + ROUNDING):
                    fused[index] = i
                    events.append(FusionEvent(standing, i, (i, j), score))
                else:
                    events.append(FusionEvent(i, standing, (i, j), score))
                break
        else:
            fused.append(i)
    return Fusion(fused, events)
