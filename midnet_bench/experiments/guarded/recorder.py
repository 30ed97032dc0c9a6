"""``Recorder``: the tables of a trial beside its counts: further metrics, each frame, each error."""

from collections.abc import Collection

from midnet_bench.agents.mobile_robot import Guard
from midnet_bench.campaign.trial import Row
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.experiments.guarded.frame_trace import FrameTrace
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena, ScoredFrame
from midnet_bench.experiments.guarded.parameters import GuardParameters
from midnet_bench.experiments.guarded.record import (
    ERRORS,
    FRAMES,
    RecordedBox,
    RecordedFrame,
    RecordedRobot,
    RecordedTruth,
    recorded_scan,
)
from midnet_bench.geometry import Pose2D
from midnet_bench.scoring.metric import TrialMetrics


class Recorder:
    """Takes one detector's frames in order, for the trial's metrics and its record."""

    def __init__(self, trial: GuardedArena, test: GuardParameters, node: DetectorNode | None = None) -> None:
        """From now on; errors only of a ``node``."""
        self._trial, self._test = trial, test
        self.trace = FrameTrace(trial, node) if node is not None and test.record else None
        self._metrics = TrialMetrics(test.metrics)
        self._frames: list[Row] = []
        self._errors: list[Row] = []

    def take(self, frame: ScoredFrame, pursuers: Collection[Guard] = ()) -> None:
        """The newest frame, with its explanation; ``pursuers``: the guards that drive to a target."""
        if self._metrics:
            self._metrics.update(self._trial.metric_frame(frame))
        # the scene of a trial with an oracle is that of the trial without, which has the frames
        if self._test.record and (self.trace is None or self._test.oracle == "none"):
            self._frames.append(self._recorded(frame, pursuers).to_row())
        if self.trace is not None:
            self._errors += self.trace.errors(frame)

    def tables(self) -> dict[str, list[Row]]:
        """``metrics``, ``recorded`` and ``errors``, those that have rows."""
        recorded = {FRAMES: self._frames, ERRORS: self._errors}
        return {**self._metrics.tables(), **{name: rows for name, rows in recorded.items() if rows}}

    def _recorded(self, frame: ScoredFrame, pursuers: Collection[Guard]) -> RecordedFrame:
        poses, active = self._trial.world.poses(), self._trial.world.active
        explanation, midnet, match = frame.midnet.explanation, frame.midnet, frame.match
        removed = explanation.removed if explanation else []
        allies = {(each.detection.robot, each.detection.box): each.ally for each in removed}
        scans = [guard.scan for guard in self._trial.guards]
        return RecordedFrame(
            frame.number,
            robots=[
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
            truths=[
                RecordedTruth(truth.name, truth.box, bool(near), detection)
                for truth, near, detection in zip(
                    frame.truths, frame.in_range, match.detection_of, strict=True
                )
            ],
            found=[
                RecordedBox(guard, box, allies.get((guard, box)))
                for guard, view in enumerate(explanation.views if explanation else ())
                for box in view.found
            ],
            detections=list(map(RecordedBox, midnet.robots, midnet.detections, match.truth_of)),
            scans_m=[[] if scan is None else recorded_scan(scan.ranges_m) for scan in scans],
            sensors=[scan and scan.pose.compose(scan.lidar.mount) for scan in scans],
        )
