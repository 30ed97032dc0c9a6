"""What can be set of frontier exploration and of the merging of maps; GMapping has a file of its own."""

from dataclasses import dataclass
from typing import ClassVar

from midnet_bench.settings import Settings, option


@dataclass(frozen=True)
class FrontierSettings(Settings):
    """The parameters of explore_lite, and those of the repairs made here."""

    concern: ClassVar[str] = "frontier exploration"

    potential_scale: float = option(
        3.0,
        "Cost per metre of the way to a frontier (from explore_lite's launch files).",
        ge=0,
        le=1000,
        source="package: explore_lite, explore_costmap.launch, potential_scale",
    )
    gain_scale: float = option(
        1.0,
        "Cost taken off per metre of a frontier's length.",
        ge=0,
        le=1000,
        source="package: explore_lite, gain_scale",
    )
    min_frontier_size_m: float = option(
        0.5,
        "Shorter frontiers are left out.",
        ge=0,
        le=100,
        source="package: explore_lite, min_frontier_size",
    )
    progress_timeout_s: float = option(
        30.0,
        "A goal to which the way has not become shorter for this long is given up.",
        ge=0,
        le=36_000,
        source="package: explore_lite, progress_timeout",
    )
    blacklist_half_width_m: float = option(
        0.5,
        "Goals this near to one that was given up, in x and in y, are not tried (explore_lite: 5 cells).",
        ge=0,
        le=100,
        source="ours: explore_lite has 5 cells, 0.25 m",
    )
    second_chances: int = option(
        1,
        "How often the list of given-up goals is emptied when nothing else is left (explore_lite: never).",
        ge=0,
        le=100,
        source="ours: explore_lite never empties its list",
    )
    traversable_below: int = option(
        99,
        "Cells of a published cost from 0 to below this can be driven through; 99 is contact.",
        ge=1,
        le=100,
        source="ours: explore_lite's search follows falling costs alone",
    )
    taken_radius_m: float = option(
        2.0,
        "Goals this near to a team mate's are left to the team mate while there are others.",
        ge=0,
        le=100,
        source="ours: explore_lite knows no other robots",
    )


@dataclass(frozen=True)
class MergeSettings(Settings):
    """When two maps are merged and when they are refused."""

    concern: ClassVar[str] = "map merging"

    min_confidence: float = option(
        0.7,
        "Maps whose features match with less confidence are not merged; of 150 pairs of different buildings "
        "one came to 0.79, the others stayed below 0.66.",
        ge=0,
        le=10,
        source="ours: off unless merge=features; multirobot_map_merge's 1.0 leaves out good pairs",
    )
    max_scale_error: float = option(
        0.02,
        "Maps whose features want a scale farther from 1 are not merged.",
        ge=0,
        source="ours: off unless merge=features",
    )
    min_agreement: float = option(
        0.9,
        "Maps are not merged if less than this share of the wall that lies where both know is shared.",
        ge=0,
        le=1,
        source="ours: off unless merge=features",
    )
    min_overlap: float = option(
        0.25,
        "Maps are not merged if the evidence is less than this share of the wall in the map that has less "
        "of it.",
        source="ours: off unless merge=features",
    )
    max_rival: float = option(
        0.3,
        "Maps are not merged if a placement elsewhere has more than this share of the best one's evidence.",
        ge=0,
        source="ours: off unless merge=features",
    )
