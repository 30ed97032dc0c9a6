"""Any recording that ``replay`` reads as a log of scans with odometry, for SLAM."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.scan_logs import LoggedScan, ScanLog
from midnet_bench.recording.inputs import opened
from midnet_bench.recording.plan import Recorded, robots_of
from midnet_bench.recording.replay import Replay
from midnet_bench.recording.setup import EVERY, FOUND, RecordingSetup


def scan_log_of(path: Path, note: Callable[[str], None]) -> ScanLog:
    """The scans of a recording's robot, each with its pose by the wheels, or by tf as far up as it goes.

    Ranges without a return are the sensor's largest, NaN says nothing. ``note`` gets remarks on the file.

    Raises:
        InputError: the file is no recording, has several robots or lasers, no pose, or scans of several
            LiDARs.
    """
    setup = RecordingSetup().changed({"start": {EVERY: FOUND}, "map": None})
    with opened([path]) as sources:
        recorded = Recorded.of(sources, setup)
        for remark in (*sources[0].remarks, *recorded.surveys[0].remarks):
            note(remark)
        robots = robots_of(recorded, setup)
        if len(robots) > 1:
            names = ", ".join(robot.name for robot in robots)[:100]
            raise InputError(f"{path}: has {len(robots)} lasers ({names}); SLAM takes a recording of one")
        note(f"{path}: scans {robots[0].topic}, poses {robots[0].pose.in_words}")
        nothing = OccupancyGrid(np.zeros((1, 1), np.int8), 0.05, (0.0, 0.0))
        frames = Replay(recorded, robots, nothing, {}, setup).frames()
        scans = [(one.scan, one.estimate.pose) for frame in frames for one in frame.observed if one.scan]
    if not scans:
        raise InputError(f"{path}: no scan of it has a pose; give a recording with odometry")
    lidar = scans[0][0].lidar
    logged = []
    for scan, pose in scans:
        if scan.lidar.beams != lidar.beams:
            beams = f"{lidar.beams} and of {scan.lidar.beams} beams"
            raise InputError(f"{path}: scans of {beams}; SLAM takes one laser")
        ranges_m = np.where(np.isinf(scan.ranges_m), lidar.range_max_m, scan.ranges_m)
        logged.append(LoggedScan(scan.stamp_s, pose, ranges_m))
    return ScanLog(path, lidar, logged)
