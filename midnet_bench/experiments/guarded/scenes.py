"""A guarded trial as the plain data that pictures are drawn from."""

from collections.abc import Sequence

import numpy as np

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.drawing.scene import Detection, Floats, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.elementary import directions
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import Pose2D
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.scoring.frame_counts import TruthObject, match_frame


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


def scene_of(
    trial: GuardedArena, frame: Frame, truths: Sequence[TruthObject], in_range: Sequence[bool]
) -> Scene:
    """The trial as it is now, with the detections of ``frame``, its newest.

    Args:
        trial: at the frame's instant.
        frame: what the detector says.
        truths: the intruders that it is to find.
        in_range: for each of them, whether not finding it is an error.
    """
    active, poses = trial.world.active, trial.world.poses()
    robots = [
        _robot(robot, Pose2D(*poses[robot.index].tolist()), trial)
        for robot in trial.fleet.robots
        if active[robot.index]
    ]
    others = {member.name: [one.outline() for one in member.solids()] for member in trial.crowd.members}
    outlines = {
        f"stationary {number}": [solid.outline()] for number, solid in enumerate(trial.layout.stationary, 1)
    }
    outlines |= {f"intruder {robot.number}": [robot.outline] for robot in robots if not robot.is_guard}
    outlines |= others
    match = match_frame(frame.detections, truths)
    found = {truth for each in match.touched for truth in each}
    return Scene(
        time_s=trial.fleet.time_s,
        frame=round(trial.fleet.time_s * FRAME_HZ),
        robots=robots,
        detections=[
            Detection(box, guard + 1, not touched, is_further=bool(touched) and truth is None)
            for box, guard, touched, truth in zip(
                frame.detections, frame.robots, match.touched, match.truth_of, strict=True
            )
        ],
        truths=[
            Truth(outlines[truth.name], index in found, near)
            for index, (truth, near) in enumerate(zip(truths, in_range, strict=True))
        ],
        explanation=frame.explanation,
        others=list(others.values()),
        scans=[_returns(guard, trial) for guard in trial.guards if active[guard.index]],
    )


def _returns(guard: Guard, trial: GuardedArena) -> Floats:
    """(n, 2) the returns of a guard's last scan in usable range, from where it took itself to be; metres."""
    scan = guard.scan
    if scan is None:
        return np.empty((0, 2))
    ranges_m = np.asarray(scan.ranges_m)
    usable = (ranges_m > 0.0) & (ranges_m <= trial.parameters.costmap.obstacle_range_m)
    ends = ranges_m[usable, None] * directions(np.asarray(scan.lidar.angles_rad)[usable])
    return scan.pose.compose(scan.lidar.mount).transform(ends)


def _robot(robot: MobileRobot, pose: Pose2D, trial: GuardedArena) -> Robot:
    is_guard = isinstance(robot, Guard)
    number = robot.index + 1 if is_guard else robot.index - len(trial.guards) + 1
    return Robot(number, is_guard, pose, robot.pose, robot.goal, robot.navigator.plan(), trial.robot)
