"""The detection test of section V.A: who is seen, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from midnet_bench.agents.mobile_robot import MobileRobot, Point
from midnet_bench.arena.free_space import free_space
from midnet_bench.campaign.trial import Row, TrialResult
from midnet_bench.elementary import directions
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.arena import FRAME_HZ, GuardedArena
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.rng import stream
from midnet_bench.robots.burger import LDS_01
from midnet_bench.scoring.causes import CauseCounter, Causes, total_causes
from midnet_bench.scoring.frame_counts import (
    FrameCounts,
    FrameMatch,
    TruthObject,
    count_frame,
    match_frame,
    ratios,
    total,
    truths_in_range,
)
from midnet_bench.simulation.lidar import SOLID

ON_SURFACE_M = 0.05
"""A noisy return this near to a stationary intruder is one of its own; walls are farther off."""
OPPOSITE_EVERY = 10
"""MIDNet is asked anew in opposite order of the robots in each tenth frame: it costs as much as a frame."""
GOAL_CLEARANCE_M = 0.4
"""From a mobile intruder's goal to walls and stationary intruders (item 49)."""


@dataclass(frozen=True)
class ScoredFrame:
    """One frame and how it was scored."""

    number: int
    """counted from 1"""
    midnet: Frame
    truths: list[TruthObject]
    in_range: list[bool]
    match: FrameMatch
    counts: FrameCounts


class DetectionTrial(GuardedArena):
    """Map 1 in motion: guards patrol, mobile intruders wander, MIDNet looks on."""

    def __init__(
        self, parameters: DetectionParameters, seed: int, variants: Sequence[DetectionParameters] = ()
    ) -> None:
        """Place everybody and give the intruders random goals, again and again."""
        super().__init__(parameters, seed, variants=variants)
        self._test = parameters
        self._free = free_space(self.arena, GOAL_CLEARANCE_M, self.layout.stationary)
        self._stationary = {
            f"stationary {number}": solid.bounding_box()
            for number, solid in enumerate(self.layout.stationary, 1)
        }
        self._goal_rngs = {robot.index: stream(seed, "goals", robot.name) for robot in self.intruders}
        self._sight_noise = self.lidars.noise([stream(seed, "sight", guard.name) for guard in self.guards])
        self._causes = CauseCounter()
        for robot in self.intruders:
            robot.next_goal = self._random_goal

    def frames(self, explain: bool = False) -> Iterator[ScoredFrame]:
        """The trial's frames, each scored against where things are at its own instant."""
        test = self._test
        for number in range(1, test.frames + 1):
            midnet = self.next_frame(explain)
            truths = self.truths()
            in_range = self.in_range(test)
            match = match_frame(midnet.detections, truths)
            counts = count_frame(midnet.detections, truths, in_range, test.tp_boxes, match)
            yield ScoredFrame(number, midnet, truths, in_range, match, counts)

    def causes(self, frame: ScoredFrame) -> Causes:
        """Which of the paper's causes the errors of the newest frame had; take each frame once, in order."""
        opposite = None
        if frame.number % OPPOSITE_EVERY == 0 and len(self.guards) > 1:
            opposite = self.detector.detect_in_opposite_order(self.observations(self.detector))
        return self._causes.count(
            frame.midnet.detections,
            frame.truths,
            frame.match.touched,
            frame.in_range,
            self._all_in_sight,
            opposite,
        )

    def truths(self, test: DetectionParameters | None = None) -> list[TruthObject]:
        """The intruders as they are now: the stationary ones, then the mobile ones (item 45)."""
        test = test or self._test
        margin_m = (
            test.local_costmap.reach_m(test.midnet.thresh_local) if test.truth_box == "inflated" else 0.0
        )
        return [truth._replace(box=truth.box.shrunk(-margin_m)) for truth in self._bodies()]

    def in_range(self, test: DetectionParameters) -> list[bool]:
        """For each truth, whether not finding it now counts as a false negative (item 46).

        "Laser scan range" of section V.A is how far from the sensor a return is marked (item 7). It goes to
        the intruder itself, whatever box it is scored by.
        """
        range_m = test.costmap.obstacle_range_m
        in_range = truths_in_range(self._bodies(), self.sensor_positions(), range_m, test.in_range)
        if test.require_line_of_sight:
            in_range = [near and seen for near, seen in zip(in_range, self._in_sight(range_m), strict=True)]
        return in_range

    def _bodies(self) -> list[TruthObject]:
        mobile = {robot.name: self.lidars.outline(robot.index) for robot in self.intruders}
        return [TruthObject(name, box, box.center) for name, box in (self._stationary | mobile).items()]

    def _all_in_sight(self) -> list[bool]:
        """For each truth, whether a beam meets it within range; True if others do not count."""
        if self._test.require_line_of_sight:
            return [True] * (len(self._stationary) + len(self.intruders))
        return self._in_sight(self._test.costmap.obstacle_range_m)

    def _in_sight(self, range_m: float) -> list[bool]:
        """For each truth, whether a beam of some guard would meet it within range at this instant."""
        guards = [guard.index for guard in self.guards]
        ranges_m, bodies = self.lidars.scan_and_bodies(guards, self._sight_noise)
        near = ranges_m <= range_m
        met = set(bodies[near].tolist())
        beams = self.world.poses()[guards, 2, None] + LDS_01.angles_rad
        ways = directions(beams.reshape(-1)).reshape(*beams.shape, 2)
        ends = np.array(self.sensor_positions())[:, None] + ranges_m[..., None] * ways
        hits = ends[near & (bodies == SOLID)]
        stationary = [
            bool((solid.distance_to(hits) < ON_SURFACE_M).any()) for solid in self.layout.stationary
        ]
        return stationary + [robot.index in met for robot in self.intruders]

    def _random_goal(self, robot: MobileRobot) -> Point:
        return self._free.draw(self._goal_rngs[robot.index])


def run_detection(parameters: DetectionParameters, seed: int) -> TrialResult:
    """One trial: ``scores`` (one row, counts summed), ``frames`` and ``robots``."""
    with DetectionTrial(parameters, seed) as trial:
        frames, causes = [], []
        for frame in trial.frames():
            frames.append(frame.counts)
            causes.append(trial.causes(frame))
        rows: list[Row] = [{"frame": i + 1, **counts._asdict()} for i, counts in enumerate(frames)]
        summed = total(frames)
        scores: Row = {
            "frames": len(frames),
            **summed._asdict(),
            **ratios(summed.tp, summed.fp, summed.fn)._asdict(),
            **total_causes(causes)._asdict(),
            "patrol_relaxations": trial.patrol.relaxations,
        }
        tables = {"scores": [scores], "frames": rows, "robots": trial.rows_of_robots()}
        return TrialResult(tables, simulated_s=len(frames) / FRAME_HZ)
