"""``Crowd``: people and things that move by themselves.

No wheels drive them. They go where the trial sends them, along paths that a planner finds around what stands,
and stop before they would run over a robot or a person. Beams meet them, and robots run into them.

At the height of the beams a person is two discs, the legs. Leg detectors for 2D scanners look for widths of
0.1 to 0.25 m and for pairs less than 0.4 m apart (Bellotto and Hu, "Multisensor-based human detection and
tracking for mobile service robots", IEEE Trans. SMC-B 39(1), 2009). The walk ratio, step length over cadence,
stays at 0.0065 m per step/min from 1 m/s up (Murakami and Otaka, J. Phys. Ther. Sci. 29(5), 2017; Sekiya and
Nagasaki, Gait & Posture 7(3), 1998): both go with the square root of the speed, 0.68 m and 1.75 steps per
second at 1.2 m/s.
"""

import math
from weakref import proxy

import numpy as np

from midnet_bench.arena.arena import OtherIntruders
from midnet_bench.arena.free_space import FreeSpace, free_space
from midnet_bench.arena.layout import OTHERS_MARGIN_M, Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos, cos_sin
from midnet_bench.geometry import Booleans, Box, Floats, Indices, Point, Pose2D, Solid, lengths
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import LETHAL
from midnet_bench.navigation.global_planner import potential_to
from midnet_bench.simulation.engine import Beams

LEG_DIAMETER_M = 0.12
FEET_APART_M = 0.25  # from one leg's middle to the other's, sideways
WALK_RATIO_M_MIN = 0.0065  # step length in metres over steps per minute
ACCELERATION_MPS2 = 2.0
TURN_RADPS = math.pi  # on the spot, before the first step
KEEP_OFF_M = 0.35  # from where a walker stops to where there would be no room; a leg reaches that far ahead
LOOK_STEP_M = 0.1
ARRIVED_M = 0.01
IMPATIENT_S = 1.0  # A way that has been blocked for so long is given up.
_TANGENT_M = 0.15
_SLACK_M = 0.01  # What is this much too far away to be in the way is not looked at; more than any rounding.

# Columns of a walker's state: its pose; its speed; its goal, NaN without one; how far along its path it is;
# how many steps it has made; how long it has been blocked; the middles of its legs; and what never changes:
# its radius and its greatest speed. Metres, radians, seconds.
POSE = slice(0, 3)
X, Y, YAW, SPEED = range(4)
GOAL = slice(4, 6)
GOAL_X, GOAL_Y, AT, STEPS, BLOCKED_S = range(4, 9)
FEET = slice(9, 13)
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, RADIUS, FASTEST = range(9, 15)
COLUMNS = 15

# Columns of a path's point: where it is, and how long the path is up to it.
ARC = 2


class DynamicObstacle:
    """One person or thing. ``go_to`` says where; it stops, turns and walks by itself."""

    def __init__(
        self, name: str, group: OtherIntruders, free: FreeSpace, crowd: "Crowd", number: int
    ) -> None:
        """Member ``number`` of ``crowd``; ``free``: where its middle may be."""
        self.name = name
        self.group = group
        self.free = free
        self._crowd = proxy(crowd)
        self._number = number
        self._state = crowd.states[number]

    @property
    def pose(self) -> Pose2D:
        """Its middle on the floor, map frame."""
        return Pose2D(*self._state[POSE].tolist())

    @property
    def place(self) -> Point:
        """(x, y) of its middle, map frame, metres."""
        x, y, _ = self.pose
        return x, y

    @property
    def speed_mps(self) -> float:
        """How fast it walks."""
        return float(self._state[SPEED])

    @property
    def goal(self) -> Point | None:
        """(x, y) where it goes, map frame, metres; None when it stays."""
        x, y = self._state[GOAL].tolist()
        return None if math.isnan(x) else (x, y)

    def go_to(self, goal: Point | None) -> None:
        """Stop, and then go there; None: stay. Without a way there, it stays and has no goal."""
        self._state[GOAL] = goal or math.nan
        self._state[BLOCKED_S] = 0.0
        if self.speed_mps == 0.0:
            self._crowd.plan(self._number)

    def solids(self) -> tuple[Solid, ...]:
        """What beams meet and robots run into: both legs, or the thing itself."""
        height_m = self.group.height_m
        if self.group.kind == "person":
            xa, ya, xb, yb = self._state[FEET].tolist()
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
        radii_m = {other.group.radius_m for other in layout.others}
        margin_m, still = OTHERS_MARGIN_M, layout.stationary
        spaces = {radius_m: free_space(layout.arena, radius_m + margin_m, still) for radius_m in radii_m}
        count = len(layout.others)
        self.states = np.zeros((count, COLUMNS))
        """(n, 15) by the columns above"""
        self._paths = np.zeros((count, 0, 3))
        self._counts = np.zeros(count, dtype=np.int64)
        numbers: dict[str, int] = {}
        self.members: list[DynamicObstacle] = []
        for group, pose in ((other.group, other.pose) for other in layout.others):
            state = self.states[len(self.members)]
            numbers[group.kind] = numbers.get(group.kind, 0) + 1
            state[POSE], state[GOAL] = pose, math.nan
            state[RADIUS], state[FASTEST] = group.radius_m, group.speed_mps
            put_feet(state, np.empty((0, 3)))
            name = f"{group.kind} {numbers[group.kind]}"
            free = spaces[group.radius_m]
            self.members.append(DynamicObstacle(name, group, free, self, len(self.members)))
        self._solids: tuple[Solid, ...] | None = None

    def step(self, robots: Floats) -> None:
        """Let one tick pass; ``robots``: (n, 3) x, y and radius of the robots that are there."""
        needs_path = walk(self.states, self._paths, self._counts, robots, self._step_s)
        for number in np.flatnonzero(needs_path).tolist():
            self.plan(number)
        self._solids = None

    def plan(self, number: int) -> None:
        """Let a member stop and find its path from where it stands; without one it has no goal any more."""
        member = self.members[number]
        stop(self.states[number], self._counts, number)
        goal, start, grid = member.goal, member.place, member.free.grid
        costs = OccupancyGrid(np.where(grid.data, 0, LETHAL).astype(np.uint8), grid.resolution, grid.origin)
        potential = None if goal is None else potential_to(goal, costs, start)
        path = None if potential is None else potential.path_from(*start)
        if path is not None:
            sides = lengths(path[1:] - path[:-1])
            path = path[np.concatenate(([True], sides > 0.0))]
            arcs = np.concatenate(([0.0], np.cumsum(sides[sides > 0.0])))
        if path is None or arcs[-1] < ARRIVED_M:
            self.states[number, GOAL] = math.nan
            return
        missing = max(len(path) - self._paths.shape[1], 0)
        self._paths = np.pad(self._paths, ((0, 0), (0, missing), (0, 0)))
        self._paths[number, : len(path)] = np.column_stack((path, arcs))
        self._counts[number] = len(path)

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


def ranges_to(solid: Solid, beams: Beams) -> Floats:
    """(m, beams) metres from the axis to one solid, whatever stands before it; inf where a beam passes."""
    dx, dy = beams.axes[:, :1] - solid.pose.x, beams.axes[:, 1:] - solid.pose.y
    wx, wy = beams.directions[..., 0], beams.directions[..., 1]
    if solid.kind == "cylinder":
        along, radius_m = -dx * wx - dy * wy, solid.length_m / 2.0
        under_root = along * along + (radius_m * radius_m - dx * dx - dy * dy)
        is_met = (along > 0.0) & (under_root > 0.0)
        return np.where(is_met, np.maximum(along - np.sqrt(np.where(is_met, under_root, 0.0)), 0.0), np.inf)
    # by the two pairs of parallel sides of a box
    c, s = solid.pose.direction
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


@njit
def step_length_m(speed_mps: float) -> float:
    """How long a step is at a speed, by the walk ratio."""
    return math.sqrt(60.0 * WALK_RATIO_M_MIN * speed_mps)


@njit
def braking_m(speed_mps: float) -> float:
    """How far a walker goes on until it stands."""
    return speed_mps * speed_mps / (2.0 * ACCELERATION_MPS2)


@njit
def walk(states: Floats, paths: Floats, counts: Indices, robots: Floats, step_s: float) -> Booleans:
    """Let one tick pass for (n, 15) ``states``, by the columns above, one walker after the other.

    ``paths``: (n, p, 3) x, y and length up to there of each path's points, of which ``counts`` are there, 0
    without a path. ``robots``: (m, 3) x, y and radius of those that are there. (n,) which need a path.
    """
    needs_path = np.zeros(len(states), dtype=np.bool_)
    near = np.empty((len(states) + len(robots), 4))
    for i in range(len(states)):
        state, has_stopped = states[i], counts[i] == 0
        if counts[i] > 0:
            has_stopped = _go(i, states, paths[i, : counts[i]], robots, step_s, near)
            if has_stopped:
                stop(state, counts, i)
            put_feet(state, paths[i, : counts[i]])
        needs_path[i] = has_stopped and not math.isnan(state[GOAL_X])
    return needs_path


@njit
def stop(state: Floats, counts: Indices, number: int) -> None:
    """Let a walker stand, without a path."""
    counts[number] = 0
    state[AT] = state[SPEED] = state[BLOCKED_S] = 0.0


@njit
def _go(i: int, states: Floats, path: Floats, robots: Floats, step_s: float, near: Floats) -> bool:
    """One tick of walker i on its path; whether it stands and has no more use for the path."""
    state = states[i]
    if state[AT] == 0.0 and _turn(state, path, step_s):
        return False
    length_m = path[-1, ARC]
    is_wanted = state[GOAL_X] == path[-1, X] and state[GOAL_Y] == path[-1, Y]
    free_m = 0.0
    if is_wanted:
        free_m = min(length_m - state[AT], _gap_m(i, states, path, robots, near))
    most_mps = min(state[FASTEST], math.sqrt(2.0 * ACCELERATION_MPS2 * max(free_m, 0.0)))
    change_mps = ACCELERATION_MPS2 * step_s
    speed_mps = min(max(most_mps, state[SPEED] - change_mps), state[SPEED] + change_mps)
    state[SPEED] = speed_mps
    state[BLOCKED_S] = state[BLOCKED_S] + step_s if speed_mps == 0.0 else 0.0
    if speed_mps > 0.0:
        # rounding may leave more speed than way
        way_m = min(speed_mps * step_s, length_m - state[AT])
        state[AT] += way_m
        state[STEPS] += way_m / step_length_m(speed_mps)
        state[X], state[Y] = _point(path, state[AT])
        state[YAW] = _heading(path, state[AT], state[YAW])
    has_arrived = is_wanted and length_m - state[AT] < ARRIVED_M
    gives_up = is_wanted and speed_mps == 0.0 and state[BLOCKED_S] > IMPATIENT_S
    if has_arrived or gives_up:
        state[GOAL_X] = state[GOAL_Y] = math.nan
    return has_arrived or gives_up or (speed_mps == 0.0 and not is_wanted)


@njit
def _turn(state: Floats, path: Floats, step_s: float) -> bool:
    """Turns on the spot towards the path; whether that took the time."""
    missing = (_heading(path, 0.0, state[YAW]) - state[YAW] + math.pi) % (2.0 * math.pi) - math.pi
    most = TURN_RADPS * step_s
    state[YAW] = (state[YAW] + min(max(missing, -most), most) + math.pi) % (2.0 * math.pi) - math.pi
    return abs(missing) > most


@njit
def _gap_m(i: int, states: Floats, path: Floats, robots: Floats, near: Floats) -> float:
    """How far walker i may go on until it has to stand for another or a robot; inf when the way is free.

    Those before it go first: it keeps off them by as much as they need to stop. ``near``: (n + m, 4) room
    for what is near.
    """
    state = states[i]
    look_m = braking_m(state[SPEED]) + 2.0 * KEEP_OFF_M
    count = 0
    for j in range(len(states) + len(robots)):
        if j == i:
            continue
        if j < len(states):
            x, y, radius_m = states[j, X], states[j, Y], states[j, RADIUS]
            if j < i:
                radius_m += braking_m(states[j, SPEED])
        else:
            x, y, radius_m = robots[j - len(states)]
        room_m = radius_m + state[RADIUS]
        dx, dy = x - state[X], y - state[Y]
        within_m = room_m + look_m + _SLACK_M
        if dx * dx + dy * dy < within_m * within_m:
            near[count, 0], near[count, 1] = x, y
            near[count, 2], near[count, 3] = room_m, math.sqrt(dx * dx + dy * dy)
            count += 1
    ahead_m = LOOK_STEP_M
    while count > 0 and ahead_m < look_m:
        px, py = _point(path, state[AT] + ahead_m)
        for x, y, room_m, now_m in near[:count]:
            dx, dy = x - px, y - py
            gap_m = math.sqrt(dx * dx + dy * dy)
            # what it leaves behind is no reason to stand
            if gap_m < room_m and gap_m < now_m:
                return max(ahead_m - KEEP_OFF_M, 0.0)
        ahead_m += LOOK_STEP_M
    return math.inf


@njit
def _point(path: Floats, arc_m: float) -> tuple[float, float]:
    """(x, y) that far along the path, or at its nearer end."""
    arc_m = min(max(arc_m, 0.0), path[-1, ARC])
    after = min(int(np.searchsorted(path[:, ARC], arc_m, side="right")), len(path) - 1)
    share = (arc_m - path[after - 1, ARC]) / (path[after, ARC] - path[after - 1, ARC])
    xa, ya, xb, yb = path[after - 1, X], path[after - 1, Y], path[after, X], path[after, Y]
    return xa + share * (xb - xa), ya + share * (yb - ya)


@njit
def _heading(path: Floats, arc_m: float, yaw: float) -> float:
    """Which way the path goes there, over a foot's length, radians; ``yaw`` where it goes nowhere."""
    xa, ya = _point(path, arc_m - _TANGENT_M)
    xb, yb = _point(path, arc_m + _TANGENT_M)
    return yaw if xa == xb and ya == yb else atan2(yb - ya, xb - xa)


@njit
def put_feet(state: Floats, path: Floats) -> None:
    """Puts the left and the right leg where they are. A walker that stands has them side by side.

    One leg stands while the other one overtakes it. Both go along the path, not straight ahead: so no leg
    comes nearer to a wall than the path does, less half of what lies between the feet.
    """
    stride_m = step_length_m(state[SPEED]) if len(path) > 0 else 0.0
    step = math.floor(state[STEPS])
    share = state[STEPS] - step
    standing_m = stride_m * (0.5 - share)
    swinging_m = -stride_m * cos(math.pi * share) / 2.0
    is_left = int(step) % 2 == 0
    for foot in range(2):
        x, y, yaw = state[X], state[Y], state[YAW]
        if len(path) > 0 and state[AT] > 0.0:
            along_m = state[AT] + (swinging_m if is_left == (foot == 0) else standing_m)
            x, y = _point(path, along_m)
            yaw = _heading(path, along_m, yaw)
        c, s = cos_sin(yaw)
        side = 0.5 - foot
        state[LEFT_X + 2 * foot] = x - s * side * FEET_APART_M
        state[LEFT_Y + 2 * foot] = y + c * side * FEET_APART_M
