"""The labyrinth test of section V.B: which intruders are caught before they escape."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from weakref import proxy

import numpy as np

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.agents.pursuit import Pursuit, TeamPursuit
from midnet_bench.arena.free_space import doors
from midnet_bench.arena.layout import Layout, place
from midnet_bench.campaign.trial import Row, TrialResult
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena, ObservedFrame, ScoredFrame
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.experiments.guarded.record import CAPTURES
from midnet_bench.experiments.guarded.recorder import Recorder
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.geometry import Box, Point, Pose2D, lengths
from midnet_bench.midnet.fusion import ally_squares
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.rng import stream
from midnet_bench.scoring.frame_counts import TruthObject, truths_in_range
from midnet_bench.scoring.metric import NONE as NO_METRICS
from midnet_bench.simulation.fleet import crossed_wall, surfaces

REFUGES = 64  # How many random points a fleeing intruder weighs against each other.


@dataclass
class Outcome:
    """What became of one intruder; seconds since the start, NaN for what did not happen."""

    start: Point
    escape: Point  # where it heads; with ``at_escape: drives_on`` each place in turn
    straight_m: float  # from its start to its first escape
    detected_at_s: float = math.nan
    caught_at_s: float = math.nan
    escaped_at_s: float = math.nan
    left_at_s: float = math.nan  # when it was taken out of the arena, caught or escaped
    caught_by: Guard | None = None  # the guard that caught it

    @property
    def result(self) -> str:
        """``caught``, ``escaped`` or, at the time limit, ``at large``."""
        if not math.isnan(self.caught_at_s):
            return "caught"
        return "at large" if math.isnan(self.escaped_at_s) else "escaped"

    def row(self, number: int) -> Row:
        """``intruders.csv``: seconds and metres."""
        return {
            "intruder": number,
            "outcome": self.result,
            "detected_at_s": self.detected_at_s,
            "caught_at_s": self.caught_at_s,
            "escaped_at_s": self.escaped_at_s,
            "left_at_s": self.left_at_s,
            "straight_m": self.straight_m,
        }


class LabyrinthTrial(GuardedArena):
    """Map 2 in motion: intruders head for their escapes, guards patrol and pursue."""

    def __init__(self, parameters: LabyrinthParameters, seed: int) -> None:
        """Place the robots and give each intruder an escape far enough from its start (item 56)."""
        self._test = parameters
        super().__init__(parameters, seed, parameters.intruders)
        self._free = self.goal_space()
        self._doors = doors(self.arena) if parameters.escape_at == "doors" else []
        self._surfaces = surfaces(self.layout)
        self._refuge_rng = stream(seed, "refuge")
        self._is_oracle = parameters.pursuit.rule == "oracle"
        rule = TeamPursuit(parameters.pursuit.rule, self.prior_map, stream(seed, "pursuit"))
        self.pursuit = Pursuit(self.guards, parameters.pursuit, rule)
        self.recorder = (
            Recorder(self, parameters) if parameters.record or parameters.metrics != NO_METRICS else None
        )
        self.targets = 0  # of the pursuit so far
        self.false_targets: set[int] = set()  # those of them whose first box was on no intruder
        self.false_pursuits = 0  # guards that pursued one of these, summed over the frames
        self.outcomes: dict[int, Outcome] = {}
        self._escape_rngs: dict[int, np.random.Generator] = {}
        trial = proxy(self)
        for robot in self.intruders:
            start = (robot.pose.x, robot.pose.y)
            rng = self._escape_rngs[robot.index] = stream(seed, "escape", robot.name)
            escape = self._escape_of(start, rng)
            self.outcomes[robot.index] = Outcome(start, escape, math.dist(start, escape))
            robot.next_goal = lambda robot: trial._next_goal_of_intruder(robot)

    @property
    def present(self) -> list[MobileRobot]:
        """Intruders that are still in the arena; a caught one may be."""
        return [robot for robot in self.intruders if math.isnan(self.outcomes[robot.index].left_at_s)]

    def frames(self, explain: bool = False) -> Iterator[ObservedFrame]:
        """MIDNet's frames until every intruder is caught or gone, or the time is up (item 58)."""
        to_the_end = self._test.ends == "time_limit"
        while (to_the_end or self.present) and self.fleet.time_s < self._test.time_limit_s - 1e-9:
            midnet = self.next_frame(explain or self._test.record)
            if self.recorder:  # before an intruder is taken out
                self.recorder.take(self.scored(midnet), self.pursuit.pursuers)
            self._update(midnet)
            yield midnet

    def truths(self) -> list[TruthObject]:
        """The intruders that are still in the arena, where they are now."""
        outlines = {robot.name: self.lidars.outline(robot.index) for robot in self.present}
        return [TruthObject(name, box, box.center) for name, box in outlines.items()]

    def scored(self, midnet: ObservedFrame) -> ScoredFrame:
        """The newest frame beside the truth; in range is an intruder's centre."""
        truths, range_m = self.truths(), self._test.usable_range_m
        in_range = truths_in_range(truths, self.sensor_positions(), range_m, "centre", self.fields_of_view())
        return ScoredFrame(round(self.fleet.time_s * FRAME_HZ), midnet, truths, in_range)

    def _placed(self, mobile_intruders: int | None) -> Layout:
        return layout_of(self._test, self.seed)

    def _update(self, midnet: ObservedFrame) -> None:
        """Update the outcomes of this instant, and the goals of guards and of fleeing intruders.

        Outcomes go by the truth. Pursuit gets the boxes alone, but under ``oracle``.
        """
        now_s = self.fleet.time_s
        if not self._is_oracle:
            targets = self.pursuit.targets
            self.false_pursuits += sum(
                len(targets[name].pursuers) for name in self.false_targets & set(targets)
            )
            self._see(midnet, now_s)
        for robot in self.present:
            outcome = self.outcomes[robot.index]
            boxes = self._boxes_on(robot, midnet)
            has_arrived = (
                self._test.at_escape == "leaves"
                and math.dist(self._place(robot), outcome.escape) <= self._test.escape_radius_m
            )
            if outcome.result == "at large":
                self._update_at_large(robot, boxes, has_arrived, now_s)
            is_taken_out = outcome.result == "caught" and self._test.after_capture == "leaves"
            if is_taken_out or has_arrived:
                outcome.left_at_s = now_s
                self.fleet.remove(robot)
        self.pursuit.update(now_s)
        if self._test.evasion == "flee":
            self._flee()

    def _update_at_large(
        self, robot: MobileRobot, boxes: Sequence[tuple[Box, Guard]], has_arrived: bool, now_s: float
    ) -> None:
        """Whether an intruder is detected, caught or escaped now; ``boxes``: those on it, of which guard."""
        outcome = self.outcomes[robot.index]
        if boxes:
            outcome.detected_at_s = now_s if math.isnan(outcome.detected_at_s) else outcome.detected_at_s
            if self._is_oracle:
                self.pursuit.detected(robot.index, boxes[0][0].center, now_s)
        catchers = self._catchers(robot, boxes)
        if catchers:
            outcome.caught_at_s, outcome.caught_by = now_s, catchers[0]
        elif has_arrived:
            outcome.escaped_at_s = now_s
        if self._is_oracle and outcome.result != "at large":
            self.pursuit.drop(robot.index)

    def _see(self, midnet: ObservedFrame, now_s: float) -> None:
        """Hand the boxes to the pursuit, and note for the record which new targets are no intruders."""
        poses = [observation.pose for observation in midnet.observations]
        squares = ally_squares(poses, self._test.midnet.ally_diameter_m)
        seen = self.pursuit.see(midnet.detections, squares, now_s)
        new = {target: box for target, box in seen.items() if target >= self.targets}
        if new:
            self.targets += len(new)
            outlines = [self.lidars.outline(robot.index) for robot in self.present]
            self.false_targets |= {
                target
                for target, box in new.items()
                if not any(box.intersection_area(outline) > 0.0 for outline in outlines)
            }

    def _boxes_on(self, robot: MobileRobot, midnet: Frame) -> list[tuple[Box, Guard]]:
        """The detections that cover some of an intruder (item 53), each with its guard."""
        outline = self.lidars.outline(robot.index)
        return [
            (box, self.guards[guard])
            for box, guard in zip(midnet.detections, midnet.robots, strict=True)
            if box.intersection_area(outline) > 0.0
        ]

    def _catchers(self, robot: MobileRobot, boxes: Sequence[tuple[Box, Guard]]) -> list[Guard]:
        """The guards that catch an intruder that has ``boxes`` on it (item 53), the nearest first.

        Walls keep guards off. An intruder without a box on it is not caught.
        """
        if not boxes or self._test.capture == "detected":
            return [guard for _, guard in boxes]
        contact_m = 2.0 * self.robot.radius_m  # robots whose centres are this near touch
        reach_m = self._test.capture_distance_m if self._test.capture == "within" else contact_m
        place = self._place(robot)
        near = [(math.dist(self._place(guard), place), guard) for guard in self.guards_alive]
        reaching = [
            (gap_m, guard)
            for gap_m, guard in near
            if gap_m <= reach_m
            and not crossed_wall(self._surfaces, np.array([self._place(guard)]), np.array([place]))[0]
        ]
        return [guard for _, guard in sorted(reaching, key=lambda each: each[0])]

    def _place(self, robot: MobileRobot) -> Point:
        x, y = self.world.poses()[robot.index, :2].tolist()
        return x, y

    def _escape_of(self, start: Point, rng: np.random.Generator) -> Point:
        """Item 56."""
        test = self._test
        if test.escape_at == "anywhere":
            return self._free.draw(rng, start, test.escape_distance_m)
        farthest_first = sorted(self._doors, key=lambda door: -math.dist(start, door))
        far = [door for door in farthest_first if math.dist(start, door) >= test.escape_distance_m]
        candidates = far or farthest_first[:1]
        return candidates[int(rng.integers(len(candidates)))]

    def _next_goal_of_intruder(self, robot: MobileRobot) -> Point | None:
        """Its escape; under ``at_escape: drives_on`` another free place each time it is done with a goal."""
        if self.fleet.time_s < self._test.intruder_wait_s:
            return None
        outcome = self.outcomes[robot.index]
        if robot.goals_set and self._test.at_escape == "drives_on":
            outcome.escape = self._free.draw(self._escape_rngs[robot.index])
        return outcome.escape

    def _flee(self) -> None:
        """Send intruders that a guard comes close to where no guard is near (item 57)."""
        guards = np.array([self._place(guard) for guard in self.guards])
        for robot in self.present:
            is_close = lengths(guards - self._place(robot)).min() < self._test.flee_radius_m
            escape = self.outcomes[robot.index].escape
            is_fleeing = robot.goal not in (None, escape)
            if is_close and not is_fleeing:
                refuges = np.array([self._free.draw(self._refuge_rng) for _ in range(REFUGES)])
                gaps = lengths(refuges[:, None] - guards[None]).min(axis=1)
                robot.drive_to(tuple(refuges[int(gaps.argmax())].tolist()))
            elif is_fleeing and not is_close:
                robot.drive_to(escape)


def layout_of(parameters: LabyrinthParameters, seed: int) -> Layout:
    """Where everything starts: intruders anywhere, or each at an entrance of its own that the seed draws."""
    count, entrances = parameters.intruders, parameters.entrances
    reach_m = parameters.simulation.robot_model.body_reach_m
    layout = place(parameters.guarded_place, seed, parameters.robots, 0 if entrances else count, reach_m)
    if not entrances:
        return layout
    rng = stream(seed, "entrance")
    chosen = [entrances[k] for k in rng.permutation(len(entrances))[:count].tolist()]
    poses = tuple(Pose2D(x, y, float(rng.uniform(-math.pi, math.pi))) for x, y in chosen)
    return replace(layout, intruders=poses)


def run_labyrinth(parameters: LabyrinthParameters, seed: int) -> TrialResult:
    """One trial: ``trial`` (one row), ``intruders``, ``robots``; by options others."""
    with LabyrinthTrial(parameters, seed) as trial:
        for _ in trial.frames():
            pass
        outcomes = [trial.outcomes[robot.index] for robot in trial.intruders]
        caught = sum(outcome.result == "caught" for outcome in outcomes)
        row: Row = {
            "caught": caught,
            "detected": sum(not math.isnan(outcome.detected_at_s) for outcome in outcomes),
            "escaped": sum(outcome.result == "escaped" for outcome in outcomes),
            "success_rate": 100.0 * caught / len(outcomes),
            "duration_s": trial.fleet.time_s,
            "ended": "time limit" if trial.present or parameters.ends == "time_limit" else "nobody left",
            "patrol_relaxations": trial.patrol.relaxations,
            "targets": trial.targets,
            "ghost_targets": len(trial.false_targets),
            "false_target_s": trial.false_pursuits / FRAME_HZ,
        }
        tables = {
            "trial": [row],
            "intruders": [outcome.row(number) for number, outcome in enumerate(outcomes, 1)],
            "robots": trial.rows_of_robots(),
            **(trial.recorder.tables() if trial.recorder else {}),
        }
        captures: list[Row] = [
            {"intruder": number, "guard": outcome.caught_by.index + 1}
            for number, outcome in enumerate(outcomes, 1)
            if outcome.caught_by is not None
        ]
        if parameters.record and captures:
            tables[CAPTURES] = captures
        return TrialResult(tables, simulated_s=trial.fleet.time_s)
