"""Section IV as a whole: what the team sees at one instant becomes one list of boxes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import (
    FREE,
    INT8,
    OCCUPIED,
    BinaryArray,
    BoxArray,
    Crop,
    Floats,
    Indices,
    binary_map,
    bounding_boxes,
    common_occupancy,
    crop_to_prior,
    foreground,
    shrunk,
    with_returns,
)
from midnet_bench.midnet.fusion import REMOVE, TeamBoxes, ally_squares, fuse_team
from midnet_bench.midnet.midnet_settings import MIDNetSettings as MIDNetSettings


@dataclass(frozen=True)
class Observation:
    """What one robot tells MIDNet."""

    pose: Pose2D
    """of the robot, map frame, the latest it reports: for Eq. 4 and, as an ally, for Algorithm 2"""
    costmap: OccupancyGrid
    """its local grid map, int8 published costs, axes along those of the map"""
    scan: Scan | None = None
    """its last one, which MIDNet needs for ``min_returns`` alone; None before the first"""


class Ally(NamedTuple):
    """Another ally, such as a person: a pose and a size, but no costmap."""

    pose: Pose2D
    """map frame"""
    diameter_m: float
    """side of the square that it is taken to fill, di of Algorithm 2"""


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


class _Grids(NamedTuple):
    """One robot's intermediates before the team comes in, as in ``RobotView``."""

    crop: Crop
    a: BinaryArray
    b: BinaryArray
    c: BinaryArray
    d: BinaryArray


class MIDNet:
    """The central bot: a prior map, and settings; it remembers nothing from frame to frame."""

    def __init__(
        self,
        prior: OccupancyGrid,
        settings: MIDNetSettings | None = None,
        shares: Callable[[Scan], Floats] | None = None,
    ) -> None:
        """Keep the prior map, uint8, 0 occupied and 255 free (Eq. 1). Raises InputError for any other.

        ``shares``: of a scan, what each return counts for ``min_returns``; ``return_area_m2`` needs it.
        """
        if prior.data.dtype != np.uint8 or not np.isin(prior.data, (OCCUPIED, FREE)).all():
            raise InputError("prior map: must be binary, uint8 of 0 and 255; put it through Eq. 1 first")
        self.prior = prior
        self.settings, self._shares = settings or MIDNetSettings(), shares

    def update(
        self, observations: Sequence[Observation], explain: bool = False, allies: Sequence[Ally] = ()
    ) -> Frame:
        """The team's detections at this instant, and how they came about if ``explain``.

        Args:
            observations: the last of each robot, in index order: the order decides fusions (item 35).
            explain: whether to keep every intermediate.
            allies: others to be removed; they count as robots behind the others, which find nothing.

        Raises:
            InputError: a costmap is not int8, or its resolution differs from the prior map's.
        """
        if not observations:
            return Frame([], [], Explanation([], []) if explain else None)
        grids = [self._grids(observation) for observation in observations]  # IV.A to IV.B.2
        found = [self._boxes(one, seen) for one, seen in zip(grids, observations, strict=True)]  # IV.B.3, B.4
        robots, squares, team = self._fuse(found, [one.pose for one in observations], allies)  # IV.C
        return Frame(
            [Box._make(box) for box in team.detections.tolist()],
            team.found_by.tolist(),
            self._explain(grids, found, robots, squares, team) if explain else None,
        )

    def found_by_each(self, observations: Sequence[Observation]) -> list[BoxArray]:
        """Sections IV.A and IV.B alone: of each robot (n, 4) boxes, map frame, before the team comes in.

        Raises InputError as :meth:`update` does. ``fused`` of this is what ``update`` gives.
        """
        return [self._boxes(self._grids(one), one) for one in observations]

    def fused(self, found: Sequence[BoxArray], poses: Sequence[Pose2D]) -> list[Box]:
        """Section IV.C alone: the team's detections from the boxes of each robot and its latest pose.

        Which settings ``found`` was made by does not matter here, so those of section IV.C can be compared
        on the same boxes.
        """
        if not found:
            return []
        return [Box._make(box) for box in self.team_of(found, poses).detections.tolist()]

    def team_of(
        self, found: Sequence[BoxArray], poses: Sequence[Pose2D], allies: Sequence[Ally] = ()
    ) -> TeamBoxes:
        """As :meth:`fused`, with what Algorithm 2 left and took; at least one robot."""
        _, _, team = self._fuse(found, poses, allies)
        return team

    def _fuse(
        self, found: Sequence[BoxArray], poses: Sequence[Pose2D], allies: Sequence[Ally]
    ) -> tuple[Indices, BoxArray, TeamBoxes]:
        """The robot of each box, each robot's square as an ally, and what is left of the boxes."""
        settings = self.settings
        robots = np.repeat(np.arange(len(found)), [len(own) for own in found])
        squares = ally_squares(poses, settings.ally_diameter_m)
        if allies:
            squares = np.concatenate((squares, *(ally_squares([pose], side_m) for pose, side_m in allies)))
        team = fuse_team(
            np.concatenate(found),
            robots,
            squares,
            settings.iou_ally,
            REMOVE[settings.ally_remove],
            settings.iou_fuse,
        )
        return robots, squares, team

    def _grids(self, observation: Observation) -> _Grids:
        """Sections IV.A, IV.B.1 and IV.B.2 for one robot. Raises InputError: a costmap that is not int8."""
        costmap, settings = observation.costmap, self.settings
        if costmap.data.dtype != INT8:
            raise InputError(
                f"costmap: its values are {costmap.data.dtype}; int8 is needed, as costmap_2d publishes them:"
                " 0 to 100, and -1 where nothing is known"
            )
        crop = crop_to_prior(costmap, self.prior, observation.pose, settings.align)  # Alg. 1, Eqs. 2 to 4
        a = crop.of_local(binary_map(costmap.data, settings.thresh_local, settings.unknown))  # Eq. 1
        b = crop.of_prior(self.prior.data)
        if crop.is_empty:
            return _Grids(crop, a, b, a, a)
        c = common_occupancy(a, b)  # Eq. 5
        return _Grids(crop, a, b, c, foreground(a, c))  # Eq. 6

    def _boxes(self, grids: _Grids, observation: Observation) -> BoxArray:
        """Sections IV.B.3 and IV.B.4 for one robot; then, if asked for, only boxes with returns in them."""
        settings, crop, scan = self.settings, grids.crop, observation.scan
        boxes = bounding_boxes(grids.d, (crop.x1_gmap, crop.y1_gmap), self.prior, settings.min_area_cells)
        if settings.min_returns and len(boxes):
            points = np.empty((0, 2)) if scan is None else scan.returns(math.inf)[1]
            shares = np.ones(len(points)) if scan is None or self._shares is None else self._shares(scan)
            boxes = with_returns(boxes, points, shares, settings.min_returns)
        return shrunk(boxes, settings.deflate_boxes_m) if settings.deflate_boxes_m > 0.0 else boxes

    def _explain(
        self,
        grids: Sequence[_Grids],
        boxes: Sequence[BoxArray],
        robots: Indices,
        squares: BoxArray,
        team: TeamBoxes,
    ) -> Explanation:
        """The intermediates with their place in the map frame."""
        found = [Box._make(box) for own in boxes for box in own.tolist()]
        views = []
        for robot, one in enumerate(grids):
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
