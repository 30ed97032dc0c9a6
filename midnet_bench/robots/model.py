"""``RobotModel``: what a robot is, said once for its navigation, simulation and pictures; those by name."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Command, LidarGeometry
from midnet_bench.plugins import Choice, ExtensionPoint
from midnet_bench.robots.lidars import LIDARS

Outline = tuple[tuple[float, float], ...]  # (x, y) of the corners in the robot's base frame, metres
LOWEST_SOLID_M = 0.25
"""An arena may hold walls and stationary intruders as low as this; a LiDAR's beams must meet them."""


class Disc(NamedTuple):
    """What the beams of other robots meet: a disc in the scan plane."""

    radius_m: float
    offset_x_m: float  # its centre ahead of the axle


@dataclass(frozen=True, kw_only=True)
class RobotModel:
    """A robot with two driven wheels and a planar LiDAR. Its base frame lies under the middle of the axle."""

    name: str
    body: Outline
    """all that can touch a wall or a robot, seen from above, counter-clockwise; its convex hull counts"""
    footprint: Outline  # what move_base plans with: a convex polygon in order, somewhat larger than the body
    size_m: tuple[float, float] | None = None
    """length and width by its maker's data sheet, metres; None: those of ``body``"""
    radius_m: float
    """robot_radius of its maker's costmaps: a disc about the base frame that leaves out the corners"""
    wheel_radius_m: float
    wheel_separation_m: float
    max_linear_mps: float
    max_angular_radps: float
    rim_acceleration_mps2: float = 1.0
    """how fast the speed of a wheel's rim changes; wheelAcceleration of a TurtleBot3's Gazebo plugin"""
    wheel_torque_nm: float = 10.0  # wheelTorque of the same
    mass_kg: float
    gyration_radius_m: float  # square root of its inertia about the vertical axis over its mass
    lidar: LidarGeometry
    lidar_hz: float = 5.0  # scans a second of it; the LDS-01's unless given
    lidar_height_m: float  # of the scan plane above the floor
    seen: Disc  # all of it that is in the scan plane
    urdf: Path | None = None
    """its description, with the root's height below; without one the engine ``bullet`` makes a body of the
    measures above"""
    base_link_height_m: float = 0.0

    def __post_init__(self) -> None:
        """Raises InputError: a line that names the robot and the measure that cannot be."""
        for measure, what in self._faults():
            raise InputError(f"robot '{self.name}': {measure}: {what}")

    def _faults(self) -> Iterator[tuple[str, str]]:
        """What cannot be, each with its measure; later checks rely on earlier ones."""
        for measure in (one.name for one in fields(self) if one.type is float):
            value = getattr(self, measure)
            if measure != "base_link_height_m" and not 0.0 < value < math.inf:
                yield measure, f"{value!r} is no finite number above 0"
        for outline in ("body", "footprint"):
            turns = _turns(getattr(self, outline))
            if len(turns) < 3 or not all(map(math.isfinite, turns)):
                yield outline, "three corners (x, y) or more are needed, in metres"
        if not (all(turn > 0.0 for turn in turns) or all(turn < 0.0 for turn in turns)):
            yield "footprint", "its corners must go once around the base frame's origin"
        if not all(_is_inside(corner, self.footprint) for corner in self.body):
            yield "footprint", "the body reaches out of it"
        if not 0.0 < self.seen.radius_m <= 2.0 * self.footprint_reach_m:
            yield "seen", f"a disc of {self.seen.radius_m!r} m is not of this robot"
        lidar = self.lidar
        if not (lidar.beams >= 1 and 0.0 < abs(lidar.angle_increment_rad) * lidar.beams < 6.2832):
            yield "lidar", "its beams must spread over a full turn or less"
        if not 0.0 <= lidar.range_min_m < lidar.range_max_m < math.inf:
            yield "lidar", "range_min_m must be below range_max_m, neither below 0"
        if self.lidar_height_m >= LOWEST_SOLID_M:
            yield "lidar_height_m", f"what stands in an arena may end at {LOWEST_SOLID_M} m"
        if lidar.mount.y or not _is_inside(lidar.mount[:2], self.footprint):
            yield "lidar", "it must be mounted above the footprint, on the middle line (y = 0)"

    def disc(self, profile: str) -> Disc:
        """What its own kind's beams meet of it, by the option ``robot_profile``."""
        return Disc(self.radius_m, 0.0) if profile == "disc" else self.seen

    def clamped(self, command: Command) -> Command:
        """What a command comes to within the robot's limits."""
        linear, angular = command
        linear = min(max(linear, -self.max_linear_mps), self.max_linear_mps)
        angular = min(max(angular, -self.max_angular_radps), self.max_angular_radps)
        return Command(linear, angular)

    def rim_speeds(self, command: Command) -> tuple[float, float]:
        """How fast the rims of the left and the right wheel turn at a command within its limits, m/s."""
        half = command.angular_radps * self.wheel_separation_m / 2.0
        return command.linear_mps - half, command.linear_mps + half

    @property
    def body_reach_m(self) -> float:
        """From the middle of the axle to the farthest corner of the body, metres."""
        return max(math.hypot(*corner) for corner in self.body)

    @property
    def diameter_m(self) -> float:
        """Of the circle about its length and width, in metres and whole millimetres: di of item 27."""
        xs, ys = zip(*self.body, strict=True)
        length_m, width_m = self.size_m or (max(xs) - min(xs), max(ys) - min(ys))
        return round(math.hypot(length_m, width_m), 3)

    @property
    def footprint_reach_m(self) -> float:
        """The footprint's circumscribed radius: to its farthest corner from the axle's middle, metres."""
        return max(math.hypot(*corner) for corner in self.footprint)


def _turns(outline: Outline) -> list[float]:
    """Twice the area of the triangle of each side with the base frame's origin; positive to the left."""
    return [
        x * following_y - y * following_x
        for (x, y), (following_x, following_y) in zip(outline, outline[1:] + outline[:1], strict=True)
    ]


def _is_inside(point: tuple[float, float], convex: Outline) -> bool:
    """Whether a point is in a convex polygon or on its edge."""
    turns = _turns(tuple((x - point[0], y - point[1]) for x, y in convex))
    return min(turns) >= -1e-12 or max(turns) <= 1e-12


class RobotExtensionPoint(ExtensionPoint):
    """Values name a :class:`RobotModel` itself. What stands in brackets replaces its numbers or its LiDAR.

    ``lidar`` names one of ``LIDARS``, which stands where the robot's own does and brings its rate.
    """

    @property
    def wanted(self) -> str:
        """See :class:`ExtensionPoint`."""
        return "a RobotModel"

    def _class(self, choice: Choice) -> RobotModel:
        found = self._found(choice)
        if not isinstance(found, RobotModel):
            raise self._refusal(choice, f"expected {self.wanted}")
        numbers = [one.name for one in fields(found) if isinstance(getattr(found, one.name), float)]
        changes: dict[str, Any] = {}
        for key, value in choice.options.items():
            if key == "lidar":
                lidar = LIDARS.get(str(value))
                if lidar is None:
                    hint = nearest_name(str(value), LIDARS)
                    raise self._refusal(choice, f"lidar: '{value}' is none that has a name{hint}")
                changes = {"lidar": lidar.at(found.lidar.mount), "lidar_hz": lidar.rate_hz, **changes}
                continue
            if key not in numbers:
                raise self._refusal(choice, f"no option '{key}'{nearest_name(key, [*numbers, 'lidar'])}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise self._refusal(choice, f"{key}: a number is needed (got {value!r})")
            changes[key] = value
        # no number of the description is a LiDAR's; the engine casts the beams
        if found.urdf is not None and (
            changes.keys() - {"lidar", "lidar_hz"} or choice.place not in self.own
        ):
            found = replace(found, urdf=None)  # the description has the old numbers, or does not travel
        return replace(found, **cast(Any, changes)) if changes else found

    def make(self, value: str, *arguments: Any) -> RobotModel:
        """The robot that ``value``, a pinned one, names."""
        return self._class(self._parsed(value))


ROBOTS = RobotExtensionPoint(
    option="robot",
    entry_points="midnet_bench.robots",
    method="rim_speeds",
    own={
        "burger": "midnet_bench.robots.turtlebot3:BURGER",
        "waffle": "midnet_bench.robots.turtlebot3:WAFFLE",
    },
)
"""in brackets: other numbers of the model"""
