"""Section IV as a whole: what the team sees at one instant becomes one list of boxes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Floats, Pose2D, Scan
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import (
    FREE,
    OCCUPIED,
    BinaryArray,
    BoxArray,
    Crop,
    binary_map,
    bounding_boxes,
    common_occupancy,
    crop_to_prior,
    foreground,
    shrunk,
    with_returns,
)
from midnet_bench.midnet.fusion import TeamBoxes, ally_squares, fuse_team
from midnet_bench.midnet.midnet_settings import MIDNetSettings as MIDNetSettings


@dataclass(frozen=True)
class Observation:
    """What one robot tells MIDNet."""

    pose: Pose2D  # of the robot, map frame, the latest it reports: for Eq. 4 and, as an ally, for Algorithm 2
    costmap: OccupancyGrid  # its local grid map, int8 published costs, axes along those of the map
    scan: Scan | None = None
    """its last one, which MIDNet needs for ``min_returns`` alone; None before the first"""


class Ally(NamedTuple):
    """Another ally, such as a person: a pose and a size, but no costmap."""

    pose: Pose2D  # map frame
    diameter_m: float  # side of the square that it is taken to fill, di of Algorithm 2


@dataclass(frozen=True)
class RobotView:
    """One robot's way through sections IV.A to IV.C.1."""

    crop: Crop  # which cells of the costmap and of the prior map were compared
    a: OccupancyGrid  # A, the local grid of Eq. 1, cropped; as all four uint8 and placed in the map frame
    b: OccupancyGrid  # B, the prior map, cropped
    c: OccupancyGrid  # C of Eq. 5, occupied in both
    d: OccupancyGrid  # D of Eq. 6: 255 where an intruder is, else 0
    found: list[Box]  # around the contours of D
    kept: list[Box]  # without the allies


class Detection(NamedTuple):
    """One box, map frame, and the robot that found it."""

    box: Box
    robot: int  # index in the team


class RemovedAlly(NamedTuple):
    """A robot's box that was taken for an ally."""

    detection: Detection
    ally: int  # index of the robot whose pose it matched
    iou: float  # with that ally's square


@dataclass(frozen=True)
class Explanation:
    """Everything between the costmaps and the detections of one frame."""

    views: list[RobotView]  # of each robot, in index order
    removed: list[RemovedAlly]  # boxes taken for allies, in the order of removal


@dataclass(frozen=True)
class Frame:
    """What MIDNet says at one instant."""

    detections: list[Box]  # fused, map frame, metres
    robots: list[int]  # for each detection, the robot whose box it is
    explanation: Explanation | None = None  # only when asked for


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
        each = [self._detect(observation) for observation in observations]  # IV.A, IV.B
        poses = [observation.pose for observation in observations]
        team = self.team_of([boxes for boxes, _, _ in each], poses, allies)  # IV.C
        explanation = self._explain(each, team) if explain else None
        return Frame(_boxes(team.detections), team.found_by.tolist(), explanation)

    def found_by_each(self, observations: Sequence[Observation]) -> list[BoxArray]:
        """Sections IV.A and IV.B alone: of each robot (n, 4) boxes, map frame, before the team comes in.

        Raises InputError as :meth:`update` does. ``team_of`` makes the team's of it.
        """
        return [self._detect(observation)[0] for observation in observations]

    def team_of(
        self, found: Sequence[BoxArray], poses: Sequence[Pose2D], allies: Sequence[Ally] = ()
    ) -> TeamBoxes:
        """Section IV.C alone, for at least one robot, from the boxes of each and its latest pose."""
        squares = ally_squares(poses, self.settings.ally_diameter_m)
        squares = np.concatenate((squares, *(ally_squares([pose], side_m) for pose, side_m in allies)))
        return fuse_team(found, squares, self.settings)

    def _detect(self, observation: Observation) -> tuple[BoxArray, Crop, tuple[BinaryArray, ...]]:
        """Sections IV.A and IV.B for one robot: boxes, what was compared, and A to D."""
        costmap, settings, prior = observation.costmap, self.settings, self.prior
        crop = crop_to_prior(costmap, prior, observation.pose, settings.align)  # Algorithm 1, Eqs. 2 to 4
        # Eq. 1 is of each cell for itself, so that the order of both steps does not matter
        a = binary_map(crop.of_local(costmap.data), settings.thresh_local, settings.unknown)
        b = crop.of_prior(prior.data)
        c = a if crop.is_empty else common_occupancy(a, b)  # Eq. 5
        d = a if crop.is_empty else foreground(a, c)  # Eq. 6
        boxes = bounding_boxes(d, (crop.x1_gmap, crop.y1_gmap), prior, settings.min_area_cells)  # IV.B.3, B.4
        if settings.min_returns and len(boxes):
            scan = observation.scan
            points = np.empty((0, 2)) if scan is None else scan.returns(math.inf)[1]
            shares = np.ones(len(points)) if scan is None or self._shares is None else self._shares(scan)
            boxes = with_returns(boxes, points, shares, settings.min_returns)
        if settings.deflate_boxes_m > 0.0:
            boxes = shrunk(boxes, settings.deflate_boxes_m)
        return boxes, crop, (a, b, c, d)

    def _explain(
        self, each: Sequence[tuple[BoxArray, Crop, tuple[BinaryArray, ...]]], team: TeamBoxes
    ) -> Explanation:
        """The intermediates with their place in the map frame."""
        every = [Detection(box, robot) for robot, (rows, _, _) in enumerate(each) for box in _boxes(rows)]
        (x_0, y_0), resolution, views = self.prior.origin, self.prior.resolution, []
        for robot, (rows, crop, arrays) in enumerate(each):
            corner = (x_0 + crop.x1_gmap * resolution, y_0 + crop.y1_gmap * resolution)
            a, b, c, d = (OccupancyGrid(data, resolution, corner) for data in arrays)
            kept = [every[k].box for k in team.kept[team.starts[robot] : team.starts[robot + 1]]]
            views.append(RobotView(crop, a, b, c, d, _boxes(rows), kept))
        allies = _boxes(team.squares)
        taken = [(every[k], ally) for ally, k in team.removed.tolist()]
        removed = [RemovedAlly(found, ally, allies[ally].iou(found.box)) for found, ally in taken]
        return Explanation(views, removed)


def _boxes(rows: BoxArray) -> list[Box]:
    return [Box._make(row) for row in rows.tolist()]
