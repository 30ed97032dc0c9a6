"""A robot's poses over time, and the pose between two of them."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D

Floats = npt.NDArray[np.float64]


class Neighbours(NamedTuple):
    """How far from an instant the poses lie that its own is made from, seconds."""

    older_s: float
    """since the pose before it; infinite where there is none"""
    newer_s: float
    """until the pose after it; infinite where there is none"""

    @property
    def age_s(self) -> float:
        """To the further of the two; to the only one before the first pose or after the last."""
        return max((age for age in self if age < math.inf), default=math.inf)


class PoseTrack(NamedTuple):
    """Poses in order of time. Between two, x and y go straight and the yaw turns the short way."""

    times_s: Floats
    """(n,) seconds, never falling, at least one; of two equal ones the later pose counts from there on"""
    poses: Floats
    """(n, 3) x and y in metres, yaw in radians, of the robot in the map frame"""

    def at(self, time_s: float) -> Pose2D:
        """The pose at an instant, yaw in [-pi, pi); that of the first or the last before and after them."""
        return Pose2D(*self.at_times(np.array([time_s]))[0].tolist())

    def at_times(self, times_s: Floats) -> Floats:
        """(m, 3) the poses at (m,) instants, as :meth:`at` gives them."""
        after = np.searchsorted(self.times_s, times_s, side="right")
        older, newer = np.maximum(after - 1, 0), np.minimum(after, len(self.times_s) - 1)
        gap_s = self.times_s[newer] - self.times_s[older]
        share = np.divide(times_s - self.times_s[older], gap_s, out=np.zeros(len(times_s)), where=gap_s > 0.0)
        first = self.poses[older]
        way = self.poses[newer] - first
        way[:, 2] = _wrapped(way[:, 2])
        found = first + share[:, None] * way
        found[:, 2] = _wrapped(found[:, 2])
        return np.asarray(found)

    def neighbours(self, time_s: float) -> Neighbours:
        """How far away in time the poses lie that :meth:`at` goes by; both are 0 at a pose's own time."""
        after = int(np.searchsorted(self.times_s, time_s, side="right"))
        older_s = time_s - float(self.times_s[after - 1]) if after > 0 else math.inf
        if older_s == 0.0:
            return Neighbours(0.0, 0.0)
        newer_s = float(self.times_s[after]) - time_s if after < len(self.times_s) else math.inf
        return Neighbours(older_s, newer_s)

    def between(self, start_s: float, end_s: float) -> "PoseTrack":
        """The poses that :meth:`at` goes by from ``start_s`` to ``end_s``, both included."""
        first = max(int(np.searchsorted(self.times_s, start_s, side="right")) - 1, 0)
        last = min(int(np.searchsorted(self.times_s, end_s, side="left")), len(self.times_s) - 1)
        return PoseTrack(self.times_s[first : last + 1], self.poses[first : last + 1])


def _wrapped(angles_rad: Floats) -> Floats:
    """The same directions within [-pi, pi)."""
    return np.asarray((angles_rad + math.pi) % (2.0 * math.pi) - math.pi)
