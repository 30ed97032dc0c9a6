"""Scans out of a survey with the poses around each, for the check of the setup."""

from collections.abc import Sequence

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.survey import Survey, spread
from midnet_bench.recording.fitting.fit import Sample
from midnet_bench.recording.plan import Link, RobotPlan
from midnet_bench.recording.poses import Clock, PoseInterpolator, PoseTrack, stamp_ns
from midnet_bench.recording.replay import geometry_of

MOST = 120
REACH_S, STEP_S = 0.8, 0.04
"""how far before and after a scan its robot's poses are sampled, and how densely"""


def samples_of(
    surveys: Sequence[Survey],
    robot: RobotPlan,
    clock: Clock,
    max_pose_age_s: float,
    offsets_ns: Sequence[int],
    most: int = MOST,
) -> list[Sample]:
    """At most so many scans of a robot that have a pose, spread over what was looked at."""
    where = _interpolator(surveys, robot, clock, offsets_ns)
    scans = [scan for scan in surveys[robot.source].streams[robot.scan_topic].scans if len(scan.ranges_m)]
    own_ns = offsets_ns[robot.source] if offsets_ns else 0
    around_ns = (np.arange(-REACH_S, REACH_S + STEP_S / 2.0, STEP_S) * NS).astype(np.int64)
    found = []
    for scan in spread(scans, most):
        time_ns = stamp_ns(scan, clock) + own_ns - robot.delay_ns
        estimate = where.at(time_ns)
        if estimate is None or estimate.age_s > max_pose_age_s:
            continue
        numbers = scan.geometry(robot.no_return.range_max_m)
        try:
            lidar = geometry_of(numbers, len(scan.ranges_m), robot.mount, robot.is_mirrored)
        except InputError:
            continue  # the replay says so
        track = PoseTrack()
        for near_ns in (time_ns + around_ns).tolist():
            near = where.at(near_ns)
            if near is not None and near.age_s <= max_pose_age_s:
                track.add(near_ns, near.pose)
        found.append(Sample(time_ns, robot.no_return.cleaned(scan), lidar, track))
    return found


def _interpolator(
    surveys: Sequence[Survey], robot: RobotPlan, clock: Clock, offsets_ns: Sequence[int]
) -> PoseInterpolator:
    """Where the robot was, by all the poses that were looked at."""
    links: list[PoseTrack | Pose2D] = []
    for link in robot.pose.links:
        if not isinstance(link, Link):
            links.append(link)
            continue
        track = PoseTrack()
        for reading in link.seen(surveys):
            track.take(stamp_ns(reading, clock) + (offsets_ns[link.source] if offsets_ns else 0), reading)
        links.append(track)
    return PoseInterpolator(links)
