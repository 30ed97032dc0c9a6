"""Recordings as text: tables of scans and poses (CSV), and CARMEN logs with their corrected poses."""

import csv
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.geometry import Floats, Pose2D
from midnet_bench.io.scan_logs import ScanLog, clock_fault, is_number, numbers, parse_log, read_lines
from midnet_bench.recording.files.readings import (
    NS,
    POSE,
    SCAN,
    PoseReading,
    Reading,
    ScanReading,
    Topic,
    Transform,
)

POSE_COLUMNS = ("t", "x", "y", "yaw")
SCAN_COLUMNS = ("t", "angle_min", "angle_increment", "range_min", "range_max")
TUM_COLUMNS = ("t", "x", "y", "z", "qx", "qy", "qz", "qw")
"""a pose of the TUM format, which evo and SLAM tools write"""
FIRST_RANGE = "r0"
STEP_NS = NS // 10  # between scans of a log without a usable clock; only their order counts then
_FAR_FUTURE_S = 4e9  # the year 2096: differences of nanoseconds fit into 64 bits


class Table:
    """One text file, all of it in memory: the topics ``scan`` and ``pose``, of a log also ``odometry``."""

    def __init__(
        self, path: Path, readings: list[Reading], remarks: Sequence[str] = (), mount: Pose2D | None = None
    ) -> None:
        """``readings`` in order of time; ``remarks`` and ``mount``: see :class:`Source`."""
        self.path, self.remarks, self.mount = str(path), list(remarks), mount
        self._readings = readings
        counts = Counter((one.topic, SCAN if isinstance(one, ScanReading) else POSE) for one in readings)
        self.topics = {topic: Topic(topic, "text", count, kind) for (topic, kind), count in counts.items()}
        self.start_ns = readings[0].record_ns if readings else 0
        self.end_ns = readings[-1].record_ns if readings else 0

    def called(self, name: str) -> "Table":
        """The same with one name for its poses, which keeps them apart from those of other recordings."""
        poses = [one._replace(topic=name) for one in self._readings if isinstance(one, PoseReading)]
        return Table(Path(self.path), list(poses), self.remarks)

    def readings(
        self, topics: set[str], start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[Reading]:
        """See :class:`Source`."""
        for one in self._readings:
            is_after_start = start_ns is None or one.record_ns >= start_ns
            if one.topic in topics and is_after_start and (stop_ns is None or one.record_ns < stop_ns):
                yield one

    def close(self) -> None:
        """See :class:`Source`."""


def read_text(path: Path) -> Table:
    """A CSV table, a table of scans without a heading, or a CARMEN log, gzipped or plain.

    Raises:
        InputError: one line with file and line: no such file, unknown or missing columns, no number.
    """
    lines = read_lines(path)
    first = next((line for line in lines if line.strip() and not line.lstrip().startswith("#")), "")
    if "," in first and not is_number(first.split(",")[0]):
        return _of_rows(path, rows_of(path, lines))
    if len(first.split()) == len(TUM_COLUMNS) and all(map(is_number, first.split())):
        cells = [",".join(line.split("#")[0].split()) for line in lines]
        return _of_rows(path, rows_of(path, cells, ",".join(TUM_COLUMNS)))
    return _of_log(path, parse_log(path, lines))


def rows_of(path: Path, lines: list[str], heading: str = "") -> Iterator[tuple[str, dict[str, str]]]:
    """``file:line`` and the cells by column of each line below the heading; comments are left out.

    ``heading``: of a table without one.

    Cells that a line lacks at its end are empty. Raises InputError: there is no line, or one is too long.
    """
    numbered = [
        (number, line)
        for number, line in enumerate([heading, *lines])
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not numbered:
        raise InputError(f"{path}: the table is empty; give a heading and rows below it")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(line for _, line in numbered)]
    except csv.Error as error:
        raise InputError(f"{path}: cannot be read as a table with commas: {error}") from error
    for (number, _), row in zip(numbered[1:], rows[1:], strict=True):
        if len(row) > len(rows[0]):
            raise InputError(f"{path}:{number}: {len(row)} cells below a heading of {len(rows[0])}")
        yield f"{path}:{number}", dict(itertools.zip_longest(rows[0], row, fillvalue=""))


def number_in(cells: dict[str, str], name: str, where: str, finite: bool = True) -> float:
    """A cell as a number. Raises InputError that names file, line and column."""
    if name not in cells:
        raise InputError(f"{where}: {name}: missing column{nearest_name(name, cells)}")
    return numbers([cells[name]], where, name, finite)[0]


def time_in(cells: dict[str, str], where: str) -> int:
    """The column ``t``, seconds, as nanoseconds."""
    time_s = number_in(cells, "t", where)
    if abs(time_s) > _FAR_FUTURE_S:
        raise InputError(f"{where}: t: {time_s:g} is no time in seconds; are these milliseconds?")
    return round(time_s * NS)


def _of_rows(path: Path, rows: Iterator[tuple[str, dict[str, str]]]) -> Table:
    found: list[Reading] = []
    for where, cells in rows:
        if not found and not (FIRST_RANGE in cells or {"x", "y", "yaw"} <= cells.keys() or "qw" in cells):
            raise InputError(
                f"{path}: columns {', '.join(cells)[:80]}: neither scans "
                f"({','.join(SCAN_COLUMNS)},r0,r1,...) nor poses ({','.join(POSE_COLUMNS)})"
            )
        time_ns = time_in(cells, where)
        # poses may be nan: the reader of poses says so
        if "x" in cells and "qw" in cells:
            placed = Transform(*(number_in(cells, name, where, finite=False) for name in TUM_COLUMNS[1:]))
            found.append(PoseReading("pose", time_ns, time_ns, "map", "", placed))
        elif "x" in cells:
            pose = (number_in(cells, name, where, finite=False) for name in POSE_COLUMNS[1:])
            found.append(_pose("pose", time_ns, "map", *pose))
        if FIRST_RANGE in cells:
            geometry = tuple(number_in(cells, name, where) for name in SCAN_COLUMNS[1:])
            ranges: list[float] = []
            while cells.get(name := f"r{len(ranges)}"):
                ranges.append(number_in(cells, name, where, finite=False))
            found.append(_scan(time_ns, np.array(ranges, dtype=np.float64), geometry))
    return Table(path, found)


def _of_log(path: Path, log: ScanLog) -> Table:
    """A log's scans, its odometry, and its corrected poses if it has any: of the laser, not of the robot."""
    remarks, fault = log.warnings, clock_fault(np.array([scan.stamp_s for scan in log]))
    if fault is None:
        times = [round(scan.stamp_s * NS) for scan in log]
    else:
        times = [k * STEP_NS for k in range(len(log))]
        order = "the order of the scans serves as their time"
        remarks.append(f"{path}: scan {fault[0] + 1}: {fault[1]}; {order}")
    lidar, is_corrected = log.geometry, log.is_corrected
    geometry = (lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m)
    found: list[Reading] = []
    for scan, time_ns in zip(log, times, strict=True):
        found.append(_pose("odometry", time_ns, "odom", *scan.odometry))
        if scan.corrected is not None and is_corrected:
            found.append(_pose("pose", time_ns, "map", *scan.corrected))
        found.append(_scan(time_ns, scan.ranges_m, geometry))
    return Table(path, found, remarks, None if is_corrected else lidar.mount)


def _scan(time_ns: int, ranges_m: Floats, geometry: tuple[float, ...]) -> ScanReading:
    """``geometry``: first angle, step, radians; least and largest range, metres."""
    first, step, least, most = geometry
    return ScanReading("scan", time_ns, time_ns, "laser", ranges_m, first, step, least, most, 0.0)


def _pose(topic: str, time_ns: int, frame: str, x: float, y: float, yaw: float) -> PoseReading:
    """A pose in the plane; one that is none where a number is not finite."""
    half = yaw / 2.0 if math.isfinite(yaw) else math.nan
    placed = Transform(x, y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))
    return PoseReading(topic, time_ns, time_ns, frame, "", placed)
