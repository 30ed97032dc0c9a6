"""What the test of large teams lets a user set."""

from dataclasses import dataclass, replace
from typing import Self

from midnet_bench.io.parameters import Parameters
from midnet_bench.midnet.settings import MIDNetSettings
from midnet_bench.rivals.seams import FUSIONS
from midnet_bench.settings import group, option


@dataclass(frozen=True)
class ScaleParameters(Parameters):
    """Scenes of boxes as dense as Map 1 with five guards, whatever the team's size."""

    robots: int = option(5, "Number of security robots.", ge=1, le=200)
    fusion: str = option(
        "paper",
        "Who makes one list of the guards' boxes, as in the detection test; one that remembers earlier "
        "frames finds nothing to remember, since each scene is a new one.",
    )
    frames: int = option(20, "Number of scenes.", ge=1, le=100_000)
    orders: int = option(
        5, "Orders of the robots, beside their own, in which each scene is fused again.", ge=0, le=1000
    )
    window_m: float = option(
        3.0, "Side of the square around a robot in which it sees; that of MIDNet's costmap.", gt=0, le=20
    )
    pose_error_m: float = option(
        0.02, "Standard deviation of each coordinate of a robot's believed place.", ge=0, le=1
    )
    midnet: MIDNetSettings = group(
        MIDNetSettings(),
        "MIDNet",
        keys={"thresh_local": None, "unknown": None, "align": None, "min_area_cells": None},
    )

    @property
    def effort(self) -> float:
        """See :class:`Parameters`."""
        return float(self.robots * self.robots)

    @property
    def expected_wall_s(self) -> float:
        """See :class:`Parameters`: 0.3 s for one robot and 19 s for 200, of 20 frames each."""
        return 0.3 + 0.0005 * self.robots * self.robots * self.frames / 20.0

    def with_files_read(self) -> Self:
        """See :class:`Parameters`: the fusion with its pin."""
        return replace(self, fusion=FUSIONS.pinned(self.fusion))
