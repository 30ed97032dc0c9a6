"""Pursuits: the nearest guard, all guards, no guard, and the least total way.

Distances are straight lines between what MIDNet knows: the estimated poses of the guards, and where the
latest boxes of the targets were.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.pursuit import TargetState
from midnet_bench.grid import OccupancyGrid

Team = Sequence[GuardState]
Targets = Mapping[int, TargetState]


class _ByDistance:
    """Needs neither the map nor random numbers."""

    def __init__(self, prior_map: OccupancyGrid, rng: np.random.Generator) -> None:
        pass


class Nobody(_ByDistance):
    """Guards patrol, whatever they see."""

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """No guard at any time."""
        return {}


class Nearest(_ByDistance):
    """One guard for each target, nearest pairs of a free guard and a free target first (item 54).

    A guard keeps its target until that is gone.
    """

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """Those that pursue already, and new pairs, whatever the time is."""
        sent = _pursuing(targets)
        free = [guard for guard in range(len(team)) if guard not in sent]
        waiting = [target for target, known in targets.items() if not known.pursuers]
        while free and waiting:
            guard, target = min(
                ((guard, target) for guard in free for target in waiting),
                key=lambda pair: _gap_m(team[pair[0]], targets[pair[1]]),
            )
            sent[guard] = target
            free.remove(guard)
            waiting.remove(target)
        return sent


class All(_ByDistance):
    """Every guard goes after the target that is nearest to it, and keeps to it until that is gone."""

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """All guards, whatever the time is."""
        sent = _pursuing(targets)
        for guard, state in enumerate(team):
            if guard not in sent:
                sent[guard] = min(targets, key=lambda target: _gap_m(state, targets[target]))
        return sent


class Assignment(_ByDistance):
    """As many pairs as there can be with the least total distance, found anew at each frame.

    Kuhn, "The Hungarian method for the assignment problem", Naval Research Logistics Quarterly 2 (1955). A
    guard may be given another target, or be called off for a guard that came nearer.
    """

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """One target for each guard of the assignment, whatever the time is."""
        names = list(targets)
        gaps_m = np.array([[_gap_m(guard, targets[name]) for name in names] for guard in team])
        guards, columns = linear_sum_assignment(gaps_m)
        return {guard: names[column] for guard, column in zip(guards.tolist(), columns.tolist(), strict=True)}


def _pursuing(targets: Targets) -> dict[int, int]:
    """Guards that pursue already, with their targets."""
    return {guard: target for target, known in targets.items() for guard in known.pursuers}


def _gap_m(guard: GuardState, known: TargetState) -> float:
    return math.dist(guard.place, known.place)
