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
from midnet_bench.mapping.log_text import count_of, numbers, shown
from midnet_bench.messages import LidarGeometry

SICK_RANGE_MAX_M = 81.8
"""a SICK LMS reports 81.83 m or a little more where nothing comes back"""
LARGEST_MAP_M = 1000.0
"""How far a log's odometry may come from its origin, along x and y, and how far a reading may reach. A map of
a square kilometre is 400 million cells of 5 cm and takes gigabytes; the largest published logs span half a
kilometre, and one in millimetres comes there in no time."""


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
    count = count_of(words[0]) if words else None
    if count is None or count < 2:
        found = shown(words[0]) if words else "nothing"
        raise InputError(f"{where}: the number of ranges must be a whole number from 2 on, not {found}")
    if len(words) - 1 < count:
        raise InputError(f"{where}: {count} ranges are announced, but only {len(words) - 1} words follow")
    ranges_m = np.array(numbers(words[1 : 1 + count], where, "range"))
    return np.where(np.isfinite(ranges_m), ranges_m, np.nan), words[1 + count :]


def check_newest(scans: list[LoggedScan], where: str) -> None:
    """Raise InputError if the last scan is not as long as the first one, or further off than a map may be."""
    first, last = scans[0], scans[-1]
    if len(first.ranges_m) != len(last.ranges_m):
        raise InputError(
            f"{where}: a scan of {len(last.ranges_m)} ranges in a log whose first scan has "
            f"{len(first.ranges_m)}"
        )
    x, y, _ = last.odometry
    if max(abs(x), abs(y)) > LARGEST_MAP_M:
        raise InputError(
            f"{where}: the odometry x {x:g}, y {y:g} lies more than {LARGEST_MAP_M:g} m from its origin, and "
            "no map can be that large; is it in metres?"
        )


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
