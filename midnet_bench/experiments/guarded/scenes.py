"""A guarded trial as the plain data that pictures are drawn from."""

from collections.abc import Sequence

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.drawing.scene import Detection, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.experiments.guarded.arena import FRAME_HZ, GuardedArena
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.pipeline import Frame


def setup_of(trial: GuardedArena) -> Setup:
    """What stays the same during the trial, which has not begun yet."""
    return Setup(
        plan=FloorPlan.of(trial.arena, trial.layout, trial.seed),
        prior_map=trial.prior_map,
        prior=trial.prior,
        guards=len(trial.guards),
        mobile_intruders=len(trial.intruders),
        usable_range_m=trial.parameters.costmap.obstacle_range_m,
        local_size_m=trial.parameters.local_costmap.size_m,
        frame_hz=FRAME_HZ,
        other_intruders=len(trial.crowd.members),
    )


def scene_of(trial: GuardedArena, frame: Frame) -> Scene:
    """The trial as it is now, with the detections of ``frame``, its newest."""
    active, poses = trial.world.active, trial.world.poses()
    robots = [
        _robot(robot, Pose2D(*poses[robot.index].tolist()), trial)
        for robot in trial.fleet.robots
        if active[robot.index]
    ]
    stationary = trial.layout.stationary
    outlines = [solid.outline() for solid in stationary]
    outlines += [robot.outline for robot in robots if not robot.is_guard]
    others = [[solid.outline() for solid in member.solids()] for member in trial.crowd.members]
    targets = [solid.bounding_box() for solid in stationary]
    targets += [trial.lidars.outline(robot.index) for robot in trial.intruders if active[robot.index]]
    found = [not _touches(target, frame.detections) for target in targets]
    truths = [Truth(outline, missed) for outline, missed in zip(outlines, found, strict=True)]
    for member, legs in zip(trial.crowd.members, others, strict=True):
        is_missed = not _touches(member.extent(), frame.detections)
        truths += [Truth(leg, is_missed) for leg in legs]
        targets.append(member.extent())
    return Scene(
        time_s=trial.fleet.time_s,
        frame=round(trial.fleet.time_s * FRAME_HZ),
        robots=robots,
        detections=[
            Detection(box, guard + 1, not _touches(box, targets))
            for box, guard in zip(frame.detections, frame.robots, strict=True)
        ],
        truths=truths,
        explanation=frame.explanation,
        others=others,
    )


def _touches(box: Box, others: Sequence[Box]) -> bool:
    return any(box.intersection_area(other) > 0.0 for other in others)


def _robot(robot: MobileRobot, pose: Pose2D, trial: GuardedArena) -> Robot:
    is_guard = isinstance(robot, Guard)
    number = robot.index + 1 if is_guard else robot.index - len(trial.guards) + 1
    return Robot(number, is_guard, pose, robot.pose, robot.goal, robot.navigator.plan(), trial.robot)
