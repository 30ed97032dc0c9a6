"""Laser scans and odometry in CARMEN's log format, as most indoor SLAM data sets come."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.log_text import count_of, finite
from midnet_bench.mapping.motion_model import odometry_increment
from midnet_bench.mapping.scan_log import (
    LARGEST_MAP_M,
    LoggedScan,
    ScanLog,
    check_newest,
    half_circle,
    take_ranges,
)
from midnet_bench.messages import LidarGeometry

Floats = npt.NDArray[np.float64]

_SAME_PLACE = 1e-3
"""metres and radians by which a fixed laser may seem to move on the robot, for want of digits in the log"""


def parse_carmen(path: Path, lines: list[str]) -> ScanLog:
    """The scans of a CARMEN log with the odometry that belongs to each.

    - ``FLASER n r1..rn x y theta odom_x odom_y odom_theta stamp ...``: the second pose is the odometry.
      The message does not tell the beams' angles: ``half_circle``.
    - ``RAWLASER1 type start_angle fov step range_max accuracy mode n r1..rn m s1..sm stamp ...`` with
      ``ODOM x y theta ...``: the last ODOM before a scan counts; scans before the first one are passed over.
    - ``ROBOTLASER1`` as ``RAWLASER1`` up to the remissions, which old logs leave out, then the poses of laser
      and robot and more; ``stamp host stamp`` end the line. The robot's pose is the odometry.

    Where a laser's pose lies at one and the same place on the robot in the whole log, that is the sensor's
    mount. In a log of several kinds, the kind that comes first counts. Comments and all other messages are
    passed over.

    Raises:
        InputError: no scan, no odometry, a number that is none or that no scanner has, or a scan unlike the
            first one of the log.
    """
    kind = next((words[0] for line in lines if (words := line.split()) and words[0] in _PARSERS), None)
    if kind is None:
        raise InputError(f"{path}: no laser scan: no line begins with {' or '.join(_PARSERS)}")
    return _PARSERS[kind](path, lines)


def _parse_flaser(path: Path, lines: list[str]) -> ScanLog:
    scans: list[LoggedScan] = []
    lasers_on_base: list[Pose2D] = []
    for where, words in _messages(path, lines, "FLASER"):
        ranges_m, rest = take_ranges(words[1:], where)
        if len(rest) < 7:
            raise InputError(
                f"{where}: odometry missing: x y theta, odom_x odom_y odom_theta and a stamp must follow the "
                f"{len(ranges_m)} ranges; the line holds {len(rest)} more words"
            )
        odometry, laser = _take_poses(rest, where)
        scans.append(LoggedScan(finite(rest[6:7], where, "stamp")[0], odometry, ranges_m))
        check_newest(scans, where)
        lasers_on_base.append(laser)
    geometry = _mounted(half_circle(len(scans[0].ranges_m)), lasers_on_base)
    return ScanLog(path, geometry, scans)


def _parse_rawlaser(path: Path, lines: list[str]) -> ScanLog:
    scans: list[LoggedScan] = []
    geometry: LidarGeometry | None = None
    odometry: Pose2D | None = None
    for where, words in _messages(path, lines, "ODOM", "RAWLASER1"):
        if words[0] == "ODOM":
            if len(words) < 4:
                raise InputError(f"{where}: odometry missing: ODOM must be followed by x y theta")
            odometry = Pose2D(*finite(words[1:4], where, "odometry"))
        elif odometry is not None:
            scanner, ranges_m, rest = _take_scan(words, where)
            stamp = finite(rest[:1], where, "stamp")
            if not stamp:
                raise InputError(f"{where}: the line ends before the stamp of the scan")
            scans.append(LoggedScan(stamp[0], odometry, ranges_m))
            check_newest(scans, where)
            geometry = geometry or scanner
    if geometry is None:
        raise InputError(f"{path}: odometry missing: no ODOM line comes before a RAWLASER1 line")
    return ScanLog(path, geometry, scans)


def _parse_robotlaser(path: Path, lines: list[str]) -> ScanLog:
    scans: list[LoggedScan] = []
    geometries: list[LidarGeometry] = []
    lasers_on_base: list[Pose2D] = []
    for where, words in _messages(path, lines, "ROBOTLASER1"):
        scanner, ranges_m, rest = _take_scan(words, where)
        if len(rest) < 9:
            raise InputError(
                f"{where}: odometry missing: laser_x laser_y laser_theta, robot_x robot_y robot_theta and at "
                f"the end stamp host stamp must follow the scan; the line holds {len(rest)} more words"
            )
        odometry, laser = _take_poses(rest, where)
        scans.append(LoggedScan(finite(rest[-3:-2], where, "stamp")[0], odometry, ranges_m))
        check_newest(scans, where)
        geometries.append(scanner)
        lasers_on_base.append(laser)
    return ScanLog(path, _mounted(geometries[0], lasers_on_base), scans)


_PARSERS = {"FLASER": _parse_flaser, "RAWLASER1": _parse_rawlaser, "ROBOTLASER1": _parse_robotlaser}


def _messages(path: Path, lines: list[str], *kinds: str) -> Iterator[tuple[str, list[str]]]:
    """The words of each line of one of ``kinds``, and where it stands."""
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in kinds:
            yield f"{path}:{number}", words


def _take_scan(words: list[str], where: str) -> tuple[LidarGeometry, Floats, list[str]]:
    """The scanner on the robot's base, its ranges and the words after ranges and remissions.

    Raises InputError, named by ``where``, for a scanner that cannot be.
    """
    if len(words) < 9:
        raise InputError(f"{where}: the line ends before the number of ranges")
    start_rad, _, step_rad, range_max_m = finite(words[2:6], where, "start angle, fov, step, largest range")
    if step_rad == 0.0:
        raise InputError(f"{where}: angle step: 0 rad; one beam lies beside the other in every scanner")
    if range_max_m <= 0.0:
        raise InputError(f"{where}: largest range: {range_max_m:g} m; it must be above 0")
    ranges_m, rest = take_ranges(words[8:], where)
    too_far = ranges_m[(ranges_m > LARGEST_MAP_M) & (ranges_m < range_max_m)]
    if len(too_far):
        raise InputError(
            f"{where}: range: {too_far[0]:g} m is further than {LARGEST_MAP_M:g} m; are ranges in metres?"
        )
    count = count_of(rest[0]) if rest else None
    remissions = 0 if count is None else 1 + count
    base = Pose2D(0.0, 0.0, 0.0)
    geometry = LidarGeometry(len(ranges_m), start_rad, step_rad, 0.0, range_max_m, base)
    return geometry, ranges_m, rest[remissions:]


def _take_poses(words: list[str], where: str) -> tuple[Pose2D, Pose2D]:
    """Of the laser's pose and the robot's, three words each: the robot's, and the laser's on the robot."""
    laser = Pose2D(*finite(words[0:3], where, "laser pose"))
    odometry = Pose2D(*finite(words[3:6], where, "odometry"))
    return odometry, odometry_increment(odometry, laser)


def _mounted(geometry: LidarGeometry, lasers_on_base: list[Pose2D]) -> LidarGeometry:
    """The geometry with its mount, if the laser has one place on the robot in the whole log."""
    if np.ptp(np.array(lasers_on_base), axis=0).max() < _SAME_PLACE:
        return replace(geometry, mount=lasers_on_base[0])
    return geometry
