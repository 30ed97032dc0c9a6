"""``Crowd``: people and things that move by themselves, and ``CrowdedWorld``, any engine with them in it.

No wheels drive them. They go where the trial sends them, along paths that a planner finds around what stands,
and stop before they would run over anybody. Beams meet them, and robots run into them.

At the height of the beams a person is two discs, the legs. Leg detectors for 2D scanners look for widths of
0.1 to 0.25 m and for pairs less than 0.4 m apart (Bellotto and Hu, "Multisensor-based human detection and
tracking for mobile service robots", IEEE Trans. SMC-B 39(1), 2009). Step length over cadence, the walk ratio,
stays at 0.0065 m per step/min from 1 m/s up (Murakami and Otaka, J. Phys. Ther. Sci. 29(5), 2017; Sekiya and
Nagasaki, Gait & Posture 7(3), 1998): both go with the square root of the speed, 0.68 m and 1.75 steps a
second at 1.2 m/s, 0.88 m and 2.26 at 2 m/s.
"""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.free_space import FreeSpace, free_space
from midnet_bench.arena.layout import OTHERS_MARGIN_M, Layout, Other
from midnet_bench.arena.solids import Solid
from midnet_bench.elementary import atan2, cos, directions
from midnet_bench.geometry import Box, Pose2D, lengths, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import Command
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.navigation.global_planner import potential_to
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.simulator import Beams, Simulator

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Point = tuple[float, float]

LEG_DIAMETER_M = 0.12
FEET_APART_M = 0.25
"""from one leg's middle to the other's, sideways"""
WALK_RATIO_M_MIN = 0.0065
"""step length in metres over steps per minute"""
ACCELERATION_MPS2 = 2.0
TURN_RADPS = math.pi
"""on the spot, before the first step"""
KEEP_OFF_M = 0.35
"""from where somebody stops to where there would be no room; a leg reaches that far ahead"""
LOOK_STEP_M = 0.1
ARRIVED_M = 0.01
IMPATIENT_S = 1.0
"""A way that somebody has blocked for so long is given up."""
_TANGENT_M = 0.15


def step_length_m(speed_mps: float) -> float:
    """How long a step is at a speed, by the walk ratio."""
    return math.sqrt(60.0 * WALK_RATIO_M_MIN * speed_mps)


class Member:
    """One person or thing. ``go_to`` says where; it stops, turns and walks by itself."""

    def __init__(self, name: str, start: Other, free: FreeSpace) -> None:
        """At rest at its start; ``free``: where its middle may be."""
        self.name = name
        self.group = start.group
        self.pose = start.pose
        self.speed_mps = 0.0
        self.goal: Point | None = None
        self.free = free
        self._costs = OccupancyGrid(
            np.where(free.grid.data, 0, LETHAL).astype(np.uint8), free.grid.resolution, free.grid.origin
        )
        self._path: Floats | None = None
        self._arcs: Floats = np.zeros(1)
        """(n,) lengths of the path up to each of its points, metres"""
        self._at_m = 0.0
        self._steps = 0.0
        self._blocked_s = 0.0

    @property
    def place(self) -> Point:
        """(x, y) of its middle, map frame, metres."""
        return self.pose.x, self.pose.y

    @property
    def braking_m(self) -> float:
        """How far it goes on until it stands."""
        return self.speed_mps * self.speed_mps / (2.0 * ACCELERATION_MPS2)

    def go_to(self, goal: Point | None) -> None:
        """Stop, and then go there; None: stay. Without a way there, it stays and has no goal."""
        self.goal = goal
        self._blocked_s = 0.0
        if self.speed_mps == 0.0:
            self._plan()

    def step(self, dt_s: float, others: Floats) -> None:
        """Let ``dt_s`` pass; ``others``: (n, 3) x, y, radius of who is in the way, metres."""
        path = self._path
        if path is None:
            if self.goal is not None:
                self._plan()
            return
        if self._at_m == 0.0 and self._turn(dt_s):
            return
        length_m = float(self._arcs[-1])
        is_wanted = self.goal is not None and self.goal == (float(path[-1, 0]), float(path[-1, 1]))
        free_m = min(length_m - self._at_m, self._gap_m(others)) if is_wanted else 0.0
        most_mps = min(self.group.speed_mps, math.sqrt(2.0 * ACCELERATION_MPS2 * max(free_m, 0.0)))
        change_mps = ACCELERATION_MPS2 * dt_s
        self.speed_mps = min(max(most_mps, self.speed_mps - change_mps), self.speed_mps + change_mps)
        self._blocked_s = self._blocked_s + dt_s if self.speed_mps == 0.0 else 0.0
        if self.speed_mps > 0.0:
            # rounding may leave more speed than way
            way_m = min(self.speed_mps * dt_s, length_m - self._at_m)
            self._at_m += way_m
            self._steps += way_m / step_length_m(self.speed_mps)
            x, y = self._point(self._at_m)
            self.pose = Pose2D(x, y, self._heading(self._at_m))
        if is_wanted and length_m - self._at_m < ARRIVED_M:
            self.goal = None
            self._stop()
        elif self.speed_mps == 0.0 and (not is_wanted or self._blocked_s > IMPATIENT_S):
            self._stop()
            if is_wanted:
                self.goal = None
            elif self.goal is not None:
                self._plan()

    def solids(self) -> tuple[Solid, ...]:
        """What beams meet and robots run into: both legs, or the thing itself."""
        height_m = self.group.height_m
        if self.group.kind == "person":
            feet = [Pose2D(x, y, 0.0) for x, y in self._feet()]
            return tuple(Solid("cylinder", foot, LEG_DIAMETER_M, LEG_DIAMETER_M, height_m) for foot in feet)
        return (Solid(self.group.kind, self.pose, *self.group.sides_m, height_m),)

    def extent(self) -> Box:
        """The axis-aligned extent of all of ``solids``, map frame, metres."""
        boxes = np.array([solid.bounding_box() for solid in self.solids()])
        return Box(*boxes[:, :2].min(axis=0).tolist(), *boxes[:, 2:].max(axis=0).tolist())

    def _plan(self) -> None:
        self._stop()
        if self.goal is None:
            return
        potential = potential_to(self.goal, self._costs, self.place)
        path = None if potential is None else potential.path_from(*self.place)
        if path is None or len(path) < 2:
            self.goal = None
            return
        sides = lengths(path[1:] - path[:-1])
        path = path[np.concatenate(([True], sides > 0.0))]
        self._arcs = np.concatenate(([0.0], np.cumsum(sides[sides > 0.0])))
        if self._arcs[-1] < ARRIVED_M:
            self.goal = None
            return
        self._path = path

    def _stop(self) -> None:
        self._path = None
        self._arcs = np.zeros(1)
        self._at_m = self.speed_mps = self._blocked_s = 0.0

    def _turn(self, dt_s: float) -> bool:
        """Turn on the spot towards the path; whether that took the time."""
        missing = wrap_angle(self._heading(0.0) - self.pose.yaw)
        most = TURN_RADPS * dt_s
        turn = min(max(missing, -most), most)
        self.pose = self.pose._replace(yaw=wrap_angle(self.pose.yaw + turn))
        return abs(missing) > most

    def _gap_m(self, others: Floats) -> float:
        """How far it may go on until it has to stand for somebody; inf when nobody is in the way."""
        if not len(others):
            return math.inf
        now_m = lengths(others[:, :2] - self.place)
        rooms_m = others[:, 2] + self.group.radius_m
        ahead_m = LOOK_STEP_M
        while ahead_m < self.braking_m + 2.0 * KEEP_OFF_M:
            gaps_m = lengths(others[:, :2] - self._point(self._at_m + ahead_m))
            # whom it leaves behind is no reason to stand
            if bool(((gaps_m < rooms_m) & (gaps_m < now_m)).any()):
                return max(ahead_m - KEEP_OFF_M, 0.0)
            ahead_m += LOOK_STEP_M
        return math.inf

    def _point(self, arc_m: float) -> Point:
        """(x, y) that far along the path, or at its nearer end."""
        assert self._path is not None
        arcs, path = self._arcs, self._path
        arc_m = min(max(arc_m, 0.0), float(arcs[-1]))
        after = min(int(np.searchsorted(arcs, arc_m, side="right")), len(arcs) - 1)
        share = (arc_m - float(arcs[after - 1])) / float(arcs[after] - arcs[after - 1])
        (xa, ya), (xb, yb) = path[after - 1].tolist(), path[after].tolist()
        return xa + share * (xb - xa), ya + share * (yb - ya)

    def _heading(self, arc_m: float) -> float:
        """Which way the path goes there, over a foot's length, radians."""
        (xa, ya), (xb, yb) = self._point(arc_m - _TANGENT_M), self._point(arc_m + _TANGENT_M)
        return self.pose.yaw if (xa, ya) == (xb, yb) else float(atan2(yb - ya, xb - xa))

    def _feet(self) -> tuple[Point, Point]:
        """The middles of the left and the right leg. Who stands has them side by side.

        One leg stands while the other one overtakes it. Both go along the path, not straight ahead: so no leg
        comes nearer to a wall than the path does, less half of what lies between the feet.
        """
        stride_m = step_length_m(self.speed_mps) if self._path is not None else 0.0
        step, share = divmod(self._steps, 1.0)
        standing_m = stride_m * (0.5 - share)
        swinging_m = -stride_m * cos(math.pi * share) / 2.0
        ahead_m = (swinging_m, standing_m) if int(step) % 2 == 0 else (standing_m, swinging_m)
        feet = []
        for along_m, side in zip(ahead_m, (0.5, -0.5), strict=True):
            if self._path is None or self._at_m == 0.0:
                x, y = self.place
                yaw = self.pose.yaw
            else:
                x, y = self._point(self._at_m + along_m)
                yaw = self._heading(self._at_m + along_m)
            ((c, s),) = directions(np.array([yaw])).tolist()
            feet.append((x - s * side * FEET_APART_M, y + c * side * FEET_APART_M))
        return feet[0], feet[1]


class Crowd:
    """All people and things of a layout."""

    def __init__(self, layout: Layout, step_s: float) -> None:
        """Everybody at their starts; ``step_s``: a tick."""
        self._step_s = step_s
        spaces = {
            other.group.radius_m: free_space(
                layout.arena, other.group.radius_m + OTHERS_MARGIN_M, layout.stationary
            )
            for other in layout.others
        }
        counts: dict[str, int] = {}
        self.members: list[Member] = []
        for other in layout.others:
            kind = other.group.kind
            counts[kind] = counts.get(kind, 0) + 1
            self.members.append(Member(f"{kind} {counts[kind]}", other, spaces[other.group.radius_m]))
        self._solids: tuple[Solid, ...] = self._standing()

    def step(self, robots: Floats) -> None:
        """Let one tick pass; ``robots``: (n, 3) x, y and radius of the robots that are there."""
        for number, member in enumerate(self.members):
            # who comes first here goes first: the others keep off by as much as it needs to stop
            first = [
                (*other.place, other.group.radius_m + other.braking_m) for other in self.members[:number]
            ]
            later = [(*other.place, other.group.radius_m) for other in self.members[number + 1 :]]
            member.step(self._step_s, np.vstack((robots, np.array(first + later).reshape(-1, 3))))
        self._solids = self._standing()

    def solids(self) -> tuple[Solid, ...]:
        """Legs and things as they are at this tick, always in the same order."""
        return self._solids

    def shorten(self, ranges: Floats, beams: Beams, far_m: float) -> None:
        """Shorten (m, beams) ``ranges`` in place where a leg or a thing is nearer than they and ``far_m``."""
        for solid in self._solids:
            met = ranges_to(solid, beams)
            np.minimum(ranges, np.where(met < far_m, met, np.inf), out=ranges)

    def _standing(self) -> tuple[Solid, ...]:
        return tuple(solid for member in self.members for solid in member.solids())


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


class CrowdedWorld:
    """A :class:`~midnet_bench.simulation.simulator.Simulator` of any engine, with a crowd in it.

    An engine that has ``obstruct(solids)`` lets robots run into the crowd; with another they pass through it.
    """

    def __init__(self, world: Simulator, crowd: Crowd) -> None:
        self._world = world
        self._crowd = crowd
        self._obstruct = getattr(world, "obstruct", None)
        self.layout: Layout = world.layout
        self.robot: RobotModel = world.robot
        self.step_hz: int = world.step_hz

    @property
    def tick(self) -> int:
        """Ticks since the start."""
        return self._world.tick

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""
        return self._world.active

    def step(self) -> None:
        """Let one tick pass: first for the crowd, which sees where the robots are, then for the robots."""
        places = self._world.poses()[self._world.active, :2]
        radii = np.full((len(places), 1), self.robot.body_reach_m)
        self._crowd.step(np.hstack((places, radii)))
        if self._obstruct is not None:
            self._obstruct(self._crowd.solids())
        self._world.step()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity."""
        self._world.drive(index, command)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good."""
        self._world.remove(index)

    def pose(self, index: int) -> Pose2D:
        """A robot's true pose; NaN once it is removed."""
        return self._world.pose(index)

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        return self._world.poses()

    def velocities(self, rows: Ints | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot."""
        return self._world.velocities(rows)

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians."""
        return self._world.wheel_angles()

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres to the first thing that is no robot, the crowd included, from the axis on."""
        ranges = self._world.cast(beams, near_m, far_m)
        self._crowd.shorten(ranges, beams, far_m)
        return ranges

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far."""
        return self._world.collisions()

    def close(self) -> None:
        """Give back what the engine holds."""
        self._world.close()
