"""A recorded trial: what happened in it, frame by frame, in numbers small enough to keep and to send."""

import base64
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from midnet_bench.campaign.trial import Row
from midnet_bench.geometry import Box, Point, Pose2D
from midnet_bench.scoring.frame_counts import match_frame
from midnet_bench.scoring.metric import NONE, TrialMetrics

if TYPE_CHECKING:
    from midnet_bench.agents.mobile_robot import Guard
    from midnet_bench.experiments.guarded.frame_trace import FrameTrace
    from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
    from midnet_bench.experiments.guarded.parameters import GuardParameters
    from midnet_bench.midnet.pipeline import Frame
    from midnet_bench.scoring.diagnosis import Cause, Kind
    from midnet_bench.scoring.frame_counts import FrameMatch, TruthObject

FRAMES, ERRORS, CAPTURES = "recorded", "errors", "captures"
"""the tables of a recorded trial"""
BEAM_STEP = 4
"""each fourth beam of a scan is kept"""
NO_RETURN = 255
"""in a recorded scan; other values are centimetres"""


class RecordedRobot(NamedTuple):
    """One robot at one frame, map frame."""

    pose: Pose2D
    """where it truly is, to the millimetre and milliradian"""
    believed: Pose2D
    """its estimated pose"""
    goal: tuple[float, float] | None
    """where it drives to, metres"""
    pursues: bool = False
    """whether the goal is what it pursues"""


class RecordedTruth(NamedTuple):
    """One intruder at one frame."""

    name: str
    box: Box
    in_range: bool
    """whether missing it counts"""
    detection: int | None
    """the index of the detection that is paired with it"""


class RecordedBox(NamedTuple):
    """One guard's box before fusion, or one box of the team."""

    guard: int
    """index of the guard that it comes from"""
    box: Box
    other: int | None
    """before fusion the index of the ally that it was removed for; then that of the truth paired with it"""


class RecordedFrame(NamedTuple):
    """One frame of a trial; metres and radians, map frame."""

    number: int
    """counted from 1, five a second"""
    robots: list[RecordedRobot | None]
    """in the order of the table ``robots``; None for one that is gone"""
    truths: list[RecordedTruth]
    found: list[RecordedBox]
    """empty where a detector explains nothing"""
    detections: list[RecordedBox]
    scans_m: list[list[float | None]]
    """of each guard the last scan, each fourth beam; None where nothing came back within 2.54 m"""
    sensors: list[Pose2D | None]
    """where each guard took its LiDAR to be at that scan"""

    def to_row(self) -> Row:
        """A row of the table ``recorded``: lists as JSON in millimetres and milliradians, scans in base64."""
        return {
            "frame": self.number,
            "poses": _text(
                [
                    robot and _mm((*robot.pose, *robot.believed, *(robot.goal or ()))) + [1] * robot.pursues
                    for robot in self.robots
                ]
            ),
            "truths": _text(
                [[name, *_mm(box), int(near), detection] for name, box, near, detection in self.truths]
            ),
            "found": _text([[guard, *_mm(box), ally] for guard, box, ally in self.found]),
            "detections": _text([[guard, *_mm(box), truth] for guard, box, truth in self.detections]),
            "scans": " ".join(
                base64.b64encode(_cm(scan)).decode() + f"@{','.join(map(str, _mm(sensor or ())))}"
                for scan, sensor in zip(self.scans_m, self.sensors, strict=True)
            ),
        }

    @classmethod
    def from_row(cls, row: Mapping[str, object]) -> "RecordedFrame":
        """What :meth:`to_row` packed. Raises ValueError if it is damaged."""
        try:
            poses, truths, found, detections = (
                json.loads(str(row[name])) for name in ("poses", "truths", "found", "detections")
            )
            scans = [scan.partition("@") for scan in str(row["scans"]).split()]
            return cls(
                int(str(row["frame"])),
                [None if robot is None else _robot(robot) for robot in poses],
                [RecordedTruth(name, _box(rest[:4]), bool(rest[4]), rest[5]) for name, *rest in truths],
                [RecordedBox(guard, _box(rest[:4]), rest[4]) for guard, *rest in found],
                [RecordedBox(guard, _box(rest[:4]), rest[4]) for guard, *rest in detections],
                [
                    [None if cm == NO_RETURN else cm / 100.0 for cm in base64.b64decode(scan)]
                    for scan, _, _ in scans
                ],
                [Pose2D(*(int(mm) / 1000.0 for mm in at.split(","))) if at else None for _, _, at in scans],
            )
        except (IndexError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"frame {row.get('frame')}: is no recorded frame") from error


class Recorder:
    """Of one detector of a trial beside its counts: further metrics, each frame, each error and its cause."""

    def __init__(
        self, trial: "GuardedArena", test: "GuardParameters", trace: "FrameTrace | None" = None
    ) -> None:
        """From now on; errors only with a ``trace``."""
        self._trial, self._test, self.trace = trial, test, trace
        self._range_m = test.costmap.obstacle_range_m
        self._metrics = TrialMetrics(test.metrics)
        self._frames: list[Row] = []
        self._errors: list[Row] = []

    def take(
        self,
        number: int,
        frame: "Frame",
        truths: "Sequence[TruthObject]",
        in_range: Sequence[bool],
        match: "FrameMatch | None" = None,
        pursuers: "Collection[Guard]" = (),
    ) -> None:
        """The newest frame, with its explanation; ``pursuers``: the guards that drive to a target."""
        if self._metrics:
            self._metrics.update(self._trial.metric_frame(frame, truths, in_range))
        if not self._test.record:
            return
        match = match or match_frame(frame.detections, truths)
        # the scene of a trial with an oracle is that of the trial without, which has the frames
        if self.trace is None or self._test.oracle == "none":
            recorded = self._recorded(number, frame, truths, in_range, match, pursuers)
            self._frames.append(recorded.to_row())
        if self.trace is None:
            return
        missed, left_over = self.trace.causes(
            frame, truths, match, in_range, partial(self._guards_near, truths, self._trial.sensor_positions())
        )
        touched = {truth for each in match.touched for truth in each}
        for index, cause in missed.items():
            row = _error("miss", number, truths[index].box, cause, truths[index].name)
            self._errors.append({**row, "paper": index not in touched})
        for index, cause in left_over.items():
            kind: Kind = "fragment" if match.touched[index] else "false"
            row = _error(kind, number, frame.detections[index], cause)
            self._errors.append({**row, "paper": kind == "false"})

    def tables(self) -> dict[str, list[Row]]:
        """``metrics``, ``recorded`` and ``errors``, those that have rows."""
        recorded = {FRAMES: self._frames, ERRORS: self._errors}
        return {**self._metrics.tables(), **{name: rows for name, rows in recorded.items() if rows}}

    def _guards_near(
        self, truths: "Sequence[TruthObject]", sensors: "Sequence[Point]", index: int
    ) -> list[int]:
        """The guards whose usable range a truth is in, by its nearest point."""
        box = truths[index].box
        return [guard for guard, at in enumerate(sensors) if box.distance_to_point(*at) <= self._range_m]

    def _recorded(
        self,
        number: int,
        frame: "Frame",
        truths: "Sequence[TruthObject]",
        in_range: Sequence[bool],
        match: "FrameMatch",
        pursuers: "Collection[Guard]",
    ) -> RecordedFrame:
        world, explanation = self._trial.world, frame.explanation
        poses, active = world.poses(), world.active
        removed = explanation.removed if explanation else []
        allies = {(each.detection.robot, each.detection.box): each.ally for each in removed}
        views = explanation.views if explanation else []
        guards = self._trial.guards
        return RecordedFrame(
            number,
            [
                RecordedRobot(
                    Pose2D(*poses[robot.index].tolist()),
                    robot.pose,
                    robot.goal,
                    robot.goal is not None and robot in pursuers,
                )
                if active[robot.index]
                else None
                for robot in self._trial.fleet.robots
            ],
            [
                RecordedTruth(truth.name, truth.box, bool(near), detection)
                for truth, near, detection in zip(truths, in_range, match.detection_of, strict=True)
            ],
            [
                RecordedBox(guard, box, allies.get((guard, box)))
                for guard, view in enumerate(views)
                for box in view.found
            ],
            [
                RecordedBox(guard, box, truth)
                for guard, box, truth in zip(frame.robots, frame.detections, match.truth_of, strict=True)
            ],
            [[] if guard.scan is None else recorded_scan(guard.scan.ranges_m) for guard in guards],
            [guard.scan and guard.scan.pose.compose(guard.scan.lidar.mount) for guard in guards],
        )


def recorder_of(
    trial: "GuardedArena", test: "GuardParameters", trace: "Callable[[], FrameTrace | None]" = lambda: None
) -> Recorder | None:
    """A recorder if the trial is to be recorded, with its ``trace``, or has further metrics; else None."""
    if test.record:
        return Recorder(trial, test, trace())
    return None if test.metrics == NONE else Recorder(trial, test)


def _error(kind: "Kind", number: int, box: Box, cause: "Cause", intruder: str = "") -> Row:
    x_min, y_min, x_max, y_max = (round(side, 3) for side in box)
    return {
        "frame": number,
        "kind": kind,
        "cause": cause.name,
        "guard": 0 if cause.guard is None else cause.guard + 1,
        "intruder": intruder,
        "by": cause.by,
        "age_s": round(cause.age_s, 3),
        "offset_m": round(cause.offset_m, 3),
        "x_min_m": x_min,
        "y_min_m": y_min,
        "x_max_m": x_max,
        "y_max_m": y_max,
    }


def recorded_scan(ranges_m: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> list[float | None]:
    """Each fourth beam of a scan as it is recorded: metres, None where nothing came back within 2.54 m."""
    far_m = NO_RETURN / 100.0 - 0.005
    return [range_m if 0.0 < range_m < far_m else None for range_m in ranges_m[::BEAM_STEP].tolist()]


def _cm(scan_m: Sequence[float | None]) -> bytes:
    ranges_cm = 100.0 * np.array(scan_m, dtype=np.float64)  # NaN for None
    return np.where(np.isnan(ranges_cm), NO_RETURN, np.rint(ranges_cm)).astype(np.uint8).tobytes()


def _mm(numbers: Sequence[float]) -> list[int]:
    return [round(1000.0 * number) for number in numbers]


def _text(values: object) -> str:
    return json.dumps(values, separators=(",", ":"))


def _box(numbers: Sequence[int]) -> Box:
    return Box(*(number / 1000.0 for number in numbers))


def _robot(numbers: Sequence[int]) -> RecordedRobot:
    x, y, yaw, *rest = (number / 1000.0 for number in numbers[:8])
    goal = (rest[3], rest[4]) if len(rest) > 3 else None
    return RecordedRobot(Pose2D(x, y, yaw), Pose2D(*rest[:3]), goal, len(numbers) > 8)
