"""What the labyrinth test lets a user set."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from midnet_bench.agents.settings import PursuitSettings
from midnet_bench.experiments.guarded.parameters import GuardParameters
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
    escape_radius_m: float = option(
        0.3, "An intruder has escaped when it is this near to its escape.", gt=0, le=5
    )
    time_limit_s: float = option(
        600.0, "Simulated time after which a trial ends with intruders still at large.", gt=0, le=36_000
    )
    pursuit: PursuitSettings = group(PursuitSettings(), "pursuit")

    @property
    def effort(self) -> float:
        """See :class:`Parameters`: each robot costs time, and more intruders take longer to catch."""
        return (self.robots + self.intruders) * self.intruders**0.5
