"""What the labyrinth test lets a user set."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

from midnet_bench.agents.settings import PursuitSettings
from midnet_bench.arena.free_space import doors
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.inputs import arena_from
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.rivals.seams import PURSUITS
from midnet_bench.settings import group, like, option


@dataclass(frozen=True)
class LabyrinthParameters(GuardParameters):
    """Map 2, section V.B: who is caught before he escapes."""

    recorded: ClassVar[tuple[str, ...] | None] = (
        *(GuardParameters.recorded or ()),
        "intruders",
        "capture",
        "capture_distance_m",
        "pursuit",
        "pursuit_timeout_s",
        "evasion",
        "flee_radius_m",
        "escape_distance_m",
        "escape_radius_m",
        "time_limit_s",
    )

    arena: str = like(GuardParameters, "arena", "map2")
    intruders: int = option(1, "Number of mobile intruders.", ge=1, le=20)
    capture: Literal["within", "detected", "contact"] = option(
        "within",
        "When a detected intruder is caught: when a guard is within capture_distance_m and no wall between "
        "them (within), at once (detected), or when a guard touches it (contact).",
    )
    capture_distance_m: float = option(
        0.5,
        "Distance from guard to intruder, centre to centre, at which capture: within catches.",
        gt=0,
        le=5,
    )
    after_capture: Literal["leaves", "drives_on"] = option(
        "leaves",
        "What a caught intruder does: it leaves the arena (leaves), or goes on to its escape as a caught one "
        "and keeps the trial going (drives_on).",
    )
    intruder_wait_s: float = option(
        0.0, "How long intruders stand at their starts before they set out.", ge=0, le=600
    )
    evasion: Literal["none", "flee"] = option(
        "none",
        "What an intruder does when a guard comes near: nothing (none), or flee to where no guard is (flee).",
    )
    flee_radius_m: float = option(
        1.5, "Distance of a guard at which evasion: flee makes an intruder flee.", gt=0, le=10
    )
    escape_distance_m: float = option(
        12.0, "Least distance from an intruder's start to its escape, in a straight line.", ge=0, le=100
    )
    escape_at: Literal["anywhere", "doors"] = option(
        "anywhere",
        "Where intruders escape to: any free point inside the walls (anywhere), or the middle of a gap in "
        "the outer wall (doors), the farthest if none is escape_distance_m away.",
    )
    escape_radius_m: float = option(
        0.3, "An intruder has escaped when it is this near to its escape.", gt=0, le=5
    )
    time_limit_s: float = option(
        600.0, "Simulated time after which a trial ends with intruders still at large.", gt=0, le=36_000
    )
    ends: Literal["nobody_left", "time_limit"] = option(
        "nobody_left",
        "When a trial ends: when no intruder is left in the arena or the time is up (nobody_left), or only "
        "when the time is up (time_limit).",
    )
    pursuit: PursuitSettings = group(PursuitSettings(), "pursuit")

    @property
    def effort(self) -> float:
        """See :class:`Parameters`: each robot costs time, and more intruders take longer to catch."""
        return (self.robots + self.intruders) * math.sqrt(self.intruders)

    @property
    def simulated_s(self) -> float:
        """About how long a trial lasts, simulated seconds: 84 in the mean of the packaged campaign."""
        return self.time_limit_s if self.ends == "time_limit" else min(84.0, self.time_limit_s)

    def with_files_read(self) -> Self:
        """See :class:`Parameters`; the arena has doors if intruders escape by them."""
        read = super().with_files_read()
        if arena_from(read.arena).has_deeds:
            raise InputError(
                "arena: the labyrinth's intruders are Burgers on their way out: leave out other_intruders, "
                "and behaviour and pause_s of mobile_intruders; 'detection' knows them"
            )
        if read.escape_at == "doors":
            doors(arena_from(read.arena))
        return replace(read, pursuit=replace(read.pursuit, rule=PURSUITS.pinned(read.pursuit.rule)))
