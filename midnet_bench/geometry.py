"""Poses and axis-aligned boxes in the plane: metres and radians, x to the right, y up."""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

Point = tuple[float, float]  # a place, metres


@cache
def _elementary() -> Callable[[], Any]:
    """``elementary.from_python``, once it is needed: numba takes long to import."""
    from midnet_bench.elementary import from_python

    return from_python


def lengths(vectors: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(...) lengths of (..., 2) vectors, each below 1e150: as ``elementary.hypot`` of each, to the bit."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def mean_point(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(k,) the mean of (n, k) points, n at least 1, of exact sums: the same in whatever order they are."""
    return np.array([math.fsum(column) / len(points) for column in points.T.tolist()])


def wrap_angle(angle_rad: float) -> float:
    """The same direction within [-pi, pi), radians."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


class Pose2D(NamedTuple):
    """Where a frame's origin lies in a parent frame and which way its x axis points."""

    x: float
    """metres"""
    y: float
    """metres"""
    yaw: float
    """radians, counter-clockwise from the parent's x axis"""

    @property
    def direction(self) -> tuple[float, float]:
        """Cosine and sine of the yaw: the way of this frame's x axis in the parent frame."""
        cos_sin: tuple[float, float] = _elementary()().cos_sin(self.yaw)
        return cos_sin

    def compose(self, local: "Pose2D") -> "Pose2D":
        """``local``, given in this pose's frame, in the parent frame; its yaw is not wrapped."""
        c, s = self.direction
        return Pose2D(
            self.x + c * local.x - s * local.y, self.y + s * local.x + c * local.y, self.yaw + local.yaw
        )

    def inverse(self) -> "Pose2D":
        """The parent's pose in this frame."""
        c, s = self.direction
        return Pose2D(-c * self.x - s * self.y, s * self.x - c * self.y, -self.yaw)

    def require_finite(self) -> None:
        """Raise ValueError if NaN or infinity is among the three numbers."""
        if not math.isfinite(self.x + self.y + self.yaw):
            raise ValueError(f"a pose must be finite, got {self}")

    def relative_to(self, other: "Pose2D") -> "Pose2D":
        """This pose in the frame of ``other``, both given in one frame; yaw within [-pi, pi)."""
        local = other.inverse().compose(self)
        return local._replace(yaw=wrap_angle(local.yaw))

    def transform(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(N, 2) float64 points that are given in this pose's frame, in the parent frame, metres."""
        c, s = self.direction
        x, y = points[:, 0], points[:, 1]
        return np.stack((self.x + (c * x - s * y), self.y + (s * x + c * y)), axis=1)

    def distance_to(self, other: "Pose2D") -> float:
        """The distance between the two origins, metres."""
        return math.hypot(other.x - self.x, other.y - self.y)


class Box(NamedTuple):
    """An axis-aligned rectangle, metres, ``x_min <= x < x_max`` and ``y_min <= y < y_max``."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @classmethod
    def square(cls, x: float, y: float, side_m: float) -> Self:
        """The square of side ``side_m`` centred on (x, y)."""
        half = side_m / 2.0
        return cls(x - half, y - half, x + half, y + half)

    @property
    def area(self) -> float:
        """Square metres; 0 for an empty box."""
        return max(0.0, self.x_max - self.x_min) * max(0.0, self.y_max - self.y_min)

    @property
    def center(self) -> tuple[float, float]:
        """(x, y) of the middle, metres."""
        return (self.x_min + self.x_max) / 2.0, (self.y_min + self.y_max) / 2.0

    def intersection_area(self, other: "Box") -> float:
        """The area both cover, square metres; 0 when they share an edge or nothing."""
        width = min(self.x_max, other.x_max) - max(self.x_min, other.x_min)
        height = min(self.y_max, other.y_max) - max(self.y_min, other.y_min)
        return width * height if width > 0.0 and height > 0.0 else 0.0

    def iou(self, other: "Box") -> float:
        """Eq. 7: the area that both boxes cover over the area that either covers, 0 to 1.

        It is 0 for boxes that share no more than an edge, and whenever one of them has no area.
        """
        # written out on plain numbers: a frame asks for hundreds, and most pairs are apart
        ax1, ay1, ax2, ay2 = self
        bx1, by1, bx2, by2 = other
        if ax2 <= bx1 or bx2 <= ax1 or ay2 <= by1 or by2 <= ay1:
            return 0.0
        width = (ax2 if ax2 < bx2 else bx2) - (ax1 if ax1 > bx1 else bx1)
        height = (ay2 if ay2 < by2 else by2) - (ay1 if ay1 > by1 else by1)
        both = width * height
        either = (ax2 - ax1) * (ay2 - ay1) + (bx2 - bx1) * (by2 - by1) - both
        return both / either if both > 0.0 else 0.0

    def distance_to_point(self, x: float, y: float) -> float:
        """From (x, y) to the nearest point of the box, metres; 0 inside."""
        return math.hypot(max(self.x_min - x, 0.0, x - self.x_max), max(self.y_min - y, 0.0, y - self.y_max))

    def shrunk(self, margin_m: float) -> "Box":
        """This box with ``margin_m`` taken off every side, never past its own centre."""
        dx = min(margin_m, (self.x_max - self.x_min) / 2.0)
        dy = min(margin_m, (self.y_max - self.y_min) / 2.0)
        return Box(self.x_min + dx, self.y_min + dy, self.x_max - dx, self.y_max - dy)
