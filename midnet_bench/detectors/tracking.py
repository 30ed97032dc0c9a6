"""``Tracker``: which of MIDNet's boxes are one intruder's, from frame to frame, by the boxes alone.

Global nearest neighbour: a Kalman filter of constant velocity for each track (Bar-Shalom, Li and Kirubarajan,
"Estimation with Applications to Tracking and Navigation", 2001, section 6.3), a gate on the squared
Mahalanobis distance, and within it the assignment of most pairs and then least distance (Hungarian method).
A box that no track takes begins a track. Nothing is confirmed: a false box makes a ghost that guards chase.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from midnet_bench.geometry import Point

BOX_SIGMA_M = 0.1
"""Standard deviation of a box's centre along an axis; five guards' boxes are 0.098 m off in the mean (seeds
2001 to 2003, 500 frames each)."""
BOX_VARIANCE_M2 = BOX_SIGMA_M * BOX_SIGMA_M
SPEED_SIGMA_MPS = 0.15
"""of a new track's speed along an axis: a Burger drives at 0.22 m/s at most"""
DRIFT_M2PS3 = 0.02
"""Spectral density of the acceleration: within 3 s a velocity may change by a Burger's top speed."""
GATE = 9.21
"""of the squared Mahalanobis distance; 99 % of a track's own boxes lie within (chi-square, two degrees)"""


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
        """For each box its track.

        Args:
            places: centres of the fused boxes of one frame, map frame, metres.
            time_s: of the frame; never less than at the last call.
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
        distances: npt.NDArray[np.float64] = np.array(
            [[track.distance2(place) for _, track in tracks] for place in places]
        )
        # a pair within the gate is worth more than all distances together, so most pairs come first
        worth = np.where(distances <= GATE, GATE * (1 + min(distances.shape)) - distances, 0.0)
        for i, k in zip(*linear_sum_assignment(worth, maximize=True), strict=True):
            if worth[i, k] > 0.0:
                numbers[i] = tracks[k][0]
        return numbers
