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
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import ReplayFrame
from midnet_bench.recording.settings import ReplaySettings
from midnet_bench.recording.truth import Label, Labels
from midnet_bench.scoring.error_causes import RECORDED_MISSES

Floats = npt.NDArray[np.float64]

NEAR_M = 0.35
"""how far a declared ally or a displaced box may lie from where it is told"""
WALL_M = 0.15
"""beyond the cells that the prior map's walls were grown by, a return this far off a wall may still be its"""


class ErrorRow(NamedTuple):
    """One error of a frame."""

    frame: int
    time_s: float
    kind: str
    """miss, false, fragment; box where nobody labelled"""
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


MOST_TOLD = 20
"""scans whose surroundings are kept: one of each robot"""


class Explainer:
    """Gathers, scan by scan, what causes are told from."""

    def __init__(
        self,
        look: str,
        prior_map: OccupancyGrid,
        node: DetectorNode,
        settings: ReplaySettings,
        counts: RayCounts,
        kept: IO[bytes],
    ) -> None:
        """Of the detector ``look``, by ray counts that may serve several.

        ``kept``: an empty file of its own. A recording may last for hours: what is told waits there for the
        causes that its end decides.
        """
        self._look, self._map, self._node, self._settings = look, prior_map, node, settings
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
        self._told: list[tuple[Floats, Surroundings]] = []
        """of the last scans' returns, which are asked for box by box"""
        self._kept = kept

    def surroundings(self, returns: Floats) -> "Surroundings":
        """What the map has about each of a scan's (n, 2) returns; worked out once for each scan."""
        for points, known in reversed(self._told):
            if points is returns:
                return known
        cells = cells_of(self._map, returns)
        on = self._on_map(cells)
        columns, rows = cells[on].T
        wall_m, unknown = np.full(len(returns), math.inf), np.ones(len(returns), np.bool_)
        wall_m[on] = self._wall_m[rows, columns]
        unknown[on] = self._map.data[rows, columns] < 0
        known = Surroundings(wall_m, unknown)
        self._told = [*self._told[-MOST_TOLD:], (returns, known)]
        return known

    def wall_distances(self, points: Floats) -> Floats:
        """(n,) metres from (n, 2) points to the nearest mapped wall; inf off the map."""
        cells = cells_of(self._map, points)
        found = np.full(len(points), math.inf)
        on = self._on_map(cells)
        found[on] = self._wall_m[cells[on, 1], cells[on, 0]]
        return found

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
                    frame.looks[self._look].observations, explain=True, allies=frame.told_allies
                )
            cause, returns = self._lost(frame, label, near_m, view)
            nearest_m = min(
                (box.distance_to_point(label.x, label.y) for box in frame.looks[self._look].frame.detections),
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

    def _lost(self, frame: ReplayFrame, label: Label, near_m: float, view: Frame) -> tuple[str, int]:
        """The stage that the returns about a label reached."""
        assert view.explanation is not None
        stages = ["beyond_range"]
        order, midnet = list(RECORDED_MISSES), self._settings.midnet
        total = 0
        if any(
            box.distance_to_point(label.x, label.y) <= near_m
            for box in frame.looks[self._look].frame.detections
        ):
            return "merged", returns_near(frame, label, near_m)
        if self._settings.detector != "midnet":  # whose stages nobody knows
            return "not_detected", returns_near(frame, label, near_m)
        for one, robot in zip(frame.seen, view.explanation.views, strict=True):
            if one.scan is None:
                continue
            all_points = off_walls(self, near(one.returns, label, near_m))
            total += len(all_points)
            if not len(all_points):
                continue
            sensor = one.scan.pose.compose(one.scan.lidar.mount)
            apart = np.hypot(all_points[:, 0] - sensor.x, all_points[:, 1] - sensor.y)
            points = all_points[apart <= self._settings.range_m]
            if not len(points):
                continue
            costmap = self._node.costmaps[one.robot]
            side_m = costmap.settings.size_m
            x0, y0 = costmap.origin
            inside = (points >= (x0, y0)).all(axis=1) & (points < (x0 + side_m, y0 + side_m)).all(axis=1)
            points = points[inside]
            if not len(points):
                stages.append("outside_window")
                continue
            prior = self._node.prior
            cells = cells_of(prior, points)
            on = (cells >= 0).all(axis=1) & (cells[:, 0] < prior.width) & (cells[:, 1] < prior.height)
            if not on.any():
                stages.append("outside_prior")
                continue
            reach = math.ceil(self._settings.local_reach_m / prior.resolution)
            free = np.count_nonzero(prior.data[cells[on, 1], cells[on, 0]])
            if not self._is_left(robot.d, points[on], reach):
                on_map = cells_of(self._map, points)
                on_map = on_map[self._on_map(on_map)]
                unknown = self._map.data[on_map[:, 1], on_map[:, 0]] < 0
                counts = self._settings.prior.unknown == "occupied" and unknown.mean() > 0.5
                stages.append("unknown_cells" if counts else "under_prior")
                continue
            grown = [
                box
                for box in bounding_boxes(
                    robot.d.data,
                    (
                        round((robot.d.origin[0] - prior.origin[0]) / prior.resolution),
                        round((robot.d.origin[1] - prior.origin[1]) / prior.resolution),
                    ),
                    prior,
                ).tolist()
                if Box._make(box).distance_to_point(label.x, label.y) <= near_m
            ]
            found = [box for box in robot.found if box.distance_to_point(label.x, label.y) <= near_m]
            kept = [box for box in robot.kept if box.distance_to_point(label.x, label.y) <= near_m]
            if kept:
                stages.append("dropped_by_fusion")
            elif found:
                stages.append("taken_for_ally")
            elif grown and midnet.min_returns and free < midnet.min_returns <= len(points):
                stages.append("under_prior")  # which leaves a rim of what was inflated, without its returns
            elif grown:
                cells_left = max(self._cells_of(box, prior) for box in grown)
                is_small = cells_left < midnet.min_area_cells or not midnet.min_returns
                stages.append("too_small" if is_small else "too_few_returns")
            else:
                stages.append("displaced")
        return max(stages, key=order.index), total

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
            box = frame.looks[self._look].frame.detections[index]
            kind = "false" if labels is not None else "box"
            name = ""
            returns, about = self._in_box(frame, box)
            offset_m = middle(about.wall_m)
            age_s = 0.0
            if labels is not None and touched[index]:
                kind, cause, name = "fragment", "fragment", labels.there[touched[index][0]].name
            else:
                cause, age_s, name = self._made_of(frame, box, about, labels, distance_m)
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

    def _made_of(
        self,
        frame: ReplayFrame,
        box: Box,
        about: Surroundings,
        labels: Labels | None,
        distance_m: float,
    ) -> tuple[str, float, str]:
        """Cause, age, and whose it is."""
        for label in labels.gaps if labels else ():
            if box.distance_to_point(label.x, label.y) <= distance_m:
                return "label_gap", 0.0, label.name
        for plan, told in frame.allies:
            if told is None:
                continue
            late = told.pose not in [ally.pose for ally in frame.told_allies]
            reach_m = plan.diameter_m / 2.0 + NEAR_M + min(told.age_s, 2.0) * late
            if box.distance_to_point(told.pose.x, told.pose.y) <= reach_m:
                return ("ally_late" if late else "ally_left"), told.age_s, plan.name
        for one in frame.seen:
            if len(frame.seen) > 1 and box.distance_to_point(one.told.pose.x, one.told.pose.y) <= NEAR_M:
                return "ally_left", one.told.age_s, f"robot {one.robot + 1}"
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
            return ("pose_error" if self._better_pose_mends(frame, box) else "near_wall"), 0.0, ""
        return "unlabelled", 0.0, ""

    def _in_box(self, frame: ReplayFrame, box: Box) -> tuple[Floats, Surroundings]:
        """The returns of the last scans in a box or a cell beside it, and what the map has about them."""
        points, walls, unknown = [], [], []
        for one in frame.seen:
            inside = is_inside(box, one.returns, self._map.resolution)
            about = self.surroundings(one.returns)
            points.append(one.returns[inside])
            walls.append(about.wall_m[inside])
            unknown.append(about.unknown[inside])
        if len(points) == 1:
            return points[0], Surroundings(walls[0], unknown[0])
        return np.concatenate(points), Surroundings(np.concatenate(walls), np.concatenate(unknown))

    def _better_pose_mends(self, frame: ReplayFrame, box: Box) -> bool:
        """Whether a match of the scan to the map puts the box's returns back onto walls."""
        if self._matcher is None:
            self._matcher = ScanToMap(self._map)
        for one in frame.seen:
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
            told, points = pickle.load(self._kept)
            row = ErrorRow(*told)
            if points is not None:
                cells = np.floor((points - self.counts.origin) / self.counts.resolution_m).astype(np.int64)
                on = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
                if on.any() and stays[cells[on, 1], cells[on, 0]].mean() > 0.5:
                    row = row._replace(cause="unmapped")
            yield row


def _local(pose: Pose2D, points: Floats) -> Floats:
    """Points of the map frame in a robot's."""
    return pose.inverse().transform(points)


def near(points: Floats, label: Label, distance_m: float) -> Floats:
    """Those of (n, 2) returns that lie no farther than ``distance_m`` from a label, map frame."""
    return np.asarray(points[np.hypot(points[:, 0] - label.x, points[:, 1] - label.y) <= distance_m])


def off_walls(explainer: Explainer, points: Floats) -> Floats:
    """Those of (n, 2) points that lie on no mapped wall; all of them if none does."""
    free = points[explainer.wall_distances(points) > explainer.counts.resolution_m]
    return free if len(free) else points


def returns_near(frame: ReplayFrame, label: Label, distance_m: float) -> int:
    """How many returns of the last scans lie near a label."""
    return sum(len(near(one.returns, label, distance_m)) for one in frame.seen)


def middle(values: Floats) -> float:
    """The median, of an even number the higher one of the middle; inf of none."""
    ordered = sorted(values.tolist())
    return float(ordered[len(ordered) // 2]) if ordered else math.inf


def is_inside(box: Box, points: Floats, margin_m: float) -> npt.NDArray[np.bool_]:
    """(n,) whether each of (n, 2) points lies in a box that is wider by a margin."""
    x, y = points[:, 0], points[:, 1]
    across = (x >= box.x_min - margin_m) & (x <= box.x_max + margin_m)
    return np.asarray(across & (y >= box.y_min - margin_m) & (y <= box.y_max + margin_m))
