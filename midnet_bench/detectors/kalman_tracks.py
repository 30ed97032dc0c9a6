"""``KalmanTracks``: boxes must come again to count, and stay for a while when they do not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from midnet_bench.detectors.plain_fusions import ConnectedComponents
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.midnet.detection import BoxArray


@dataclass
class _Seen:
    box: BoxArray
    """(4,) the last one"""
    seen_s: float
    times: int = 1


class KalmanTracks:
    """Connected components, followed from frame to frame by constant velocity (``detectors/tracking.py``).

    A track is reported from its ``hits``-th box on, and ends ``keep_s`` after its last one. A box that is
    reported without being seen stays where it was last.
    """

    def __init__(self, hits: int = 3, keep_s: float = 0.5, iou: float = 0.1) -> None:
        self._hits, self._keep_s = hits, keep_s
        self._components = ConnectedComponents(iou)
        self._tracker = Tracker()
        self._seen: dict[int, _Seen] = {}

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """The boxes of the tracks that are reported."""
        boxes = self._components.fuse(found, time_s)
        centres = [tuple(centre) for centre in ((boxes[:, :2] + boxes[:, 2:]) / 2.0).tolist()]
        for number, box in zip(self._tracker.update(centres, time_s), boxes, strict=True):
            times = self._seen[number].times + 1 if number in self._seen else 1
            self._seen[number] = _Seen(box, time_s, times)
        for number, seen in list(self._seen.items()):
            if time_s - seen.seen_s > self._keep_s + 1e-9:
                self._tracker.drop(number)
                del self._seen[number]
        told = [seen.box for seen in self._seen.values() if seen.times >= self._hits]
        return np.array(told, dtype=np.float64).reshape(-1, 4)
