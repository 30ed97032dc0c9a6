"""``Evaders``: the behaviour of intruders: standing, wandering, hiding, following a path; with pauses.

They are no robots of the benchmark: one that hides knows the true position of every guard. Nothing of that
reaches a guard.
"""

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import MobileRobot
from midnet_bench.arena.arena import Behaviour
from midnet_bench.arena.free_space import FreeSpace
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Floats, Point, lengths
from midnet_bench.rng import stream
from midnet_bench.simulation.crowd import Crowd
from midnet_bench.simulation.fleet import CONTROL_HZ, crossed_wall, surfaces
from midnet_bench.simulation.world import World

HIDE_EVERY_S = 1.0  # how often an intruder that hides checks its place
HIDING_PLACES = 128  # random places that it chooses from


class EvaderPolicy:
    """One intruder's behaviour: where it wants to be at a time."""

    def __init__(self, settings: Behaviour, free: FreeSpace, name: str, seed: int, walls: Floats) -> None:
        self._settings, self._free, self._walls = settings, free, walls
        self._rng = stream(seed, "goals", name)
        self._cycle_s = settings.walk_s + settings.pause_s
        # not all of them pause at once: the first walk is a part of one
        self._early_s = (
            float(stream(seed, "pause", name).uniform(0.0, settings.walk_s)) if self._cycle_s else 0.0
        )
        self._path = itertools.cycle(settings.path_m)
        self._hidden_until_s = 0.0

    def goal(self, at: Point, goal: Point | None, time_s: float, guards: Floats) -> Point | None:
        """Where to go now: ``goal``, which it has, or another; None to stand.

        ``at``: where it is; ``guards``: (n, 2) where they truly are, map frame, metres.
        """
        kind, walk_s = self._settings.behaviour, self._settings.walk_s
        pauses = self._settings.pause_s and (time_s + self._early_s) % self._cycle_s >= walk_s
        if kind == "stand" or pauses:
            return None
        if kind == "hide":
            return self._hiding_place(at, goal, time_s, guards)
        if goal is not None:
            return goal
        return next(self._path) if kind == "follow" else self._free.draw(self._rng)

    def _hiding_place(self, at: Point, goal: Point | None, time_s: float, guards: Floats) -> Point | None:
        """The nearest place of some that no guard sees; if all are seen, the one farthest from all guards.

        An intruder on its way to a place that is seen by now goes on unless there is a hidden one.
        """
        if time_s < self._hidden_until_s - 1e-9:
            return goal
        self._hidden_until_s = time_s + HIDE_EVERY_S
        if self._is_hidden(np.array([at if goal is None else goal]), guards)[0]:
            return goal
        places = np.array([self._free.draw(self._rng) for _ in range(HIDING_PLACES)])
        hidden = self._is_hidden(places, guards)
        if hidden.any():
            places = places[hidden]
            best = int(lengths(places - at).argmin())
        elif goal is not None:
            return goal
        else:
            best = int(lengths(places[:, None] - guards[None]).min(axis=1).argmax())
        x, y = places[best].tolist()
        return x, y

    def _is_hidden(self, places: Floats, guards: Floats) -> npt.NDArray[np.bool_]:
        """(n,) whether walls or stationary intruders lie between each place and every guard."""
        hidden = np.ones(len(places), dtype=np.bool_)
        for guard in guards:
            hidden &= crossed_wall(self._walls, np.tile(guard, (len(places), 1)), places)
        return hidden


class Evaders:
    """Gives Burgers, people and things their goals, ten times a second."""

    def __init__(
        self, layout: Layout, burgers: Sequence[MobileRobot], free: FreeSpace, crowd: Crowd, seed: int
    ) -> None:
        """``free``: where Burgers may go."""
        walls, settings = surfaces(layout), layout.arena.mobile_intruders
        self._guards = len(layout.robots)
        is_plain = settings.behaviour == "wander" and not settings.pause_s  # as the trial itself does it
        self._burgers = [
            (robot, EvaderPolicy(settings, free, robot.name, seed, walls))
            for robot in ([] if is_plain else burgers)
        ]
        self._members = [
            (member, EvaderPolicy(member.group, member.free, member.name, seed, walls))
            for member in crowd.members
        ]

    def update(self, world: World) -> None:
        """Update all goals, if it is time to."""
        if world.tick % (world.step_hz // CONTROL_HZ):
            return
        time_s, poses = world.tick / world.step_hz, world.poses()
        guards = np.ascontiguousarray(poses[: self._guards, :2][world.active[: self._guards]])
        for robot, policy in self._burgers:
            if not world.active[robot.index]:
                continue
            x, y = poses[robot.index, :2].tolist()
            goal = policy.goal((x, y), robot.goal, time_s, guards)
            if goal is None and robot.goal is not None:
                robot.cancel_goal()
            elif goal is not None and goal != robot.goal:
                robot.drive_to(goal)
        for member, policy in self._members:
            goal = policy.goal(member.place, member.goal, time_s, guards)
            if goal != member.goal:
                member.go_to(goal)
