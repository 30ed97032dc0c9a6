"""``Arena``: what a YAML file says about a place to guard, checked."""

import math
from collections.abc import Iterator
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Box, Pose2D, Solid, gap_m
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.checked_yaml import Spec, parse, parsed_yaml, read_text
from midnet_bench.io.map_server import load_map
from midnet_bench.robots.model import LOWEST_SOLID_M

FOLDER = Path(__file__).parent / "arenas"
MAPS = Path(__file__).parent / "maps"
"""``ARENA.yaml`` and ``ARENA.pgm``, chosen from ``campaigns/mapping.yaml``; ``ARENA_worst``, its worst map"""

Coordinate = Annotated[float, Field(allow_inf_nan=False)]
Length = Annotated[float, Field(gt=0.0, le=200.0)]
Clearance = Annotated[float, Field(ge=0.0, le=200.0)]
Height = Annotated[float, Field(ge=LOWEST_SOLID_M, le=10.0)]
"""At least 0.25 m: a Burger's beams pass at 0.182 m, and what they do not meet is no obstacle."""
Count = Annotated[int, Field(ge=0, le=100)]
Point = tuple[Coordinate, Coordinate]
Corners = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
MOST_BLOCKS = 5000  # Engines look for walls one by one; a plan with more rectangles is not drawn by hand.
TEAM = 5
"""Intruders keep clear of the starts of all teams up to this size, unless an arena says another: one seed's
intruders suit them all."""
Size = tuple[Length, Length]
Shape = Literal["box", "cylinder"]
Kind = Literal["person", "box", "cylinder"]
BehaviourName = Literal["stand", "wander", "hide", "follow"]
Seconds = Annotated[float, Field(ge=0.0, le=36_000.0)]
PERSON_RADIUS_M = 0.25  # about the middle between the feet: what a person needs to pass


class RobotStarts(Spec):
    """Where security robots start: one at the centre, more of them on a ring, looking outwards (item 63)."""

    center_m: Point = (0.0, 0.0)
    spacing_m: Annotated[float, Field(ge=0.3, le=10.0)] = 0.6  # from each robot on the ring to the next
    team: Annotated[int, Field(ge=1, le=100, exclude_if=lambda team: team == TEAM)] = TEAM
    """the largest team that is to start here: intruders keep clear of the starts of all teams up to it

    At its default it is not written: older arenas stay the same text.
    """


class PlacedSolid(Spec):
    """A stationary intruder at a place that the file fixes."""

    shape: Shape
    x_m: Coordinate
    y_m: Coordinate
    yaw_rad: Coordinate = 0.0
    size_m: Size  # length and width of a box; a cylinder's diameter is the first


class StationaryIntruders(Spec):
    """Things that stand where the prior map has nothing (item 48): drawn per seed, or placed, or both."""

    count: Count = 0  # how many to draw
    size_m: Size = (0.4, 1.0)  # least and greatest side or diameter
    shapes: Annotated[tuple[Shape, ...], Field(min_length=1)] = ("box", "cylinder")
    height_m: Height = 0.5
    clearance_m: Clearance = 0.5
    """to walls and to each other: a Burger passes, and the prior map's inflation does not hide them"""
    clear_of_robots_m: Clearance = 1.0
    placed: tuple[PlacedSolid, ...] = ()

    @field_validator("size_m")
    @classmethod
    def _ordered(cls, size_m: Size) -> Size:
        if size_m[0] > size_m[1]:
            raise ValueError("the least size comes first")
        return size_m


class Behaviour(Spec):
    """What an intruder does. Keys at their default are not written: older arenas stay the same text."""

    behaviour: Annotated[BehaviourName, Field(exclude_if=lambda name: name == "wander")] = "wander"
    """``stand``; ``wander`` to random places; ``hide`` out of sight of all guards; ``follow`` ``path_m``"""
    path_m: Annotated[tuple[Point, ...], Field(exclude_if=lambda points: not points)] = ()
    """goes from each point to the next, and from the last to the first"""
    walk_s: Annotated[Seconds, Field(exclude_if=lambda time_s: time_s == 0.0)] = 0.0
    """how long it is under way until it pauses"""
    pause_s: Annotated[Seconds, Field(exclude_if=lambda time_s: time_s == 0.0)] = 0.0
    """how long it stands then; 0: it never pauses"""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.behaviour == "follow") != bool(self.path_m):
            raise ValueError("behaviour: follow goes with path_m, a list of points, and with nothing else")
        if (self.pause_s > 0.0) != (self.walk_s > 0.0):
            raise ValueError("walk_s and pause_s go together: give both, above 0, or none")
        return self


def _sides(kind: Kind, size_m: Size) -> Size:
    """Length and width of a shape of this size: those of a cylinder are its diameter, the first."""
    return (size_m[0], size_m[0]) if kind == "cylinder" else size_m


class MobileIntruders(Behaviour):
    """Burgers that do not belong here."""

    count: Count = 0
    clearance_m: Annotated[float, Field(ge=0.15, le=10.0)] = 0.3
    """from a start to walls and stationary intruders (a Burger's body reaches 0.124 m from its axle)"""
    spacing_m: Annotated[float, Field(ge=0.3, le=100.0)] = 0.6  # from one start to the next
    clear_of_robots_m: Clearance = 1.0


class OtherIntruders(Behaviour):
    """People and things that move by themselves, of one kind and with one behaviour."""

    kind: Kind
    count: Annotated[int, Field(ge=1, le=100)] = 1
    starts_m: tuple[Point, ...] = ()  # where the first of them start; the others' places are drawn
    size_m: Size | None = None
    """length and width of a box, a cylinder's diameter first; 0.4 m each unless given; of no person"""
    height_m: Height = 0.5
    speed_mps: Annotated[float, Field(gt=0.0, le=2.0)] = 1.2
    """when nothing is in the way; people walk at 1.0 to 1.6 m/s"""
    clear_of_robots_m: Clearance = 1.0  # from a start that is drawn to the guards'

    @model_validator(mode="after")
    def _fitting(self) -> Self:
        if self.kind == "person" and self.size_m is not None:
            raise ValueError("size_m: people have none here; leave it out")
        if len(self.starts_m) > self.count:
            raise ValueError(f"starts_m: more places than intruders (count: {self.count})")
        return self

    @property
    def sides_m(self) -> Size:
        """Length and width of what is no person."""
        return _sides(self.kind, self.size_m or (0.4, 0.4))

    @property
    def radius_m(self) -> float:
        """From its middle to what it must not touch, at least."""
        if self.kind == "person":
            return PERSON_RADIUS_M
        length_m, width_m = self.sides_m
        return length_m / 2.0 if self.kind == "cylinder" else math.hypot(length_m, width_m) / 2.0


_WALL_KEYS = ("wall_thickness_m", "wall_height_m", "walls", "blocks")


class Arena(Spec):
    """A plane centred on the origin, its walls, and the start of each robot."""

    name: str
    plane_m: Size
    enclosure_m: Size
    """The walled region about the origin, wall centre to wall centre. Its diagonal is p of Eq. 12."""
    wall_thickness_m: Annotated[float, Field(ge=0.02, le=5.0)]
    wall_height_m: Height
    walls: tuple[Annotated[tuple[Point, ...], Field(min_length=2)], ...] = ()
    """lines that walls follow, corner by corner"""
    blocks: Annotated[
        tuple[Corners, ...], Field(max_length=MOST_BLOCKS, exclude_if=lambda blocks: not blocks)
    ] = ()
    """rectangles that are wall throughout: x_min, y_min, x_max, y_max of each, as high as the walls

    Left out where there is none, so that arenas without them are written, and their trials named, as ever.
    """
    robots: RobotStarts = RobotStarts()
    stationary_intruders: StationaryIntruders = StationaryIntruders()
    mobile_intruders: MobileIntruders = MobileIntruders()

    other_intruders: Annotated[
        tuple[OtherIntruders, ...], Field(max_length=20, exclude_if=lambda groups: not groups)
    ] = ()
    no_entry_m: Annotated[tuple[Point, ...], Field(exclude_if=lambda points: not points)] = ()
    """places (x, y) in floor that no robot reaches and none has to: that floor is no fault of the arena"""

    @property
    def has_behaviours(self) -> bool:
        """Whether an intruder does anything else than drive from one random place to the next."""
        burgers = self.mobile_intruders
        return bool(self.other_intruders) or burgers.behaviour != "wander" or burgers.pause_s > 0.0

    @property
    def walls_alone(self) -> "Arena":
        """The same without robots and intruders, and equal for all arenas that differ in those alone."""
        others = set(Arena.model_fields) - {"name", "plane_m", "enclosure_m", *_WALL_KEYS}
        return self.model_copy(update={key: Arena.model_fields[key].default for key in others})

    def plane_grid(self, resolution_m: float, value: np.generic) -> OccupancyGrid:
        """A grid over the whole plane, of ``value`` and its dtype throughout."""
        columns, rows = (math.ceil(side / resolution_m - 1e-9) for side in self.plane_m)
        origin = (-columns * resolution_m / 2.0, -rows * resolution_m / 2.0)
        return OccupancyGrid(np.full((rows, columns), value), resolution_m, origin)

    def wall_solids(self) -> tuple[Solid, ...]:
        """Every straight piece of wall as a box, then the blocks."""
        return _boxes(self.walls, self.blocks, self.wall_thickness_m, self.wall_height_m)

    def placed_solids(self) -> tuple[Solid, ...]:
        """The stationary intruders whose place the file fixes."""
        spec = self.stationary_intruders
        places = [Pose2D(one.x_m, one.y_m, one.yaw_rad) for one in spec.placed]
        return tuple(
            Solid(one.shape, place, *_sides(one.shape, one.size_m), spec.height_m)
            for one, place in zip(spec.placed, places, strict=True)
        )


@lru_cache(maxsize=16)
def _boxes(
    walls: tuple[tuple[Point, ...], ...], blocks: tuple[Corners, ...], thickness_m: float, height_m: float
) -> tuple[Solid, ...]:
    """Made once in a process: the same in every trial in one arena, and each remembers its outline."""
    return (
        *(Solid.segment(a, b, thickness_m, height_m) for line in walls for a, b in pairwise(line)),
        *(Solid.upright(Box(*block), height_m) for block in blocks),
    )


def arena_names() -> list[str]:
    """The names of the arenas that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def arena_path(name_or_path: str | Path) -> Path:
    """The YAML file of an arena: the package's of that name, or the one at that path.

    Raises:
        InputError: no arena has that name.
    """
    text = str(name_or_path)
    if isinstance(name_or_path, Path) or "/" in text or text.endswith((".yaml", ".yml")):
        return Path(name_or_path)
    if text not in arena_names():
        hint = nearest_name(text, arena_names())
        raise InputError(f"no arena is called {text!r}{hint} (or give the path of a .yaml file)")
    return FOLDER / f"{text}.yaml"


def load_arena(name_or_path: str | Path) -> Arena:
    """The arena of that name, or the one that a YAML file describes.

    Raises:
        InputError: no such arena or file, or the file is wrong; one line that names file and key.
    """
    path = arena_path(name_or_path)
    return _written_arena(read_text(path), str(path), str(name_or_path))


@lru_cache(maxsize=16)
def _written_arena(yaml: str, path: str, source: str) -> Arena:
    """The arena that a file's text describes; read once: every trial needs it twice."""
    return checked_arena(parsed_yaml(yaml, path), source)


def explored_map(arena: str, worst: bool = False) -> OccupancyGrid | None:
    """An explored map of a packaged arena, int8 (100 occupied, 0 free, -1 unknown), or None without one.

    The best of the finished maps of the campaign, or the ``worst`` of them: first and last by the rule of
    ``mapping_choice`` in the campaign's report.
    """
    path = MAPS / f"{arena}{'_worst' if worst else ''}.yaml"
    return _load(path) if path.is_file() else None


@cache
def _load(path: Path) -> OccupancyGrid:
    grid = load_map(path)
    grid.data.flags.writeable = False
    return grid


def checked_arena(values: Any, source: str) -> Arena:
    """The arena that ``values`` describe. Raises InputError, ``source: key: what is wrong``."""
    arena = parse(Arena, values, source)
    for fault in _faults(arena):
        raise InputError(f"{source}: {fault}")
    return arena


def _faults(arena: Arena) -> Iterator[str]:
    """What lies where it cannot, each with its key."""
    if not arena.walls and not arena.blocks:
        yield "walls: there is none; give lines that walls follow, or blocks"
    for axis in (0, 1):
        if arena.enclosure_m[axis] > arena.plane_m[axis]:
            yield f"enclosure_m.{axis}: larger than the plane ({arena.plane_m[axis]:g} m)"
    end_x, end_y = arena.plane_m[0] / 2.0, arena.plane_m[1] / 2.0
    ends = f"the plane, which ends at ({end_x:g}, {end_y:g})"
    for number, line in enumerate(arena.walls):
        for corner, (x, y) in enumerate(line):
            if abs(x) > end_x or abs(y) > end_y:
                yield f"walls.{number}.{corner}: ({x:g}, {y:g}) is off {ends}"
            if corner and line[corner - 1] == (x, y):
                yield f"walls.{number}.{corner}: the same point as the one before"
    for number, (x_min, y_min, x_max, y_max) in enumerate(arena.blocks):
        if x_min >= x_max or y_min >= y_max:
            yield f"blocks.{number}: give x_min, y_min, x_max, y_max"
        # a hair: corners of a plan are sums of cells
        if max(-x_min, x_max) > end_x + 1e-6 or max(-y_min, y_max) > end_y + 1e-6:
            yield f"blocks.{number}: it leaves {ends}"
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    for key, (x, y) in _inner_points(arena).items():
        if abs(x) >= half_x or abs(y) >= half_y:
            yield f"{key}: ({x:g}, {y:g}) is not inside the enclosure"
    walls = arena.wall_solids()
    for number, solid in enumerate(arena.placed_solids()):
        if abs(solid.pose.x) > end_x or abs(solid.pose.y) > end_y or gap_m(solid, walls) <= 0.0:
            yield f"stationary_intruders.placed.{number}: in a wall or off the plane; move it"


def _inner_points(arena: Arena) -> dict[str, Point]:
    """Key and value of every point at which robots and intruders start or to which they go."""
    lists = {"mobile_intruders.path_m": arena.mobile_intruders.path_m}
    for number, group in enumerate(arena.other_intruders):
        lists[f"other_intruders.{number}.path_m"] = group.path_m
        lists[f"other_intruders.{number}.starts_m"] = group.starts_m
    points = {f"{key}.{k}": point for key, listed in lists.items() for k, point in enumerate(listed)}
    return {"robots.center_m": arena.robots.center_m, **points}
