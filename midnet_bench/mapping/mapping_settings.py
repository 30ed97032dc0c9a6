"""What can be set of frontier exploration and of the merging of maps; GMapping has a file of its own."""

from dataclasses import dataclass

from midnet_bench.settings import Settings, fixed


@dataclass(frozen=True)
class FrontierSettings(Settings):
    """The parameters of explore_lite, and those of the repairs made here."""

    potential_scale: float = fixed(3.0, "package: explore_lite, explore_costmap.launch, potential_scale")
    gain_scale: float = fixed(1.0, "package: explore_lite, gain_scale")
    min_frontier_size_m: float = fixed(0.5, "package: explore_lite, min_frontier_size")
    progress_timeout_s: float = fixed(30.0, "package: explore_lite, progress_timeout")
    blacklist_half_width_m: float = fixed(0.5, "ours: explore_lite has 5 cells, 0.25 m")
    second_chances: int = fixed(1, "ours: explore_lite never empties its list")
    traversable_below: int = fixed(99, "ours: explore_lite's search follows falling costs alone")
    taken_radius_m: float = fixed(2.0, "ours: explore_lite knows no other robots")
    min_gap_m: float = fixed(0.1, "ours: two cells; a gap of one lies within a cell of walls on both sides")
    view_m: float = fixed(1.0, "ours: beams are 1.7 cm apart there, a third of a cell")
    look_radius_m: float = fixed(0.5, "ours: as far as a blacklisted goal counts")


@dataclass(frozen=True)
class MergeSettings(Settings):
    """When two maps are merged and when they are refused."""

    min_confidence: float = fixed(
        0.7, "ours: off unless merge=features; multirobot_map_merge's 1.0 leaves out good pairs"
    )
    max_scale_error: float = fixed(0.02, "ours: off unless merge=features")
    min_agreement: float = fixed(0.9, "ours: off unless merge=features")
    min_overlap: float = fixed(0.25, "ours: off unless merge=features")
    max_rival: float = fixed(0.3, "ours: off unless merge=features")
