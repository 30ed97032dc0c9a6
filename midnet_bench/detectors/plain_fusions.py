"""Fusions that need no more than a line or two: none, non-maximum suppression, connected components."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from midnet_bench.detectors.fusion import all_of, ious, pair_ious
from midnet_bench.midnet.detection import BoxArray


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
    """Boxes that overlap by ``iou`` or more, directly or by others between them, become one around all.

    A k-d tree finds those that can overlap, so that time grows with the team and not with its square.
    """

    def __init__(self, iou: float = 0.1) -> None:
        self._iou = iou

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """One box for each component, whatever the time is."""
        boxes = all_of(found)
        if not len(boxes):
            return boxes
        one, other = self._pairs(boxes).T
        graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(len(boxes), len(boxes)))
        _, labels = connected_components(graph, directed=False)
        order = np.argsort(labels, kind="stable")
        first = np.flatnonzero(np.diff(labels[order], prepend=-1))
        low, high = boxes[order, :2], boxes[order, 2:]
        return np.hstack((np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)))

    def _pairs(self, boxes: BoxArray) -> npt.NDArray[np.int64]:
        """(n, 2) indices of the boxes that overlap enough."""
        # two boxes with a common area have centres nearer than the longest side, along each axis
        reach_m = float((boxes[:, 2:] - boxes[:, :2]).max())
        tree = KDTree((boxes[:, :2] + boxes[:, 2:]) / 2.0)
        near = tree.query_pairs(reach_m, p=np.inf, output_type="ndarray")
        return near[pair_ious(boxes[near[:, 0]], boxes[near[:, 1]]) >= self._iou]
