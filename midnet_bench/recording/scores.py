"""Counts of a recording, and the causes of its errors.

A recording has no truth as a simulation has. So causes are what the data itself shows: where the returns
near a label ended, and what is in a box.
"""

import math
import pickle
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median_high
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.campaign.trial import Scalar
from midnet_bench.detectors.detector_node import WallEvidence
from midnet_bench.detectors.tracking import Events
from midnet_bench.geometry import Box, Floats, Pose2D, Scan, wrap_angle
from midnet_bench.grid import UNKNOWN, OccupancyGrid, cells_of, cells_to_unset, values_at
from midnet_bench.localization.scan_to_map import MIN_SHARE_RECORDED, ScanToMap
from midnet_bench.midnet.detection import bounding_boxes
from midnet_bench.midnet.pipeline import Frame, RobotView
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.ray_counts import RayCounts, dilated
from midnet_bench.recording.replay import Replay, ReplayFrame, RobotObservation
from midnet_bench.recording.truth import Label, Labels, matched
from midnet_bench.scoring.error_causes import RECORDED_MISSES
from midnet_bench.scoring.frame_counts import (
    NOTHING,
    FrameCounts,
    FrameMatch,
    TruthObject,
    count_frame,
    ratios,
    total,
)

OFF_WALLS_CELLS = 1.5  # a return this far from a mapped wall is none of its
FULL_CIRCLE_RAD = math.tau - 1e-6
NEAR_M = 0.35  # how far a declared ally or a fragment may lie from where its pose is
WALL_M = 0.15
"""beyond the cells that the prior map's walls were grown by, a return this far off a wall may still be its"""
WALL_STAYS_M = 0.25  # up to here from a mapped wall, what stays put is the wall's own
FRAGMENT, GHOST = "fragment", "ghost"
MAY_STAY = ("unlabelled", "near_wall", "unknown_cells", GHOST, FRAGMENT)
"""causes that become ``unmapped`` where the whole recording shows that what is there stays put"""


@dataclass
class Score:
    """The sums over a recording."""

    counts: FrameCounts = NOTHING
    frames: int = 0
    labelled: int = 0  # frames with labels, which alone are scored
    boxes: int = 0
    not_visible: int = 0  # labels in range that no return lies near
    events: Events = field(default_factory=Events)
    switches: int = 0  # how often a label came to another track

    def looked_at(self) -> dict[str, Scalar]:
        """Frames and boxes: a row of the table of frames."""
        per_frame = self.boxes / max(self.frames, 1)
        return {"frames": self.frames, "boxes": self.boxes, "boxes_per_frame": per_frame}

    def scored(self) -> dict[str, Scalar]:
        """The paper's counts and ratios; the columns are those of a trial's."""
        counts = self.counts
        return {
            "labelled": self.labelled,
            "in_range": counts.intruders_in_range,
            "not_visible": self.not_visible,
            "tp": counts.tp,
            "fp": counts.fp,
            "fn": counts.fn,
            **ratios(counts.tp, counts.fp, counts.fn)._asdict(),
        }

    def paired(self) -> dict[str, Scalar]:
        """The same by one-to-one matching, as in a trial's tables."""
        counts = self.counts
        return {
            "matched": counts.matched,
            "fp": counts.fp,
            "duplicates": counts.duplicates,
            "missed": counts.missed,
            **ratios(counts.matched, counts.fp + counts.duplicates, counts.missed)._asdict(),
            "mean_error_m": counts.error_sum_m / counts.matched if counts.matched else math.nan,
            "gospa_per_frame_m": counts.gospa_m / max(self.labelled, 1),
        }

    def event_counts(self, has_truth: bool) -> dict[str, Scalar]:
        """How many events there were; with labels, how many were none, and MOTA.

        MOTA (Bernardin, Stiefelhagen 2008): 1 - (missed, false, second boxes and switched tracks) / labels.
        """
        every, counts = self.events.gathered(), self.counts
        if not has_truth:
            return {"events": len(every)}
        wrong = counts.missed + counts.fp + counts.duplicates + self.switches
        return {
            "events": len(every),
            "false_events": sum(not event.is_true for event in every),
            "false_events_per_hour": self.events.false_per_hour,
            "id_switches": self.switches,
            "mota": 1.0 - wrong / counts.intruders_in_range if counts.intruders_in_range else math.nan,
        }


class FrameScore(NamedTuple):
    """Of one frame with labels."""

    labels: list[Label]  # within the setup's sector and window
    in_range: list[bool]  # for each label, whether missing it counts
    match: FrameMatch  # of these labels and the scored boxes
    scored: list[int]
    """indices of the frame's boxes within sector and window; the others are neither right nor wrong"""


class Scorer:
    """Scores frame after frame of one detector, and has errors explained."""

    def __init__(self, preset: str, replay: Replay, counts: RayCounts, kept: IO[bytes]) -> None:
        """See :class:`Explainer`."""
        self._preset, self._setup = preset, replay.setup
        self._range_m = replay.settings[preset].range_m
        self.score, self.explainer = Score(), Explainer(preset, replay, counts, kept)
        self._track_of: dict[str, int] = {}
        """label -> the track that it was on last"""

    def take(self, frame: ReplayFrame, labels: Labels | None) -> FrameScore | None:
        """Score one frame, and take its boxes for events; None without labels."""
        score, boxes = self.score, frame.outputs[self._preset].frame.detections
        score.frames += 1
        score.boxes += len(boxes)
        if labels is None:
            self.explainer.boxes(frame, dict.fromkeys(range(len(boxes)), ()), None)
            score.events.take(boxes, [False] * len(boxes), frame.time_ns / NS)
            return None
        score.labelled += 1
        found = self._scored(frame, boxes, labels)
        is_true = [bool(on) for on in found.match.touched]
        tracks = score.events.take([boxes[k] for k in found.scored], is_true, frame.time_ns / NS)
        for label, place in zip(found.labels, found.match.detection_of, strict=True):
            if place is not None:
                score.switches += self._track_of.get(label.name, tracks[place]) != tracks[place]
                self._track_of[label.name] = tracks[place]
        return found

    def _scored(self, frame: ReplayFrame, every: Sequence[Box], labels: Labels) -> FrameScore:
        """Which box was paired with which label; the counts and the causes of the others."""
        score = self.score
        distance_m = self._setup.match_distance_m
        there = [one for one in labels.there if self._is_scored(frame.observed, one.x, one.y)]
        scored = self._scored_boxes(frame.observed, every, labels.there, there)
        boxes = [every[index] for index in scored]
        match = matched(boxes, there, distance_m)
        seen = [self._visibility(frame.observed, label) for label in there]
        in_range = [counts and is_visible for counts, is_visible in seen]
        score.not_visible += sum(counts and not is_visible for counts, is_visible in seen)
        truths = [
            TruthObject(one.name, Box.square(one.x, one.y, 2.0 * distance_m), (one.x, one.y)) for one in there
        ]
        score.counts = total([score.counts, count_frame(boxes, truths, in_range, match=match)])
        missed = [one for k, one in enumerate(there) if match.detection_of[k] is None and in_range[k]]
        wrong = {scored[k]: match.touched[k] for k, truth in enumerate(match.truth_of) if truth is None}
        if missed:
            self.explainer.misses(frame, missed)
        if wrong:
            self.explainer.boxes(frame, wrong, labels._replace(there=there))
        return FrameScore(there, in_range, match, scored)

    def _scored_boxes(
        self,
        observed: Sequence[RobotObservation],
        boxes: Sequence[Box],
        every: Sequence[Label],
        there: Sequence[Label],
    ) -> list[int]:
        """Indices of the boxes within sector and window; none that lies on labels outside alone."""
        if self._setup.sector_deg is None and self._setup.window_m is None:
            return list(range(len(boxes)))

        def is_on(box: Box, labels: Iterable[Label]) -> bool:
            return any(box.distance_to_point(one.x, one.y) <= self._setup.match_distance_m for one in labels)

        outside = [label for label in every if label not in there]
        return [
            index
            for index, box in enumerate(boxes)
            if is_on(box, there) or (self._is_scored(observed, *box.center) and not is_on(box, outside))
        ]

    def _is_scored(self, observed: Sequence[RobotObservation], x: float, y: float) -> bool:
        """Whether a place of the map frame lies in the setup's sector and window of some robot."""
        return any(one.scan is not None and self._is_within(one.scan, x, y) for one in observed)

    def _is_within(self, scan: Scan, x: float, y: float) -> bool:
        setup, pose = self._setup, scan.pose
        if setup.window_m is not None and max(abs(x - pose.x), abs(y - pose.y)) > setup.window_m / 2.0:
            return False
        if setup.sector_deg is None:
            return True
        begin, end = map(math.radians, setup.sector_deg)
        _, bearing = _polar(scan, x, y)
        return (wrap_angle(bearing - pose.yaw) - begin) % math.tau <= (end - begin) % math.tau

    def _visibility(self, observed: Sequence[RobotObservation], label: Label) -> tuple[bool, bool]:
        """Whether a robot has a label in range, sector and window; and a return off the walls near it."""
        counts = is_visible = False
        for one in observed:
            if one.scan is None or not self._is_in_view(one.scan, label):
                continue
            counts = True
            dx, dy = one.returns[:, 0] - label.x, one.returns[:, 1] - label.y
            near = dx * dx + dy * dy <= self._setup.match_distance_m * self._setup.match_distance_m
            wall_m = self.explainer.surroundings(one.returns[near]).wall_m
            is_visible |= bool((wall_m > OFF_WALLS_CELLS * self.explainer.counts.resolution_m).any())
        return counts, is_visible

    def _is_in_view(self, scan: Scan, label: Label) -> bool:
        """Whether a label lies in range and among the beams of a scan, in the setup's window and sector."""
        lidar = scan.lidar
        distance_m, bearing = _polar(scan, label.x, label.y)
        last_rad = lidar.angle_min_rad + lidar.angle_increment_rad * (lidar.beams - 1)
        first_rad = min(lidar.angle_min_rad, last_rad)
        sweep_rad = abs(lidar.angle_increment_rad) * lidar.beams
        from_first_rad = (bearing - scan.pose.compose(lidar.mount).yaw - first_rad) % math.tau
        if distance_m > self._range_m or (sweep_rad < FULL_CIRCLE_RAD and from_first_rad > sweep_rad):
            return False
        return self._is_within(scan, label.x, label.y)


def _polar(scan: Scan, x: float, y: float) -> tuple[float, float]:
    """Distance and bearing of a place from a scan's sensor, map frame."""
    sensor = scan.pose.compose(scan.lidar.mount)
    return math.hypot(x - sensor.x, y - sensor.y), math.atan2(y - sensor.y, x - sensor.x)


class ErrorRow(NamedTuple):
    """One error of a frame."""

    frame: int
    time_s: float
    kind: str  # miss, false, fragment; box in a frame without labels
    cause: str
    name: str  # of the label, if it has to do with one
    x: float  # map frame, metres: of the label, or the middle of the box
    y: float
    width_m: float
    height_m: float
    returns: int  # near the label or in the box, of the last scans
    age_s: float  # of the newest return there, of a ghost; of the ally's pose; 0 otherwise
    offset_m: float  # to the nearest mapped wall, of a box; to the nearest box, of a miss


class Surroundings(NamedTuple):
    """What a map has about n points."""

    wall_m: Floats  # (n,) metres to the nearest mapped wall; inf off the map
    unknown: npt.NDArray[np.bool_]  # (n,) whether the map knows nothing there, or ends before


class Explainer:
    """Finds the causes of errors, scan by scan, and keeps them until the whole recording is known."""

    def __init__(self, preset: str, replay: Replay, counts: RayCounts, kept: IO[bytes]) -> None:
        """Of the detector of one of a replay's presets, by ray counts that may serve several.

        ``kept``: an empty file, where rows wait for the causes that the end of the recording decides.
        """
        self._preset, self._node, self._settings = preset, replay.nodes[preset], replay.settings[preset]
        self._map = prior_map = replay.prior_map
        self.counts, self._kept, self._near_m = counts, kept, replay.setup.match_distance_m
        solid = (prior_map.data == 100).astype(np.uint8)
        self._wall_m = np.full(solid.shape, math.inf)
        if solid.any():
            self._wall_m = cells_to_unset(1 - solid).astype(np.float64) * prior_map.resolution
        self._matcher: ScanToMap | None = None
        self._matched: dict[int, tuple[Scan, Pose2D | None]] = {}
        """robot -> its last scan that was matched to the map, and the pose that came of it"""
        self._label_ways: dict[str, tuple[list[float], list[float]]] = {}
        """label -> lowest and highest x, y that it was at"""

    def surroundings(self, points: Floats) -> Surroundings:
        """What the map has about each of (n, 2) points, map frame."""
        wall_m = values_at(self._wall_m, self._map, points, math.inf)
        return Surroundings(wall_m, values_at(self._map.data, self._map, points, UNKNOWN) < 0)

    def misses(self, frame: ReplayFrame, missed: Sequence[Label]) -> None:
        """Add a row for each missed label."""
        made = frame.outputs[self._preset]
        view = self._node.midnet.update(made.observations, explain=True, allies=frame.fresh_allies)
        for label in missed:
            cause, returns = self._miss_stage(frame, label, view)
            apart_m = [box.distance_to_point(label.x, label.y) for box in made.frame.detections]
            self._keep(frame, "miss", cause, *label, 0.0, 0.0, returns, 0.0, min(apart_m, default=math.inf))

    def _miss_stage(self, frame: ReplayFrame, label: Label, view: Frame) -> tuple[str, int]:
        """The last stage that returns near a label reached with any robot, and their number."""
        assert view.explanation is not None
        every = sum(len(self._points_near(one.returns, label)) for one in frame.observed)
        if self._boxes_near(frame.outputs[self._preset].frame.detections, label):
            return "merged", every
        if self._settings.detector != "midnet":  # its stages are not known
            return "not_detected", every
        stages, total = ["beyond_range"], 0
        for one, robot in zip(frame.observed, view.explanation.views, strict=True):
            if one.scan is not None:
                points = self._points_near(one.returns, label)
                free = points[self.surroundings(points).wall_m > self.counts.resolution_m]
                points = free if len(free) else points
                total += len(points)
                stages.append(self._stage(one.robot, one.scan, points, robot, label))
        return max(stages, key=list(RECORDED_MISSES).index), total

    def _boxes_near(self, boxes: Sequence[Box], label: Label) -> list[Box]:
        return [box for box in boxes if box.distance_to_point(label.x, label.y) <= self._near_m]

    def _points_near(self, points: Floats, label: Label) -> Floats:
        return np.asarray(points[np.hypot(points[:, 0] - label.x, points[:, 1] - label.y) <= self._near_m])

    def _stage(self, robot: int, scan: Scan, points: Floats, view: RobotView, label: Label) -> str:
        """The stage at which one robot loses the (n, 2) returns near a label, map frame."""
        settings, midnet, prior = self._settings, self._settings.midnet, self._node.prior
        sensor = scan.pose.compose(scan.lidar.mount)
        apart = np.hypot(points[:, 0] - sensor.x, points[:, 1] - sensor.y)
        points = points[apart <= settings.range_m]
        if not len(points):
            return "beyond_range"
        costmap = self._node.costmaps[robot]
        side_m, (x0, y0) = costmap.settings.size_m, costmap.origin
        points = points[(points >= (x0, y0)).all(axis=1) & (points < (x0 + side_m, y0 + side_m)).all(axis=1)]
        if not len(points):
            return "outside_window"
        values = values_at(prior.data.astype(np.int16), prior, points, -1)
        points_on, values_on = points[values >= 0], values[values >= 0]
        if not len(points_on):
            return "outside_prior"
        about = self.surroundings(points_on)
        if not _is_left(view.d, points_on, math.ceil(settings.local_reach_m / prior.resolution)):
            is_unknown = settings.prior.unknown == "occupied" and about.unknown.mean() > 0.5
            return "unknown_cells" if is_unknown else "under_prior"
        if self._boxes_near(view.kept, label):
            return "dropped_by_fusion"
        if self._boxes_near(view.found, label):
            return "taken_for_ally"
        corner = [round((view.d.origin[k] - prior.origin[k]) / prior.resolution) for k in (0, 1)]
        contours = bounding_boxes(view.d.data, (corner[0], corner[1]), prior).tolist()
        grown = self._boxes_near([Box._make(box) for box in contours], label)
        if not grown:
            return "displaced"
        free = int(np.count_nonzero(values_on))
        if settings.return_area_m2 and middle(about.wall_m) <= WallEvidence.WALL_M:
            free = 0  # so near to a wall returns count in part
        if midnet.min_returns and free < midnet.min_returns <= len(points):
            return "under_prior"  # which leaves a rim of what was inflated, without its returns
        # at most so many cells has the blob in a box
        sides = [(box.x_max - box.x_min, box.y_max - box.y_min) for box in grown]
        largest = max(round(x / prior.resolution) * round(y / prior.resolution) for x, y in sides)
        is_small = largest < midnet.min_area_cells or not midnet.min_returns
        return "too_small" if is_small else "too_few_returns"

    def boxes(self, frame: ReplayFrame, wrong: Mapping[int, Sequence[int]], labels: Labels | None) -> None:
        """Add a row for each box that is no label's own: by index, and the labels that it touches."""
        for label in labels.there if labels else ():
            low, high = self._label_ways.setdefault(label.name, ([math.inf] * 2, [-math.inf] * 2))
            for axis, at in enumerate((label.x, label.y)):
                low[axis], high[axis] = min(low[axis], at), max(high[axis], at)
        for index, touched in wrong.items():
            box = frame.outputs[self._preset].frame.detections[index]
            returns = np.concatenate([self._in_box(box, one.returns) for one in frame.observed])
            about = self.surroundings(returns)
            if labels is not None and touched:
                kind, cause, age_s, name = "fragment", FRAGMENT, 0.0, labels.there[touched[0]].name
            else:
                kind = "box" if labels is None else "false"
                cause, age_s, name = self._false_positive_source(frame, box, about, labels)
            size = box.x_max - box.x_min, box.y_max - box.y_min
            inside = returns if cause in MAY_STAY and len(returns) else None
            cells = (kind, cause, name, *box.center, *size, len(returns), age_s, middle(about.wall_m))
            self._keep(frame, *cells, inside=inside)

    def _false_positive_source(
        self, frame: ReplayFrame, box: Box, about: Surroundings, labels: Labels | None
    ) -> tuple[str, float, str]:
        """Cause, age in seconds, and the name of its label, ally or robot."""
        there, gaps = labels or ((), ())
        for label in gaps:
            if box.distance_to_point(label.x, label.y) <= self._near_m:
                return "label_gap", 0.0, label.name
        for plan, estimate in frame.allies:
            if estimate is None:
                continue
            late = estimate.pose not in [ally.pose for ally in frame.fresh_allies]
            reach_m = plan.diameter_m / 2.0 + NEAR_M + min(estimate.age_s, 2.0) * late
            if box.distance_to_point(estimate.pose.x, estimate.pose.y) <= reach_m:
                return ("ally_late" if late else "ally_left"), estimate.age_s, plan.name
        is_team = len({one.carrier for one in frame.observed}) > 1
        for one in frame.observed:
            if is_team and box.distance_to_point(*one.estimate.pose[:2]) <= NEAR_M:
                return "ally_left", one.estimate.age_s, f"robot {one.carrier + 1}"
        for label in there:
            if box.distance_to_point(label.x, label.y) <= self._near_m + NEAR_M:
                return FRAGMENT, 0.0, label.name
        if len(about.wall_m) < 2:
            newest_s = self.counts.newest_hit_s((box.x_min, box.y_min), (box.x_max, box.y_max))
            return GHOST, max(frame.time_ns / NS - newest_s, 0.0), ""
        if np.count_nonzero(about.unknown) > 0.5 * len(about.unknown):
            return "unknown_cells", 0.0, ""
        settings = self._settings
        near_m = WallEvidence.WALL_M if settings.return_area_m2 else settings.prior_reach_m + WALL_M
        if middle(about.wall_m) <= near_m:
            return ("pose_error" if self._better_pose_corrects(frame, box) else "near_wall"), 0.0, ""
        return "unlabelled", 0.0, ""

    def _in_box(self, box: Box, points: Floats) -> Floats:
        """Those of (n, 2) points, map frame, that lie in a box or a cell beside it."""
        grown = box.shrunk(-self._map.resolution)
        return np.asarray(points[((points >= grown[:2]) & (points <= grown[2:])).all(axis=1)])

    def _better_pose_corrects(self, frame: ReplayFrame, box: Box) -> bool:
        """Whether a match of the scan to the map puts the box's returns back onto walls."""
        grown_m = self._settings.prior_reach_m - self._settings.local_reach_m
        for one in frame.observed:
            points = self._in_box(box, one.returns)
            pose = self._matched_pose(one.robot, one.scan) if one.scan is not None and len(points) else None
            if one.scan is None or pose is None:
                continue
            shifted = pose.transform(one.scan.pose.inverse().transform(points))
            if np.median(self.surroundings(shifted).wall_m) <= max(grown_m, self._map.resolution):
                return True
        return False

    def _matched_pose(self, robot: int, scan: Scan) -> Pose2D | None:
        """The pose by which a robot's scan lies best on the map; None if the scan cannot be matched."""
        self._matcher = self._matcher or ScanToMap(self._map, MIN_SHARE_RECORDED)
        if robot not in self._matched or self._matched[robot][0] is not scan:
            found = self._matcher.match(scan.pose, scan.ranges_m, scan.lidar)
            self._matched[robot] = scan, None if found is None else found[0]
        return self._matched[robot][1]

    def _keep(self, frame: ReplayFrame, *cells: Any, inside: Floats | None = None) -> None:
        """Keep a row, its cells from the kind on; ``inside``: returns in a box that may stay put."""
        pickle.dump(((frame.number, frame.time_ns / NS, *cells), inside), self._kept)

    def settled(self) -> Iterator[ErrorRow]:
        """All rows in order, ``unmapped`` where the whole recording shows that what is there stays put."""
        counts = self.counts
        near = dilated(counts.stays())  # the cells beside them, too
        grid = OccupancyGrid(near.astype(np.int8), counts.resolution_m, counts.origin)
        end = self._kept.tell()
        self._kept.seek(0)
        while self._kept.tell() < end:
            cells, points = pickle.load(self._kept)
            row = ErrorRow(*cells)
            if points is not None and row.offset_m > WALL_STAYS_M:
                # what is beside a labelled object that was in one place at all its errors is the object's
                is_known = row.cause == FRAGMENT and math.dist(*self._label_ways[row.name]) <= NEAR_M
                points_stay = values_at(grid.data, grid, points, -1)
                points_stay = points_stay[points_stay >= 0]
                if not is_known and len(points_stay) and points_stay.mean() > 0.5:
                    row = row._replace(cause="unmapped")
            yield row


def _is_left(d: OccupancyGrid, points: Floats, reach: int) -> bool:
    """Whether a cell within ``reach`` cells of a point is left in grid D."""
    return any(
        d.data[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1].any()
        for column, row in cells_of(d, points).tolist()
    )


def middle(values: Floats) -> float:
    """The median, of an even number the higher one of the middle; inf of none."""
    return median_high(values.tolist()) if len(values) else math.inf
