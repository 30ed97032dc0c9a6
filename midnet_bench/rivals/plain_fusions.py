"""Fusions that need no more than a line or two: none, non-maximum suppression, connected components."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse.csgraph import connected_components

from midnet_bench.midnet.detection import BoxArray
from midnet_bench.rivals.fusion import all_of, ious


class NoFusion:
    """Every robot's boxes as they are."""

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """All of ``found``, whatever the time is."""
        return all_of(found)


class NonMaximumSuppression:
    """The largest box stays and takes out all that overlap it by ``iou`` or more; then the next largest.

    Boxes have no score here, so size stands for it: a robot that sees more of an intruder has the larger box.
    """

    def __init__(self, iou: float = 0.1) -> None:
        self._iou = iou

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The boxes that nothing larger takes out, whatever the time is."""
        boxes = all_of(found)
        overlap = ious(boxes, boxes) >= self._iou
        kept: list[int] = []
        for i in range(len(boxes)):
            if not overlap[i, kept].any():
                kept.append(i)
        return boxes[kept]


class ConnectedComponents:
    """Boxes that overlap by ``iou`` or more, directly or by others between them, become one around all."""

    def __init__(self, iou: float = 0.1) -> None:
        self._iou = iou

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """One box for each component, whatever the time is."""
        boxes = all_of(found)
        count, labels = connected_components(ious(boxes, boxes) >= self._iou, directed=False)
        groups = [boxes[labels == label] for label in range(count)]
        around = [[*group[:, :2].min(axis=0), *group[:, 2:].max(axis=0)] for group in groups]
        return np.array(around, dtype=np.float64).reshape(-1, 4)
