"""Section IV.C on lists of boxes, one list for each robot: what the tests say things in."""

from collections.abc import Sequence

import numpy as np

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.fusion import (
    REMOVE,
    AllyRemove,
    TeamBoxes,
    ally_squares,
    divide_and_conquer,
    fuse_detections,
    fuse_team,
)
from tests.midnet.plain_fusion import AllyRemoval, Detection, RemovedAlly


def rows(boxes: Sequence[Box]) -> BoxArray:
    return np.array(boxes, np.float64).reshape(-1, 4)


def fused_team(
    poses: Sequence[Pose2D],
    lists: Sequence[Sequence[Box]],
    diameter_m: float,
    iou_ally: float,
    remove: AllyRemove,
    iou_fuse: float,
) -> TeamBoxes:
    robots = np.repeat(np.arange(len(lists)), [len(own) for own in lists])
    boxes = rows([box for own in lists for box in own])
    return fuse_team(boxes, robots, ally_squares(poses, diameter_m), iou_ally, REMOVE[remove], iou_fuse)


def remove_ally_detections(
    poses: Sequence[Pose2D],
    detections: Sequence[Sequence[Detection]],
    diameter_m: float,
    threshold: float,
    remove: AllyRemove = "first",
) -> AllyRemoval:
    team = fused_team(
        poses, [[one.box for one in own] for own in detections], diameter_m, threshold, remove, 1.0
    )
    flat = [one for own in detections for one in own]
    kept = [
        [flat[k] for k in team.kept[begin:end]]
        for begin, end in zip(team.starts, team.starts[1:], strict=False)
    ]
    squares = [Box.square(pose.x, pose.y, diameter_m) for pose in poses]
    return AllyRemoval(
        kept, [RemovedAlly(flat[k], i, squares[i].iou(flat[k].box)) for i, k in team.removed.tolist()]
    )


def fuse(s1: Sequence[Detection], s2: Sequence[Detection], threshold: float) -> list[Detection]:
    """Algorithm 4."""
    both = [*s1, *s2]
    indices = np.arange(len(both))
    found = fuse_detections(
        indices[: len(s1)], indices[len(s1) :], rows([one.box for one in both]), threshold
    )
    return [both[k] for k in found]


def conquer(lists: Sequence[Sequence[Detection]], left: int, right: int, threshold: float) -> list[Detection]:
    """Algorithm 3."""
    flat = [one for own in lists for one in own]
    indices = np.split(np.arange(len(flat)), np.cumsum([len(own) for own in lists])[:-1])
    boxes = rows([one.box for one in flat])
    return [flat[k] for k in divide_and_conquer(indices, left, right, boxes, threshold)]
