"""Section IV as a whole: what the team sees at one instant becomes one list of boxes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, get_args

import numpy as np

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.binary_map import FREE, OCCUPIED, Unknown, binary_map
from midnet_bench.midnet.cropping import Align, Crop, crop_to_prior
from midnet_bench.midnet.foreground import (
    BinaryArray,
    bounding_boxes,
    common_occupancy,
    find_contours,
    foreground,
)
from midnet_bench.midnet.fusion import (
    AllyRemove,
    RemovedAlly,
    Sighting,
    divide_and_conquer,
    remove_ally_detections,
)


@dataclass(frozen=True)
class MIDNetSettings:
    """What section IV leaves open; the defaults are our readings. Raises InputError when out of range."""

    thresh_local: int = 99
    """thresh of Eq. 1 for local costmaps, 1 to 100 (items 1, 2)"""
    unknown: Unknown = "free"
    """what an unknown cell of a local costmap counts as (item 4)"""
    align: Align = "floor"
    """crop by the robot's pose, Eqs. 2 to 4, or by the costmap's own ``origin`` (item 16)"""
    min_area_cells: int = 1
    """boxes of fewer cells are dropped, >= 1 (item 23)"""
    deflate_boxes_m: float = 0.0
    """taken off each side of a box as soon as it is found, >= 0; changes every later IoU (item 25)"""
    ally_diameter_m: float = 0.297
    """di of Algorithm 2, > 0 (item 27)"""
    iou_ally: float = 0.05
    """t of Algorithm 2, above 0, at most 1 (item 29)"""
    ally_remove: AllyRemove = "first"
    """which boxes of one observer go for one ally (item 30)"""
    iou_fuse: float = 0.1
    """t of Algorithms 3 and 4, above 0, at most 1 (item 29)"""

    def __post_init__(self) -> None:
        self._require("thresh_local", 1 <= self.thresh_local <= 100, "1 to 100")
        self._require("min_area_cells", self.min_area_cells >= 1, "1 or more")
        self._require("deflate_boxes_m", 0.0 <= self.deflate_boxes_m < math.inf, "0 or more")
        self._require("ally_diameter_m", 0.0 < self.ally_diameter_m < math.inf, "more than 0")
        self._require("iou_ally", 0.0 < self.iou_ally <= 1.0, "above 0 and at most 1")
        self._require("iou_fuse", 0.0 < self.iou_fuse <= 1.0, "above 0 and at most 1")
        for key, choices in (("unknown", Unknown), ("align", Align), ("ally_remove", AllyRemove)):
            value = getattr(self, key)
            if value not in get_args(choices):
                raise InputError(
                    f"midnet: {key}: no such choice '{value}'{nearest_name(value, get_args(choices))}"
                )

    def _require(self, key: str, holds: bool, allowed: str) -> None:
        if not holds:
            raise InputError(f"midnet: {key}: {getattr(self, key)} is out of range; allowed: {allowed}")


@dataclass(frozen=True)
class Observation:
    """What one robot tells MIDNet."""

    pose: Pose2D
    """of the robot, map frame, the latest it reports: for Eq. 4 and, as an ally, for Algorithm 2"""
    costmap: OccupancyGrid
    """its local grid map, int8 published costs, axes along those of the map"""


@dataclass(frozen=True)
class RobotView:
    """One robot's way through sections IV.A to IV.C.1."""

    crop: Crop
    """which cells of the costmap and of the prior map were compared"""
    a: OccupancyGrid
    """A, the local grid of Eq. 1, cropped; as all four uint8 and placed in the map frame"""
    b: OccupancyGrid
    """B, the prior map, cropped"""
    c: OccupancyGrid
    """C of Eq. 5, occupied in both"""
    d: OccupancyGrid
    """D of Eq. 6: 255 where an intruder is, else 0"""
    found: list[Box]
    """around the contours of D"""
    kept: list[Box]
    """without the allies"""


@dataclass(frozen=True)
class Explanation:
    """Everything between the costmaps and the detections of one frame."""

    views: list[RobotView]
    """of each robot, in index order"""
    removed: list[RemovedAlly]
    """boxes taken for allies, in the order of removal"""


@dataclass(frozen=True)
class Frame:
    """What MIDNet says at one instant."""

    detections: list[Box]
    """fused, map frame, metres"""
    robots: list[int]
    """for each detection, the robot whose box it is"""
    explanation: Explanation | None = None
    """only when asked for"""


class _Seen(NamedTuple):
    """One robot's intermediates before the team comes in."""

    crop: Crop
    a: BinaryArray
    b: BinaryArray
    c: BinaryArray
    d: BinaryArray
    boxes: list[Box]


class MIDNet:
    """The central bot: a prior map, and settings; it remembers nothing from frame to frame."""

    def __init__(self, prior: OccupancyGrid, settings: MIDNetSettings | None = None) -> None:
        """Keep the prior map, uint8, 0 occupied and 255 free (Eq. 1). Raises InputError for any other."""
        if prior.data.dtype != np.uint8 or not np.isin(prior.data, (OCCUPIED, FREE)).all():
            raise InputError("prior map: must be binary, uint8 of 0 and 255; put it through Eq. 1 first")
        self.prior = prior
        self.settings = settings or MIDNetSettings()

    def update(self, observations: Sequence[Observation], explain: bool = False) -> Frame:
        """The team's detections at this instant, and how they came about if ``explain``.

        Args:
            observations: the last of each robot, in index order: the order decides fusions (item 35).
            explain: whether to keep every intermediate.

        Raises:
            InputError: a costmap's resolution differs from the prior map's.
        """
        if not observations:
            return Frame([], [], Explanation([], []) if explain else None)
        settings = self.settings
        seen = [self._look(observation) for observation in observations]
        allies = remove_ally_detections(
            [observation.pose for observation in observations],
            [[Sighting(box, robot) for box in one.boxes] for robot, one in enumerate(seen)],
            settings.ally_diameter_m,
            settings.iou_ally,
            settings.ally_remove,
        )
        fused = divide_and_conquer(allies.kept, 0, len(observations) - 1, settings.iou_fuse)
        explanation = None
        if explain:
            views = [self._view(one, kept) for one, kept in zip(seen, allies.kept, strict=True)]
            explanation = Explanation(views, allies.removed)
        return Frame(
            [sighting.box for sighting in fused],
            [sighting.robot for sighting in fused],
            explanation,
        )

    def _look(self, observation: Observation) -> _Seen:
        """Sections IV.A and IV.B for one robot."""
        settings, prior, costmap = self.settings, self.prior, observation.costmap
        crop = crop_to_prior(costmap, prior, observation.pose, settings.align)
        local = binary_map(costmap.data, settings.thresh_local, settings.unknown)
        a, b = crop.of_local(local), crop.of_prior(prior.data)
        if crop.is_empty:
            return _Seen(crop, a, b, a, a, [])
        c = common_occupancy(a, b)
        d = foreground(a, c)
        boxes = bounding_boxes(find_contours(d), (crop.x1_gmap, crop.y1_gmap), prior, settings.min_area_cells)
        if settings.deflate_boxes_m > 0.0:
            boxes = [box.shrunk(settings.deflate_boxes_m) for box in boxes]
        return _Seen(crop, a, b, c, d, boxes)

    def _view(self, seen: _Seen, kept: Sequence[Sighting]) -> RobotView:
        """The intermediates with their place in the map frame."""
        resolution = self.prior.resolution
        corner = (
            self.prior.origin[0] + seen.crop.x1_gmap * resolution,
            self.prior.origin[1] + seen.crop.y1_gmap * resolution,
        )
        a, b, c, d = (OccupancyGrid(data, resolution, corner) for data in (seen.a, seen.b, seen.c, seen.d))
        return RobotView(seen.crop, a, b, c, d, seen.boxes, [sighting.box for sighting in kept])
