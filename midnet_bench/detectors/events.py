"""Events: what moves past a team is one event, however many boxes it has; a flicker is none.

Boxes whose centres lie within ``GROUP_M`` are one thing, as a person's two legs are. Things get the numbers
of tracks (``detectors/tracking.py``). A track is an event from its ``HITS``-th box on, if it lasts
``LEAST_S``; it has ended when ``KEPT_S`` went by without a box. The four values are ours: a stride, the
shortest run that no single wrong return makes, and the time that a person is behind a pillar.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from midnet_bench.detectors.tracking import Tracker
from midnet_bench.geometry import Box, Point

GROUP_M = 0.8
HITS, LEAST_S, KEPT_S = 3, 0.3, 2.0
WALKS = 0.7, 0.5
"""a new track's deviation of speed along an axis, m/s, and the spectral density of its acceleration, m2/s3:
people walk at 1.4 m/s and stop within a second"""


class Event(NamedTuple):
    """One thing that was there for a while. Map frame, metres, seconds of the frames' clock."""

    first_s: float
    last_s: float
    frames: int
    """with a box of it"""
    share: float
    """of the frames from the first to the last: how sure it is"""
    x_first_m: float
    y_first_m: float
    x_last_m: float
    y_last_m: float
    speed_mps: float
    """from second to second, on the average"""
    is_true: bool
    """whether a box of it is an intruder's, where that is known"""


@dataclass
class _Seen:
    frame: int
    """number of the first one"""
    places: list[tuple[float, Point]] = field(default_factory=list)
    """(time in s, centre in metres) of each frame with a box of it"""
    last_frame: int = 0
    is_true: bool = False


class Events:
    """Gathers events frame by frame."""

    def __init__(self) -> None:
        """None yet."""
        self._tracker, self._seen, self._frames = Tracker(*WALKS), dict[int, _Seen](), 0
        self._ended: list[Event] = []
        self._first_s, self._last_s = math.inf, -math.inf

    def take(self, boxes: Sequence[Box], are_true: Sequence[bool], time_s: float) -> list[int]:
        """One frame's boxes, and for each whether it is an intruder's; the number of each one's track.

        Times never go back.
        """
        self._first_s, self._last_s = min(self._first_s, time_s), time_s
        for number, seen in list(self._seen.items()):
            if time_s - seen.places[-1][0] > KEPT_S:
                self._tracker.drop(number)
                self._end(self._seen.pop(number))
        groups = _groups([box.center for box in boxes])
        places = [
            (
                math.fsum(boxes[k].center[0] for k in group) / len(group),
                math.fsum(boxes[k].center[1] for k in group) / len(group),
            )
            for group in groups
        ]
        numbers = [-1] * len(boxes)
        for number, place, group in zip(self._tracker.update(places, time_s), places, groups, strict=True):
            for k in group:
                numbers[k] = number
            seen = self._seen.setdefault(number, _Seen(self._frames))
            seen.last_frame = self._frames
            seen.places.append((time_s, place))
            seen.is_true |= any(are_true[k] for k in group)
        self._frames += 1
        return numbers

    def gathered(self) -> list[Event]:
        """All events, by their beginning."""
        for seen in self._seen.values():
            self._end(seen)
        self._seen.clear()
        return sorted(self._ended)

    @property
    def false_per_hour(self) -> float:
        """Events of which no box is an intruder's, by the time that was watched; NaN for none at all."""
        lasted_h = (self._last_s - self._first_s) / 3600.0
        return sum(not event.is_true for event in self.gathered()) / lasted_h if lasted_h > 0.0 else math.nan

    def _end(self, seen: _Seen) -> None:
        (first_s, (x, y)), (last_s, (x_last, y_last)) = seen.places[0], seen.places[-1]
        lasted_s, hits = last_s - first_s, len(seen.places)
        if hits < HITS or lasted_s < LEAST_S:
            return
        way_m, (since_s, place) = 0.0, seen.places[0]
        for time_s, at in seen.places:  # a second apart: jitter is no way
            if time_s - since_s >= 1.0 or time_s == last_s:
                way_m, since_s, place = way_m + math.dist(place, at), time_s, at
        share = hits / (seen.last_frame - seen.frame + 1)
        self._ended.append(
            Event(first_s, last_s, hits, share, x, y, x_last, y_last, way_m / lasted_s, seen.is_true)
        )


def _groups(places: Sequence[Point]) -> list[list[int]]:
    """Indices of places that lie within ``GROUP_M`` of another of their group."""
    groups: list[list[int]] = []
    for k, place in enumerate(places):
        near = [group for group in groups if any(math.dist(place, places[i]) <= GROUP_M for i in group)]
        groups = [group for group in groups if group not in near] + [[*(i for one in near for i in one), k]]
    return groups
