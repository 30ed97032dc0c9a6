"""``WeightedBoxes``: boxes on one thing become their mean, as in weighted boxes fusion.

Solovyev, Wang and Gabruseva, "Weighted boxes fusion: Ensembling boxes from different object detection
models", Image and Vision Computing 107 (2021). MIDNet's boxes have no score, so each weighs the same.
"""

from collections.abc import Sequence

import numpy as np

from midnet_bench.detectors.fusion import all_of, ious
from midnet_bench.geometry import mean_point
from midnet_bench.midnet.detection import BoxArray


class WeightedBoxes:
    """Each box, largest first, joins the mean that it overlaps most, by ``iou`` or more; or begins one."""

    def __init__(self, iou: float = 0.1) -> None:
        self._iou = iou

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The means, whatever the time is."""
        members: list[list[BoxArray]] = []
        means = np.empty((0, 4))
        for box in all_of(found):
            overlap = ious(box[None], means)[0]
            if len(overlap) and overlap.max() >= self._iou:
                best = int(overlap.argmax())
                members[best].append(box)
                means[best] = mean_point(np.array(members[best]))
            else:
                members.append([box])
                means = np.concatenate((means, box[None]))
        return means
