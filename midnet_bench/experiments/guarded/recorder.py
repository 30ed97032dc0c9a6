"""``Recorder``: what is kept of a trial to explain its errors and to play it again."""

from collections.abc import Collection, Sequence
from functools import partial

from midnet_bench.agents.mobile_robot import Guard, Point
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.guarded.arena import GuardedArena
from midnet_bench.experiments.guarded.frame_trace import FrameTrace
from midnet_bench.experiments.guarded.record import (
    ERRORS,
    FRAMES,
    RecordedBox,
    RecordedFrame,
    RecordedRobot,
    RecordedTruth,
    recorded_scan,
)
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.scoring.errors import Cause, Kind
from midnet_bench.scoring.frame_counts import FrameMatch, TruthObject


class Recorder:
    """Of one detector of a trial: every frame, and with a trace each error and its cause."""

    def __init__(
        self,
        trial: GuardedArena,
        range_m: float,
        trace: FrameTrace | None = None,
        keeps_frames: bool = True,
    ) -> None:
        """From now on; ``range_m``: up to which an intruder has to be found.

        ``keeps_frames``: whether the frames are wanted, beside the errors.
        """
        self._trial, self._range_m = trial, range_m
        self._keeps_frames = keeps_frames
        self.trace = trace
        self._frames: list[Row] = []
        self._errors: list[Row] = []

    def take(
        self,
        number: int,
        frame: Frame,
        truths: Sequence[TruthObject],
        in_range: Sequence[bool],
        match: FrameMatch,
        pursuers: Collection[Guard] = (),
    ) -> None:
        """The newest frame, with its explanation; ``pursuers``: the guards that drive to a target."""
        if self._keeps_frames:
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
        """``recorded`` and ``errors``, those that have rows."""
        return {name: rows for name, rows in ((FRAMES, self._frames), (ERRORS, self._errors)) if rows}

    def _guards_near(self, truths: Sequence[TruthObject], sensors: Sequence[Point], index: int) -> list[int]:
        """The guards whose usable range a truth is in, by its nearest point."""
        box = truths[index].box
        return [guard for guard, at in enumerate(sensors) if box.distance_to_point(*at) <= self._range_m]

    def _recorded(
        self,
        number: int,
        frame: Frame,
        truths: Sequence[TruthObject],
        in_range: Sequence[bool],
        match: FrameMatch,
        pursuers: Collection[Guard],
    ) -> RecordedFrame:
        world, explanation = self._trial.world, frame.explanation
        poses, active = world.poses(), world.active
        removed = explanation.removed if explanation else []
        allies = {(each.detection.robot, each.detection.box): each.ally for each in removed}
        views = explanation.views if explanation else []
        guards = [robot for robot in self._trial.fleet.robots if isinstance(robot, Guard)]
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


def _error(kind: Kind, number: int, box: Box, cause: Cause, intruder: str = "") -> Row:
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
