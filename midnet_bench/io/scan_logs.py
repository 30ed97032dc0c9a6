"""Recorded scans with odometry, as CARMEN logs and plain tables; and trajectories, as evo reads them."""

import math
import zlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, LidarGeometry, Pose2D
from midnet_bench.io.checked_yaml import short
from midnet_bench.io.files import read_bounded, write_atomically

SICK_RANGE_MAX_M = 81.8  # a SICK LMS reports 81.83 m or a little more where nothing comes back
LARGEST_MAP_M = 1000.0
"""How far a log's odometry may come from its first pose, along x and y, and how far a reading may reach.

A map of a square kilometre is 400 million cells of 5 cm and takes gigabytes; the largest published logs span
half a kilometre, and one in millimetres comes there in no time.
"""
FARTHEST_M = 1e8
"""How far from its frame's origin a log may lie, along x and y: all of UTM's frames and those of web maps end
before, and a double still tells less than a micrometre there."""

LARGEST_HEADING_RAD = 1e5
"""Odometry need not wrap its heading, but a robot that turns by 1 rad/s takes a day to come here."""
FULL_CIRCLE_RAD = 2.0 * math.pi * 1.01
"""what a scanner's beams may go round; a hundredth is the rounding of a step that few digits tell"""
LONGEST_MOUNT_M = 5.0  # how far a laser may sit from its robot's base

LARGEST_BYTES = 200_000_000
"""of a log's text; five hours of a Burger's scans have as much: 360 readings, five times a second"""
_SAME_PLACE = 1e-3
"""metres and radians by which a fixed laser may seem to move on the robot, for want of digits in the log"""
_BASE = Pose2D(0.0, 0.0, 0.0)
IMAGES = (".bmp", ".gif", ".jpeg", ".jpg", ".pgm", ".png", ".tif", ".tiff", ".webp")
_KINDS = ("FLASER", "RAWLASER1", "ROBOTLASER1")
LATEST_STAMP_S = 1e11
"""No clock of seconds comes here in three thousand years; one of milliseconds has passed it."""
_STAMP_DIGITS = 6


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, gzipped or plain. Raises InputError if it cannot be read or holds no text."""
    try:
        lines = read_bounded(path, LARGEST_BYTES).decode("utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (EOFError, UnicodeDecodeError, zlib.error) as error:
        if path.suffix.lower() in IMAGES:
            raise InputError(
                f"{path}: this is an image, not a log; 'midnet-bench arena from-image' takes a plan"
            ) from error
        raise InputError(f"{path}: cannot be read as a text file, gzipped or plain: {error}") from error
    if not any(line.strip() for line in lines):
        raise InputError(f"{path}: the file is empty; give a log with laser scans and odometry")
    return lines


def numbers(words: list[str], where: str, what: str, are_finite: bool = True) -> list[float]:
    """``words`` as floats. Raises InputError ``where: what: `` and the first that is none, or not finite."""
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            raise InputError(f"{where}: {what}: {short(word)} is not a number") from None
        if are_finite and not math.isfinite(values[-1]):
            raise InputError(f"{where}: {what}: {short(word)} is not a finite number")
    return values


def is_number(word: str) -> bool:
    """Whether a word is one as Python reads it, nan and inf included."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _count_of(word: str) -> int | None:
    """The whole number that a word is, or None: no sign, no digits but 0 to 9 and nine of them at most."""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 9 else None


class LoggedScan(NamedTuple):
    """One scan of a log."""

    stamp_s: float
    odometry: Pose2D  # where the odometry put the robot's base
    ranges_m: Floats  # (beams,) metres
    corrected: Pose2D | None = None
    """where the log puts the laser, if it says so: by odometry in a raw log, by SLAM in a corrected one"""


@dataclass(frozen=True, eq=False)
class ScanLog:
    """The scans of a log in the order of the file, all from one LiDAR."""

    path: Path
    geometry: LidarGeometry
    scans: list[LoggedScan]
    left_out: Mapping[int, int] = field(default_factory=dict)
    """how many scans were left out by their number of beams, which is not that of the others"""
    laser_off_m: float | None = None
    """how far the laser's poses lie from the robot's, if that is too far for a mount"""

    def __iter__(self) -> Iterator[LoggedScan]:
        """The scans in order."""
        return iter(self.scans)

    def __len__(self) -> int:
        """Number of scans."""
        return len(self.scans)

    @property
    def is_corrected(self) -> bool:
        """Whether the laser's poses are other ones than odometry's with a mount."""
        apart = [scan.corrected.relative_to(scan.odometry) for scan in self.scans if scan.corrected]
        return len(apart) == len(self) and bool(np.ptp(np.array(apart), axis=0).max() >= _SAME_PLACE)

    @property
    def invalid_ranges(self) -> int:
        """How many ranges are NaN; their beams say nothing."""
        return sum(int(np.count_nonzero(np.isnan(scan.ranges_m))) for scan in self.scans)

    @property
    def warnings(self) -> list[str]:
        """A line for each kind of thing in the log that is not taken as it stands there."""
        negative = sum(int(np.count_nonzero(scan.ranges_m < 0.0)) for scan in self.scans)
        total = len(self) * self.geometry.beams
        lines = [
            f"{self.path}: {count} of {total} ranges are {kind} and were left out"
            for kind, count in (("NaN or infinite", self.invalid_ranges), ("negative", negative))
            if count
        ]
        if self.left_out:
            scans, total = sum(self.left_out.values()), len(self) + sum(self.left_out.values())
            beams = " or ".join(map(str, sorted(self.left_out)))
            lines.append(
                f"{self.path}: {scans} of {total} scans have {beams} ranges, not {self.geometry.beams} as "
                "the others, and were left out"
            )
        if self.laser_off_m is not None:
            lines.append(
                f"{self.path}: the laser's poses lie {self.laser_off_m:g} m from the robot's, which is no "
                "mount; the laser is taken to sit on the robot's base"
            )
        return lines


def half_circle(beams: int) -> LidarGeometry:
    """The geometry of a scanner whose log does not tell it: beam i at -90 degrees + i steps, on the base.

    180 beams lie 1 degree apart and so do 181, 360 and 361 half a degree, as in the SICK LMS: an even
    number of beams leaves out the last one of the half circle.
    """
    step = math.pi / (beams if beams % 2 == 0 else beams - 1)
    return LidarGeometry(beams, -math.pi / 2, step, 0.0, SICK_RANGE_MAX_M, _BASE)


def read_scan_log(path: Path) -> ScanLog:
    """The scans of a log as :func:`parse_log` takes them, for a map.

    The largest range is that of the sensor or, where readings pile up below it, the one at which they do.

    Raises:
        InputError: as ``parse_log``, or no range says anything.
    """
    log = parse_log(path, read_lines(path))
    if log.invalid_ranges == len(log) * log.geometry.beams:
        raise InputError(f"{path}: every range in the log is NaN or infinite; there is nothing to map")
    largest_m = _ceiling(log)
    log = replace(log, geometry=replace(log.geometry, range_max_m=largest_m))
    # 1 cm below it GMapping begins to take readings for "nothing came back"
    if not any(np.any((scan.ranges_m > 0.0) & (scan.ranges_m < largest_m - 0.01)) for scan in log):
        raise InputError(
            f"{path}: no range lies between 0 and the sensor's {largest_m:g} m; there is nothing to map"
        )
    return log


def _ceiling(log: ScanLog) -> float:
    """The log's largest range, or the one at which its readings pile up below.

    Scanners differ in the number that they report for "no return". If the largest range of a log occurs
    (within 1 cm) ten times and once in ten scans, it is taken for that number and not for a wall. Taken
    wrongly, it costs these few beams. Where all readings are so far, it is a wall: no scan saw nothing else.
    """
    ranges = np.concatenate([scan.ranges_m for scan in log])
    ranges = ranges[np.isfinite(ranges)]
    largest_m = float(ranges.max(initial=0.0))
    is_largest = ranges >= largest_m - 0.01
    is_code = np.count_nonzero(is_largest) >= max(10, len(log) / 10) and bool(
        (ranges[~is_largest] > 0.0).any()
    )
    return largest_m if largest_m < log.geometry.range_max_m and is_code else log.geometry.range_max_m


class _Line(NamedTuple):
    """What a line of a log says."""

    where: str
    scan: LoggedScan
    scanner: LidarGeometry  # on the robot's base
    laser: Pose2D | None = None  # on the robot, by the line's two poses


def parse_log(path: Path, lines: list[str]) -> ScanLog:
    """The scans of a table if the lines begin with a number, else those of a CARMEN log.

    A table's lines are ``stamp x y theta n r1..rn``, where ``#`` begins a comment: x, y (metres) and theta
    (radians) are the wheel odometry; the beams' angles are those of ``half_circle``. Of CARMEN:

    - ``FLASER n r1..rn x y theta odom_x odom_y odom_theta stamp ...``: the second pose is the odometry.
      The message does not tell the beams' angles: ``half_circle``.
    - ``RAWLASER1 type start_angle fov step range_max accuracy mode n r1..rn m s1..sm stamp ...`` with
      ``ODOM x y theta ...``: the last ODOM before a scan counts; scans before the first one are passed over.
    - ``ROBOTLASER1`` as ``RAWLASER1`` up to the remissions, which old logs leave out, then the poses of laser
      and robot and more; ``stamp host stamp`` end the line. The robot's pose is the odometry.

    Where a laser's pose lies at one and the same place on the robot in the whole log, that is the sensor's
    mount. In a log of several kinds, the kind that comes first counts. Comments and all other messages are
    passed over. Single NaN or negative ranges are beams that say nothing. Scans of another number of beams
    than most have are left out and counted, as slam_gmapping and slam_toolbox do.

    Raises:
        InputError: one line with the file and, where there is one, the line: no scan, no odometry, odometry
            too far off or turned too far for a map, a number that is none or that no scanner has, or no
            number of beams that more than half of the scans have.
    """
    said = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "-").split()
    if is_number(said[0]):
        return _log(path, _of_table(path, lines))
    kind = next((words[0] for line in lines if (words := line.split()) and words[0] in _KINDS), None)
    if kind is None:
        raise InputError(f"{path}: no laser scan: no line begins with {' or '.join(_KINDS)}")
    return _log(path, (_of_raw if kind == "RAWLASER1" else _of_posed)(path, lines, kind))


def _log(path: Path, said: Iterator[_Line]) -> ScanLog:
    """The log of its lines, with its laser's mount if the laser has one place on the robot in all of it."""
    lines: list[_Line] = []
    for line in said:
        _check_pose(line.scan.odometry, "odometry", line.where, (lines or [line])[0].scan.odometry)
        lines.append(line)
    if not lines:
        raise InputError(f"{path}: odometry missing: no ODOM line comes before a RAWLASER1 line")
    beams, left_out = usual_beams(path, [len(line.scan.ranges_m) for line in lines])
    lines = [line for line in lines if len(line.scan.ranges_m) == beams]
    geometry, lasers = lines[0].scanner, [line.laser for line in lines if line.laser is not None]
    log = ScanLog(path, geometry, [line.scan for line in lines], left_out)
    if not lasers or np.ptp(np.array(lasers), axis=0).max() >= _SAME_PLACE:
        return log
    off_m = math.hypot(lasers[0].x, lasers[0].y)
    if off_m > LONGEST_MOUNT_M:
        return replace(log, laser_off_m=off_m)
    return replace(log, geometry=replace(geometry, mount=lasers[0]))


def usual_beams(path: Path, beams: Sequence[int]) -> tuple[int, dict[int, int]]:
    """The number of beams that more than half of the scans have, and how many have each other number.

    ``beams``: of each scan, at least one. Raises InputError: there is no such number.
    """
    counts = Counter(beams)
    (usual, scans), *others = counts.most_common()
    if 2 * scans <= len(beams):
        some = ", ".join(map(str, sorted(counts)[:4])) + (", ..." if len(counts) > 4 else "")
        raise InputError(
            f"{path}: its scans have {some} ranges, and no number of them more than half; "
            "SLAM takes one laser"
        )
    return usual, dict(others)


def _of_table(path: Path, lines: list[str]) -> Iterator[_Line]:
    for number, line in enumerate(lines, start=1):
        words, where = line.split("#")[0].split(), f"{path}:{number}"
        if not words:
            continue
        if len(words) < 5 or _count_of(words[4]) is None:
            raise InputError(
                f"{where}: odometry missing: a line must read 'stamp x y theta n r1 .. rn', with the number "
                "of ranges in the fifth place"
            )
        stamp_s, x, y, yaw = numbers(words[:4], where, "stamp and odometry")
        ranges_m, rest = _take_ranges(words[4:], where)
        if rest:
            raise InputError(
                f"{where}: {len(ranges_m)} ranges are announced, but {len(rest)} more words follow"
            )
        yield _Line(where, LoggedScan(stamp_s, Pose2D(x, y, yaw), ranges_m), half_circle(len(ranges_m)))


def _of_raw(path: Path, lines: list[str], kind: str) -> Iterator[_Line]:
    odometry: Pose2D | None = None
    for where, words in _messages(path, lines, "ODOM", kind):
        if words[0] == "ODOM":
            if len(words) < 4:
                raise InputError(f"{where}: odometry missing: ODOM must be followed by x y theta")
            odometry = Pose2D(*numbers(words[1:4], where, "odometry"))
        elif odometry is not None:
            scanner, ranges_m, rest = _take_scan(words, where)
            stamp = numbers(rest[:1], where, "stamp")
            if not stamp:
                raise InputError(f"{where}: the line ends before the stamp of the scan")
            yield _Line(where, LoggedScan(stamp[0], odometry, ranges_m), scanner)


def _of_posed(path: Path, lines: list[str], kind: str) -> Iterator[_Line]:
    """Of ``FLASER`` or ``ROBOTLASER1``, whose lines have the laser's pose and the robot's."""
    first: tuple[Pose2D, Pose2D] | None = None
    for where, words in _messages(path, lines, kind):
        if kind == "FLASER":
            ranges_m, rest = _take_ranges(words[1:], where)
            scanner, fewest, stamp_at = half_circle(len(ranges_m)), 7, 6
            needed = f"x y theta, odom_x odom_y odom_theta and a stamp must follow the {len(ranges_m)} ranges"
        else:
            scanner, ranges_m, rest = _take_scan(words, where)
            fewest, stamp_at = 9, len(rest) - 3
            needed = (
                "laser_x laser_y laser_theta, robot_x robot_y robot_theta and at the end stamp host stamp "
                "must follow the scan"
            )
        if len(rest) < fewest:
            raise InputError(f"{where}: odometry missing: {needed}; the line holds {len(rest)} more words")
        placed = Pose2D(*numbers(rest[0:3], where, "laser pose"))
        odometry = Pose2D(*numbers(rest[3:6], where, "odometry"))
        first = first or (placed, odometry)
        _check_pose(placed, "laser's pose", where, first[0])
        _check_pose(
            odometry, "odometry", where, first[1]
        )  # before it is turned, which needs numbers of a size
        laser = placed.relative_to(odometry)
        (stamp_s,) = numbers([rest[stamp_at]], where, "stamp")
        scan = LoggedScan(stamp_s, odometry, ranges_m, odometry.compose(laser))
        yield _Line(where, scan, scanner, laser)


def _messages(path: Path, lines: list[str], *kinds: str) -> Iterator[tuple[str, list[str]]]:
    """The words of each line of one of ``kinds``, and where it stands."""
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words and words[0] in kinds:
            yield f"{path}:{number}", words


def _take_ranges(words: list[str], where: str) -> tuple[Floats, list[str]]:
    """The ranges at the head of ``words``, which begin with their number, and the words after them.

    An infinite range is NaN in the result: logs do not say whether it means open space.
    """
    count = _count_of(words[0]) if words else None
    if count is None or count < 2:
        found = short(words[0]) if words else "nothing"
        raise InputError(f"{where}: the number of ranges must be a whole number from 2 on, not {found}")
    if len(words) - 1 < count:
        raise InputError(f"{where}: {count} ranges are announced, but only {len(words) - 1} words follow")
    ranges_m = np.array(numbers(words[1 : 1 + count], where, "range", are_finite=False))
    return np.where(np.isfinite(ranges_m), ranges_m, np.nan), words[1 + count :]


def _take_scan(words: list[str], where: str) -> tuple[LidarGeometry, Floats, list[str]]:
    """The scanner on the robot's base, its ranges and the words after ranges and remissions."""
    if len(words) < 9:
        raise InputError(f"{where}: the line ends before the number of ranges")
    start_rad, _, step_rad, range_max_m = numbers(words[2:6], where, "start angle, fov, step, largest range")
    if step_rad == 0.0:
        raise InputError(f"{where}: angle step: 0 rad; one beam lies beside the other in every scanner")
    if range_max_m <= 0.0:
        raise InputError(f"{where}: largest range: {range_max_m:g} m; it must be above 0")
    ranges_m, rest = _take_ranges(words[8:], where)
    round_rad = abs(step_rad) * (len(ranges_m) - 1)
    if round_rad > FULL_CIRCLE_RAD:
        raise InputError(
            f"{where}: angle step: {len(ranges_m)} beams {step_rad:g} rad apart go "
            f"{round_rad / (2.0 * math.pi):.3g} times round the circle; is the step in radians?"
        )
    if abs(start_rad) > FULL_CIRCLE_RAD:
        raise InputError(
            f"{where}: start angle: {start_rad:g} rad is beyond a full circle; is it in radians?"
        )
    too_far = ranges_m[(ranges_m > LARGEST_MAP_M) & (ranges_m < range_max_m)]
    if len(too_far):
        raise InputError(
            f"{where}: range: {too_far[0]:g} m is further than {LARGEST_MAP_M:g} m; are ranges in metres?"
        )
    count = _count_of(rest[0]) if rest else None
    geometry = LidarGeometry(len(ranges_m), start_rad, step_rad, 0.0, range_max_m, _BASE)
    return geometry, ranges_m, rest if count is None else rest[1 + count :]


def _check_pose(pose: Pose2D, whose: str, where: str, first: Pose2D) -> None:
    """Raise InputError if a pose is further from the first than a map may be large, or no robot's."""
    x, y, yaw = pose
    if max(abs(x), abs(y)) > FARTHEST_M:
        raise InputError(
            f"{where}: the {whose} x {x:g}, y {y:g} lies more than {FARTHEST_M:g} m from its origin, where "
            "no frame has a robot; is it in metres?"
        )
    if max(abs(x - first.x), abs(y - first.y)) > LARGEST_MAP_M:
        raise InputError(
            f"{where}: the {whose} x {x:g}, y {y:g} lies more than {LARGEST_MAP_M:g} m from the first one, "
            "and no map can be that large; is it in metres?"
        )
    if abs(yaw) > LARGEST_HEADING_RAD:
        raise InputError(
            f"{where}: the {whose} has a heading of {yaw:g} rad, more than a robot turns in a day; "
            "is it in radians?"
        )


@dataclass(frozen=True, eq=False)
class Trajectory:
    """K stamped poses in the map frame, in driving order."""

    stamps_s: npt.NDArray[np.float64]  # (K,) seconds
    poses: npt.NDArray[np.float64]  # (K, 3) x, y (metres) and yaw (radians)

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.stamps_s)

    def pose(self, index: int) -> Pose2D:
        """The pose at an index."""
        x, y, yaw = self.poses[index]
        return Pose2D(float(x), float(y), float(yaw))


def clock_fault(stamps_s: npt.NDArray[np.float64]) -> tuple[int, str] | None:
    """The index of the first stamp that no clock of seconds gives after those before it, and what is wrong.

    None if every stamp of the (K,) is later than the one before, by a microsecond at least, and no later than
    ``LATEST_STAMP_S``.
    """
    sane = np.clip(stamps_s, -2.0 * LATEST_STAMP_S, 2.0 * LATEST_STAMP_S)  # no difference overflows
    steps = np.diff(np.round(sane, _STAMP_DIGITS), prepend=-np.inf)
    wrong = np.flatnonzero((steps <= 0.0) | (np.abs(stamps_s) > LATEST_STAMP_S))
    if len(wrong) == 0:
        return None
    first = int(wrong[0])
    if abs(stamps_s[first]) > LATEST_STAMP_S:
        return first, f"its stamp {stamps_s[first]:g} is no time in seconds"
    return first, "the clock stands still" if steps[first] == 0.0 else "the clock runs backwards"


def write_tum(trajectory: Trajectory, path: Path, numbers: Sequence[int] | None = None) -> None:
    """Write a line ``timestamp x y z qx qy qz qw`` for each pose; z, qx and qy are 0.

    ``numbers`` stand in place of the timestamps if given, one for each pose; the file's first line says so.

    Raises:
        MidnetBenchError: the file cannot be written (:func:`midnet_bench.io.files.temporary_path`).
    """
    stamps: Iterable[str]
    if numbers is None:
        lines = ["# timestamp x y z qx qy qz qw"]
        stamps = (f"{stamp:.{_STAMP_DIGITS}f}" for stamp in trajectory.stamps_s)
    else:
        lines = [
            "# scan_number x y z qx qy qz qw: the log's clock is no use, so poses have their scans' numbers"
        ]
        stamps = map(str, numbers)
    for stamp, (x, y, yaw) in zip(stamps, trajectory.poses, strict=True):
        qz, qw = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
        lines.append(f"{stamp} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}")
    write_atomically(path, "\n".join(lines) + "\n")
