"""From a recorded log to a map and a trajectory."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.scan_logs import ScanLog
from midnet_bench.io.trajectory import Trajectory
from midnet_bench.mapping.gmapping.filter import GMapping
from midnet_bench.mapping.gmapping.settings import RECORDED_LOG
from midnet_bench.rng import stream

MAX_LOOKS = 200

Look = Callable[[int, GMapping], None]
"""Is shown the filter after so many scans; it may ask for its map, pose and trajectory."""


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


def start_mapping(log: ScanLog, particles: int, seed: int, threads: int = 1) -> GMapping:
    """GMapping with the ``RECORDED_LOG`` settings, ready for the first scan of the log."""
    settings = replace(RECORDED_LOG, particles=particles)
    return GMapping(log.geometry, settings, log.scans[0].odometry, stream(seed, "gmapping"), threads)


def map_scans(
    log: ScanLog,
    particles: int = RECORDED_LOG.particles,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    look: Look | None = None,
    threads: int = 1,
) -> MappingResult:
    """The map and the trajectory that GMapping makes of a log; the same seed gives the same bytes.

    Args:
        log: the scans.
        particles: of the filter.
        seed: of the motion noise and the resampling.
        progress: called after each scan with the number of scans done and of all scans.
        look: called after the first scan, after the last and at even distances between them, 200 times at
            most. It changes nothing of the result.
        threads: that the particles are shared between. They change nothing of the result either.

    Raises:
        InputError: no scan that counts has a usable range.
    """
    slam = start_mapping(log, particles, seed, threads)
    every = math.ceil(len(log) / (MAX_LOOKS - 1))
    for done, scan in enumerate(log, start=1):
        slam.process(scan.odometry, scan.ranges_m, scan.stamp_s)
        if look is not None and (done in (1, len(log)) or done % every == 0):
            look(done, slam)
        if progress is not None:
            progress(done, len(log))
    grid = slam.occupancy(anew=True)
    if grid.data.size == 0:
        raise InputError(
            f"{log.path}: no range of the scans after which the robot moved lies between 0 and "
            f"{log.geometry.range_max_m:g} m; there is nothing to map"
        )
    warnings = []
    if log.invalid_ranges:
        total = len(log) * log.geometry.beams
        warnings.append(
            f"{log.path}: {log.invalid_ranges} of {total} ranges are NaN or infinite and were left out"
        )
    return MappingResult(grid, slam.trajectory, len(log), warnings)
