"""``Crowd``: people and things that move by themselves.

No wheels drive them. They go where the trial sends them, along paths that a planner finds around what stands,
and stop before they would run over a robot or a person. Beams meet them, and robots run into them.

At the height of the beams a person is two discs, the legs. Leg detectors for 2D scanners look for widths of
0.1 to 0.25 m and for pairs less than 0.4 m apart (Bellotto and Hu, "Multisensor-based human detection and
tracking for mobile service robots", IEEE Trans. SMC-B 39(1), 2009). ``walking`` says how they go.
"""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.arena import OtherIntruders
from midnet_bench.arena.free_space import FreeSpace, free_space
from midnet_bench.arena.layout import OTHERS_MARGIN_M, Layout
from midnet_bench.geometry import Box, Point, Pose2D, Solid, lengths
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.navigation.global_planner import potential_to
from midnet_bench.simulation import walking
from midnet_bench.simulation.engine import Beams

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

LEG_DIAMETER_M = 0.12


class DynamicObstacle:
    """One person or thing. ``go_to`` says where; it stops, turns and walks by itself."""

    def __init__(
        self,
        name: str,
        group: OtherIntruders,
        space: tuple[FreeSpace, OccupancyGrid],
        crowd: "Crowd",
        number: int,
    ) -> None:
        """Member ``number`` of ``crowd``; ``space``: where its middle may be, also as the planner's costs."""
        self.name = name
        self.group = group
        self.free, self._costs = space
        self._crowd = crowd
        self._number = number
        self._state = crowd.states[number]

    @property
    def pose(self) -> Pose2D:
        """Its middle on the floor, map frame."""
        return Pose2D(*self._state[walking.POSE].tolist())

    @property
    def place(self) -> Point:
        """(x, y) of its middle, map frame, metres."""
        x, y, _ = self.pose
        return x, y

    @property
    def speed_mps(self) -> float:
        """How fast it walks."""
        return float(self._state[walking.SPEED])

    @property
    def goal(self) -> Point | None:
        """(x, y) where it goes, map frame, metres; None when it stays."""
        x, y = self._state[walking.GOAL].tolist()
        return None if math.isnan(x) else (x, y)

    def go_to(self, goal: Point | None) -> None:
        """Stop, and then go there; None: stay. Without a way there, it stays and has no goal."""
        self._state[walking.GOAL] = goal or math.nan
        self._state[walking.BLOCKED_S] = 0.0
        if self.speed_mps == 0.0:
            self.plan()

    def plan(self) -> None:
        """Find a path to its goal from where it stands; without one it has no goal any more."""
        goal, start = self.goal, self.place
        potential = None if goal is None else potential_to(goal, self._costs, start)
        path = None if potential is None else potential.path_from(*start)
        if not self._crowd.follow(self._number, path):
            self._state[walking.GOAL] = math.nan

    def solids(self) -> tuple[Solid, ...]:
        """What beams meet and robots run into: both legs, or the thing itself."""
        height_m = self.group.height_m
        if self.group.kind == "person":
            xa, ya, xb, yb = self._state[walking.FEET].tolist()
            feet = Pose2D(xa, ya, 0.0), Pose2D(xb, yb, 0.0)
            return tuple(Solid("cylinder", foot, LEG_DIAMETER_M, LEG_DIAMETER_M, height_m) for foot in feet)
        return (Solid(self.group.kind, self.pose, *self.group.sides_m, height_m),)

    def extent(self) -> Box:
        """The axis-aligned extent of all of ``solids``, map frame, metres."""
        boxes = np.array([solid.bounding_box() for solid in self.solids()])
        return Box(*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist())


class Crowd:
    """All people and things of a layout."""

    def __init__(self, layout: Layout, step_s: float) -> None:
        """All at their starts; ``step_s``: a tick."""
        self._step_s = step_s
        spaces = {
            radius_m: _space(layout, radius_m) for radius_m in {o.group.radius_m for o in layout.others}
        }
        count = len(layout.others)
        self.states = np.zeros((count, walking.COLUMNS))
        """(n, 15) by the columns of ``walking``"""
        self._paths = np.zeros((count, 0, 3))
        self._counts = np.zeros(count, dtype=np.int64)
        self._needs_path = np.zeros(count, dtype=np.bool_)
        counts: dict[str, int] = {}
        self.members: list[DynamicObstacle] = []
        for number, other in enumerate(layout.others):
            kind = other.group.kind
            counts[kind] = counts.get(kind, 0) + 1
            name, space = f"{kind} {counts[kind]}", spaces[other.group.radius_m]
            state = self.states[number]
            state[walking.POSE], state[walking.GOAL] = other.pose, math.nan
            state[walking.RADIUS], state[walking.FASTEST] = other.group.radius_m, other.group.speed_mps
            walking.put_feet(state, self._paths[number])
            self.members.append(DynamicObstacle(name, other.group, space, self, number))
        self._solids: tuple[Solid, ...] | None = None

    def step(self, robots: Floats) -> None:
        """Let one tick pass; ``robots``: (n, 3) x, y and radius of the robots that are there."""
        walking.walk(self.states, self._paths, self._counts, robots, self._step_s, self._needs_path)
        for number in np.flatnonzero(self._needs_path).tolist():
            self.members[number].plan()
        self._solids = None

    def follow(self, number: int, path: Floats | None) -> bool:
        """Let a member stop and take a path of (k, 2) points; whether it leads anywhere."""
        walking.stop(self.states[number], self._counts, number)
        if path is None:
            return False
        sides = lengths(path[1:] - path[:-1])
        path = path[np.concatenate(([True], sides > 0.0))]
        arcs = np.concatenate(([0.0], np.cumsum(sides[sides > 0.0])))
        if arcs[-1] < walking.ARRIVED_M:
            return False
        missing = len(path) - self._paths.shape[1]
        if missing > 0:
            self._paths = np.pad(self._paths, ((0, 0), (0, missing), (0, 0)))
        self._paths[number, : len(path)] = np.column_stack((path, arcs))
        self._counts[number] = len(path)
        return True

    def solids(self) -> tuple[Solid, ...]:
        """Legs and things as they are at this tick, always in the same order."""
        if self._solids is None:
            self._solids = tuple(solid for member in self.members for solid in member.solids())
        return self._solids

    def shorten(self, ranges: Floats, beams: Beams, far_m: float) -> None:
        """Shorten (m, beams) ``ranges`` in place where a leg or a thing is nearer than they and ``far_m``."""
        solids = self.solids()
        sizes = np.array([(*one.pose, one.length_m, one.width_m) for one in solids]).reshape(-1, 5)
        reaches_m = far_m + lengths(sizes[:, 3:]) / 2.0
        near = (lengths(beams.axes[:, None] - sizes[:, :2]) < reaches_m).any(axis=0)
        for number in np.flatnonzero(near).tolist():
            met = ranges_to(solids[number], beams)
            np.minimum(ranges, np.where(met < far_m, met, np.inf), out=ranges)


def _space(layout: Layout, radius_m: float) -> tuple[FreeSpace, OccupancyGrid]:
    """Where the middle of what has that radius may be, and that as costs for the planner."""
    free = free_space(layout.arena, radius_m + OTHERS_MARGIN_M, layout.stationary)
    costs = np.where(free.grid.data, 0, LETHAL).astype(np.uint8)
    return free, OccupancyGrid(costs, free.grid.resolution, free.grid.origin)


def ranges_to(solid: Solid, beams: Beams) -> Floats:
    """(m, beams) metres from the axis to one solid, whatever stands before it; inf where a beam passes."""
    return _met_disc(beams, solid) if solid.kind == "cylinder" else _met_box(beams, solid)


def _met_disc(beams: Beams, solid: Solid) -> Floats:
    """(m, beams) metres to an upright cylinder; inf where a beam passes."""
    dx, dy = solid.pose.x - beams.axes[:, :1], solid.pose.y - beams.axes[:, 1:]
    along = dx * beams.directions[..., 0] + dy * beams.directions[..., 1]
    radius_m = solid.length_m / 2.0
    under_root = along * along + (radius_m * radius_m - dx * dx - dy * dy)
    is_met = (along > 0.0) & (under_root > 0.0)
    return np.where(is_met, np.maximum(along - np.sqrt(np.where(is_met, under_root, 0.0)), 0.0), np.inf)


def _met_box(beams: Beams, solid: Solid) -> Floats:
    """(m, beams) metres to a box, by its two pairs of parallel sides; inf where a beam passes."""
    c, s = solid.pose.direction
    dx, dy = beams.axes[:, :1] - solid.pose.x, beams.axes[:, 1:] - solid.pose.y
    wx, wy = beams.directions[..., 0], beams.directions[..., 1]
    enter, leave = np.zeros(wx.shape), np.full(wx.shape, np.inf)
    for start, way, side_m in (
        (c * dx + s * dy, c * wx + s * wy, solid.length_m),
        (c * dy - s * dx, c * wy - s * wx, solid.width_m),
    ):
        # a beam along the sides is between them all the way or never
        way = np.where(np.abs(way) < 1e-12, 1e-12, way)
        one, other = (-side_m / 2.0 - start) / way, (side_m / 2.0 - start) / way
        enter = np.maximum(enter, np.minimum(one, other))
        leave = np.minimum(leave, np.maximum(one, other))
    return np.where(enter < leave, enter, np.inf)
