"""Recorded laser scans with odometry, whatever file they come from."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.log_text import numbers
from midnet_bench.messages import LidarGeometry

SICK_RANGE_MAX_M = 81.8
"""a SICK LMS reports 81.83 m or a little more where nothing comes back"""


class LoggedScan(NamedTuple):
    """One scan of a log."""

    stamp_s: float
    odometry: Pose2D
    """where the odometry put the robot's base"""
    ranges_m: npt.NDArray[np.float64]
    """(beams,) metres"""


@dataclass(frozen=True, eq=False)
class ScanLog:
    """The scans of a log in the order of the file, all from one LiDAR."""

    path: Path
    geometry: LidarGeometry
    scans: list[LoggedScan]

    def __iter__(self) -> Iterator[LoggedScan]:
        """The scans in order."""
        return iter(self.scans)

    def __len__(self) -> int:
        """Number of scans."""
        return len(self.scans)

    @property
    def invalid_ranges(self) -> int:
        """How many ranges are NaN; their beams say nothing."""
        return sum(int(np.count_nonzero(np.isnan(scan.ranges_m))) for scan in self.scans)


def take_ranges(words: list[str], where: str) -> tuple[npt.NDArray[np.float64], list[str]]:
    """The ranges at the head of ``words``, which begin with their number, and the words after them.

    A range that is NaN is one that the sensor could not tell. So is an infinite one (NaN in the result): logs
    do not say whether it means open space. Raises InputError, named by ``where``, if there are fewer ranges
    than announced or one is no number.
    """
    if not words or not words[0].isdigit() or int(words[0]) < 2:
        found = f"'{words[0]}'" if words else "nothing"
        raise InputError(f"{where}: the number of ranges must be a whole number from 2 on, not {found}")
    count = int(words[0])
    if len(words) - 1 < count:
        raise InputError(f"{where}: {count} ranges are announced, but only {len(words) - 1} words follow")
    ranges_m = np.array(numbers(words[1 : 1 + count], where, "range"))
    return np.where(np.isfinite(ranges_m), ranges_m, np.nan), words[1 + count :]


def check_same_length(scans: list[LoggedScan], where: str) -> None:
    """Raise InputError if the last scan has another number of ranges than the first one."""
    first, last = len(scans[0].ranges_m), len(scans[-1].ranges_m)
    if first != last:
        raise InputError(f"{where}: a scan of {last} ranges in a log whose first scan has {first}")


def half_circle(beams: int) -> LidarGeometry:
    """The geometry of a scanner whose log does not tell it: beam i at -90 degrees + i steps, on the base.

    180 beams lie 1 degree apart and so do 181, 360 and 361 half a degree, as in the SICK LMS: an even
    number of beams leaves out the last one of the half circle.
    """
    step = math.pi / (beams if beams % 2 == 0 else beams - 1)
    return LidarGeometry(beams, -math.pi / 2, step, 0.0, SICK_RANGE_MAX_M, Pose2D(0.0, 0.0, 0.0))


def with_ceiling(geometry: LidarGeometry, scans: list[LoggedScan]) -> LidarGeometry:
    """The geometry, its largest range lowered to the one at which this log's readings pile up, if they do.

    Scanners differ in the number that they report for "no return". If the largest range of a log occurs
    (within 1 cm) ten times and once in ten scans, it is taken for that number and not for a wall. Taken
    wrongly, it costs these few beams.
    """
    ranges = np.concatenate([scan.ranges_m for scan in scans])
    ranges = ranges[np.isfinite(ranges)]
    largest_m = float(ranges.max(initial=0.0))
    piled = np.count_nonzero(ranges >= largest_m - 0.01)
    if largest_m >= geometry.range_max_m or piled < max(10, len(scans) / 10):
        return geometry
    return replace(geometry, range_max_m=largest_m)
