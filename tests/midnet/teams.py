"""Section IV.C on lists of boxes, one list for each robot: what the tests say things in."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.fusion import (
    AllyRemove,
    ally_squares,
    divide_and_conquer,
    fuse_detections,
    fuse_team,
)
from midnet_bench.midnet.pipeline import Detection, MIDNetSettings


class AllyRemoval(NamedTuple):
    kept: list[list[Detection]]
    removed: list[tuple[Detection, int]]  # and the ally


def of(robot: int, *boxes: Box) -> list[Detection]:
    return [Detection(box, robot) for box in boxes]


def rows(detections: Sequence[Detection]) -> np.ndarray:
    return np.array([one.box for one in detections], np.float64).reshape(-1, 4)


def remove_ally_detections(
    poses: Sequence[Pose2D],
    lists: Sequence[Sequence[Detection]],
    di: float,
    t: float,
    remove: AllyRemove = "first",
) -> AllyRemoval:
    flat = [one for own in lists for one in own]
    settings = MIDNetSettings(iou_ally=t, ally_remove=remove, iou_fuse=1.0)
    team = fuse_team([rows(own) for own in lists], ally_squares(poses, di), settings)
    kept = [[flat[k] for k in team.kept[i:j]] for i, j in zip(team.starts, team.starts[1:], strict=False)]
    return AllyRemoval(kept, [(flat[k], ally) for ally, k in team.removed.tolist()])


def fuse(s1: Sequence[Detection], s2: Sequence[Detection], threshold: float) -> list[Detection]:
    """Algorithm 4."""
    both, indices = [*s1, *s2], np.arange(len(s1) + len(s2))
    found, _ = fuse_detections(indices[: len(s1)], indices[len(s1) :], rows(both), threshold)
    return [both[k] for k in found]


def conquer(lists: Sequence[Sequence[Detection]], left: int, right: int, threshold: float) -> list[Detection]:
    """Algorithm 3."""
    flat = [one for own in lists for one in own]
    indices = np.split(np.arange(len(flat)), np.cumsum([len(own) for own in lists])[:-1])
    return [flat[k] for k in divide_and_conquer(indices, left, right, rows(flat), threshold)]
