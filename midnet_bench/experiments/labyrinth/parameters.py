"""What the labyrinth test lets a user set."""

import math
from dataclasses import dataclass, replace
from typing import Literal, Self

from midnet_bench.agents.agent_settings import PURSUITS, PursuitSettings
from midnet_bench.arena.arena import Arena
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, doors, free_space, widest_pair_m
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded import parameters as guarded
from midnet_bench.experiments.guarded.inputs import arena_from
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.geometry import Point
from midnet_bench.settings import group, like, option

DOOR_M = 0.6  # from a door to floor that guards reach, at most


@dataclass(frozen=True)
class LabyrinthParameters(GuardParameters):
    """Map 2, section V.B: which intruders are caught before they escape."""

    arena: str = like(GuardParameters, "arena", "map2", source="paper: III, Map 2; the walls inside are ours")
    intruders: int = option(
        1, "Number of mobile intruders.", ge=1, le=20, source="paper: V.B, 1 to 5 intruders"
    )
    capture: Literal["within", "detected", "contact"] = option(
        "within",
        "When a detected intruder is caught: when a guard is within capture_distance_m and no wall "
        "between them (within), at once (detected), or when a guard touches it (contact).",
        source="ours: V.B counts caught intruders and does not say when one is",
    )
    capture_distance_m: float = option(
        0.5,
        "Distance from guard to intruder, centre to centre, at which capture: within catches.",
        gt=0,
        le=5,
        source="ours: V.B does not say when an intruder is caught",
    )
    after_capture: Literal["leaves", "drives_on"] = option(
        "leaves",
        "What a caught intruder does: it leaves the arena (leaves), or goes on to its escape as a "
        "caught one and keeps the trial going (drives_on).",
        source="ours: V.B does not say what a caught intruder does",
    )
    intruder_wait_s: float = option(
        0.0,
        "How long intruders stand at their starts before they set out.",
        ge=0,
        le=600,
        source="ours: off, V.B has no wait",
    )
    evasion: Literal["none", "flee"] = option(
        "none",
        "What an intruder does when a guard comes near: nothing (none), or flee to where no guard is (flee).",
        source="ours: off, V.B has no evasion",
    )
    flee_radius_m: float = option(
        1.5,
        "Distance of a guard at which evasion: flee makes an intruder flee.",
        gt=0,
        le=10,
        source="ours: off unless evasion=flee",
    )
    escape_distance_m: float = option(
        12.0,
        "Least distance from an intruder's start to its escape, in a straight line.",
        ge=0,
        le=100,
        source="paper: V.B, at least 12 m",
    )
    escape_at: Literal["anywhere", "doors"] = option(
        "anywhere",
        "Where intruders escape to: any free point inside the walls (anywhere), or the middle of a "
        "gap in the outer wall (doors), the farthest if none is escape_distance_m away.",
        source="paper: V.B, random escape locations",
    )
    at_escape: Literal["leaves", "drives_on"] = option(
        "leaves",
        "What an intruder does at its escape: it has escaped and leaves the arena (leaves), or drives on to "
        "one random free place after another, until it is caught or the time is up (drives_on).",
        source="paper: V.B, intruders escape",
    )
    start_at: str = option(
        "anywhere",
        "Where intruders start: any free place (anywhere), the middle of a gap in the outer wall "
        "(doors), or one of these places: (X,Y) in metres, with spaces between them.",
        source="paper: V.B, spawned at different locations",
    )
    escape_radius_m: float = option(
        0.3,
        "An intruder has escaped when it is this near to its escape.",
        gt=0,
        le=5,
        source="ours: V.B gives no number",
    )
    time_limit_s: float = option(
        600.0,
        "Simulated time after which a trial ends with intruders still at large.",
        gt=0,
        le=36_000,
        source="ours: V.B has no limit",
    )
    ends: Literal["nobody_left", "time_limit"] = option(
        "nobody_left",
        "When a trial ends: when no intruder is left in the arena or the time is up (nobody_left), or"
        " only when the time is up (time_limit).",
        source="ours: V.B does not say when a trial ends",
    )
    pursuit: PursuitSettings = group(PursuitSettings(), "pursuit")

    @property
    def entrances(self) -> list[Point]:
        """The places that ``start_at`` names, metres, map frame; none if intruders start anywhere.

        Raises:
            InputError: no such place, the outer wall has no gap, or there are fewer places than intruders.
        """
        if self.start_at == "anywhere":
            return []
        arena = arena_from(self.arena)
        floor = free_space(arena, arena.mobile_intruders.clearance_m)
        if self.start_at == "doors":
            found = doors(arena, "start_at")
            closed = [at for at in found if floor.distance_to(*at) > DOOR_M]
        else:
            found = [_place(text) for text in self.start_at.split()]
            closed = [at for at in found if not floor.contains(*at)]
        if closed:
            x, y = closed[0]
            raise InputError(f"start_at: ({x:g}, {y:g}) is in a wall, near one, or no robot comes there")
        if len(found) < self.intruders:
            raise InputError(
                f"start_at: {len(found)} places for {self.intruders} intruders; name more of them"
            )
        return found

    @property
    def effort(self) -> float:
        """See :class:`Parameters`: each robot costs time, and more intruders take longer to catch."""
        return (self.robots + self.intruders) * math.sqrt(self.intruders)

    def _check_size(self, arena: Arena) -> None:
        """Refuse an arena in which no escape can be far enough from any start. Raises InputError."""
        usual = type(self).usual()
        if self.arena == usual.arena and self.escape_distance_m <= usual.escape_distance_m:
            return  # known to be large enough, and to look takes a while
        clearance_m = max(GOAL_CLEARANCE_M, self.simulation.robot_model.footprint_reach_m)
        widest_m = widest_pair_m(arena, clearance_m)
        if widest_m < self.escape_distance_m:
            name = arena.name if self.arena.startswith("{") else self.arena
            raise InputError(
                f"{name} cannot hold the labyrinth test: no two free points are {self.escape_distance_m:g} m "
                f"apart (the widest pair is {widest_m:.1f} m); set escape_distance_m below "
                f"{math.floor(widest_m)}"
            )

    @property
    def simulated_s(self) -> float:
        """About how long a trial lasts, simulated seconds: 112 in the mean of the packaged campaign."""
        is_long = self.ends == "time_limit" or self.at_escape == "drives_on"
        return self.time_limit_s if is_long else min(112.0, self.time_limit_s)

    def with_files_read(self) -> Self:
        """See :class:`Parameters`; the arena has doors if intruders escape by them."""
        read = super().with_files_read()
        if arena_from(read.arena).has_behaviours:
            raise InputError(
                "arena: the labyrinth's intruders are Burgers on their way out: leave out other_intruders, "
                "and behaviour and pause_s of mobile_intruders; 'detection' knows them"
            )
        read.entrances  # noqa: B018 - raises InputError
        if read.escape_at == "doors":
            doors(arena_from(read.arena))
        else:
            self._check_size(arena_from(read.arena))
        return replace(read, pursuit=replace(read.pursuit, rule=PURSUITS.pinned(read.pursuit.rule)))


def result_key(parameters: LabyrinthParameters) -> LabyrinthParameters:
    """What a trial's numbers depend on; see :func:`guarded.parameters.result_key`.

    ``ally_diameter_m`` counts for one guard too, whose own square keeps boxes from its pursuit (item 78).
    """
    pursuit, key = parameters.pursuit, guarded.result_key(parameters)
    if pursuit.rule == "oracle":
        return key.but(pursuit=pursuit.but(ignores_allies=True))
    if not pursuit.ignores_allies:
        return key
    return key.but(midnet=key.midnet.but(ally_diameter_m=parameters.midnet.ally_diameter_m))


def _place(text: str) -> Point:
    """``X,Y``. Raises InputError."""
    try:
        x, y = map(float, text.strip("()").split(","))
    except ValueError as error:
        raise InputError(
            f"start_at: '{text}': anywhere, doors, or places (X,Y) with spaces between"
        ) from error
    if not math.isfinite(x + y):
        raise InputError(f"start_at: '{text}': finite numbers are needed")
    return x, y
