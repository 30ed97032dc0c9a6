"""Trials as the plain data that pictures are drawn from."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.drawing.scene import Chase, Demo, Detection, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.elementary import directions
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena, ScoredFrame
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.geometry import Floats, Pose2D
from midnet_bench.scoring.frame_counts import NOTHING, ratios, total


@contextmanager
def detection_demo(parameters: DetectionParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene."""
    with DetectionTrial(parameters, seed) as trial:
        yield Demo(setup_of(trial), parameters.frames, _detection_scenes(trial))


def _detection_scenes(trial: DetectionTrial) -> Iterator[Scene]:
    summed = NOTHING
    for scored in trial.frames(explain=True):
        summed = total([summed, scored.counts])
        scene = scene_of(trial, scored)
        yield replace(scene, so_far=ratios(summed.tp, summed.fp, summed.fn))


@contextmanager
def labyrinth_demo(parameters: LabyrinthParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene, until no intruder is at large or the time is up."""
    with LabyrinthTrial(parameters, seed) as trial:
        # a last frame that the time limit falls into is made in full
        max_frames = math.ceil(parameters.time_limit_s * FRAME_HZ - 1e-6)
        yield Demo(setup_of(trial), max_frames, _labyrinth_scenes(trial))


def _labyrinth_scenes(trial: LabyrinthTrial) -> Iterator[Scene]:
    """Each frame with the intruders that leave after it, and the outcomes so far."""
    seen: list[Scene] = []
    trial.frame_callbacks.append(lambda frame: seen.append(scene_of(trial, trial.scored(frame))))
    for _ in trial.frames(explain=True):
        yield replace(seen.pop(), chase=_chase(trial))


def _chase(trial: LabyrinthTrial) -> Chase:
    outcomes = [trial.outcomes[robot.index] for robot in trial.intruders]
    events: list[tuple[float, str]] = []
    for number, outcome in enumerate(outcomes, 1):
        name = f"intruder {number} " if len(outcomes) > 1 else ""
        if outcome.caught_by is not None:
            by = outcome.caught_by.index + 1
            events.append((outcome.caught_at_s, f"{name}caught by guard {by}, {outcome.caught_at_s:.1f} s"))
        elif outcome.result == "escaped":
            events.append((outcome.escaped_at_s, f"{name}escaped, {outcome.escaped_at_s:.1f} s"))
    results = [outcome.result for outcome in outcomes]
    lines = tuple(text for _, text in sorted(events))
    return Chase(len(outcomes), results.count("caught"), results.count("escaped"), lines)


def setup_of(trial: GuardedArena) -> Setup:
    """What stays the same during the trial, which has not begun yet."""
    return Setup(
        plan=FloorPlan.of(trial.arena, trial.layout, trial.seed),
        prior_map=trial.prior_map,
        prior=trial.prior,
        guards=len(trial.guards),
        mobile_intruders=len(trial.intruders),
        usable_range_m=trial.parameters.usable_range_m,
        local_size_m=trial.parameters.local_costmap.size_m,
        frame_hz=FRAME_HZ,
        other_intruders=len(trial.crowd.members),
    )


def scene_of(trial: GuardedArena, frame: ScoredFrame) -> Scene:
    """The trial as it is now, with its newest frame."""
    active, poses = trial.world.active, trial.world.poses()
    robots = [
        _robot(robot, Pose2D(*poses[robot.index].tolist()), trial)
        for robot in trial.fleet.robots
        if active[robot.index]
    ]
    others = {member.name: [one.outline for one in member.solids()] for member in trial.crowd.members}
    outlines = {
        f"stationary {number}": [solid.outline] for number, solid in enumerate(trial.layout.stationary, 1)
    }
    outlines |= {f"intruder {robot.number}": [robot.outline] for robot in robots if not robot.is_guard}
    outlines |= others
    match, midnet = frame.match, frame.midnet
    found = {truth for each in match.touched for truth in each}
    return Scene(
        time_s=trial.fleet.time_s,
        frame=frame.number,
        robots=robots,
        detections=[
            Detection(box, guard + 1, not touched, is_further=bool(touched) and truth is None)
            for box, guard, touched, truth in zip(
                midnet.detections, midnet.robots, match.touched, match.truth_of, strict=True
            )
        ],
        truths=[
            Truth(outlines[truth.name], index in found, near)
            for index, (truth, near) in enumerate(zip(frame.truths, frame.in_range, strict=True))
        ],
        explanation=midnet.explanation,
        others=list(others.values()),
        scans=[_returns(guard, trial) for guard in trial.guards if active[guard.index]],
    )


def _returns(guard: Guard, trial: GuardedArena) -> Floats:
    """(n, 2) the returns of a guard's last scan in usable range, from where it took itself to be; metres."""
    scan = guard.scan
    if scan is None:
        return np.empty((0, 2))
    ranges_m = np.asarray(scan.ranges_m)
    usable = (ranges_m > 0.0) & (ranges_m <= trial.parameters.usable_range_m)
    ends = ranges_m[usable, None] * directions(np.asarray(scan.lidar.angles_rad)[usable])
    return scan.pose.compose(scan.lidar.mount).transform(ends)


def _robot(robot: MobileRobot, pose: Pose2D, trial: GuardedArena) -> Robot:
    is_guard = isinstance(robot, Guard)
    number = robot.index + 1 if is_guard else robot.index - len(trial.guards) + 1
    return Robot(number, is_guard, pose, robot.pose, robot.goal, robot.navigator.plan(), trial.robot)
