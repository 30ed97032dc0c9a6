"""Where a robot was and when, and the TUM format that evo and other SLAM tools read."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import finite, read_lines


@dataclass(frozen=True, eq=False)
class Trajectory:
    """K stamped poses in the map frame, in driving order."""

    stamps_s: npt.NDArray[np.float64]
    """(K,) seconds"""
    poses: npt.NDArray[np.float64]
    """(K, 3) x, y (metres) and yaw (radians)"""

    def __len__(self) -> int:
        """Number of poses."""
        return len(self.stamps_s)

    def pose(self, index: int) -> Pose2D:
        """The pose at an index."""
        x, y, yaw = self.poses[index]
        return Pose2D(float(x), float(y), float(yaw))


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """Write a line ``timestamp x y z qx qy qz qw`` for each pose; z, qx and qy are 0."""
    lines = ["# timestamp x y z qx qy qz qw"]
    for stamp, (x, y, yaw) in zip(trajectory.stamps_s, trajectory.poses, strict=True):
        qz, qw = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
        lines.append(f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_tum(path: Path) -> Trajectory:
    """The stamps and planar poses of a TUM trajectory; z and tilt are dropped.

    Raises:
        InputError: the file cannot be read, or a line does not hold eight finite numbers.
    """
    rows = []
    for number, line in enumerate(read_lines(path), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        where = f"{path}:{number}"
        if len(words) != 8:
            raise InputError(f"{where}: {len(words)} words instead of 'timestamp x y z qx qy qz qw'")
        stamp, x, y, _, qx, qy, qz, qw = finite(words, where, "TUM trajectory")
        yaw = math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        rows.append((stamp, x, y, yaw))
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Trajectory(table[:, 0], table[:, 1:])
