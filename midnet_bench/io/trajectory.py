"""Where a robot was and when, and the TUM format that evo and other SLAM tools read."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.io.files import write_atomically

LATEST_STAMP_S = 1e11
"""No clock of seconds comes here in three thousand years; one of milliseconds has passed it."""
_STAMP_DIGITS = 6


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
