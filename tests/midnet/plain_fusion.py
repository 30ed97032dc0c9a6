"""Section IV.C box by box in plain Python, as MIDNet had it before it went over to arrays: an oracle."""

from collections.abc import Sequence
from typing import NamedTuple

from midnet_bench.geometry import Box, Pose2D

ROUNDING = 1e-9


class Detection(NamedTuple):
    box: Box
    robot: int


class RemovedAlly(NamedTuple):
    detection: Detection
    ally: int
    iou: float


class AllyRemoval(NamedTuple):
    kept: list[list[Detection]]
    removed: list[RemovedAlly]


def ally_box(pose: Pose2D, diameter_m: float) -> Box:
    return Box.square(pose.x, pose.y, diameter_m)


def remove_ally_detections(
    poses: Sequence[Pose2D],
    detections: Sequence[Sequence[Detection]],
    diameter_m: float,
    threshold: float,
    remove: str = "first",
) -> AllyRemoval:
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
    if left == right:
        return list(lists[left])
    middle = (left + right) // 2
    first = divide_and_conquer(lists, left, middle, threshold)
    second = divide_and_conquer(lists, middle + 1, right, threshold)
    return fuse_detections(second, first, threshold)


def fuse_detections(s1: Sequence[Detection], s2: Sequence[Detection], threshold: float) -> list[Detection]:
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
