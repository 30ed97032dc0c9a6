"""How wrong a trajectory is, by relative poses that people checked by hand (Kuemmerle et al., 2009)."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import Trajectory, numbers, read_lines

_SAME_INSTANT_S = 0.01  # two programs' stamps of one reading may lie this far apart


class Relation(NamedTuple):
    """Where the robot was at one stamp, seen from where it was at another."""

    from_stamp_s: float
    to_stamp_s: float
    pose: Pose2D


class RelationsError(NamedTuple):
    """Translational errors over the relations whose stamps the trajectory covers."""

    mean_m: float  # NaN when there is none
    relations: int


def read_relations(path: Path) -> list[Relation]:
    """The relations of a file with lines ``stamp1 stamp2 x y z roll pitch yaw``, planar part.

    Raises:
        InputError: the file cannot be read or a line does not hold eight finite numbers.
    """
    return [
        Relation(first, second, Pose2D(x, y, yaw))
        for first, second, x, y, _, _, _, yaw in _rows(path, 8, "stamp1 stamp2 x y z roll pitch yaw")
    ]


def read_dense_odometry(path: Path) -> Trajectory:
    """The odometry of every reading of a log, in driving order: lines ``stamp x y theta ...``.

    Raises:
        InputError: the file cannot be read or a line does not hold four finite numbers.
    """
    table = np.array(_rows(path, 4, "stamp x y theta"), dtype=np.float64).reshape(-1, 4)
    return Trajectory(table[:, 0], table[:, 1:])


def relations_error(
    relations: list[Relation], trajectory: Trajectory, odometry: Trajectory
) -> RelationsError:
    """Mean length of the translation of rel^-1 (p1^-1 p2) over the relations, p1 and p2 as estimated.

    The estimate at a stamp is the last pose of the trajectory at or before it *in driving order*, composed
    with the odometry since. Relations outside the stamps of the trajectory are left out.

    Which of several poses with one stamp is meant, a stamp cannot say (of the Intel log's relations a third
    ends at such a stamp). The first one in driving order is taken, of the odometry's readings and of the
    trajectory's poses alike; so is the first of two readings that are equally near in time.

    Args:
        relations: checked by hand.
        trajectory: estimated poses at stamps that are among the odometry's.
        odometry: dense, in driving order; clocks that jump back are why stamps alone do not order it.
    """
    estimated = np.full(len(odometry), -1)
    for k in reversed(range(len(trajectory))):  # so that the first of equal stamps stays
        estimated[_reading(odometry, trajectory.stamps_s[k])] = k
    readings = np.arange(len(odometry))
    last = np.maximum.accumulate(np.where(estimated >= 0, readings, -1))

    def pose_at(stamp_s: float) -> Pose2D | None:
        reading = _reading(odometry, stamp_s)
        anchor = int(last[reading])
        if anchor < 0:
            return None
        since = odometry.pose(anchor).inverse().compose(odometry.pose(reading))
        return trajectory.pose(int(estimated[anchor])).compose(since)

    begin, end = trajectory.stamps_s.min(), trajectory.stamps_s.max()
    errors = []
    for relation in relations:
        stamps_s = relation[:2]
        if min(stamps_s) < begin - _SAME_INSTANT_S or max(stamps_s) > end + _SAME_INSTANT_S:
            continue
        first, second = pose_at(relation.from_stamp_s), pose_at(relation.to_stamp_s)
        if first is not None and second is not None:
            difference = relation.pose.inverse().compose(first.inverse().compose(second))
            errors.append(math.hypot(difference.x, difference.y))
    return RelationsError(float(np.mean(errors)) if errors else math.nan, len(errors))


def _reading(odometry: Trajectory, stamp_s: float) -> int:
    """The reading nearest in time, the first one in driving order of those equally near."""
    differences: npt.NDArray[np.float64] = np.abs(odometry.stamps_s - stamp_s)
    return int(np.argmin(differences))


def _rows(path: Path, columns: int, layout: str) -> list[list[float]]:
    rows = []
    for number, line in enumerate(read_lines(path), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        where = f"{path}:{number}"
        if len(words) < columns:
            raise InputError(f"{where}: {len(words)} numbers where '{layout}' needs {columns}")
        rows.append(numbers(words[:columns], where, layout))
    return rows
