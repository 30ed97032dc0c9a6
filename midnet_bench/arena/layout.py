"""``Layout``: an arena as one seed draws it, with all robots at their starts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from midnet_bench.arena.arena import Arena, OtherIntruders, StationaryIntruders
from midnet_bench.arena.free_space import free_space
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Pose2D, Solid, gap_m, lengths
from midnet_bench.rng import stream

ROBOT_CLEARANCE_M = 0.2
"""From a security robot's start to anything that stands (a Burger's body reaches 0.124 m from its axle); one
that reaches farther keeps its own reach."""
OTHERS_MARGIN_M = 0.05  # between what a person or thing needs to pass and what stands
_TRIES, _RESTARTS = 200, 20


@dataclass(frozen=True)
class OtherIntruder:
    """One of an arena's other intruders at its start."""

    group: OtherIntruders
    pose: Pose2D  # the middle of its floor, map frame


@dataclass(frozen=True)
class Layout:
    """Where everything is at time zero, map frame."""

    arena: Arena
    seed: int
    stationary: tuple[Solid, ...]  # stationary intruders
    robots: tuple[Pose2D, ...]
    """security robots' starts: base_footprint, the point under the middle of the axle"""
    intruders: tuple[Pose2D, ...]  # mobile intruders' starts, likewise
    others: tuple[OtherIntruder, ...] = ()  # people and things that move by themselves
    mobile_scale: float = 1.0
    """what beams meet of a mobile intruder, as a multiple of what they meet of a security robot"""

    @property
    def solids(self) -> tuple[Solid, ...]:
        """Everything that never moves: walls, then stationary intruders."""
        return self.arena.wall_solids() + self.stationary


def place(
    arena: Arena, seed: int, robots: int, mobile_intruders: int | None = None, reach_m: float = 0.0
) -> Layout:
    """The arena as ``seed`` draws it for a team of ``robots`` whose bodies reach so far from their axles.

    Stationary and mobile intruders do not depend on the team's size (up to the arena's ``team``), and the
    first k mobile ones are the same whatever their number: cells of a campaign meet the same worlds
    (common random numbers, item 71). ``mobile_intruders``: the arena's own number when None.

    Raises:
        InputError: a count is out of range, or there is no room.
    """
    wanted = arena.mobile_intruders.count if mobile_intruders is None else mobile_intruders
    if robots < 1:
        raise InputError(f"robots: at least 1 is needed (got {robots})")
    if wanted < 0:
        raise InputError(f"intruders: must not be negative (got {wanted})")
    _check_reach(arena, robots, wanted, reach_m)
    starts = robot_starts(arena, robots)
    sizes = {*range(1, arena.robots.team + 1), robots}
    all_starts = _points([pose for size in sizes for pose in robot_starts(arena, size)])
    stationary = arena.placed_solids() + _draw_stationary(arena, seed, all_starts)
    points, solids = _points(starts), arena.wall_solids() + stationary
    if min(float(one.distance_to(points).min()) for one in solids) < max(ROBOT_CLEARANCE_M, reach_m):
        raise InputError(
            f"arena '{arena.name}': robots: {robots} starts {arena.robots.spacing_m:g} m apart "
            f"do not fit about {arena.robots.center_m}; move center_m, lower spacing_m or take fewer robots"
        )
    mobile = _draw_mobile(arena, seed, wanted, stationary, all_starts)
    others = _place_others(arena, seed, stationary, all_starts)
    return Layout(arena, seed, stationary, starts, mobile, others)


def robot_starts(arena: Arena, robots: int) -> tuple[Pose2D, ...]:
    """Start poses of a team: the centre for one, else evenly on a ring, looking outwards (item 63)."""
    x, y = arena.robots.center_m
    if robots == 1:
        return (Pose2D(x, y, 0.0),)
    from midnet_bench.elementary import from_python  # which needs a compiler

    radius = arena.robots.spacing_m / 2.0 / from_python.sin(math.pi / robots)
    center = Pose2D(x, y, 0.0)
    turns = (Pose2D(0.0, 0.0, 2.0 * math.pi * k / robots) for k in range(robots))
    return tuple(center.compose(turn.compose(Pose2D(radius, 0.0, 0.0))) for turn in turns)


def _check_reach(arena: Arena, robots: int, intruders: int, reach_m: float) -> None:
    """Raise InputError where robots that reach so far would start in each other or in a wall."""
    spaces = [("robots.spacing_m", arena.robots.spacing_m, 2.0 * reach_m)] if robots > 1 else []
    if intruders:
        mobile = arena.mobile_intruders
        spaces.append(("mobile_intruders.clearance_m", mobile.clearance_m, reach_m))
        spaces.append(("mobile_intruders.spacing_m", mobile.spacing_m, 2.0 * reach_m))
    for key, given_m, needed_m in spaces:
        if given_m < needed_m:
            raise InputError(
                f"arena '{arena.name}': {key}: {given_m:g} m is too little for robots that reach "
                f"{reach_m:.2f} m from their axles; {needed_m:.2f} m is needed"
            )


def _draw_stationary(arena: Arena, seed: int, starts: Floats) -> tuple[Solid, ...]:
    spec = arena.stationary_intruders
    rng = stream(seed, "arena", "stationary")
    standing = arena.wall_solids() + arena.placed_solids()
    for _ in range(_RESTARTS):
        drawn: tuple[Solid, ...] = ()
        for _ in range(_TRIES):
            if len(drawn) == spec.count:
                return drawn
            solid = _draw_solid(spec, arena, rng)
            is_clear = solid.distance_to(starts).min() >= spec.clear_of_robots_m
            if is_clear and gap_m(solid, standing + drawn) >= spec.clearance_m:
                drawn = (*drawn, solid)
    raise InputError(
        f"arena '{arena.name}': stationary_intruders.count: no room for {spec.count} with seed {seed}; "
        f"take fewer, smaller ones, a smaller clearance_m, or at most {arena.robots.team} robots"
    )


def _draw_solid(spec: StationaryIntruders, arena: Arena, rng: np.random.Generator) -> Solid:
    kind = spec.shapes[int(rng.integers(len(spec.shapes)))]
    length, width = rng.uniform(spec.size_m[0], spec.size_m[1], size=2).tolist()
    half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
    x, y = rng.uniform(-half_x, half_x), rng.uniform(-half_y, half_y)
    pose = _facing_anywhere((float(x), float(y)), rng)
    return Solid(kind, pose, length, length if kind == "cylinder" else width, spec.height_m)


def _draw_mobile(
    arena: Arena, seed: int, count: int, stationary: tuple[Solid, ...], starts: Floats
) -> tuple[Pose2D, ...]:
    if count == 0:
        return ()
    spec = arena.mobile_intruders
    free = free_space(arena, spec.clearance_m, stationary)
    poses: list[Pose2D] = []
    for number in range(count):
        rng, others = stream(seed, "intruders", number), _points(poses)
        for point in (free.draw(rng) for _ in range(_TRIES)):
            is_clear = lengths(starts - point).min() >= spec.clear_of_robots_m
            if is_clear and np.all(lengths(others - point) >= spec.spacing_m):
                poses.append(_facing_anywhere(point, rng))
                break
        else:
            raise InputError(
                f"arena '{arena.name}': mobile_intruders: no room for {count} with seed {seed}; "
                f"take fewer of them, at most {arena.robots.team} robots, or lower spacing_m or"
                " clear_of_robots_m"
            )
    return tuple(poses)


def _place_others(
    arena: Arena, seed: int, stationary: tuple[Solid, ...], starts: Floats
) -> tuple[OtherIntruder, ...]:
    """People and things: those with a start of their own, then those whose place is drawn, group by group.

    Mobile robots are no matter to them, so that their number changes no place.
    """
    others: list[OtherIntruder] = []
    for group_number, group in enumerate(arena.other_intruders):
        key = f"arena '{arena.name}': other_intruders.{group_number}"
        free = free_space(arena, group.radius_m + OTHERS_MARGIN_M, stationary)
        for number in range(group.count):
            rng, given = stream(seed, "others", group_number, number), group.starts_m[number : number + 1]
            taken = _points([other.pose for other in others])
            gaps_m = np.array([other.group.radius_m + group.radius_m for other in others])
            least_m = group.radius_m + ROBOT_CLEARANCE_M if given else group.clear_of_robots_m
            for point in given or [free.draw(rng) for _ in range(_TRIES)]:
                is_clear = free.contains(*point) and lengths(starts - point).min() >= least_m
                if is_clear and np.all(lengths(taken - point) > gaps_m):
                    others.append(OtherIntruder(group, _facing_anywhere(point, rng)))
                    break
            else:
                if given:
                    ((x, y),) = given
                    raise InputError(
                        f"{key}.starts_m.{number}: ({x:g}, {y:g}) is too near to a wall, a guard's start "
                        f"or another intruder with seed {seed}, or out of reach; move it"
                    )
                raise InputError(
                    f"{key}: no room for {group.count} with seed {seed}; take fewer, or lower "
                    "clear_of_robots_m"
                )
    return tuple(others)


def _points(poses: Sequence[Pose2D]) -> Floats:
    """(n, 2) x, y."""
    return np.array([(pose.x, pose.y) for pose in poses]).reshape(-1, 2)


def _facing_anywhere(point: tuple[float, float], rng: np.random.Generator) -> Pose2D:
    return Pose2D(*point, float(rng.uniform(-math.pi, math.pi)))
