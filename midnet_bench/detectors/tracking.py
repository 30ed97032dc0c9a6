"""``Tracker``: which boxes are one intruder's, from frame to frame; ``Events``: what moved past a team.

Global nearest neighbour: a Kalman filter of constant velocity for each track (Bar-Shalom, Li and Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, section 6.3), a gate on the squared
Mahalanobis distance, and within it the assignment of most pairs and then least distance (Hungarian method).
A box that no track takes begins a track. Nothing is confirmed: a false box makes a ghost that guards chase.

What moves past a team is one event, however many boxes it has; a flicker is none. Boxes whose centres lie
within ``GROUP_M`` are one thing, as a person's two legs are. A track of such things is an event from its
``HITS``-th box on, if it lasts ``LEAST_S``; it has ended when ``KEPT_S`` went by without a box. The four
values are ours: a stride, the shortest run that no single wrong return makes, and the time that a person is
behind a pillar.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from midnet_bench.geometry import Box, Floats, Indices, Point, mean_point

BOX_SIGMA_M = 0.1
"""Standard deviation of a box's centre along an axis; five guards' boxes are 0.098 m off in the mean (seeds
2001 to 2003, 500 frames each)."""
BOX_VARIANCE_M2 = BOX_SIGMA_M * BOX_SIGMA_M
SPEED_SIGMA_MPS = 0.15  # of a new track's speed along an axis: a Burger drives at 0.22 m/s at most
DRIFT_M2PS3 = 0.02
"""Spectral density of the acceleration: within 3 s a velocity may change by a Burger's top speed."""
GATE = 9.21
"""of the squared Mahalanobis distance; 99 % of a track's own boxes lie within (chi-square, two degrees)"""

GROUP_M = 0.8
HITS, LEAST_S, KEPT_S = 3, 0.3, 2.0
WALKS = 0.7, 0.5
"""a new track's deviation of speed along an axis, m/s, and the spectral density of its acceleration, m2/s3:
people walk at 1.4 m/s and stop within a second"""


class _Track:
    """Position and velocity along x and y; both axes have one covariance."""

    def __init__(self, place: Point, time_s: float, speed_sigma_mps: float, drift_m2ps3: float) -> None:
        self.state = np.array([place, (0.0, 0.0)])
        """(2, 2) x, y of the position, metres, and of the velocity, m/s"""
        self.covariance = np.diag([BOX_VARIANCE_M2, speed_sigma_mps * speed_sigma_mps])
        self._time_s, self._drift_m2ps3 = time_s, drift_m2ps3

    def predict(self, time_s: float) -> None:
        """Move on to a later time."""
        dt = time_s - self._time_s
        self._time_s = time_s
        place, velocity = self.state
        self.state = np.stack((place + dt * velocity, velocity))
        # written out: BLAS takes its additions' order from the processor
        (of_place, of_both), (_, of_velocity) = self.covariance.tolist()
        both = of_both + dt * of_velocity + self._drift_m2ps3 * (dt * dt / 2.0)
        of_place += dt * (2.0 * of_both + dt * of_velocity) + self._drift_m2ps3 * (dt * dt * dt / 3.0)
        self.covariance = np.array([[of_place, both], [both, of_velocity + self._drift_m2ps3 * dt]])

    def distance2(self, place: Point) -> float:
        """The squared Mahalanobis distance of a box's centre."""
        distance_m = math.dist(self.state[0].tolist(), place)
        return distance_m * distance_m / (float(self.covariance[0, 0]) + BOX_VARIANCE_M2)

    def correct(self, place: Point) -> None:
        """Take a box's centre for the place."""
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + BOX_VARIANCE_M2)
        self.state = self.state + np.outer(gain, np.array(place) - self.state[0])
        self.covariance = self.covariance - np.outer(gain, self.covariance[0])


class Tracker:
    """Gives boxes their tracks' numbers, which count up from 0 and do not come again."""

    def __init__(self, speed_sigma_mps: float = SPEED_SIGMA_MPS, drift_m2ps3: float = DRIFT_M2PS3) -> None:
        """No tracks yet; how fast what is followed moves at first, and how its speed changes."""
        self._motion = speed_sigma_mps, drift_m2ps3
        self._tracks: dict[int, _Track] = {}
        self._next = 0

    def update(self, places: Sequence[Point], time_s: float) -> list[int]:
        """For each fused box of one frame, by its centre, map frame, metres, its track.

        ``time_s``: never less than at the last call.
        """
        for track in self._tracks.values():
            track.predict(time_s)
        numbers = self._assigned(places)
        for i, place in enumerate(places):
            if (known := self._tracks.get(numbers[i])) is not None:
                known.correct(place)
            else:
                numbers[i] = self._next
                self._tracks[self._next] = _Track(place, time_s, *self._motion)
                self._next += 1
        return numbers

    def drop(self, number: int) -> None:
        """End a track; one that is not there is left so."""
        self._tracks.pop(number, None)

    def _assigned(self, places: Sequence[Point]) -> list[int]:
        """For each box its track, -1 for none."""
        numbers = [-1] * len(places)
        tracks = list(self._tracks.items())
        if not places or not tracks:
            return numbers
        distances = np.array([[track.distance2(place) for _, track in tracks] for place in places])
        for i, k in zip(*most_pairs(distances, GATE), strict=True):
            numbers[i] = tracks[k][0]
        return numbers


def most_pairs(distances: Floats, gate: float) -> tuple[Indices, Indices]:
    """Rows and columns of the most pairs within the gate, among those of the least sum of distances."""
    # a pair within the gate is worth more than all distances together
    worth = np.where(distances <= gate, gate * (1 + min(distances.shape)) - distances, 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    near = worth[rows, columns] > 0.0
    return rows[near], columns[near]


class Event(NamedTuple):
    """One thing that was there for a while. Map frame, metres, seconds of the frames' clock."""

    first_s: float
    last_s: float
    frames: int  # with a box of it
    share: float  # of the frames from the first to the last: how sure it is
    x_first_m: float
    y_first_m: float
    x_last_m: float
    y_last_m: float
    speed_mps: float  # from second to second, on the average
    is_true: bool  # whether a box of it is an intruder's, where that is known


@dataclass
class _Seen:
    frame: int  # number of the first one
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
        centers = [box.center for box in boxes]
        groups = _groups(centers)
        means = [mean_point(np.array([centers[k] for k in group])).tolist() for group in groups]
        places = [(x, y) for x, y in means]
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
