"""The detection test of section V.A: which intruders are seen, frame by frame."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from midnet_bench.campaign.trial import Row, TrialResult
from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.elementary import directions
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.ground_truth import fused_by_identity
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena, ScoredFrame
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.experiments.guarded.recorder import Recorder
from midnet_bench.geometry import Solid
from midnet_bench.plugins import PluginError
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import (
    CauseCounter,
    Causes,
    FrameCounts,
    TruthObject,
    ratios,
    total,
    total_causes,
    touches,
    truths_in_range,
)
from midnet_bench.scoring.metric import NONE as NO_METRICS
from midnet_bench.simulation.sensors import SOLID

ON_SURFACE_M = 0.05
"""A noisy return this near to a stationary intruder is one of its own; walls are farther off."""
OPPOSITE_EVERY = 10
"""MIDNet runs anew in opposite order of the robots in each tenth frame: it costs as much as a frame."""


class Scorer:
    """One detector of a trial, how its frames are scored, and what that remembers from frame to frame."""

    def __init__(self, trial: "DetectionTrial", test: DetectionParameters, node: DetectorNode) -> None:
        """For a trial that has not begun."""
        self.test = test
        self.node = node
        rngs = [stream(trial.seed, "sight", guard.name) for guard in trial.guards]
        self.sight = trial.lidars.noise(rngs)
        """the noise of the beams that decide what is in sight"""
        self.causes = CauseCounter()
        self.counted: list[tuple[FrameCounts, Causes]] = []  # of each frame of a whole trial
        self.counts_hidden = test.counts_hidden
        self.margin_m = 0.0  # by which intruders' boxes are wider than they are
        if test.truth_box == "inflated":
            self.margin_m = test.local_costmap.reach_m(test.midnet.thresh_local)
        self.recorder = Recorder(trial, test, node) if test.record or test.metrics != NO_METRICS else None


class DetectionTrial(GuardedArena):
    """Map 1 in motion: guards patrol, mobile intruders wander, MIDNet detects."""

    def __init__(
        self, parameters: DetectionParameters, seed: int, variants: Sequence[DetectionParameters] = ()
    ) -> None:
        """Place the robots and give the intruders random goals, again and again."""
        super().__init__(parameters, seed, parameters.intruders, variants)
        self._test = parameters
        self._stationary = {
            f"stationary {number}": solid.bounding_box()
            for number, solid in enumerate(self.layout.stationary, 1)
        }
        self._newest_bodies: tuple[int, list[TruthObject]] = (-1, [])  # and the tick at which they were there
        self.own = Scorer(self, parameters, self.detector)  # of these ``parameters``
        self.scorers = list(map(partial(Scorer, self), variants, self.variant_detectors))
        """of each of the ``variants``"""
        if self.arena.mobile_intruders.behaviour == "wander" and not self.arena.mobile_intruders.pause_s:
            free = self.goal_space()
            rngs = {robot.index: stream(seed, "goals", robot.name) for robot in self.intruders}
            for robot in self.intruders:
                robot.next_goal = lambda robot: free.draw(rngs[robot.index])

    def frames(self, explain: bool = False) -> Iterator[ScoredFrame]:
        """The trial's frames, each scored against where things are at its own instant."""
        for number in range(1, self._test.frames + 1):
            self.advance()
            yield self.scored(number, self.own, explain)

    def scored(self, number: int, scorer: Scorer, explain: bool = False) -> ScoredFrame:
        """What a detector finds at this instant, the frame of that number; take each frame once, in order."""
        test, truths = scorer.test, self.truths(scorer)
        is_fused_anew = test.oracle == "fusion"
        midnet = self.detected(scorer.node, explain or is_fused_anew or test.record)
        if is_fused_anew:
            fused = fused_by_identity(midnet, truths)
            midnet = replace(midnet, detections=fused.detections, robots=fused.robots)
        frame = ScoredFrame(number, midnet, truths, self.in_range(scorer), test.tp_boxes)
        if scorer.recorder:
            scorer.recorder.take(frame)
        return frame

    def causes(self, frame: ScoredFrame, scorer: Scorer) -> Causes:
        """Which of the paper's causes the errors of the newest frame had; take each frame once, in order."""
        opposite = None
        if frame.number % OPPOSITE_EVERY == 0 and len(self.guards) > 1 and scorer.test.oracle != "fusion":
            opposite = scorer.node.detect_in_opposite_order(self.observations(scorer.node))

        def in_sight() -> list[bool]:
            """True where hidden intruders do not count as missed."""
            return self._in_sight(scorer) if scorer.counts_hidden else [True] * len(frame.truths)

        windows = [costmap.extent for costmap in scorer.node.costmaps]
        return scorer.causes.count(
            frame.midnet.detections,
            frame.truths,
            frame.match.touched,
            frame.in_range,
            in_sight,
            [any(touches(window, truth.box) for window in windows) for truth in frame.truths],
            opposite,
        )

    def truths(self, scorer: Scorer | None = None) -> list[TruthObject]:
        """The intruders as they are now (item 45): the stationary ones, the Burgers, people and things.

        A person is one truth, whose box is the extent of both legs at the height of the beams.
        """
        margin_m, bodies = (scorer or self.own).margin_m, self._bodies()
        return [truth._replace(box=truth.box.shrunk(-margin_m)) for truth in bodies] if margin_m else bodies

    def in_range(self, scorer: Scorer | None = None) -> list[bool]:
        """For each truth, whether not finding it now counts as a false negative (item 46).

        "Laser scan range" of section V.A is how far from the sensor a return is marked (item 7), in the
        sensor's field of view. It goes to the intruder itself, whatever box it is scored by.
        """
        scorer = scorer or self.own
        sensors, views = self.sensor_positions(), self.fields_of_view()
        range_m, rule = scorer.test.usable_range_m, scorer.test.in_range
        in_range = truths_in_range(self._bodies(), sensors, range_m, rule, views)
        if not scorer.counts_hidden:
            seen = self._in_sight(scorer)
            in_range = [near and is_seen for near, is_seen in zip(in_range, seen, strict=True)]
        return in_range

    def _bodies(self) -> list[TruthObject]:
        if self._newest_bodies[0] != self.world.tick:
            mobile = {robot.name: self.lidars.outline(robot.index) for robot in self.intruders}
            others = {member.name: member.extent() for member in self.crowd.members}
            boxes = self._stationary | mobile | others
            bodies = [TruthObject(name, box, box.center) for name, box in boxes.items()]
            self._newest_bodies = self.world.tick, bodies
        return self._newest_bodies[1]

    def result(self, scorer: Scorer) -> TrialResult:
        """The tables of a trial that is over, from the counts of all its frames by one detector."""
        frames = [counts for counts, _ in scorer.counted]
        summed = total(frames)
        scores: Row = {
            "frames": len(frames),
            **summed._asdict(),
            **ratios(summed.tp, summed.fp, summed.fn)._asdict(),
            **total_causes(causes for _, causes in scorer.counted)._asdict(),
            "patrol_relaxations": self.patrol.relaxations,
        }
        tables: dict[str, list[Row]] = {
            "scores": [scores],
            "frames": [{"frame": number, **counts._asdict()} for number, counts in enumerate(frames, 1)],
            "robots": self.rows_of_robots(),
            **(scorer.recorder.tables() if scorer.recorder else {}),
        }
        return TrialResult(tables, simulated_s=len(frames) / FRAME_HZ)

    def _in_sight(self, scorer: Scorer) -> list[bool]:
        """For each truth, whether a beam of some guard would meet it within range at this instant."""
        reach_m = scorer.test.usable_range_m
        guards = np.array([guard.index for guard in self.guards])
        _, true_m, bodies = self.lidars.true_scan(guards)
        ranges_m = self.lidars.measured(true_m, guards, scorer.sight)  # no beam drops out
        near = ranges_m <= reach_m
        ranges_m = np.where(near, ranges_m, 0.0)  # infinity has no place on a beam along an axis
        met = set(bodies[near].tolist())
        lidar = self.robot.lidar
        beams = self.world.poses()[guards, 2, None] + (lidar.mount.yaw + lidar.angles_rad)
        ways = directions(beams.reshape(-1)).reshape(*beams.shape, 2)
        ends = np.array(self.sensor_positions())[:, None] + ranges_m[..., None] * ways
        hits = ends[near & (bodies == SOLID)]

        def is_hit(solids: Iterable[Solid]) -> bool:
            return any(bool((solid.distance_to(hits) < ON_SURFACE_M).any()) for solid in solids)

        return [
            *(is_hit([solid]) for solid in self.layout.stationary),
            *(robot.index in met for robot in self.intruders),
            *(is_hit(member.solids()) for member in self.crowd.members),
        ]


def run_detection(parameters: DetectionParameters, seed: int) -> TrialResult:
    """One trial: ``scores`` (one row, counts summed), ``frames``, ``robots``; ``metrics`` by option."""
    (result,) = run_together([parameters], seed)
    if isinstance(result, Exception):
        raise result
    return result


def run_together(tests: Sequence[DetectionParameters], seed: int) -> list[TrialResult | Exception]:
    """Trials of one ``simulation_key`` in one simulation: the tables of each, or its detector's exception."""
    # the motion is the same for all; with the first one's costmap there is one less to keep
    moving = replace(tests[0], detector="midnet", fusion="paper", record=False)
    with DetectionTrial(moving, seed, tests) as trial:
        failures: dict[int, Exception] = {}
        for number in range(1, moving.frames + 1):
            trial.advance()
            for index, scorer in enumerate(trial.scorers):
                if index in failures:
                    continue
                try:
                    frame = trial.scored(number, scorer)
                    scorer.counted.append((frame.counts, trial.causes(frame, scorer)))
                except Exception as error:  # other detectors' trials go on
                    failures[index] = error
            if len(failures) == len(tests):
                break
        results: list[TrialResult | Exception] = []
        for index, scorer in enumerate(trial.scorers):
            try:
                results.append(failures.get(index) or trial.result(scorer))
            except PluginError as error:  # of a metric, at the end
                results.append(error)
        return results
