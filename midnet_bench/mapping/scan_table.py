"""Laser scans and odometry as a plain table, one scan a line."""

from pathlib import Path

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.log_text import count_of, finite
from midnet_bench.mapping.scan_log import LoggedScan, ScanLog, check_newest, half_circle, take_ranges


def parse_table(path: Path, lines: list[str]) -> ScanLog:
    """The scans of a table whose lines are ``stamp x y theta n r1..rn``; ``#`` begins a comment.

    x, y (metres) and theta (radians) are the wheel odometry; the beams' angles are those of ``half_circle``.

    Raises:
        InputError: odometry or ranges missing, a scan of another length, a word that is no number.
    """
    scans: list[LoggedScan] = []
    for number, line in enumerate(lines, start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        where = f"{path}:{number}"
        if len(words) < 5 or count_of(words[4]) is None:
            raise InputError(
                f"{where}: odometry missing: a line must read 'stamp x y theta n r1 .. rn', with the number "
                "of ranges in the fifth place"
            )
        stamp_s, x, y, yaw = finite(words[:4], where, "stamp and odometry")
        ranges_m, rest = take_ranges(words[4:], where)
        if rest:
            raise InputError(
                f"{where}: {len(ranges_m)} ranges are announced, but {len(rest)} more words follow"
            )
        scans.append(LoggedScan(stamp_s, Pose2D(x, y, yaw), ranges_m))
        check_newest(scans, where)
    return ScanLog(path, half_circle(len(scans[0].ranges_m)), scans)
