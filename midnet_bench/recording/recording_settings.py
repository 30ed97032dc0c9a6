"""What can be set of a replay: options of MIDNet and of its inputs; the presets ``paper`` and ``real``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from midnet_bench.midnet.midnet_settings import MIDNetSettings, PriorMapSettings
from midnet_bench.navigation.navigation_settings import MIDNET_SOURCES, CostmapSettings
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.robots.model import ROBOTS, RobotModel
from midnet_bench.settings import Scalar, Settings, group, option

Preset = Literal["real", "paper"]

PRESETS: dict[Preset, dict[str, Scalar]] = {
    "paper": {},
    "real": {
        "local_map": "single_scan",
        "local_size_m": 0.0,
        "min_returns": 2,
        "thresh_global": 40,
        "return_area_m2": 0.004,
        "unknown_in_prior": "occupied",
        "align": "origin",
        "ally_remove": "all",
        "ally_diameter_m": 0.42,
        "iou_ally": 0.05,
    },
}
"""values that differ from the defaults, which are those of a trial; ``benchmarks/real_preset.py``
chose ``thresh_global`` and ``return_area_m2`` by the rule that it states"""


@dataclass(frozen=True)
class ReplaySettings(Settings):
    """All that lies between a map, poses and scans and the boxes; see ``DetectorSettings``."""

    detector: str = option(
        "midnet",
        "Detector of boxes: midnet, subtraction, clusters, background, or your own as in a trial.",
        source="paper: IV",
    )
    fusion: str = option(
        "paper",
        "Fusion of the robots' boxes into one list, as in a trial.",
        source="paper: IV.C.2, Algorithms 3 and 4",
    )
    robot: str = option(
        "burger",
        "Robot model, for its footprint and radius: burger, waffle, or your own as in a trial.",
        source="paper: III, Turtlebot3 Burgers",
    )
    deflate_boxes: bool = option(
        False,
        "Shrink each box by what the local costmap's inflation added to it.",
        source="paper: IV.B.4, boxes as boundingRect makes them",
    )
    return_area_m2: float = option(
        0.0,
        "Area off the mapped walls from which on a return counts as one for min_returns, its width times "
        "its depth beyond a margin that grows where returns do not fit the map; 0: each return counts.",
        ge=0,
        le=1,
        source="ours: a wall beside its place on the map covers little; see detectors/detector_node.py",
    )
    local_size_m: float = option(
        3.5,
        "Side of the local costmaps; 0: as much as the obstacle range needs.",
        ge=0,
        le=200,
        source=MIDNET_SOURCES["size_m"],
    )
    prior: PriorMapSettings = group(PriorMapSettings(), "prior map")
    costmap: CostmapSettings = group(
        CostmapSettings(size_m=3.5, raytrace_range_m=3.5, inf_is_valid=True),
        "MIDNet's local costmaps",
        only=(
            *("obstacle_range_m", "raytrace_range_m", "inflation_radius_m", "cost_scaling_factor"),
            *("inscribed_radius_m", "footprint_clearing", "inf_is_valid", "memory", "decay_s"),
        ),
        sources=MIDNET_SOURCES,
    )
    midnet: MIDNetSettings = group(MIDNetSettings(), "MIDNet")

    @classmethod
    def of(cls, preset: Preset, values: Mapping[str, Scalar], resolution_m: float) -> "ReplaySettings":
        """A preset with values set by the user, for a map of this resolution.

        Raises:
            InputError: an unknown key, or a value that is out of range.
        """
        settings = cls.from_flat({**PRESETS[preset], **values})
        model = settings.robot_model
        costmap = replace(settings.costmap, resolution=resolution_m)
        if settings.robot != "burger":
            costmap = costmap.of_robot(model)
        far_m = costmap.obstacle_range_m
        if "raytrace_range_m" not in values:  # a beam clears beyond the range up to which it marks
            costmap = replace(costmap, raytrace_range_m=max(costmap.raytrace_range_m, far_m + 0.5))
        # the range begins at the sensor, within the footprint, and ends with what is inflated there
        beyond_m = model.footprint_reach_m + costmap.inflation_radius_m
        size_m = settings.local_size_m or 2.0 * (far_m + beyond_m)
        return replace(
            settings,
            costmap=replace(costmap, size_m=max(size_m, 1.0)),
            detector=DETECTORS.pinned(settings.detector),
            fusion=FUSIONS.pinned(settings.fusion),
        )

    @property
    def robot_model(self) -> RobotModel:
        """The robot that the recording's are taken to be."""
        return ROBOTS.make(ROBOTS.pinned(self.robot))

    @property
    def local_costmap(self) -> CostmapSettings:
        """Each robot's local costmap."""
        return replace(self.costmap, track_unknown=self.midnet.unknown == "occupied")

    @property
    def prior_costmap(self) -> CostmapSettings:
        """The costmap from which the prior map is cut."""
        return replace(self.costmap, track_unknown=self.prior.unknown == "occupied")

    @property
    def midnet_settings(self) -> MIDNetSettings:
        """What MIDNet works by, the shrinking of boxes included."""
        shrunk_m = self.local_reach_m if self.deflate_boxes else 0.0
        return replace(self.midnet, deflate_boxes_m=shrunk_m, return_area_m2=self.return_area_m2)

    @property
    def local_reach_m(self) -> float:
        """How far about a return cells count as occupied."""
        return self.costmap.reach_m(self.midnet.thresh_local)

    @property
    def prior_reach_m(self) -> float:
        """How far about a mapped wall cells are taken off."""
        return self.costmap.reach_m(self.prior.thresh)

    @property
    def range_m(self) -> float:
        """Up to which an intruder is to be found."""
        return self.costmap.obstacle_range_m

    def in_words(self, increment_rad: float) -> list[str]:
        """What the thresholds mean in metres, a line each, for a LiDAR with beams so far apart."""
        cell_m, reach_m, grown_m = self.costmap.resolution, self.local_reach_m, self.prior_reach_m
        least = self.midnet.min_returns
        side_m = cell_m * (2 * math.floor(reach_m / cell_m + 1e-9) + 1)
        lines = [
            f"a return counts from {grown_m:.2f} m off a mapped wall; cells about it reach {reach_m:.2f} m, "
            f"so the tolerance to errors of pose, map and range is {grown_m - reach_m:.2f} m (cells of "
            f"{cell_m:g} m)",
            f"one return alone makes a box of {side_m:.2f} m; a box needs "
            + (f"{least} returns" if least else "no return of the last scan"),
            f"window {self.costmap.size_m:.3g} m, range {self.range_m:g} m, marks: {self.costmap.memory}",
        ]
        if self.return_area_m2:
            lines.append(
                f"a return counts as one from {self.return_area_m2:g} m2 off the walls on, less where the "
                "wall returns about it are off the map too"
            )
        half_m = self.costmap.size_m / 2.0
        if half_m < self.range_m:
            lines.append(
                f"sees {half_m:g} m ahead although the LiDAR range is {self.range_m:g} m: objects in "
                f"between are missed; try --set local_size_m={2.0 * (self.range_m + 0.5):g}"
            )
        apart_m = self.range_m * abs(increment_rad)
        if self.costmap.memory != "single_scan" and apart_m > cell_m:
            lines.append(
                f"beams are {apart_m:.3f} m apart at {self.range_m:g} m, more than a cell: rays miss marks, "
                "and ghosts remain; --set local_map=single_scan leaves none"
            )
        return lines
