"""Which guard pursues which target (items 53, 54).

A target is a track of MIDNet's boxes. Nobody tells the guards whether there is an intruder behind it, whether
it was caught, or whether two tracks are one intruder.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from midnet_bench.agents.mobile_robot import Guard, Point
from midnet_bench.agents.settings import PursuitSettings
from midnet_bench.agents.tracking import Tracker


@dataclass
class Target:
    """What guards may pursue, as far as MIDNet knows."""

    place: Point
    """centre of its latest box, map frame, metres"""
    seen_s: float
    pursuers: list[Guard] = field(default_factory=list)


NEAR_M = 0.5
EMPTY_AFTER_S = 1.0
"""A target is not there if a pursuer is this near to its place and no box was on it for this long."""


class Pursuit:
    """Keeps the targets and the guards that pursue each."""

    def __init__(self, guards: Sequence[Guard], settings: PursuitSettings) -> None:
        """No targets yet; ``guards`` are those that may be sent."""
        self.targets: dict[int, Target] = {}
        self._guards = guards
        self._settings = settings
        self._tracker = Tracker()

    def see(self, places: Sequence[Point], time_s: float) -> list[int]:
        """Take the centres of a frame's fused boxes, map frame, metres; for each, its target.

        A target is new where its number is higher than all before.
        """
        targets = self._tracker.update(places, time_s)
        for target, place in zip(targets, places, strict=True):
            self.detected(target, place, time_s)
        return targets

    def detected(self, target: int, place: Point, time_s: float) -> None:
        """A detection at ``place`` was put down to ``target``."""
        known = self.targets.setdefault(target, Target(place, time_s))
        known.place, known.seen_s = place, time_s

    def drop(self, target: int) -> None:
        """Give a target up and call its pursuers off."""
        self._tracker.drop(target)
        lost = self.targets.pop(target, None)
        for guard in lost.pursuers if lost else ():
            guard.cancel_goal()

    def update(self, time_s: float) -> None:
        """Give up targets that are lost or not where they should be; send free guards and new goals out."""
        for name in [name for name, known in self.targets.items() if self._is_gone(known, time_s)]:
            self.drop(name)
        if self._settings.rule == "none" or not self.targets:
            return
        for guard, known in self._assignments():
            known.pursuers.append(guard)
            guard.drive_to(known.place)
        for known in self.targets.values():
            for guard in known.pursuers:
                if guard.goal is None or math.dist(guard.goal, known.place) >= self._settings.retarget_m:
                    guard.drive_to(known.place)

    def _is_gone(self, known: Target, time_s: float) -> bool:
        unseen_s = time_s - known.seen_s
        if unseen_s > self._settings.timeout_s:
            return True
        # an oracle would have told
        looks = self._settings.rule != "oracle" and unseen_s > EMPTY_AFTER_S
        return looks and any(_gap(guard, known) < NEAR_M for guard in known.pursuers)

    def _assignments(self) -> list[tuple[Guard, Target]]:
        """Pairs of a guard that patrols and the target it is to pursue, nearest pairs first."""
        busy = {guard.index for known in self.targets.values() for guard in known.pursuers}
        free = [guard for guard in self._guards if guard.index not in busy]
        if self._settings.rule == "all":
            return [
                (guard, min(self.targets.values(), key=lambda known: _gap(guard, known))) for guard in free
            ]
        waiting = [known for known in self.targets.values() if not known.pursuers]
        pairs = []
        while free and waiting:
            guard, known = min(
                ((guard, known) for guard in free for known in waiting), key=lambda pair: _gap(*pair)
            )
            pairs.append((guard, known))
            free.remove(guard)
            waiting.remove(known)
        return pairs


def _gap(guard: Guard, known: Target) -> float:
    return math.dist((guard.pose.x, guard.pose.y), known.place)
