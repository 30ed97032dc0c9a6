"""Which guard pursues which detected intruder (items 53, 54)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from midnet_bench.agents.mobile_robot import Guard, Point
from midnet_bench.agents.settings import PursuitSettings


@dataclass
class Target:
    """An intruder that was detected, as far as MIDNet knows."""

    place: Point
    """centre of the latest box on it, map frame, metres"""
    seen_s: float
    pursuers: list[Guard] = field(default_factory=list)


class Pursuit:
    """Keeps the targets and the guards that pursue each."""

    def __init__(self, guards: Sequence[Guard], settings: PursuitSettings) -> None:
        """No targets yet; ``guards`` are those that may be sent."""
        self.targets: dict[int, Target] = {}
        self._guards = guards
        self._settings = settings

    def detected(self, target: int, place: Point, time_s: float) -> None:
        """A detection at ``place`` was put down to ``target``."""
        known = self.targets.setdefault(target, Target(place, time_s))
        known.place, known.seen_s = place, time_s

    def drop(self, target: int) -> None:
        """Call the pursuers of a target off, which was caught or escaped."""
        lost = self.targets.pop(target, None)
        for guard in lost.pursuers if lost else ():
            guard.cancel_goal()

    def update(self, time_s: float) -> None:
        """Give up targets that were not detected for too long, then send free guards and new goals out."""
        for target in [
            name for name, known in self.targets.items() if time_s - known.seen_s > self._settings.timeout_s
        ]:
            self.drop(target)
        if self._settings.rule == "none" or not self.targets:
            return
        for guard, known in self._assignments():
            known.pursuers.append(guard)
            guard.drive_to(known.place)
        for known in self.targets.values():
            for guard in known.pursuers:
                if guard.goal is None or math.dist(guard.goal, known.place) >= self._settings.retarget_m:
                    guard.drive_to(known.place)

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
