"""Where a robot was and when, and the TUM format that evo and other SLAM tools read."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.io.files import write_atomically


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
    """Write a line ``timestamp x y z qx qy qz qw`` for each pose; z, qx and qy are 0.

    Raises:
        MidnetBenchError: the file cannot be written (:func:`midnet_bench.io.files.draft_of`).
    """
    lines = ["# timestamp x y z qx qy qz qw"]
    for stamp, (x, y, yaw) in zip(trajectory.stamps_s, trajectory.poses, strict=True):
        qz, qw = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
        lines.append(f"{stamp:.6f} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}")
    write_atomically(path, "\n".join(lines) + "\n")
