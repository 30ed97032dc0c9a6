"""Laser scans and odometry in CARMEN's log format, as most indoor SLAM data sets come."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.log_text import finite
from midnet_bench.mapping.motion_model import odometry_increment
from midnet_bench.mapping.scan_log import (
    LoggedScan,
    ScanLog,
    check_same_length,
    half_circle,
    take_ranges,
    with_ceiling,
)
from midnet_bench.messages import LidarGeometry

SCAN_MESSAGES = ("FLASER", "RAWLASER1")
_SAME_PLACE = 1e-3
"""metres and radians by which a fixed laser may seem to move on the robot, for want of digits in the log"""


def parse_carmen(path: Path, lines: list[str]) -> ScanLog:
    """The scans of a CARMEN log with the odometry that belongs to each.

    - ``FLASER n r1..rn x y theta odom_x odom_y odom_theta stamp ...``: the second pose is the odometry.
      The message does not tell the beams' angles: ``half_circle``. Where the first pose, the laser's, lies at
      one and the same place on the robot in the whole log, that is the sensor's mount.
    - ``RAWLASER1 type start_angle fov step range_max accuracy mode n r1..rn m s1..sm stamp ...`` with
      ``ODOM x y theta ...``: the last ODOM before a scan counts; scans before the first one are passed over.

    In a log with both, the kind that comes first counts. Comments and all other messages are passed over.

    Raises:
        InputError: no scan, no odometry, a number that is none, or a scan unlike the first one of the log.
    """
    kind = next((words[0] for line in lines if (words := line.split()) and words[0] in SCAN_MESSAGES), None)
    if kind is None:
        raise InputError(f"{path}: no laser scan: no line begins with {' or '.join(SCAN_MESSAGES)}")
    return _parse_flaser(path, lines) if kind == "FLASER" else _parse_rawlaser(path, lines)


def _parse_flaser(path: Path, lines: list[str]) -> ScanLog:
    scans: list[LoggedScan] = []
    lasers_on_base: list[Pose2D] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words[:1] != ["FLASER"]:
            continue
        where = f"{path}:{number}"
        ranges_m, rest = take_ranges(words[1:], where)
        if len(rest) < 7:
            raise InputError(
                f"{where}: odometry missing: x y theta, odom_x odom_y odom_theta and a stamp must follow the "
                f"{len(ranges_m)} ranges; the line holds {len(rest)} more words"
            )
        laser = Pose2D(*finite(rest[0:3], where, "laser pose"))
        odometry = Pose2D(*finite(rest[3:6], where, "odometry"))
        scans.append(LoggedScan(finite(rest[6:7], where, "stamp")[0], odometry, ranges_m))
        check_same_length(scans, where)
        lasers_on_base.append(odometry_increment(odometry, laser))
    geometry = half_circle(len(scans[0].ranges_m))
    if np.ptp(np.array(lasers_on_base), axis=0).max() < _SAME_PLACE:
        geometry = replace(geometry, mount=lasers_on_base[0])
    return ScanLog(path, with_ceiling(geometry, scans), scans)


def _parse_rawlaser(path: Path, lines: list[str]) -> ScanLog:
    scans: list[LoggedScan] = []
    geometry: LidarGeometry | None = None
    odometry: Pose2D | None = None
    for number, line in enumerate(lines, start=1):
        words = line.split()
        where = f"{path}:{number}"
        if words[:1] == ["ODOM"]:
            if len(words) < 4:
                raise InputError(f"{where}: odometry missing: ODOM must be followed by x y theta")
            odometry = Pose2D(*finite(words[1:4], where, "odometry"))
        if words[:1] != ["RAWLASER1"] or odometry is None:
            continue
        start_rad, _, step_rad, range_max_m = finite(
            words[2:6], where, "start angle, fov, step, largest range"
        )
        ranges_m, rest = take_ranges(words[8:], where)
        remissions = int(rest[0]) if rest and rest[0].isdigit() else 0
        stamp = finite(rest[1 + remissions : 2 + remissions], where, "stamp")
        if not stamp:
            raise InputError(f"{where}: the line ends before the stamp of the scan")
        scans.append(LoggedScan(stamp[0], odometry, ranges_m))
        check_same_length(scans, where)
        if geometry is None:
            base = Pose2D(0.0, 0.0, 0.0)
            geometry = LidarGeometry(len(ranges_m), start_rad, step_rad, 0.0, range_max_m, base)
    if geometry is None:
        raise InputError(f"{path}: odometry missing: no ODOM line comes before a RAWLASER1 line")
    return ScanLog(path, with_ceiling(geometry, scans), scans)
