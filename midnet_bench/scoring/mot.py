"""Multiple-object tracking by the library motmetrics, the extra ``midnet-bench[mot]``."""

import math
from typing import Any

import numpy as np

from midnet_bench.detectors.events import Events
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.geometry import Box
from midnet_bench.scoring.metric import MetricFrame


class ClearMot:
    """How well the team's boxes tell intruders apart over time.

    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics",
    EURASIP Journal on Image and Video Processing (2008); Ristani et al., "Performance measures and a data set
    for multi-target, multi-camera tracking", ECCV workshops 2016, for identities. Boxes have no identity of
    their own, so they get those of the tracks that guards pursue (``detectors/tracking.py``). A box farther
    than ``cutoff_m`` from an intruder, centre to centre, is not on it. Intruders out of range and boxes on
    them are left out.
    """

    def __init__(self, cutoff_m: float = 1.0) -> None:
        import motmetrics

        motmetrics.lap.default_solver = "scipy"  # unasked it takes whichever happens to be installed
        self._motmetrics: Any = motmetrics
        self._events = motmetrics.MOTAccumulator(auto_id=True)
        self._tracker = Tracker()
        self._cutoff_m = cutoff_m
        self._numbers: dict[str, int] = {}
        """of the intruders, since motmetrics takes no names"""

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """No value of its own."""
        places = [box.center for box in seen.counted_boxes]
        near = [truth for truth, counts in zip(seen.truths, seen.in_range, strict=True) if counts]
        gaps_m = np.array([[math.dist(truth.center, place) for place in places] for truth in near])
        gaps_m = gaps_m.reshape(len(near), len(places))
        gaps_m[gaps_m > self._cutoff_m] = np.nan
        tracks = self._tracker.update(places, seen.time_s)
        numbers = [self._numbers.setdefault(truth.name, len(self._numbers)) for truth in near]
        self._events.update(numbers, tracks, gaps_m)
        return {}

    def trial(self) -> dict[str, float]:
        """``mota``, ``motp_m``, ``idf1`` and ``id_switches``; those that are not defined are left out."""
        wanted = ("mota", "motp", "idf1", "num_switches")
        found = self._motmetrics.metrics.create().compute(self._events, metrics=wanted).to_dict("records")[0]
        names = {"motp": "motp_m", "num_switches": "id_switches"}
        return {names.get(name, name): float(value) for name, value in found.items() if math.isfinite(value)}


class EventCounts:
    """What a guard reads: events, and how many an hour are false (``detectors/events.py``)."""

    def __init__(self) -> None:
        self._events = Events()

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """No value of its own."""
        boxes = [Box._make(box) for box in seen.boxes.tolist()]
        self._events.take(boxes, [bool(on) for on in seen.touched], seen.time_s)
        return {}

    def trial(self) -> dict[str, float]:
        """``events``, and ``false_events_per_hour`` if more than one frame was seen."""
        found = {"events": float(len(self._events.gathered()))}
        rate = self._events.false_per_hour
        return found | ({"false_events_per_hour": rate} if math.isfinite(rate) else {})
