"""From a recorded log to a map and a trajectory."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.carmen import parse_carmen
from midnet_bench.mapping.gmapping import GMapping
from midnet_bench.mapping.gmapping_settings import RECORDED_LOG
from midnet_bench.mapping.log_text import read_lines
from midnet_bench.mapping.scan_log import ScanLog
from midnet_bench.mapping.scan_table import parse_table
from midnet_bench.mapping.trajectory import Trajectory
from midnet_bench.rng import stream


@dataclass(frozen=True, eq=False)
class MappingResult:
    """What GMapping makes of a log."""

    grid: OccupancyGrid
    """int8: 100 occupied, 0 free, -1 unknown; the map frame is the odometry frame at the first scan"""
    trajectory: Trajectory
    """the robot's base in the map frame at each integrated scan"""
    scans: int
    """in the log; the trajectory has fewer where the robot had hardly moved since the scan before"""
    warnings: list[str]
    """one line for each kind of thing in the log that was left out"""


def read_scan_log(path: Path) -> ScanLog:
    """The scans of a log, gzipped or plain: a table if it begins with a number, else CARMEN's format.

    Raises:
        InputError: one line with the file and, where there is one, the line: an empty or unreadable file, no
            scan, missing odometry, a scan of another length, a word that is no number, NaN for odometry, or
            NaN for every range. Single NaN ranges are beams that say nothing.
    """
    lines = read_lines(path)
    words = next((line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")), [""])
    log = parse_table(path, lines) if _is_number(words[0]) else parse_carmen(path, lines)
    if log.invalid_ranges == len(log) * log.geometry.beams:
        raise InputError(f"{path}: every range in the log is NaN or infinite; there is nothing to map")
    return log


def start_mapping(log: ScanLog, particles: int, seed: int) -> GMapping:
    """GMapping with the ``RECORDED_LOG`` settings, ready for the first scan of the log."""
    settings = replace(RECORDED_LOG, particles=particles)
    return GMapping(log.geometry, settings, log.scans[0].odometry, stream(seed, "gmapping"))


def map_log(
    path: Path,
    particles: int = RECORDED_LOG.particles,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> MappingResult:
    """``map_scans`` of the log at ``path``, as ``read_scan_log`` takes it."""
    return map_scans(read_scan_log(path), particles, seed, progress)


def map_scans(
    log: ScanLog,
    particles: int = RECORDED_LOG.particles,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> MappingResult:
    """The map and the trajectory that GMapping makes of a log; the same seed gives the same bytes.

    Args:
        log: the scans.
        particles: of the filter.
        seed: of the motion noise and the resampling.
        progress: called after each scan with the number of scans done and of all scans.

    Raises:
        InputError: the log has no usable range.
    """
    slam = start_mapping(log, particles, seed)
    for done, scan in enumerate(log, start=1):
        slam.process(scan.odometry, scan.ranges_m, scan.stamp_s)
        if progress is not None:
            progress(done, len(log))
    grid = slam.occupancy()
    if grid.data.size == 0:
        raise InputError(
            f"{log.path}: no range lies between 0 and the sensor's {log.geometry.range_max_m:g} m"
        )
    warnings = []
    if log.invalid_ranges:
        total = len(log) * log.geometry.beams
        warnings.append(
            f"{log.path}: {log.invalid_ranges} of {total} ranges are NaN or infinite and were left out"
        )
    return MappingResult(grid, slam.trajectory, len(log), warnings)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
