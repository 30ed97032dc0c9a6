"""How people and things walk: one tick of all of them, compiled.

Step length over cadence, the walk ratio, stays at 0.0065 m per step/min from 1 m/s up (Murakami and Otaka,
J. Phys. Ther. Sci. 29(5), 2017; Sekiya and Nagasaki, Gait & Posture 7(3), 1998): both go with the square root
of the speed, 0.68 m and 1.75 steps a second at 1.2 m/s, 0.88 m and 2.26 at 2 m/s.
"""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos, cos_sin

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

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


@njit
def step_length_m(speed_mps: float) -> float:
    """How long a step is at a speed, by the walk ratio."""
    return math.sqrt(60.0 * WALK_RATIO_M_MIN * speed_mps)


@njit
def braking_m(speed_mps: float) -> float:
    """How far a walker goes on until it stands."""
    return speed_mps * speed_mps / (2.0 * ACCELERATION_MPS2)


@njit
def walk(
    states: Floats,
    paths: Floats,
    counts: Ints,
    robots: Floats,
    step_s: float,
    needs_path: npt.NDArray[np.bool_],
) -> None:
    """Let one tick pass for (n, 15) ``states``, by the columns above, one walker after the other.

    Args:
        states: changed in place.
        paths: (n, p, 3) x, y and length up to there of each path's points.
        counts: (n,) how many of them there are; 0 without a path. Changed in place.
        robots: (m, 3) x, y and radius of the robots that are there.
        step_s: the tick.
        needs_path: (n,) filled: whether each has a goal and needs a path.
    """
    near = np.empty((len(states) + len(robots), 4))
    for i in range(len(states)):
        state, path = states[i], paths[i, : counts[i]]
        needs_path[i] = False
        if counts[i] > 0:
            has_stopped = _go(i, states, path, robots, step_s, near)
            if has_stopped:
                stop(state, counts, i)
            put_feet(state, paths[i, : counts[i]])
            needs_path[i] = has_stopped and not math.isnan(state[GOAL_X])
        else:
            needs_path[i] = not math.isnan(state[GOAL_X])


@njit
def stop(state: Floats, counts: Ints, number: int) -> None:
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
    missing = _wrapped(_heading(path, 0.0, state[YAW]) - state[YAW])
    most = TURN_RADPS * step_s
    state[YAW] = _wrapped(state[YAW] + min(max(missing, -most), most))
    return abs(missing) > most


@njit
def _wrapped(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


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
