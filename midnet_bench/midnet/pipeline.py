"""Section IV as a whole: what the team sees at one instant becomes one list of boxes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.binary_map import FREE, INT8, OCCUPIED, binary_map
from midnet_bench.midnet.detection import (
    BinaryArray,
    BoxArray,
    Crop,
    Indices,
    bounding_boxes,
    common_occupancy,
    crop_to_prior,
    foreground,
    shrunk,
)
from midnet_bench.midnet.fusion import REMOVE, TeamBoxes, ally_squares, fuse_team
from midnet_bench.midnet.settings import MIDNetSettings as MIDNetSettings


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


class Detection(NamedTuple):
    """One box, map frame, and the robot that found it."""

    box: Box
    robot: int
    """index in the team"""


class RemovedAlly(NamedTuple):
    """A robot's box that was taken for an ally."""

    detection: Detection
    ally: int
    """index of the robot whose pose it matched"""
    iou: float
    """with that ally's square"""


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
    boxes: BoxArray


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
            InputError: a costmap is not int8, or its resolution differs from the prior map's.
        """
        if not observations:
            return Frame([], [], Explanation([], []) if explain else None)
        settings = self.settings
        seen: list[_Seen] = []
        found: list[BoxArray] = []
        for observation in observations:
            one = self._look(observation)
            found.append(one.boxes)
            if explain:  # else the next robot's grids take the memory of these, which is still in the cache
                seen.append(one)
        boxes = np.concatenate(found)
        robots = np.repeat(np.arange(len(found)), [len(own) for own in found])
        squares = ally_squares([observation.pose for observation in observations], settings.ally_diameter_m)
        team = fuse_team(
            boxes, robots, squares, settings.iou_ally, REMOVE[settings.ally_remove], settings.iou_fuse
        )
        return Frame(
            [Box._make(box) for box in team.detections.tolist()],
            team.found_by.tolist(),
            self._explain(seen, robots, squares, team) if explain else None,
        )

    def _look(self, observation: Observation) -> _Seen:
        """Sections IV.A and IV.B for one robot."""
        settings, prior, costmap = self.settings, self.prior, observation.costmap
        if costmap.data.dtype != INT8:
            raise InputError(
                f"costmap: its values are {costmap.data.dtype}; int8 is needed, as costmap_2d publishes them:"
                " 0 to 100, and -1 where nothing is known"
            )
        crop = crop_to_prior(costmap, prior, observation.pose, settings.align)
        local = binary_map(costmap.data, settings.thresh_local, settings.unknown)
        a, b = crop.of_local(local), crop.of_prior(prior.data)
        if crop.is_empty:
            return _Seen(crop, a, b, a, a, np.empty((0, 4)))
        c = common_occupancy(a, b)
        d = foreground(a, c)
        boxes = bounding_boxes(d, (crop.x1_gmap, crop.y1_gmap), prior, settings.min_area_cells)
        if settings.deflate_boxes_m > 0.0:
            boxes = shrunk(boxes, settings.deflate_boxes_m)
        return _Seen(crop, a, b, c, d, boxes)

    def _explain(
        self, seen: Sequence[_Seen], robots: Indices, squares: BoxArray, team: TeamBoxes
    ) -> Explanation:
        """The intermediates with their place in the map frame."""
        found = [Box._make(box) for one in seen for box in one.boxes.tolist()]
        views = []
        for robot, one in enumerate(seen):
            crop, resolution = one.crop, self.prior.resolution
            corner = (
                self.prior.origin[0] + crop.x1_gmap * resolution,
                self.prior.origin[1] + crop.y1_gmap * resolution,
            )
            a, b, c, d = (OccupancyGrid(data, resolution, corner) for data in (one.a, one.b, one.c, one.d))
            own = [found[k] for k in np.flatnonzero(robots == robot)]
            kept = [found[k] for k in team.kept[team.starts[robot] : team.starts[robot + 1]]]
            views.append(RobotView(crop, a, b, c, d, own, kept))
        removed = []
        for ally, k in team.removed.tolist():
            share = Box._make(squares[ally].tolist()).iou(found[k])
            removed.append(RemovedAlly(Detection(found[k], int(robots[k])), ally, share))
        return Explanation(views, removed)
