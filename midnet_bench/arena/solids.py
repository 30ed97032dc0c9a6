"""``Solid``: an upright box or cylinder that never moves: a piece of wall or a stationary intruder."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Box, Pose2D, lengths

CYLINDER_SIDES = 64
"""Corners of a cylinder's outline; the outline stays within 0.7 mm of a circle of 1 m diameter."""


@dataclass(frozen=True)
class Solid:
    """A box turned by ``pose.yaw`` about its centre, or a cylinder; it stands on the floor."""

    kind: Literal["box", "cylinder"]
    pose: Pose2D
    """centre, map frame"""
    length_m: float
    """along its own x axis; a cylinder's diameter"""
    width_m: float
    """along its own y axis; a cylinder's diameter"""
    height_m: float

    @classmethod
    def segment(
        cls, start: tuple[float, float], end: tuple[float, float], thickness_m: float, height_m: float
    ) -> "Solid":
        """The wall about the line from ``start`` to ``end``, longer by half its thickness at both ends.

        The overlength closes the corner where two walls share an end.
        """
        dx, dy = end[0] - start[0], end[1] - start[1]
        if dy == 0.0 != dx:  # along an axis no compiler has to be loaded
            yaw = math.copysign(0.0 if dx > 0.0 else math.pi, dy)
        elif dx == 0.0 != dy:
            yaw = math.copysign(math.pi / 2.0, dy)
        else:
            from midnet_bench.elementary import from_python

            yaw = from_python().atan2(dy, dx)
        pose = Pose2D((start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0, yaw)
        return cls("box", pose, math.hypot(dx, dy) + thickness_m, thickness_m, height_m)

    @classmethod
    def upright(cls, box: Box, height_m: float) -> "Solid":
        """The box whose sides go along the map's axes."""
        x, y = box.center
        return cls("box", Pose2D(x, y, 0.0), box.x_max - box.x_min, box.y_max - box.y_min, height_m)

    def distance_to(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(n,) from each of (n, 2) points to the surface in the plane, metres; negative inside."""
        dx, dy = points[:, 0] - self.pose.x, points[:, 1] - self.pose.y
        if self.kind == "cylinder":
            return np.sqrt(dx * dx + dy * dy) - self.length_m / 2.0
        c, s = self.pose.direction
        beyond_x = np.abs(c * dx + s * dy) - self.length_m / 2.0
        beyond_y = np.abs(c * dy - s * dx) - self.width_m / 2.0
        outside = lengths(np.maximum(np.stack((beyond_x, beyond_y), axis=-1), 0.0))
        return outside + np.minimum(np.maximum(beyond_x, beyond_y), 0.0)

    def outline(self) -> npt.NDArray[np.float64]:
        """(k, 2) corners seen from above, counter-clockwise, map frame, metres; read-only.

        A cylinder's corners lie outside its circle by as much as the middles of its sides lie inside.
        """
        return self._outline

    @cached_property
    def _outline(self) -> npt.NDArray[np.float64]:
        from midnet_bench.elementary import from_python  # which needs a compiler

        if self.kind == "cylinder":
            half_side = math.pi / CYLINDER_SIDES
            radius = self.length_m / (1.0 + from_python().cos(half_side))
            angles = 2.0 * half_side * np.arange(CYLINDER_SIDES, dtype=np.float64)
            corners = radius * from_python().directions(angles)
        else:
            half = np.array([self.length_m, self.width_m]) / 2.0
            corners = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        outline = self.pose.transform(corners)
        outline.flags.writeable = False
        return outline

    def bounding_box(self) -> Box:
        """The axis-aligned extent in the plane, which is also that in the scan plane (item 45)."""
        if self.kind == "cylinder":
            return Box.square(self.pose.x, self.pose.y, self.length_m)
        corners = self.outline()
        return Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())


def gap_m(solid: Solid, others: tuple[Solid, ...]) -> float:
    """The least distance from ``solid`` to any of ``others``, metres; inf when there is none.

    Taken at its centre and at points no more than 5 cm apart along its outline, so an overlap never
    goes unseen and the distance is right to a millimetre from 0.3 m up.
    """
    points = np.vstack((dense_outline(solid.outline(), 0.05), (solid.pose.x, solid.pose.y)))
    return min((float(other.distance_to(points).min()) for other in others), default=math.inf)


def dense_outline(corners: npt.NDArray[np.float64], step_m: float = 0.02) -> npt.NDArray[np.float64]:
    """(n, 2) points along a closed outline of (k, 2) corners, ``step_m`` apart at most, corners included."""
    sides = np.roll(corners, -1, axis=0) - corners
    pieces = math.ceil(float(lengths(sides).max()) / step_m)
    steps = np.arange(pieces) / pieces
    return np.asarray((corners[:, None, :] + steps[None, :, None] * sides[:, None, :]).reshape(-1, 2))
