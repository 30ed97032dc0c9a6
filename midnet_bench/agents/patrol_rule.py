"""``PatrolRule``: where an idle guard goes next, in the place of section V.B's random patrol."""

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.settings import PATROLS
from midnet_bench.geometry import Point


class PatrolRule(Protocol):
    """A class of these is made anew for each trial, and may keep a state.

    It is made of ``(points, guards, rng)`` and its own options, which have defaults: (n, 2) places where a
    guard may be sent, map frame, metres; the number of guards; the trial's own generator of random numbers.
    """

    def next_point(self, guard: int, team: Sequence[GuardState], time_s: float) -> Point:
        """Where the guard ``team[guard]`` goes, which has reached its goal or lost it: (x, y), metres.

        The point should be one of ``points``; a guard gives up what it cannot reach.
        """


class TeamPatrol:
    """A patrol rule from outside, watched: what is wrong with it is said by its name."""

    relaxations = 0
    """none of the paper's conditions was relaxed"""

    def __init__(
        self, name: str, points: npt.NDArray[np.float64], guards: int, rng: np.random.Generator
    ) -> None:
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
