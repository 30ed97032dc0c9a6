"""``Opponents``: what intruders are up to: standing, wandering, hiding, following a path; with pauses.

They are the opponent and none of the benchmark's robots: who hides knows where every guard truly is. Nothing
of what they know reaches a guard.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import MobileRobot, Point
from midnet_bench.arena.arena import Behaviour
from midnet_bench.arena.free_space import FreeSpace
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import lengths
from midnet_bench.rng import stream
from midnet_bench.simulation.crowd import Crowd, Member
from midnet_bench.simulation.fleet import CONTROL_HZ
from midnet_bench.simulation.integrity import crossed_wall, surfaces
from midnet_bench.simulation.simulator import Simulator

Floats = npt.NDArray[np.float64]

HIDE_EVERY_S = 1.0
"""how often somebody who hides looks whether the place is still a good one"""
REFUGES = 128
"""random places that it weighs against each other"""


class Deed:
    """One intruder's behaviour: where it wants to be at a time."""

    def __init__(self, said: Behaviour, free: FreeSpace, name: str, seed: int, walls: Floats) -> None:
        self._said = said
        self._free = free
        self._rng = stream(seed, "goals", name)
        self._walls = walls
        cycle_s = said.walk_s + said.pause_s
        # not all of them pause at once: the first walk is a part of one
        self._early_s = float(stream(seed, "pause", name).uniform(0.0, said.walk_s)) if cycle_s else 0.0
        self._next = 0
        self._hidden_until_s = 0.0

    def pauses(self, time_s: float) -> bool:
        """Whether it stands now because it takes a pause."""
        said = self._said
        if not said.pause_s:
            return False
        return (time_s + self._early_s) % (said.walk_s + said.pause_s) >= said.walk_s

    def goal(self, at: Point, goal: Point | None, time_s: float, guards: Floats) -> Point | None:
        """Where to go now: ``goal``, which it has, or another; None to stand.

        ``at``: where it is; ``guards``: (n, 2) where they truly are, map frame, metres.
        """
        kind = self._said.behaviour
        if kind == "stand" or self.pauses(time_s):
            return None
        if kind == "hide":
            return self._refuge(at, goal, time_s, guards)
        if goal is not None:
            return goal
        if kind == "follow":
            self._next += 1
            return self._said.path_m[(self._next - 1) % len(self._said.path_m)]
        return self._free.draw(self._rng)

    def _refuge(self, at: Point, goal: Point | None, time_s: float, guards: Floats) -> Point | None:
        """The nearest place of some that no guard sees; if all are seen, the one farthest from all guards.

        Who is under way to a place that is seen by now goes on unless there is one that is not.
        """
        if time_s < self._hidden_until_s - 1e-9:
            return goal
        self._hidden_until_s = time_s + HIDE_EVERY_S
        if self._is_hidden(np.array([at if goal is None else goal]), guards)[0]:
            return goal
        places = np.array([self._free.draw(self._rng) for _ in range(REFUGES)])
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


class Opponents:
    """Sends Burgers, people and things about, ten times a second."""

    def __init__(
        self,
        layout: Layout,
        burgers: Sequence[MobileRobot],
        free: FreeSpace,
        crowd: Crowd,
        seed: int,
        guards: int,
    ) -> None:
        """``free``: where Burgers may be sent; ``guards``: how many of the first robots are guards."""
        walls = surfaces(layout)
        self._guards = guards
        said = layout.arena.mobile_intruders
        self._burgers: list[tuple[MobileRobot, Deed]] = []
        if said.behaviour != "wander" or said.pause_s:
            self._burgers = [(robot, Deed(said, free, robot.name, seed, walls)) for robot in burgers]
        self._members: list[tuple[Member, Deed]] = [
            (member, Deed(member.group, member.free, member.name, seed, walls)) for member in crowd.members
        ]

    def update(self, world: Simulator) -> None:
        """Look after everybody, if it is time to."""
        if world.tick % (world.step_hz // CONTROL_HZ):
            return
        time_s = world.tick / world.step_hz
        poses = world.poses()
        guards = poses[: self._guards, :2]
        guards = np.ascontiguousarray(guards[world.active[: self._guards]])
        for robot, deed in self._burgers:
            if not world.active[robot.index]:
                continue
            x, y = poses[robot.index, :2].tolist()
            goal = deed.goal((x, y), robot.goal, time_s, guards)
            if goal is None and robot.goal is not None:
                robot.cancel_goal()
            elif goal is not None and goal != robot.goal:
                robot.drive_to(goal)
        for member, deed in self._members:
            goal = deed.goal(member.place, member.goal, time_s, guards)
            if goal != member.goal:
                member.go_to(goal)
