"""Where the guards go next: the random patrol of section V.B, or a rule from outside in its place."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from midnet_bench.agents.agent_settings import PATROLS, PatrolSettings
from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Point, lengths
from midnet_bench.grid import OCCUPIED, OccupancyGrid, cell_centers, cells_to_unset, connected_to

DRIVABLE_M = 0.15
"""How near to an occupied cell a robot's centre may come: the reach of a Burger's footprint, 0.1485 m, in
whole cells of 5 cm. One that reaches farther keeps its own reach."""

DRAWS_PER_RELAXATION, RELAXATION = 200, 0.9
"""After so many failed draws z shrinks by this factor (item 59)."""


def safe_distance(diagonal_m: float, robots: int, z_factor: float = PatrolSettings().z_factor) -> float:
    """The distance z of Eq. 12, metres: p / 2q with p the enclosure's diagonal and q the number of robots."""
    return z_factor * diagonal_m / robots


def patrol_points(
    prior_map: OccupancyGrid,
    start: Point,
    enclosure_m: tuple[float, float],
    clearance_m: float = PatrolSettings().clearance_m,
    reach_m: float = 0.0,
) -> Floats:
    """(n, 2) cell centres, metres, map frame, that a patrol may be sent to.

    They lie inside the enclosure (its sides in x and y, centred on the map frame's origin), at least
    ``clearance_m`` from the centre of every occupied cell, and where a guard whose footprint reaches
    ``reach_m`` from its axle can drive from ``start``. Raises InputError if there is no such cell.
    """
    distance_m = cells_to_unset(prior_map.data != OCCUPIED) * prior_map.resolution
    x, y = prior_map.x_centers, prior_map.y_centers
    inside = (np.abs(x) < enclosure_m[0] / 2.0) & (np.abs(y) < enclosure_m[1] / 2.0)[:, None]
    drivable = (distance_m >= max(DRIVABLE_M, reach_m)) & inside & (prior_map.data >= 0)
    reachable = connected_to(*prior_map.cell_at(*start), drivable)
    points = cell_centers(prior_map, reachable & (distance_m >= clearance_m))
    if not len(points):
        raise InputError(
            f"prior_map: no cell is {clearance_m:g} m from walls and within reach of the guards' start "
            f"({start[0]:g}, {start[1]:g}); is it the map of this arena?"
        )
    return points


class PatrolRule(Protocol):
    """A class of these is made anew for each trial, and may keep a state.

    It is made of ``(points, guards, rng)`` and its own options, which have defaults: (n, 2) places where a
    guard may be sent, map frame, metres; the number of guards; the trial's own generator of random numbers.
    """

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """Where the guard ``team[guard]`` goes, which has reached its goal or lost it: (x, y), metres.

        The point should be one of ``points``; a guard gives up what it cannot reach.
        """


@dataclass
class Patrol:
    """The paper's rule: random patrol points."""

    points: Floats  # (n, 2), metres: where a patrol point may lie
    z_m: float  # Eq. 12
    rng: np.random.Generator
    relaxations: int = 0  # how often the conditions had to be relaxed

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """A random point at least z from the guard and from the others' patrol points, metres, at any time.

        Guards without a goal have no part in it (item 60), nor have those that pursue: theirs is no patrol
        point (item 79). Distances are straight lines (item 61). One robot
        at the centre of an arena has no such point at all, so z shrinks by a tenth after every 200 draws that
        fail, for this draw only (item 59).
        """
        others = [one for i, one in enumerate(team) if i != guard and not one.is_pursuing]
        goals = [one.goal for one in others if one.goal is not None]
        keep_away = np.array([team[guard].place, *goals], dtype=np.float64)
        z_m = self.z_m
        while True:
            draws = self.points[self.rng.integers(len(self.points), size=DRAWS_PER_RELAXATION)]
            gaps = draws[:, None, :] - keep_away[None, :, :]
            good = np.flatnonzero(lengths(gaps).min(axis=1) >= z_m)
            if len(good):
                x, y = draws[good[0]]
                return float(x), float(y)
            z_m = z_m * RELAXATION if z_m > 0.01 else -math.inf
            self.relaxations += 1


class TeamPatrol:
    """A patrol rule from outside, watched: what is wrong with it is said by its name."""

    relaxations = 0  # none of the paper's conditions was relaxed

    def __init__(self, name: str, points: Floats, guards: int, rng: np.random.Generator) -> None:
        """``name`` is a pinned value of ``PATROLS``. Raises PluginError if it cannot be made."""
        self.points = points
        self._name = name
        self._rule = PATROLS.make(name, points, guards, rng)

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """See :class:`PatrolRule`. Raises PluginError: it failed, or gave no finite point."""
        with PATROLS.calling(self._name):
            x, y = map(float, self._rule.next_point(guard, team, time_s))
        if not math.isfinite(x + y):
            raise PATROLS.refused(self._name, f"next_point gave ({x}, {y}); a finite point is needed")
        return x, y
