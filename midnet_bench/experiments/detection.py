"""The detection test of section V.A: who is seen, frame by frame."""

from collections.abc import Iterator
from dataclasses import dataclass

from midnet_bench.agents.mobile_robot import MobileRobot, Point
from midnet_bench.experiments.guarded_arena import FRAME_HZ, GuardedArena, costmap_settings, inflation_m
from midnet_bench.experiments.parameters import DetectionParameters
from midnet_bench.experiments.trial import Row, TrialResult
from midnet_bench.geometry import Box
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import FrameCounts, TruthObject, count_frame, total, truths_in_range
from midnet_bench.scoring.ratios import ratios
from midnet_bench.simulation.free_space import free_space

GOAL_CLEARANCE_M = 0.4
"""From a mobile intruder's goal to walls and stationary intruders (paper-notes item 49)."""


@dataclass(frozen=True)
class ScoredFrame:
    """One frame and how it was scored."""

    number: int
    """counted from 1"""
    midnet: Frame
    truths: list[TruthObject]
    in_range: list[bool]
    counts: FrameCounts


class DetectionTrial(GuardedArena):
    """Map 1 in motion: guards patrol, mobile intruders wander, MIDNet looks on."""

    def __init__(self, parameters: DetectionParameters, seed: int) -> None:
        """Place everybody and give the intruders random goals, again and again."""
        super().__init__(parameters, seed)
        self._test = parameters
        self._free = free_space(self.arena, GOAL_CLEARANCE_M, self.layout.stationary)
        self._goal_rngs = {robot.index: stream(seed, "goals", i) for i, robot in enumerate(self.intruders)}
        self._sight_noise = [stream(seed, "sight", guard.index) for guard in self.guards]
        for robot in self.intruders:
            robot.next_goal = self._random_goal
        self._inflation_m = (
            inflation_m(costmap_settings(parameters), parameters.thresh_local)
            if parameters.truth_box == "inflated"
            else 0.0
        )

    def frames(self, explain: bool = False) -> Iterator[ScoredFrame]:
        """The trial's frames, each scored against where things are at its own instant."""
        test = self._test
        for number in range(1, test.frames + 1):
            midnet = self.next_frame(explain)
            truths = self.truths()
            in_range = truths_in_range(truths, self.sensor_positions(), test.obstacle_range_m, test.in_range)
            if test.require_line_of_sight:
                in_range = [near and seen for near, seen in zip(in_range, self._in_sight(), strict=True)]
            counts = count_frame(midnet.detections, truths, in_range)
            yield ScoredFrame(number, midnet, truths, in_range, counts)

    def truths(self) -> list[TruthObject]:
        """The intruders as they are now: the stationary ones, then the mobile ones."""
        stationary = [
            self._truth(f"stationary {i + 1}", solid.bounding_box())
            for i, solid in enumerate(self.layout.stationary)
        ]
        return stationary + [
            self._truth(self.name_of(robot), self.world.scan_outline(robot.index)) for robot in self.intruders
        ]

    def _in_sight(self) -> list[bool]:
        """For each truth, whether a beam of some guard would meet it within range at this instant."""
        guards = [guard.index for guard in self.guards]
        ranges_m, bodies = self.world.scan_and_bodies(guards, self._sight_noise)
        met = set(bodies[ranges_m <= self._test.obstacle_range_m].tolist())
        first_stationary = len(self.fleet.robots)
        stationary = range(first_stationary, first_stationary + len(self.layout.stationary))
        return [body in met for body in (*stationary, *(robot.index for robot in self.intruders))]

    def _truth(self, name: str, box: Box) -> TruthObject:
        return TruthObject(name, box.shrunk(-self._inflation_m), box.center)

    def _random_goal(self, robot: MobileRobot) -> Point:
        return self._free.draw(self._goal_rngs[robot.index])


def run_detection(parameters: DetectionParameters, seed: int) -> TrialResult:
    """One trial: ``scores`` (one row, counts summed), ``frames`` and ``robots``."""
    with DetectionTrial(parameters, seed) as trial:
        frames = [frame.counts for frame in trial.frames()]
        rows: list[Row] = [{"frame": i + 1, **counts._asdict()} for i, counts in enumerate(frames)]
        summed = total(frames)
        scores: Row = {
            "frames": len(frames),
            **summed._asdict(),
            **ratios(summed.tp, summed.fp, summed.fn)._asdict(),
            "patrol_relaxations": trial.patrol.relaxations,
        }
        tables = {"scores": [scores], "frames": rows, "robots": trial.rows_of_robots()}
        return TrialResult(tables, simulated_s=len(frames) / FRAME_HZ)
