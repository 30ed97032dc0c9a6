"""Which labels of a frame count, and the counts of a recording."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import IO, NamedTuple

from midnet_bench.campaign.trial import Scalar
from midnet_bench.detectors.tracking import Events
from midnet_bench.geometry import Box, Scan, wrap_angle
from midnet_bench.recording.causes import Explainer
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.ray_counts import RayCounts
from midnet_bench.recording.replay import Replay, ReplayFrame, RobotObservation
from midnet_bench.recording.truth import Label, Labels, matched
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
