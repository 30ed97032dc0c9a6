"""One tick of all bodies: motors, contacts, motion."""

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, hypot
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.fast.contacts import (
    GAP,
    GRAVITY_MPS2,
    NORMAL,
    NORMAL_X,
    NORMAL_Y,
    PER_BODY,
    SKIN_M,
    TANGENTIAL,
    WHEEL_FRICTION,
    Body,
    ContactBuffer,
    Scene,
    depenetrate,
    find_contacts,
    hull_of,
    islands,
    least_speed,
    parting_speed,
    penetrates,
    solve_contacts,
)
from midnet_bench.simulation.fast.outlines import Outlines, SideGrid, side_grid

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Parts = tuple[npt.NDArray[Any], ...]

# Columns of a body's state: its pose; its velocity in the map frame, forward, and its yaw rate; for the left
# and the right wheel the rim speed that is asked for, the one that it has, and how far it has turned. Metres,
# radians, seconds.
POSE = slice(0, 3)
SPEED_X, SPEED_Y = 3, 4
FORWARD, TURN = 5, 6
VELOCITY = slice(5, 7)
ASKED = slice(7, 9)
ASKED_LEFT, LEFT, RIGHT = 7, 9, 10
ANGLES = slice(11, 13)
ANGLE_LEFT = 11
COLUMNS = 13


class Drive(NamedTuple):
    """What moves bodies, and how time passes."""

    step_s: float  # a tick
    ramp_mps: float  # by how much a rim's speed changes in a tick
    separation_m: float
    wheel_m: float  # radius
    most_m: float  # how far any point of a body may come in a tick
    rounds: int  # of the solver, at most


TOUCH_M = 2.0 * SKIN_M  # What is this near touches.
_PARTINGS = 20
_OVERLAP_M = 5e-4  # Nothing gets deeper into anything.
_STILL_MPS = 1e-6  # The solver ends when no impulse changes by more.
_PUSHED = 1.25  # How much faster than by its own wheels a body may be moved.


def parts_of(robot: RobotModel, outlines: Outlines, count: int, step_hz: int, rounds: int) -> Parts:
    """What ``count`` robots are, how they drive, what stands about them, and room for their contacts.

    Arrays only: handing named tuples to compiled code takes three times as long as a tick, 2.6 % of a trial.
    """
    step_s, reach_m = 1.0 / step_hz, robot.body_reach_m
    fastest = robot.max_linear_mps + robot.max_angular_radps * reach_m
    ramp_mps, most_m = robot.rim_acceleration_mps2 * step_s, _PUSHED * fastest * step_s
    drive = Drive(step_s, ramp_mps, robot.wheel_separation_m, robot.wheel_radius_m, most_m, rounds)
    body = Body(hull_of(robot.body), reach_m, robot.gyration_radius_m * robot.gyration_radius_m)
    rows = PER_BODY * count
    return (
        np.array([*drive, body.reach_m, body.gyration2_m2]),
        body.hull,
        *side_grid(outlines, reach_m + 2.0 * drive.most_m),
        np.zeros((count, *body.hull.shape)),
        np.zeros((rows, 9)),
        np.zeros((rows, 2), dtype=np.int64),
    )


@njit
def put_together(parts: Parts) -> tuple[Drive, Scene]:
    """The named tuples of :func:`parts_of`."""
    numbers, hull, sides, frame, first, members, hulls, rows, pairs = parts
    drive = Drive(numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], int(numbers[5]))
    body = Body(hull, numbers[6], numbers[7])
    ground = SideGrid(sides, frame, first, members)
    return drive, Scene(body, ground, ContactBuffer(hulls, rows, pairs))


@njit
def step_world(states: Floats, present: npt.NDArray[np.bool_], solids: Floats, parts: Parts) -> None:
    """Let one tick pass for (n, 13) ``states``, by the columns above, of the bodies that are ``present``.

    ``solids``: (k, 6) what moves by itself, as for :func:`~.contacts.find_contacts`. ``parts``: as
    :func:`parts_of` gives them.
    """
    drive, scene = put_together(parts)
    n = len(states)
    poses = states[:, :3]
    moves = np.zeros((n, 3))
    for i in range(n):
        if present[i]:
            _turn_wheels(states[i], drive)
            _roll(states[i], drive, moves[i])
    # two bodies come nearer by as much as both can move
    count = find_contacts(poses, present, 2.0 * drive.most_m, solids, scene)
    held = np.zeros(n, dtype=np.bool_)
    if count == 0:
        for i in range(n):
            if present[i]:
                poses[i] += moves[i] * drive.step_s
    else:
        label = islands(count, scene.room.pairs, n)
        _hold(count, states, drive, scene, label, moves, held)
        _move_among_contacts(poses, present, drive, scene, label, moves, held)
    for i in range(n):
        if present[i]:
            _note_velocity(states[i], moves[i], held[i])


@njit
def _turn_wheels(state: Floats, drive: Drive) -> None:
    """Moves each rim's speed one tick closer to its target; the wheel turns by it, on the floor or not."""
    for wheel in range(2):
        missing = state[ASKED_LEFT + wheel] - state[LEFT + wheel]
        if abs(missing) <= drive.ramp_mps:
            state[LEFT + wheel] = state[ASKED_LEFT + wheel]
        else:
            state[LEFT + wheel] += math.copysign(drive.ramp_mps, missing)
        state[ANGLE_LEFT + wheel] += state[LEFT + wheel] * drive.step_s / drive.wheel_m


@njit
def _roll(state: Floats, drive: Drive, move: Floats) -> None:
    """Fills ``move`` with the velocity of wheels that do not slip: along the heading half-way of the tick."""
    forward = (state[LEFT] + state[RIGHT]) / 2.0
    turn = (state[RIGHT] - state[LEFT]) / drive.separation_m
    heading = state[2] + turn * drive.step_s / 2.0
    c, s = cos_sin(heading)
    move[0], move[1], move[2] = forward * c, forward * s, turn


@njit
def _hold(
    count: int,
    states: Floats,
    drive: Drive,
    scene: Scene,
    label: Ints,
    moves: Floats,
    held: npt.NDArray[np.bool_],
) -> None:
    """Changes ``moves`` of islands whose free motion would close a gap, and marks their bodies ``held``.

    Each body starts from the velocity that it had; friction of its wheels works
    towards the free motion, as far as it goes, and contacts against whatever closes a gap.
    """
    n, step_s, gyration2 = len(states), drive.step_s, scene.body.gyration2_m2
    _, rows, pairs = scene.room
    is_hindered = np.zeros(n, dtype=np.bool_)
    for c in range(count):
        row, a, b = rows[c], pairs[c, 0], pairs[c, 1]
        least = least_speed(row[GAP], b, step_s)
        speed = parting_speed(row, a, b, row[NORMAL_X], row[NORMAL_Y], moves)
        if speed < least - 1e-12 or row[GAP] < 0.0:
            is_hindered[label[a]] = True
        row[NORMAL] = row[TANGENTIAL] = 0.0
    headings = np.empty((n, 2))
    grips = np.zeros((n, 2, 2))
    for i in range(n):
        if is_hindered[label[i]]:
            held[i] = True
            heading = states[i, 2] + moves[i, 2] * step_s / 2.0
            headings[i, 0], headings[i, 1] = cos_sin(heading)
            moves[i, 0], moves[i, 1], moves[i, 2] = states[i, SPEED_X], states[i, SPEED_Y], states[i, TURN]
    for island in range(n):
        if not is_hindered[island] or label[island] != island:
            continue
        for _ in range(drive.rounds):
            change = 0.0
            for i in range(island, n):
                if label[i] == island:
                    change = max(change, _grip(states[i], drive, gyration2, headings[i], grips[i], moves[i]))
            change = max(change, solve_contacts(island, label, count, rows, pairs, step_s, gyration2, moves))
            if change < _STILL_MPS:
                break
    for i in range(n):
        if held[i]:
            _limit(drive, scene.body.reach_m, moves[i])


@njit
def _grip(
    state: Floats, drive: Drive, gyration2: float, heading: Floats, grip: Floats, move: Floats
) -> float:
    """One round over a body's wheels: friction works against their slip, as far as it goes.

    ``grip``: (2, 2) the impulses so far per mass, of both wheels, along and across. The largest change, m/s.
    """
    c, s = heading[0], heading[1]
    most = WHEEL_FRICTION * GRAVITY_MPS2 * drive.step_s / 2.0
    forward, aside = c * move[0] + s * move[1], c * move[1] - s * move[0]
    turn, change = move[2], 0.0
    for wheel in range(2):
        lever = drive.separation_m * (0.5 - wheel)
        slip = forward - turn * lever - state[LEFT + wheel]
        along = grip[wheel, 0] - slip / (1.0 + lever * lever / gyration2)
        across = grip[wheel, 1] - aside
        size = hypot(along, across)
        if size > most:
            along, across = along * most / size, across * most / size
        more_along, more_across = along - grip[wheel, 0], across - grip[wheel, 1]
        grip[wheel, 0], grip[wheel, 1] = along, across
        forward += more_along
        turn -= lever * more_along / gyration2
        aside += more_across
        change = max(change, abs(more_along), abs(more_across))
    move[0], move[1], move[2] = c * forward - s * aside, s * forward + c * aside, turn
    return change


@njit
def _limit(drive: Drive, reach_m: float, move: Floats) -> None:
    """Slows a body that would move farther in a tick than contacts were looked for."""
    travel_m = (hypot(move[0], move[1]) + abs(move[2]) * reach_m) * drive.step_s
    if travel_m > drive.most_m:
        share = drive.most_m / travel_m
        move[0], move[1], move[2] = move[0] * share, move[1] * share, move[2] * share


@njit
def _move_among_contacts(
    poses: Floats,
    present: npt.NDArray[np.bool_],
    drive: Drive,
    scene: Scene,
    label: Ints,
    moves: Floats,
    held: npt.NDArray[np.bool_],
) -> None:
    """Moves all bodies, parts those that overlap then, as turning may make them, and checks what came of it.

    An island of which a body would stand in something, and did not before, does not move in this tick. So
    whatever the solver makes of a jam, nothing gets deeper than the check allows.
    """
    n = len(poses)
    before, nothing = poses.copy(), np.empty((0, 6))
    for i in range(n):
        if present[i]:
            poses[i] += moves[i] * drive.step_s
    for _ in range(_PARTINGS):
        count = find_contacts(poses, present, 0.0, nothing, scene)
        if not depenetrate(count, scene.room.rows, scene.room.pairs, scene.body.gyration2_m2, poses):
            break
    is_bad = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        if (
            present[i]
            and penetrates(i, poses, present, _OVERLAP_M, scene)
            and not penetrates(i, before, present, _OVERLAP_M, scene)
        ):
            is_bad[label[i]] = True
    for i in range(n):
        if is_bad[label[i]]:
            held[i] = True
            poses[i], moves[i] = before[i], 0.0


@njit
def _note_velocity(state: Floats, move: Floats, is_held: bool) -> None:
    """Keeps what a body's velocity came to, and its yaw within [-pi, pi]."""
    if state[2] > math.pi:
        state[2] -= 2.0 * math.pi
    elif state[2] < -math.pi:
        state[2] += 2.0 * math.pi
    state[SPEED_X], state[SPEED_Y], state[TURN] = move[0], move[1], move[2]
    if is_held:
        c, s = cos_sin(state[2])
        state[FORWARD] = move[0] * c + move[1] * s
    else:
        state[FORWARD] = (state[LEFT] + state[RIGHT]) / 2.0


@njit
def touching(
    states: Floats, present: npt.NDArray[np.bool_], solids: Floats, parts: Parts
) -> npt.NDArray[np.bool_]:
    """(n,) whether each body touches something; arguments as for :func:`step_world`."""
    _, scene = put_together(parts)
    count = find_contacts(states[:, :3], present, TOUCH_M, solids, scene)
    found = np.zeros(len(states), dtype=np.bool_)
    for c in range(count):
        for i in scene.room.pairs[c]:
            if i >= 0:
                found[i] = True
    return found
