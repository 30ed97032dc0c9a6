"""``Fusion``: what makes one list of the robots' boxes; and those to compare Algorithms 3 and 4 with."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from midnet_bench.detectors.tracking import Tracker, most_pairs
from midnet_bench.geometry import Floats, Indices, lengths, mean_point
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.settings import option


class Fusion(Protocol):
    """A class of these is made anew for each trial, of its own options, and may remember what it saw."""

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> npt.ArrayLike:
        """The team's boxes of one frame.

        Args:
            found: for each robot (n, 4) boxes without its allies: x_min, y_min, x_max, y_max, map frame,
                metres. They must stay as they are.
            time_s: of the frame, more at each call.

        Returns:
            (n, 4) boxes, or an empty list.
        """


def _least_iou() -> Any:
    return option(0.1, "Boxes that overlap by this IoU (Eq. 7) or more are one thing's.", gt=0, le=1)


def ious(some: BoxArray, others: BoxArray) -> Floats:
    """(...) Eq. 7 of (..., 4) boxes with others; shapes are broadcast."""
    low = np.maximum(some[..., :2], others[..., :2])
    high = np.minimum(some[..., 2:], others[..., 2:])
    both = np.clip(high - low, 0.0, None).prod(axis=-1)
    return np.asarray(both / (_areas(some) + _areas(others) - both))


def _areas(boxes: BoxArray) -> Floats:
    return np.asarray((boxes[..., 2:] - boxes[..., :2]).prod(axis=-1))


def centres(boxes: BoxArray) -> BoxArray:
    """(n, 2) of (n, 4) boxes."""
    return (boxes[:, :2] + boxes[:, 2:]) / 2.0


def all_of(found: Sequence[BoxArray]) -> BoxArray:
    """The boxes of all robots, the largest first and then by their corners, whatever the robots' order is."""
    boxes = np.concatenate([*found, np.empty((0, 4))])
    return boxes[np.lexsort((*boxes.T[::-1], -_areas(boxes)))]


class NoFusion:
    """Every robot's boxes as they are."""

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """All of ``found``, whatever the time is."""
        return all_of(found)


@dataclass
class NonMaximumSuppression:
    """The largest box stays and takes out all that overlap it by ``iou`` or more; then the next largest.

    Boxes have no score here, so size stands for it: a robot that sees more of an intruder has the larger box.
    """

    iou: float = _least_iou()

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The boxes that nothing larger takes out, whatever the time is."""
        boxes = all_of(found)
        overlap = ious(boxes[:, None], boxes) >= self.iou
        kept: list[int] = []
        for i in range(len(boxes)):
            if not overlap[i, kept].any():
                kept.append(i)
        return boxes[kept]


@dataclass
class ConnectedComponents:
    """Boxes that overlap by ``iou`` or more, directly or by others between them, become one around all.

    A k-d tree finds those that can overlap, so that time grows with the team and not with its square.
    """

    iou: float = _least_iou()
    gap_m: float = option(0.0, "So do boxes no farther apart, such as two legs; 0: none.", ge=0, le=100)

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

    def _pairs(self, boxes: BoxArray) -> Indices:
        """(n, 2) indices of the boxes that overlap enough, or lie near enough."""
        # two boxes with a common area have centres nearer than the longest side, along each axis
        reach_m = float((boxes[:, 2:] - boxes[:, :2]).max()) + self.gap_m
        near = KDTree(centres(boxes)).query_pairs(reach_m, p=np.inf, output_type="ndarray")
        some, others = boxes[near[:, 0]], boxes[near[:, 1]]
        are_one = ious(some, others) >= self.iou
        if self.gap_m > 0.0:
            gaps_m = np.maximum(some[:, :2], others[:, :2]) - np.minimum(some[:, 2:], others[:, 2:])
            are_one |= lengths(np.maximum(gaps_m, 0.0)) <= self.gap_m
        return near[are_one]


@dataclass
class WeightedBoxes:
    """Each box, largest first, joins the mean that it overlaps most, by ``iou`` or more; or begins one.

    As in Solovyev, Wang and Gabruseva, "Weighted boxes fusion: Ensembling boxes from different object
    detection models", Image and Vision Computing 107 (2021). Boxes have no score here: each weighs the same.
    """

    iou: float = _least_iou()

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The means, whatever the time is."""
        members: list[list[BoxArray]] = []
        means = np.empty((0, 4))
        for box in all_of(found):
            overlap = ious(box, means)
            if len(overlap) and overlap.max() >= self.iou:
                best = int(overlap.argmax())
                members[best].append(box)
                means[best] = mean_point(np.array(members[best]))
            else:
                members.append([box])
                means = np.concatenate((means, box[None]))
        return means


@dataclass
class CentreDistance:
    """Robot after robot: pairs within ``gap_m`` that are nearest in sum become their mean, the rest stays.

    Pairs by the Hungarian method. The order of the robots matters here.
    """

    gap_m: float = option(0.3, "Boxes whose centres are farther apart are no pair.", ge=0, le=100)

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """One box for each thing, whatever the time is."""
        team, weights = np.empty((0, 4)), np.empty(0)
        for own in found:
            gaps = lengths(centres(team)[:, None] - centres(own)[None])
            rows, columns = most_pairs(gaps, self.gap_m)
            share = weights[rows, None]
            team[rows] = (team[rows] * share + own[columns]) / (share + 1.0)
            weights[rows] += 1.0
            alone = np.setdiff1d(np.arange(len(own)), columns)
            team = np.concatenate((team, own[alone]))
            weights = np.concatenate((weights, np.ones(len(alone))))
        return team


@dataclass
class KalmanTracks:
    """Connected components, followed from frame to frame by constant velocity (``detectors/tracking.py``).

    A box that is reported without being seen stays where it was last.
    """

    hits: int = option(3, "A track is reported from this box of it on.", ge=1, le=1_000_000)
    keep_s: float = option(0.5, "A track ends so long after its last box, seconds.", ge=0, le=1e6)
    iou: float = _least_iou()

    def __post_init__(self) -> None:
        self._components, self._tracker = ConnectedComponents(self.iou), Tracker()
        self._seen: dict[int, tuple[BoxArray, float, int]] = {}  # track -> its last box, when, how many

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The boxes of the tracks that are reported."""
        boxes = self._components.fuse(found, time_s)
        places = [(x, y) for x, y in centres(boxes).tolist()]
        for number, box in zip(self._tracker.update(places, time_s), boxes, strict=True):
            times = self._seen[number][2] if number in self._seen else 0
            self._seen[number] = (box, time_s, times + 1)
        for number, (_, seen_s, _) in list(self._seen.items()):
            if time_s - seen_s > self.keep_s + 1e-9:
                self._tracker.drop(number)
                del self._seen[number]
        reported = [box for box, _, times in self._seen.values() if times >= self.hits]
        return np.array(reported, dtype=np.float64).reshape(-1, 4)
