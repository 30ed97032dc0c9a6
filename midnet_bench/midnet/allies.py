"""Section IV.C.1: detections that are team mates are taken out."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.boxes import Sighting

AllyRemove = Literal["first", "best", "all"]


class RemovedAlly(NamedTuple):
    """A robot's box that was taken for an ally."""

    sighting: Sighting
    ally: int
    """index of the robot whose pose it matched"""
    iou: float
    """with that ally's square"""


class AllyRemoval(NamedTuple):
    """What Algorithm 2 leaves and what it takes."""

    kept: list[list[Sighting]]
    """one list per robot, in their old order"""
    removed: list[RemovedAlly]
    """in the order of removal"""


def iou(a: Box, b: Box) -> float:
    """Eq. 7, the area that both boxes cover over the area that either covers, 0 to 1.

    Boxes that share no more than an edge have 0, and so has anything with a box of no area.
    """
    # written out on plain numbers: a frame asks for hundreds, and most pairs are apart
    ax1, ay1, ax2, ay2 = a
    bx1, by1, bx2, by2 = b
    if ax2 <= bx1 or bx2 <= ax1 or ay2 <= by1 or by2 <= ay1:
        return 0.0
    width = (ax2 if ax2 < bx2 else bx2) - (ax1 if ax1 > bx1 else bx1)
    height = (ay2 if ay2 < by2 else by2) - (ay1 if ay1 > by1 else by1)
    both = width * height
    either = (ax2 - ax1) * (ay2 - ay1) + (bx2 - bx1) * (by2 - by1) - both
    return both / either if both > 0.0 else 0.0


def ally_box(pose: Pose2D, diameter_m: float) -> Box:
    """``bbox`` of Algorithm 2: the upright square of side di about a robot's position."""
    return Box.square(pose.x, pose.y, diameter_m)


def remove_ally_detections(
    poses: Sequence[Pose2D],
    sightings: Sequence[Sequence[Sighting]],
    diameter_m: float,
    threshold: float,
    remove: AllyRemove = "first",
) -> AllyRemoval:
    """Algorithm 2, Remove Ally Detections: each ally's box out of the lists of all the others.

    The paper takes out one box per ally and observer and then stops looking, so an ally that is seen
    as two boxes leaves one behind (item 30). The inputs are not changed (item 32).

    Args:
        poses: of each robot as it reports it, map frame (R, ``i.pos``).
        sightings: of each robot, in the same order (``j.d``).
        diameter_m: di, the diameter of the circle around a robot (item 27).
        threshold: t, 0 < t <= 1; an IoU of t or more is the ally (item 29).
        remove: ``first`` in the list, as the paper; ``best`` IoU; or ``all`` of t or more.
    """
    kept = [list(own) for own in sightings]
    removed = []
    for ally, pose in enumerate(poses):
        square = ally_box(pose, diameter_m)
        for observer, own in enumerate(kept):
            if observer == ally:
                continue
            matches = [
                RemovedAlly(sighting, ally, score)
                for sighting in own
                if (score := iou(square, sighting.box)) >= threshold
            ]
            if not matches:
                continue
            if remove == "first":
                matches = matches[:1]
            elif remove == "best":
                matches = [max(matches, key=lambda match: match.iou)]
            for match in matches:
                own.remove(match.sighting)
            removed += matches
    return AllyRemoval(kept, removed)
