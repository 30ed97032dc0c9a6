"""``FastEngine``: one trial's robots, walls and intruders in compiled loops of our own."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from midnet_bench.arena.layout import Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, hypot
from midnet_bench.geometry import Booleans, Command, Floats, Indices, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import SOLVER_ITERATIONS, Beams
from midnet_bench.simulation.fast import contacts
from midnet_bench.simulation.fast.contacts import GAP, NORMAL, NORMAL_X, NORMAL_Y, TANGENTIAL, Scene
from midnet_bench.simulation.fast.outlines import cast_on_outlines, outlines_of, side_grid

Parts = tuple[Any, ...]  # of a ``Scene``

# Columns of a body's state: its pose; its velocity in the map frame, forward, and its yaw rate; for the left
# and the right wheel the rim speed that is asked for, the one that it has, and how far it has turned. Metres,
# radians, seconds.
POSE = slice(0, 3)
SPEED_X, SPEED_Y = 3, 4
FORWARD, TURN = 5, 6
VELOCITY = slice(5, 7)
ASKED_LEFT, ASKED_RIGHT, LEFT, RIGHT = 7, 8, 9, 10
ANGLES = slice(11, 13)
ANGLE_LEFT = 11
COLUMNS = 13

GRAVITY_MPS2, GRIP = 9.81, 1.0  # Coulomb's coefficient of wheels on the floor, as in PyBullet
TOUCH_M = 2.0 * contacts.SKIN_M  # What is this near touches.
_PARTINGS = 20
_OVERLAP_M = 5e-4  # Nothing gets deeper into anything.
_STILL_MPS = 1e-6  # The solver ends when no impulse changes by more.
_PUSHED = 1.25  # How much faster than by its own wheels a body may be moved.


class FastEngine:
    """The :class:`~midnet_bench.simulation.engine.Engine` without PyBullet: planar bodies without wheels."""

    def __init__(self, layout: Layout, robot: RobotModel, step_hz: int) -> None:
        self._robot = robot
        starts = layout.robots + layout.intruders
        count, step_s, reach_m = len(starts), 1.0 / step_hz, robot.body_reach_m
        most_m = _PUSHED * (robot.max_linear_mps + robot.max_angular_radps * reach_m) * step_s
        hull, outlines = contacts.hull_of(robot.body), outlines_of(layout.solids)
        # Handing named tuples to compiled code takes three times as long as a tick.
        self._outlines = outlines[:]
        self._parts = tuple(
            Scene(
                hull,
                *side_grid(outlines, reach_m + 2.0 * most_m),
                np.zeros((count, *hull.shape)),
                np.zeros((contacts.PER_BODY * count, 9)),
                np.zeros((contacts.PER_BODY * count, 2), dtype=np.int64),
                np.zeros(1, dtype=np.int64),
                step_s=step_s,
                ramp_mps=robot.rim_acceleration_mps2 * step_s,
                separation_m=robot.wheel_separation_m,
                wheel_m=robot.wheel_radius_m,
                most_m=most_m,
                reach_m=reach_m,
                gyration2_m2=robot.gyration_radius_m * robot.gyration_radius_m,
            )
        )
        self._states = np.zeros((count, COLUMNS))
        self._states[:, POSE] = starts
        self._present = np.ones(count, dtype=np.bool_)
        self._obstacles = np.zeros((0, 6))

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity, within its limits; held until the next one."""
        self._states[index, ASKED_LEFT], self._states[index, ASKED_RIGHT] = self._robot.rim_speeds(command)

    def step(self) -> None:
        """Let 1 / ``step_hz`` seconds pass."""
        step_world(self._states, self._present, self._obstacles, self._parts)

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way from now on, in place of those before; beams pass them."""
        rows = [(*one.pose, one.length_m, one.width_m, one.kind == "cylinder") for one in solids]
        self._obstacles = np.array(rows, dtype=np.float64).reshape(-1, 6)

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame, under the middle of its axle."""
        return self._states[:, POSE]

    def velocities(self, rows: Indices) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot."""
        return self._states[:, VELOCITY]

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians."""
        return self._states[:, ANGLES]

    def contacts(self) -> Booleans:
        """(n,) whether each robot touches anything now."""
        return np.asarray(touching(self._states, self._present, self._obstacles, self._parts))

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        return np.asarray(cast_on_outlines(*beams, self._outlines, near_m, far_m))

    def remove(self, index: int) -> None:
        """Take a robot out for good."""
        self._present[index] = False


@njit
def step_world(states: Floats, present: Booleans, solids: Floats, parts: Parts) -> None:
    """Let one tick pass for (n, 13) ``states``, by the columns above, of the bodies that are ``present``.

    ``solids``: (k, 6) what moves by itself, as for :func:`~.contacts.find_contacts`.
    """
    scene = Scene(*parts)
    n = len(states)
    poses = states[:, :3]
    before, moves, held = poses.copy(), np.zeros((n, 3)), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        if present[i]:
            _roll(states[i], scene, moves[i])
    # two bodies come nearer by as much as both can move
    count = contacts.find_contacts(poses, present, 2.0 * scene.most_m, solids, scene)
    label = contacts.islands(count, scene.pairs, n)
    if count > 0:
        _hold(count, states, scene, label, moves, held)
    for i in range(n):
        if present[i]:
            poses[i] += moves[i] * scene.step_s
    if count > 0:
        is_bad = _part(poses, before, present, scene, label)
        for i in range(n):
            # such an island does not move in this tick: whatever a jam comes to, nothing gets deeper
            if is_bad[label[i]]:
                held[i] = True
                poses[i], moves[i] = before[i], 0.0
    for i in range(n):
        if present[i]:
            _note_velocity(states[i], moves[i], held[i])


@njit
def _roll(state: Floats, scene: Scene, move: Floats) -> None:
    """Turns the wheels, and fills ``move`` with the velocity of a body whose wheels do not slip.

    Each rim's speed comes one tick closer to its target; the wheel turns by it, on the floor or not. The
    velocity is along the heading half-way of the tick.
    """
    for wheel in range(2):
        missing = state[ASKED_LEFT + wheel] - state[LEFT + wheel]
        if abs(missing) <= scene.ramp_mps:
            state[LEFT + wheel] = state[ASKED_LEFT + wheel]
        else:
            state[LEFT + wheel] += math.copysign(scene.ramp_mps, missing)
        state[ANGLE_LEFT + wheel] += state[LEFT + wheel] * scene.step_s / scene.wheel_m
    forward = (state[LEFT] + state[RIGHT]) / 2.0
    turn = (state[RIGHT] - state[LEFT]) / scene.separation_m
    c, s = cos_sin(state[2] + turn * scene.step_s / 2.0)
    move[0], move[1], move[2] = forward * c, forward * s, turn


@njit
def _hold(count: int, states: Floats, scene: Scene, label: Indices, moves: Floats, held: Booleans) -> None:
    """Changes ``moves`` of islands whose free motion would close a gap, and marks their bodies ``held``.

    Each body starts from the velocity that it had; friction of its wheels works towards the free motion, as
    far as it goes, and contacts against whatever closes a gap.
    """
    n = len(states)
    is_hindered = np.zeros(n, dtype=np.bool_)
    for c in range(count):
        row, (a, b) = scene.rows[c], scene.pairs[c]
        least = contacts.least_speed(row[GAP], b, scene.step_s)
        speed = contacts.parting_speed(row, a, b, row[NORMAL_X], row[NORMAL_Y], moves)
        if speed < least - 1e-12 or row[GAP] < 0.0:
            is_hindered[label[a]] = True
        row[NORMAL] = row[TANGENTIAL] = 0.0
    headings, grips = np.empty((n, 2)), np.zeros((n, 2, 2))
    for i in range(n):
        if is_hindered[label[i]]:
            held[i] = True
            headings[i, 0], headings[i, 1] = cos_sin(states[i, 2] + moves[i, 2] * scene.step_s / 2.0)
            moves[i, 0], moves[i, 1], moves[i, 2] = states[i, SPEED_X], states[i, SPEED_Y], states[i, TURN]
    for island in range(n):
        if not is_hindered[island] or label[island] != island:
            continue
        for _ in range(SOLVER_ITERATIONS):
            change = 0.0
            for i in range(island, n):
                if label[i] == island:
                    change = max(change, _grip(states[i], scene, headings[i], grips[i], moves[i]))
            change = max(change, contacts.solve_contacts(island, label, count, scene, moves))
            if change < _STILL_MPS:
                break
    for i in range(n):
        # no farther in a tick than contacts were looked for
        way_m = (hypot(moves[i, 0], moves[i, 1]) + abs(moves[i, 2]) * scene.reach_m) * scene.step_s
        if held[i] and way_m > scene.most_m:
            moves[i] *= scene.most_m / way_m


@njit
def _grip(state: Floats, scene: Scene, heading: Floats, grip: Floats, move: Floats) -> float:
    """One round over a body's wheels: friction works against their slip, as far as it goes.

    ``grip``: (2, 2) the impulses so far per mass, of both wheels, along and across. The largest change, m/s.
    """
    c, s = heading
    most = GRIP * GRAVITY_MPS2 * scene.step_s / 2.0
    forward, aside = c * move[0] + s * move[1], c * move[1] - s * move[0]
    turn, change = move[2], 0.0
    for wheel in range(2):
        lever = scene.separation_m * (0.5 - wheel)
        slip = forward - turn * lever - state[LEFT + wheel]
        along = grip[wheel, 0] - slip / (1.0 + lever * lever / scene.gyration2_m2)
        across = grip[wheel, 1] - aside
        size = hypot(along, across)
        if size > most:
            along, across = along * most / size, across * most / size
        more_along, more_across = along - grip[wheel, 0], across - grip[wheel, 1]
        grip[wheel, 0], grip[wheel, 1] = along, across
        forward += more_along
        turn -= lever * more_along / scene.gyration2_m2
        aside += more_across
        change = max(change, abs(more_along), abs(more_across))
    move[0], move[1], move[2] = c * forward - s * aside, s * forward + c * aside, turn
    return change


@njit
def _part(poses: Floats, before: Floats, present: Booleans, scene: Scene, label: Indices) -> Booleans:
    """Parts moved bodies that overlap, as turning may make them, and checks what came of it.

    (n,) by their least body the islands of which a body would stand in something and did not before.
    """
    n = len(poses)
    for _ in range(_PARTINGS):
        count = contacts.find_contacts(poses, present, 0.0, np.empty((0, 6)), scene)
        if not contacts.part_overlapping(count, scene, poses):
            break
    is_bad = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        if present[i] and contacts.penetrates(i, poses, present, _OVERLAP_M, scene):
            is_bad[label[i]] |= not contacts.penetrates(i, before, present, _OVERLAP_M, scene)
    return is_bad


@njit
def _note_velocity(state: Floats, move: Floats, is_held: bool) -> None:
    """Keeps what a body's velocity came to, and its yaw within [-pi, pi]."""
    if state[2] > math.pi:
        state[2] -= 2.0 * math.pi
    elif state[2] < -math.pi:
        state[2] += 2.0 * math.pi
    state[SPEED_X], state[SPEED_Y], state[TURN] = move
    if is_held:
        c, s = cos_sin(state[2])
        state[FORWARD] = move[0] * c + move[1] * s
    else:
        state[FORWARD] = (state[LEFT] + state[RIGHT]) / 2.0


@njit
def touching(states: Floats, present: Booleans, solids: Floats, parts: Parts) -> Booleans:
    """(n,) whether each body touches something; arguments as for :func:`step_world`."""
    scene = Scene(*parts)
    count = contacts.find_contacts(states[:, :3], present, TOUCH_M, solids, scene)
    found = np.zeros(len(states), dtype=np.bool_)
    for a, b in scene.pairs[:count]:
        found[a] = True
        if b >= 0:
            found[b] = True
    return found
