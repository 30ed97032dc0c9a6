"""What guards may pursue, the rules that send guards after it, and those that come with the package.

A target is a track of MIDNet's boxes. No truth says whether there is an intruder behind it, whether it was
caught, or whether two tracks are one intruder (items 53, 54).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from midnet_bench.agents.agent_settings import PURSUITS, PursuitSettings
from midnet_bench.agents.mobile_robot import Guard, GuardState
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.geometry import Box, Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.plugins import PluginError

NEAR_M = 0.5
EMPTY_AFTER_S = 1.0
"""A target is not there if a pursuer is this near to its place and no box was on it for this long."""
WITH_ORACLE = "nearest"  # the rule that the referee's truth decides for


class TargetState(NamedTuple):
    """What guards may pursue, as far as MIDNet knows; a pursuit rule receives it."""

    place: Point  # centre of its latest box, map frame, metres
    seen_s: float  # when that box was
    pursuers: tuple[int, ...]  # the guards that pursue it, by their places in the team


Team = Sequence[GuardState]
Targets = Mapping[int, TargetState]


class PursuitRule(Protocol):
    """Which guard pursues which target. A class of these is made anew for each trial, and may keep a state.

    It is made of ``(prior_map, rng)`` and its own options, which have defaults: the map, int8, 100 occupied,
    0 free, -1 unknown; the trial's own generator of random numbers.
    """

    def pursue(self, team: Team, targets: Targets, time_s: float) -> Mapping[int, int]:
        """For each guard that is to pursue now, its target; the others patrol.

        It is called at each frame at which there is a target, with every guard, known by its place in
        ``team``, and the tracks of boxes by their numbers, which count up and do not come again.
        """


class TeamPursuit:
    """The chosen pursuit rule; what is wrong with it is said by its name."""

    def __init__(self, name: str, prior_map: OccupancyGrid, rng: np.random.Generator) -> None:
        """``name`` is a pinned value of ``PURSUITS``. Raises PluginError if it cannot be made."""
        self._name = name
        self._rule = PURSUITS.make(WITH_ORACLE if PURSUITS.is_made_here(name) else name, prior_map, rng)

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """See :class:`PursuitRule`. Raises PluginError: it failed, or named what is not there."""

        def refused(what: str) -> PluginError:
            return PURSUITS.refused(self._name, f"pursue gave {what}")

        with PURSUITS.calling(self._name):
            given = self._rule.pursue(team, dict(targets), time_s)
            if not isinstance(given, Mapping):
                raise refused(f"{type(given).__name__}; give a dict, guards to their targets")
            for guard, target in given.items():
                if guard not in range(len(team)):
                    raise refused(f"a guard {guard!r:.40}; there are 0 to {len(team) - 1}")
                if target not in targets:
                    there = ", ".join(map(str, sorted(targets)[:9]))
                    raise refused(f"guard {guard} a target {target!r:.40}; there are {there}")
            return {int(guard): int(target) for guard, target in given.items()}


class Pursuit:
    """Keeps the targets and the guards that pursue each."""

    def __init__(self, guards: Sequence[Guard], settings: PursuitSettings, rule: PursuitRule) -> None:
        """No targets yet; ``guards`` are those that may be sent, by ``rule``."""
        self.targets: dict[int, TargetState] = {}
        self._guards = guards
        self._settings = settings
        self._rule = rule
        self._tracker = Tracker()

    @property
    def pursuers(self) -> list[Guard]:
        """The guards that are after a target now."""
        return [self._guards[i] for known in self.targets.values() for i in known.pursuers]

    def see(self, boxes: Sequence[Box], squares: BoxArray, time_s: float) -> dict[int, Box]:
        """Take a frame's fused boxes; the targets that were seen come back, each with its box.

        ``squares``: (guards, 4) of ``ally_squares``, the area that each guard is believed to cover. A box
        that has any area in common with one is no target, nor the latest place of any (item 78), unless
        ``ignores_allies`` is off. All are in the map frame, metres.
        """
        if self._settings.ignores_allies:
            guards = [Box(*square) for square in squares.tolist()]
            boxes = [box for box in boxes if not any(box.intersection_area(guard) > 0.0 for guard in guards)]
        targets = self._tracker.update([box.center for box in boxes], time_s)
        for target, box in zip(targets, boxes, strict=True):
            self.detected(target, box.center, time_s)
        return dict(zip(targets, boxes, strict=True))

    def detected(self, target: int, place: Point, time_s: float) -> None:
        """A detection at ``place`` was put down to ``target``."""
        known = self.targets.get(target)
        self.targets[target] = TargetState(place, time_s, known.pursuers if known else ())

    def drop(self, target: int) -> None:
        """Give a target up and call its pursuers off."""
        self._tracker.drop(target)
        lost = self.targets.pop(target, None)
        for i in lost.pursuers if lost else ():
            self._guards[i].cancel_goal()

    def update(self, time_s: float) -> None:
        """Give up targets that are lost or not where they should be; send guards out as the rule says."""
        for name in [name for name, known in self.targets.items() if self._is_gone(known, time_s)]:
            self.drop(name)
        if not self.targets:
            return
        self._send(self._rule.pursue([guard.state for guard in self._guards], self.targets, time_s))
        for i, target in _pursuing(self.targets).items():
            guard, place = self._guards[i], self.targets[target].place
            if guard.goal is None or math.dist(guard.goal, place) >= self._settings.retarget_m:
                guard.pursue(place)

    def _send(self, sent: Mapping[int, int]) -> None:
        """Make the guards' targets those of ``sent``, by their places in the team."""
        before = _pursuing(self.targets)
        for i, guard in enumerate(self._guards):
            if i in sent and sent[i] != before.get(i):
                guard.pursue(self.targets[sent[i]].place)
            elif i in before and i not in sent:
                guard.cancel_goal()
        for name, known in self.targets.items():
            pursuers = tuple(i for i, target in sent.items() if target == name)
            self.targets[name] = known._replace(pursuers=pursuers)

    def _is_gone(self, known: TargetState, time_s: float) -> bool:
        unseen_s = time_s - known.seen_s
        if unseen_s > self._settings.timeout_s:
            return True
        # ground truth reports a lost target itself
        looks = self._settings.rule != "oracle" and unseen_s > EMPTY_AFTER_S
        places = (self._guards[i].state.place for i in known.pursuers)
        return looks and any(math.dist(place, known.place) < NEAR_M for place in places)


class Nobody:
    """Guards patrol, whatever they see."""

    def __init__(self, prior_map: OccupancyGrid, rng: np.random.Generator) -> None:
        pass

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """No guard at any time."""
        return {}


class Nearest(Nobody):
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
                key=lambda pair: math.dist(team[pair[0]].place, targets[pair[1]].place),
            )
            sent[guard] = target
            free.remove(guard)
            waiting.remove(target)
        return sent


class All(Nobody):
    """Every guard goes after the target that is nearest to it, and keeps to it until that is gone."""

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """All guards, whatever the time is."""
        sent = _pursuing(targets)
        for guard, state in enumerate(team):
            if guard not in sent:
                gaps_m = {target: math.dist(state.place, known.place) for target, known in targets.items()}
                sent[guard] = min(gaps_m, key=gaps_m.__getitem__)
        return sent


class Assignment(Nobody):
    """As many pairs as there can be with the least total distance, found anew at each frame.

    Kuhn, "The Hungarian method for the assignment problem", Naval Research Logistics Quarterly 2 (1955). A
    guard may be given another target, or be called off for a guard that came nearer.
    """

    def pursue(self, team: Team, targets: Targets, time_s: float) -> dict[int, int]:
        """One target for each guard of the assignment, whatever the time is."""
        from scipy.optimize import linear_sum_assignment  # which other rules need not

        names = list(targets)
        gaps_m = np.array([[math.dist(one.place, targets[name].place) for name in names] for one in team])
        guards, columns = linear_sum_assignment(gaps_m)
        return {guard: names[column] for guard, column in zip(guards.tolist(), columns.tolist(), strict=True)}


def _pursuing(targets: Targets) -> dict[int, int]:
    """Guards that pursue already, with their targets."""
    return {guard: target for target, known in targets.items() for guard in known.pursuers}
