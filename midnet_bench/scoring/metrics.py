"""Metrics beside the paper's: OSPA, first detections, idleness of patrolled places, identities, and events.

Multiple-object tracking is by the library motmetrics, the extra ``midnet-bench[mot]``.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from midnet_bench.detectors.tracking import Events, Tracker
from midnet_bench.geometry import Box, Floats, lengths
from midnet_bench.scoring.metric import MetricFrame
from midnet_bench.settings import option


def _cutoff_m() -> Any:
    return option(1.0, "A box farther from an intruder, centre to centre, is not on it.", gt=0, le=1000)


@dataclass
class Ospa:
    """Optimal sub-pattern assignment: mean distance of boxes from intruders, 0 to ``cutoff_m``.

    Schuhmacher, Vo and Vo, "A consistent metric for performance evaluation of multi-object filters", IEEE
    Transactions on Signal Processing 56 (2008), of order 1. What has no partner is ``cutoff_m`` off.
    Intruders out of range and boxes on them are left out.
    """

    cutoff_m: float = _cutoff_m()

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """``ospa_m``, metres; 0 where neither a box nor an intruder is."""
        boxes = [box.center for box in seen.counted_boxes]
        intruders = [truth.center for truth, near in zip(seen.truths, seen.in_range, strict=True) if near]
        most, least = max(len(boxes), len(intruders)), min(len(boxes), len(intruders))
        if not least:
            return {"ospa_m": self.cutoff_m if most else 0.0}
        gaps_m = np.array(
            [[min(math.dist(box, intruder), self.cutoff_m) for intruder in intruders] for box in boxes]
        )
        paired_m = math.fsum(gaps_m[linear_sum_assignment(gaps_m)].tolist())
        return {"ospa_m": (paired_m + self.cutoff_m * (most - least)) / most}


class FirstDetection:
    """When intruders get their first box."""

    def __init__(self) -> None:
        self._near_s: dict[str, float] = {}
        self._found_s: dict[str, float] = {}

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """No value of its own."""
        found = {i for on in seen.touched for i in on}
        for i, truth in enumerate(seen.truths):
            if seen.in_range[i] or i in found:
                self._near_s.setdefault(truth.name, seen.time_s)
            if i in found:
                self._found_s.setdefault(truth.name, seen.time_s)
        return {}

    def trial(self) -> dict[str, float]:
        """Means over the intruders that were found, seconds: since the start, and since each was in range.

        ``never_detected`` is how many others were in range at some time.
        """
        values = {"never_detected": float(len(self._near_s) - len(self._found_s))}
        if self._found_s:
            count = len(self._found_s)
            values["first_detection_s"] = math.fsum(self._found_s.values()) / count
            waits_s = (time_s - self._near_s[name] for name, time_s in self._found_s.items())
            values["detection_delay_s"] = math.fsum(waits_s) / count
        return values


@dataclass
class Idleness:
    """For how long places have not been visited.

    Machado, Ramalho, Zucker and Drogoul, "Multi-agent patrolling: an empirical analysis of alternative
    architectures", MABS 2002; used to compare patrols by Portugal and Rocha, "Multi-robot patrolling
    algorithms: examining performance and scalability", Advanced Robotics 27 (2013). The places are those
    where a guard may be sent, one in each square. At the start all have just been visited.
    """

    reach_m: float = option(1.0, "A guard this near visits a place, walls or not.", gt=0, le=1000)
    spacing_m: float = option(0.5, "Side of the squares that have one place each.", ge=0.05, le=1000)
    _visited_s: Floats | None = field(default=None, init=False)
    _longest_s: float = field(default=0.0, init=False)

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """``idleness_s``: the mean over the places now, seconds."""
        squares = np.floor(seen.points / self.spacing_m).astype(np.int64)
        _, first = np.unique(squares, axis=0, return_index=True)
        if self._visited_s is None:
            self._visited_s = np.zeros(len(first))
        if len(seen.guards):
            gaps = seen.points[first][:, None] - seen.guards[None]
            self._visited_s[lengths(gaps).min(axis=1) <= self.reach_m] = seen.time_s
        idle_s = (seen.time_s - self._visited_s).tolist()
        self._longest_s = max(self._longest_s, *idle_s)
        return {"idleness_s": math.fsum(idle_s) / len(idle_s)}

    def trial(self) -> dict[str, float]:
        """``longest_idleness_s``: of any place at any time, seconds."""
        return {"longest_idleness_s": self._longest_s}


@dataclass
class ClearMot:
    """How well the team's boxes tell intruders apart over time.

    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT metrics",
    EURASIP Journal on Image and Video Processing (2008); Ristani et al., "Performance measures and a data set
    for multi-target, multi-camera tracking", ECCV workshops 2016, for identities. Boxes have no identity of
    their own, so they get those of the tracks that guards pursue (``detectors/tracking.py``). Intruders out
    of range and boxes on them are left out.
    """

    cutoff_m: float = _cutoff_m()

    def __post_init__(self) -> None:
        import motmetrics

        motmetrics.lap.default_solver = "scipy"  # unasked it takes whichever happens to be installed
        self._motmetrics: Any = motmetrics
        self._events = motmetrics.MOTAccumulator(auto_id=True)
        self._tracker = Tracker()
        self._numbers: dict[str, int] = {}
        """of the intruders, since motmetrics takes no names"""

    def frame(self, seen: MetricFrame) -> dict[str, float]:
        """No value of its own."""
        places = [box.center for box in seen.counted_boxes]
        near = [truth for truth, counts in zip(seen.truths, seen.in_range, strict=True) if counts]
        gaps_m = np.array([[math.dist(truth.center, place) for place in places] for truth in near])
        gaps_m = gaps_m.reshape(len(near), len(places))
        gaps_m[gaps_m > self.cutoff_m] = np.nan
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
    """What a guard reads: events, and how many an hour are false (``detectors/tracking.py``)."""

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
