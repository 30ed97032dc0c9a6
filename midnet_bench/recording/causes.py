"""Why a recording's labels were missed and what its boxes are made of, from scans, map and poses alone.

A recording has no truth as a simulation has. So these causes are what the data itself shows: where the
returns near a label ended, and what is in a box.
"""

import math
import pickle
from collections.abc import Iterator, Sequence
from typing import IO, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.assembly.detector_node import DetectorNode
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid, cells_of
from midnet_bench.localization.scan_to_map import ScanToMap
from midnet_bench.messages import Scan
from midnet_bench.midnet.detection import bounding_boxes
from midnet_bench.midnet.pipeline import Frame, RobotView
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import ReplayFrame
from midnet_bench.recording.settings import ReplaySettings
from midnet_bench.recording.truth import Label, Labels
from midnet_bench.scoring.error_causes import RECORDED_MISSES

Floats = npt.NDArray[np.float64]

NEAR_M = 0.35
"""how far a declared ally or a displaced box may lie from where its pose is"""
WALL_M = 0.15
"""beyond the cells that the prior map's walls were grown by, a return this far off a wall may still be its"""


class ErrorRow(NamedTuple):
    """One error of a frame."""

    frame: int
    time_s: float
    kind: str
    """miss, false, fragment; box in a frame without labels"""
    cause: str
    name: str
    """of the label, if it has to do with one"""
    x: float
    """map frame, metres: of the label, or the middle of the box"""
    y: float
    width_m: float
    height_m: float
    returns: int
    """near the label or in the box, of the last scans"""
    age_s: float
    """of the newest return there, of a ghost; of the ally's pose; 0 otherwise"""
    offset_m: float
    """to the nearest mapped wall, of a box; to the nearest box, of a miss"""


class Surroundings(NamedTuple):
    """What a map has about n points."""

    wall_m: Floats
    """(n,) metres to the nearest mapped wall; inf off the map"""
    unknown: npt.NDArray[np.bool_]
    """(n,) whether the map knows nothing there, or ends before"""


MOST_RECENT = 20
"""scans whose surroundings are kept: one of each robot"""


class Explainer:
    """Finds the causes of errors, scan by scan, and keeps them until the whole recording is known."""

    def __init__(
        self,
        preset: str,
        prior_map: OccupancyGrid,
        node: DetectorNode,
        settings: ReplaySettings,
        counts: RayCounts,
        kept: IO[bytes],
    ) -> None:
        """Of one detector, by ray counts that may serve several.

        ``kept``: an empty file for its rows. A recording may last for hours: rows wait there for the
        causes that its end decides.
        """
        self._preset, self._map, self._node, self._settings = preset, prior_map, node, settings
        self.counts = counts
        shape = (prior_map.height, prior_map.width)
        solid = (prior_map.data == 100).astype(np.uint8)
        if solid.any():
            away = cv2.distanceTransform(1 - solid, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            self._wall_m = away.astype(np.float64) * prior_map.resolution
        else:
            self._wall_m = np.full(shape, math.inf)
        self._matcher: ScanToMap | None = None
        self._matched: dict[int, tuple[Scan, Pose2D | None]] = {}
        """robot -> its last scan that was matched to the map, and the pose that came of it"""
        self._recent: list[tuple[Floats, Surroundings]] = []
        """of the last scans' returns, which each box needs"""
        self._kept = kept

    def surroundings(self, returns: Floats) -> Surroundings:
        """What the map has about each of a scan's (n, 2) returns; worked out once for each scan."""
        for points, known in reversed(self._recent):
            if points is returns:
                return known
        known = self._surroundings(returns)
        self._recent = [*self._recent[-MOST_RECENT:], (returns, known)]
        return known

    def _surroundings(self, points: Floats) -> Surroundings:
        cells = cells_of(self._map, points)
        on = self._on_map(cells)
        columns, rows = cells[on].T
        wall_m, unknown = np.full(len(points), math.inf), np.ones(len(points), np.bool_)
        wall_m[on] = self._wall_m[rows, columns]
        unknown[on] = self._map.data[rows, columns] < 0
        return Surroundings(wall_m, unknown)

    def wall_distances(self, points: Floats) -> Floats:
        """(n,) metres from (n, 2) points to the nearest mapped wall; inf off the map."""
        return self._surroundings(points).wall_m

    def _on_map(self, cells: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
        return np.asarray(
            (cells >= 0).all(axis=1) & (cells[:, 0] < self._map.width) & (cells[:, 1] < self._map.height)
        )

    def misses(
        self, frame: ReplayFrame, labels: Sequence[Label], missed: Sequence[int], near_m: float
    ) -> None:
        """Add a row for each missed label, by index, that a return lies near."""
        view = None
        for index in missed:
            label = labels[index]
            if view is None:
                view = self._node.midnet.update(
                    frame.outputs[self._preset].observations, explain=True, allies=frame.fresh_allies
                )
            cause, returns = self._miss_stage(frame, label, near_m, view)
            nearest_m = min(
                (
                    box.distance_to_point(label.x, label.y)
                    for box in frame.outputs[self._preset].frame.detections
                ),
                default=math.inf,
            )
            self._keep(
                ErrorRow(
                    frame.number,
                    frame.time_ns / 1e9,
                    "miss",
                    cause,
                    label.name,
                    label.x,
                    label.y,
                    0.0,
                    0.0,
                    returns,
                    0.0,
                    nearest_m,
                )
            )

    def _miss_stage(self, frame: ReplayFrame, label: Label, near_m: float, view: Frame) -> tuple[str, int]:
        """The last stage that returns near a label reached with any robot, and their number."""
        assert view.explanation is not None
        boxes = frame.outputs[self._preset].frame.detections
        if _near(boxes, label, near_m):
            return "merged", returns_near(frame, label, near_m)
        if self._settings.detector != "midnet":  # its stages are not known
            return "not_detected", returns_near(frame, label, near_m)
        stages, total = ["beyond_range"], 0
        for one, robot in zip(frame.observed, view.explanation.views, strict=True):
            if one.scan is not None:
                points = off_walls(self, near(one.returns, label, near_m))
                total += len(points)
                stages.append(self._stage(one.robot, one.scan, points, robot, label, near_m))
        return max(stages, key=list(RECORDED_MISSES).index), total

    def _stage(
        self, robot: int, scan: Scan, points: Floats, view: RobotView, label: Label, near_m: float
    ) -> str:
        """The stage at which one robot loses the (n, 2) returns near a label, map frame."""
        sensor = scan.pose.compose(scan.lidar.mount)
        apart = np.hypot(points[:, 0] - sensor.x, points[:, 1] - sensor.y)
        points = points[apart <= self._settings.range_m]
        if not len(points):
            return "beyond_range"
        costmap = self._node.costmaps[robot]
        side_m, (x0, y0) = costmap.settings.size_m, costmap.origin
        points = points[(points >= (x0, y0)).all(axis=1) & (points < (x0 + side_m, y0 + side_m)).all(axis=1)]
        if not len(points):
            return "outside_window"
        prior = self._node.prior
        cells = cells_of(prior, points)
        on = (cells >= 0).all(axis=1) & (cells[:, 0] < prior.width) & (cells[:, 1] < prior.height)
        if not on.any():
            return "outside_prior"
        if not self._is_left(view.d, points[on], math.ceil(self._settings.local_reach_m / prior.resolution)):
            on_map = cells_of(self._map, points)
            on_map = on_map[self._on_map(on_map)]
            unknown = self._map.data[on_map[:, 1], on_map[:, 0]] < 0
            is_unknown = self._settings.prior.unknown == "occupied" and unknown.mean() > 0.5
            return "unknown_cells" if is_unknown else "under_prior"
        if _near(view.kept, label, near_m):
            return "dropped_by_fusion"
        if _near(view.found, label, near_m):
            return "taken_for_ally"
        corner = [round((view.d.origin[k] - prior.origin[k]) / prior.resolution) for k in (0, 1)]
        contours = bounding_boxes(view.d.data, (corner[0], corner[1]), prior).tolist()
        grown = _near([Box._make(box) for box in contours], label, near_m)
        if not grown:
            return "displaced"
        midnet, free = self._settings.midnet, np.count_nonzero(prior.data[cells[on, 1], cells[on, 0]])
        if midnet.min_returns and free < midnet.min_returns <= len(points):
            return "under_prior"  # which leaves a rim of what was inflated, without its returns
        largest = max(self._cells_of(box, prior) for box in grown)
        is_small = largest < midnet.min_area_cells or not midnet.min_returns
        return "too_small" if is_small else "too_few_returns"

    @staticmethod
    def _cells_of(box: Sequence[float], prior: OccupancyGrid) -> int:
        """At most so many cells has the blob in a box."""
        return round((box[2] - box[0]) / prior.resolution) * round((box[3] - box[1]) / prior.resolution)

    @staticmethod
    def _is_left(d: OccupancyGrid, points: Floats, reach: int) -> bool:
        """Whether a cell within ``reach`` cells of a point is left in D."""
        for column, row in cells_of(d, points).tolist():
            part = d.data[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
            if part.any():
                return True
        return False

    def boxes(
        self,
        frame: ReplayFrame,
        wrong: Sequence[int],
        labels: Labels | None,
        truth_of: Sequence[int | None],
        touched: Sequence[Sequence[int]],
        distance_m: float,
    ) -> None:
        """Add a row for each box, by index, that is no label's own."""
        for index in wrong:
            box = frame.outputs[self._preset].frame.detections[index]
            kind = "false" if labels is not None else "box"
            name = ""
            returns, about = self._in_box(frame, box)
            offset_m = middle(about.wall_m)
            age_s = 0.0
            if labels is not None and touched[index]:
                kind, cause, name = "fragment", "fragment", labels.there[touched[index][0]].name
            else:
                cause, age_s, name = self._false_positive_source(frame, box, about, labels, distance_m)
            may_stay = cause in ("unlabelled", "near_wall", "unknown_cells", "single_return")
            self._keep(
                ErrorRow(
                    frame.number,
                    frame.time_ns / 1e9,
                    kind,
                    cause,
                    name,
                    *box.center,
                    box.x_max - box.x_min,
                    box.y_max - box.y_min,
                    len(returns),
                    age_s,
                    offset_m,
                ),
                returns if may_stay and len(returns) else None,
            )

    def _false_positive_source(
        self,
        frame: ReplayFrame,
        box: Box,
        about: Surroundings,
        labels: Labels | None,
        distance_m: float,
    ) -> tuple[str, float, str]:
        """Cause, age in seconds, and the name of its label, ally or robot."""
        for label in labels.gaps if labels else ():
            if box.distance_to_point(label.x, label.y) <= distance_m:
                return "label_gap", 0.0, label.name
        for plan, estimate in frame.allies:
            if estimate is None:
                continue
            late = estimate.pose not in [ally.pose for ally in frame.fresh_allies]
            reach_m = plan.diameter_m / 2.0 + NEAR_M + min(estimate.age_s, 2.0) * late
            if box.distance_to_point(estimate.pose.x, estimate.pose.y) <= reach_m:
                return ("ally_late" if late else "ally_left"), estimate.age_s, plan.name
        for one in frame.observed:
            if (
                len(frame.observed) > 1
                and box.distance_to_point(one.estimate.pose.x, one.estimate.pose.y) <= NEAR_M
            ):
                return "ally_left", one.estimate.age_s, f"robot {one.robot + 1}"
        for label in labels.there if labels else ():
            if box.distance_to_point(label.x, label.y) <= distance_m + NEAR_M:
                return "displaced", 0.0, label.name
        if not len(about.wall_m):
            newest_s = self.counts.newest_hit_s((box.x_min, box.y_min), (box.x_max, box.y_max))
            return (
                "ghost",
                max(frame.time_ns / 1e9 - newest_s, 0.0) if math.isfinite(newest_s) else math.inf,
                "",
            )
        if len(about.wall_m) == 1:
            return "single_return", 0.0, ""
        if np.count_nonzero(about.unknown) > 0.5 * len(about.unknown):
            return "unknown_cells", 0.0, ""
        near_m = self._settings.prior_reach_m + WALL_M
        if middle(about.wall_m) <= near_m:
            return ("pose_error" if self._better_pose_corrects(frame, box) else "near_wall"), 0.0, ""
        return "unlabelled", 0.0, ""

    def _in_box(self, frame: ReplayFrame, box: Box) -> tuple[Floats, Surroundings]:
        """The returns of the last scans in a box or a cell beside it, and what the map has about them."""
        points, walls, unknown = [], [], []
        for one in frame.observed:
            inside = is_inside(box, one.returns, self._map.resolution)
            about = self.surroundings(one.returns)
            points.append(one.returns[inside])
            walls.append(about.wall_m[inside])
            unknown.append(about.unknown[inside])
        if len(points) == 1:
            return points[0], Surroundings(walls[0], unknown[0])
        return np.concatenate(points), Surroundings(np.concatenate(walls), np.concatenate(unknown))

    def _better_pose_corrects(self, frame: ReplayFrame, box: Box) -> bool:
        """Whether a match of the scan to the map puts the box's returns back onto walls."""
        if self._matcher is None:
            self._matcher = ScanToMap(self._map)
        for one in frame.observed:
            scan = one.scan
            if scan is None:
                continue
            points = one.returns[is_inside(box, one.returns, self._map.resolution)]
            if not len(points):
                continue
            if one.robot not in self._matched or self._matched[one.robot][0] is not scan:
                matched = self._matcher.match(scan.pose, scan.ranges_m, scan.lidar)
                self._matched[one.robot] = scan, None if matched is None else matched[0]
            pose = self._matched[one.robot][1]
            if pose is None:
                continue
            shifted = pose.transform(_local(scan.pose, points))
            grown_m = self._settings.prior_reach_m - self._settings.local_reach_m
            if float(np.median(self.wall_distances(shifted))) <= max(grown_m, self._map.resolution):
                return True
        return False

    def _keep(self, row: ErrorRow, returns: Floats | None = None) -> None:
        """Keep a row; ``returns``: in the box, of what may turn out to stay put."""
        pickle.dump((tuple(row), returns), self._kept)

    def settled(self) -> Iterator[ErrorRow]:
        """All rows in order, ``unmapped`` where the whole recording shows that what is there stays put."""
        stays = self.counts.near_what_stays()
        height, width = stays.shape
        end = self._kept.tell()
        self._kept.seek(0)
        while self._kept.tell() < end:
            cells_of_row, points = pickle.load(self._kept)
            row = ErrorRow(*cells_of_row)
            if points is not None:
                cells = np.floor((points - self.counts.origin) / self.counts.resolution_m).astype(np.int64)
                on = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
                if on.any() and stays[cells[on, 1], cells[on, 0]].mean() > 0.5:
                    row = row._replace(cause="unmapped")
            yield row


def _local(pose: Pose2D, points: Floats) -> Floats:
    """Points of the map frame in a robot's."""
    return pose.inverse().transform(points)


def _near(boxes: Sequence[Box], label: Label, near_m: float) -> list[Box]:
    """Those of the boxes that are no farther than this from a label, metres."""
    return [box for box in boxes if box.distance_to_point(label.x, label.y) <= near_m]


def near(points: Floats, label: Label, distance_m: float) -> Floats:
    """Those of (n, 2) returns that lie no farther than ``distance_m`` from a label, map frame."""
    return np.asarray(points[np.hypot(points[:, 0] - label.x, points[:, 1] - label.y) <= distance_m])


def off_walls(explainer: Explainer, points: Floats) -> Floats:
    """Those of (n, 2) points that lie on no mapped wall; all of them if none does."""
    free = points[explainer.wall_distances(points) > explainer.counts.resolution_m]
    return free if len(free) else points


def returns_near(frame: ReplayFrame, label: Label, distance_m: float) -> int:
    """How many returns of the last scans lie near a label."""
    return sum(len(near(one.returns, label, distance_m)) for one in frame.observed)


def middle(values: Floats) -> float:
    """The median, of an even number the higher one of the middle; inf of none."""
    ordered = sorted(values.tolist())
    return float(ordered[len(ordered) // 2]) if ordered else math.inf


def is_inside(box: Box, points: Floats, margin_m: float) -> npt.NDArray[np.bool_]:
    """(n,) whether each of (n, 2) points lies in a box that is wider by a margin."""
    x, y = points[:, 0], points[:, 1]
    across = (x >= box.x_min - margin_m) & (x <= box.x_max + margin_m)
    return np.asarray(across & (y >= box.y_min - margin_m) & (y <= box.y_max + margin_m))
