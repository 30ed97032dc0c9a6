"""Poses, axis-aligned boxes and solids in the plane, and what sensors say in the shape of ROS messages.

Metres and radians, x to the right, y up.
"""

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt

Booleans = npt.NDArray[np.bool_]
Point = tuple[float, float]  # a place, metres
Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


CELL_SLACK = 1e-6  # Of a cell: keeps a point that rounding moves off its cell's lower edge on that cell.


@cache
def _elementary() -> Any:
    """``elementary.from_python``, once it is needed: numba takes long to import."""
    from midnet_bench.elementary import from_python

    return from_python


def lengths(vectors: Floats) -> Floats:
    """(...) lengths of (..., 2) vectors, each below 1e150: as ``elementary.hypot`` of each, to the bit."""
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.sqrt(x * x + y * y))


def mean_point(points: Floats) -> Floats:
    """(k,) the mean of (n, k) points, n at least 1, of exact sums: the same in whatever order they are."""
    return np.array([math.fsum(column) / len(points) for column in points.T.tolist()])


def cell_along(distance_m: float, resolution: float) -> int:
    """The cell that is so far from a lattice's start along one axis, by floor; on an edge, the upper one.

    Of a cell's edge, too, where bare division misses it: 0.15 / 0.05 is 2.9999999999999996.
    """
    return math.floor(distance_m / resolution + CELL_SLACK)


def wrap_angle(angle_rad: float) -> float:
    """The same direction within [-pi, pi), radians."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


class Pose2D(NamedTuple):
    """Where a frame's origin lies in a parent frame and which way its x axis points."""

    x: float  # metres
    y: float  # metres
    yaw: float  # radians, counter-clockwise from the parent's x axis

    @property
    def direction(self) -> tuple[float, float]:
        """Cosine and sine of the yaw: the way of this frame's x axis in the parent frame."""
        return _elementary().cos_sin(self.yaw)

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

    def transform(self, points: Floats) -> Floats:
        """(N, 2) float64 points that are given in this pose's frame, in the parent frame, metres."""
        x, y = points[:, 0], points[:, 1]
        c, s = (1.0, 0.0) if self.yaw == 0.0 else self.direction
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
        both = self.intersection_area(other)
        return both / (self.area + other.area - both) if both > 0.0 else 0.0

    def distance_to_point(self, x: float, y: float) -> float:
        """From (x, y) to the nearest point of the box, metres; 0 inside."""
        return math.hypot(max(self.x_min - x, 0.0, x - self.x_max), max(self.y_min - y, 0.0, y - self.y_max))

    def shrunk(self, margin_m: float) -> "Box":
        """This box with ``margin_m`` taken off every side, never past its own centre."""
        dx = min(margin_m, (self.x_max - self.x_min) / 2.0)
        dy = min(margin_m, (self.y_max - self.y_min) / 2.0)
        return Box(self.x_min + dx, self.y_min + dy, self.x_max - dx, self.y_max - dy)


@dataclass(frozen=True)
class LidarGeometry:
    """How a planar LiDAR's beams leave its axis; all of one scan at one instant."""

    beams: int
    angle_min_rad: float
    angle_increment_rad: float
    range_min_m: float
    range_max_m: float
    mount: Pose2D  # the sensor in the robot's base frame

    @property
    def angles_rad(self) -> Floats:
        """(beams,) direction of each beam in the sensor frame, radians."""
        return self.angle_min_rad + self.angle_increment_rad * np.arange(self.beams, dtype=np.float64)

    @cached_property
    def directions(self) -> Floats:
        """(beams, 2) unit vector along each beam in the sensor frame."""
        return _elementary().directions(self.angles_rad)

    @cached_property
    def is_full_turn(self) -> bool:
        """Whether the beams go all round: the first one follows the last one as the others do."""
        gap_rad = 2.0 * math.pi - abs(self.angle_increment_rad) * (self.beams - 1)
        return gap_rad < 1.5 * abs(self.angle_increment_rad)

    def covers(self, sensor: Pose2D, points: Floats) -> Booleans:
        """(n,) which of (n, 2) points lie in the field of view of a sensor at a pose of the same frame.

        A field of view ends half a beam beyond its first and its last beam.
        """
        if self.is_full_turn:
            return np.ones(len(points), dtype=np.bool_)
        half_rad = abs(self.angle_increment_rad) * self.beams / 2.0
        middle_rad = self.angle_min_rad + self.angle_increment_rad * (self.beams - 1) / 2.0
        middle = sensor.compose(Pose2D(0.0, 0.0, middle_rad)).direction
        to_points = np.asarray(points) - sensor[:2]
        along = to_points[:, 0] * middle[0] + to_points[:, 1] * middle[1]
        return np.asarray(along >= lengths(to_points) * _elementary().cos(half_rad))


class Scan(NamedTuple):
    """sensor_msgs/LaserScan, and where the robot took itself to be then."""

    ranges_m: Floats  # (beams,); inf where nothing was met, nan where the reading is void
    lidar: LidarGeometry
    pose: Pose2D  # of the robot, map frame
    stamp_s: float

    def returns(self, range_m: float) -> tuple[Indices, Floats]:
        """(n,) the beams that met something within ``range_m``, and (n, 2) where, map frame, metres."""
        lidar = self.lidar
        near = (self.ranges_m >= lidar.range_min_m) & (self.ranges_m <= min(range_m, lidar.range_max_m))
        beams = np.flatnonzero(near)
        points = lidar.directions[beams] * self.ranges_m[beams, None]
        return beams, self.pose.compose(lidar.mount).transform(points)


class Command(NamedTuple):
    """geometry_msgs/Twist in the plane, body frame."""

    linear_mps: float
    angular_radps: float


STOP = Command(0.0, 0.0)


CYLINDER_SIDES = 64
"""Corners of a cylinder's outline; the outline stays within 0.7 mm of a circle of 1 m diameter."""


@dataclass(frozen=True)
class Solid:
    """A box turned by ``pose.yaw`` about its centre, or a cylinder; it stands on the floor."""

    kind: Literal["box", "cylinder"]
    pose: Pose2D  # centre, map frame
    length_m: float  # along its own x axis; a cylinder's diameter
    width_m: float  # along its own y axis; a cylinder's diameter
    height_m: float

    @classmethod
    def segment(
        cls, start: tuple[float, float], end: tuple[float, float], thickness_m: float, height_m: float
    ) -> "Solid":
        """The wall about the line from ``start`` to ``end``, longer by half its thickness at both ends.

        The overlength closes the corner where two walls share an end.
        """
        dx, dy = end[0] - start[0], end[1] - start[1]
        # along an axis all libraries give the same bits, and no compiler has to be loaded
        yaw = (math if 0.0 in (dx, dy) else _elementary()).atan2(dy, dx)
        pose = Pose2D((start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0, yaw)
        return cls("box", pose, math.hypot(dx, dy) + thickness_m, thickness_m, height_m)

    @classmethod
    def upright(cls, box: Box, height_m: float) -> "Solid":
        """The box whose sides go along the map's axes."""
        x, y = box.center
        return cls("box", Pose2D(x, y, 0.0), box.x_max - box.x_min, box.y_max - box.y_min, height_m)

    def distance_to(self, points: Floats) -> Floats:
        """(n,) from each of (n, 2) points to the surface in the plane, metres; negative inside."""
        dx, dy = points[:, 0] - self.pose.x, points[:, 1] - self.pose.y
        if self.kind == "cylinder":
            return np.sqrt(dx * dx + dy * dy) - self.length_m / 2.0
        c, s = self.pose.direction
        beyond_x = np.abs(c * dx + s * dy) - self.length_m / 2.0
        beyond_y = np.abs(c * dy - s * dx) - self.width_m / 2.0
        outside = lengths(np.maximum(np.stack((beyond_x, beyond_y), axis=-1), 0.0))
        return outside + np.minimum(np.maximum(beyond_x, beyond_y), 0.0)

    @cached_property
    def outline(self) -> Floats:
        """(k, 2) corners seen from above, counter-clockwise, map frame, metres; read-only.

        A cylinder's corners lie outside its circle by as much as the middles of its sides lie inside.
        """
        if self.kind == "cylinder":
            half_side = math.pi / CYLINDER_SIDES
            radius = self.length_m / (1.0 + _elementary().cos(half_side))
            corners = radius * _unit_circle()
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
        return Box(*self.outline.min(axis=0).tolist(), *self.outline.max(axis=0).tolist())


@cache
def _unit_circle() -> Floats:
    """(``CYLINDER_SIDES``, 2) corners on the circle of radius 1 about the origin, counter-clockwise."""
    half_side = math.pi / CYLINDER_SIDES
    return _elementary().directions(2.0 * half_side * np.arange(CYLINDER_SIDES, dtype=np.float64))


def gap_m(solid: Solid, others: tuple[Solid, ...]) -> float:
    """The least distance from ``solid`` to any of ``others``, metres; inf when there is none.

    Taken at its centre and at points no more than 5 cm apart along its outline, so an overlap never
    goes unseen and the distance is right to a millimetre from 0.3 m up.
    """
    points = np.vstack((dense_outline(solid.outline, 0.05), (solid.pose.x, solid.pose.y)))
    return min((float(other.distance_to(points).min()) for other in others), default=math.inf)


def dense_outline(corners: Floats, step_m: float = 0.02) -> Floats:
    """(n, 2) points along a closed outline of (k, 2) corners, ``step_m`` apart at most, corners included."""
    sides = np.roll(corners, -1, axis=0) - corners
    pieces = math.ceil(float(lengths(sides).max()) / step_m)
    steps = np.arange(pieces) / pieces
    return np.asarray((corners[:, None, :] + steps[None, :, None] * sides[:, None, :]).reshape(-1, 2))
