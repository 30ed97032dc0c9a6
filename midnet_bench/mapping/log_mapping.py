"""From a recorded log to a map and a trajectory."""

import contextlib
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.scan_logs import ScanLog, Trajectory
from midnet_bench.mapping.gmapping import GMapping
from midnet_bench.mapping.graph_slam import FEWEST_BEAMS, GraphSlam
from midnet_bench.mapping.grid_slam import GridSlam
from midnet_bench.mapping.mapping_settings import RECORDED_LOG
from midnet_bench.rng import stream

MAX_LOOKS = 200
COLLAPSED = 0.45
"""Share of the log's median score below which a scan does not fit GMapping's map.

The worst scan of the Intel Research Lab's log has 0.51 of it. Where a heading was turned by 26 to 180 degrees
and the matcher did not find back, the scan had 0.40 at most.
"""
GRAPH_COLLAPSED = 0.3
"""The same for graph SLAM, which matches with the last scans alone: that log's worst scan has 0.35 of it."""

Look = Callable[[int, GridSlam], None]
"""Is shown the SLAM after so many scans; it may ask for its map, pose and trajectory."""


@dataclass(frozen=True, eq=False)
class MappingResult:
    """What SLAM makes of a log."""

    grid: OccupancyGrid
    """int8: 100 occupied, 0 free, -1 unknown; the map frame is the odometry frame at the first scan"""
    trajectory: Trajectory  # the robot's base in the map frame at each integrated scan
    scans: int  # in the log; the trajectory has fewer where the robot had hardly moved since the scan before
    integrated: list[int]  # the number, from 1, of the scan that each pose of the trajectory belongs to
    warnings: list[str]
    """one line for each kind of thing in the log that was not taken as it stands, and where the map broke"""


@contextlib.contextmanager
def held_in_memory(log: ScanLog) -> Iterator[None]:
    """Raises InputError if the map that is made inside does not fit into memory."""
    try:
        yield
    except MemoryError as error:
        raise InputError(
            f"{log.path}: a map of that size does not fit into memory; are odometry and ranges in metres?"
        ) from error


def map_scans(
    log: ScanLog,
    particles: int | None = None,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    look: Look | None = None,
    threads: int = 1,
) -> MappingResult:
    """The map and the trajectory that SLAM makes of a log; the same seed gives the same bytes.

    Args:
        log: the scans.
        particles: of GMapping; None: graph SLAM, which survives slips of the wheels (docs/studies/slips.md).
        seed: of GMapping's motion noise and resampling. Graph SLAM leaves nothing to chance.
        progress: called after each scan with the number of scans done and of all scans.
        look: called after the first scan, after the last and at even distances between them, 200 times at
            most. It changes nothing of the result.
        threads: that GMapping's particles are shared between. They change nothing of the result either.

    Raises:
        InputError: no scan that counts has a usable range, or graph SLAM gets too few beams.
    """
    if particles is None and log.geometry.beams < FEWEST_BEAMS:
        raise InputError(
            f"{log.path}: {log.geometry.beams} beams are too few for graph SLAM, which needs {FEWEST_BEAMS}; "
            "GMapping maps them (--slam gmapping)"
        )
    start = log.scans[0].odometry
    slam: GridSlam = GraphSlam(log.geometry, start)
    share = GRAPH_COLLAPSED
    if particles is not None:
        settings = replace(RECORDED_LOG, particles=particles)
        slam = GMapping(log.geometry, settings, start, stream(seed, "gmapping"), threads)
        share = COLLAPSED
    every = math.ceil(len(log) / (MAX_LOOKS - 1))
    integrated = []
    for done, scan in enumerate(log, start=1):
        if slam.process(scan.odometry, scan.ranges_m, scan.stamp_s):
            integrated.append(done)
        if done == len(log) and isinstance(slam, GraphSlam):
            slam.finish()
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
    found = collapse(log, integrated, slam.scores, share)
    if isinstance(slam, GraphSlam) and slam.slips:
        node, way_m, turn_rad = slam.slips[0]
        others = f", and so {len(slam.slips) - 1} more times" if len(slam.slips) > 1 else ""
        found.append(
            f"scan {integrated[node]}: taken {way_m:.2f} m and {math.degrees(turn_rad):.0f} degrees off the "
            f"wheels{others}: they slipped, or the map is broken from there on"
        )
    warnings = [*log.warnings, *(f"{log.path}: {line}" for line in found)]
    return MappingResult(grid, slam.trajectory, len(log), integrated, warnings)


def collapse(
    log: ScanLog, integrated: Sequence[int], scores: Sequence[float], share: float = COLLAPSED
) -> list[str]:
    """A line on the scan at which the map broke; none if it did not.

    That is the first scan whose score is below ``share`` times the median of the log. The scan after it
    may fit again, but what it fits is a second map over the first. ``integrated`` has the number, from 1, of
    each scan that was integrated, and ``scores`` what :attr:`GridSlam.scores` says of it.
    """
    known = [score for score in scores if math.isfinite(score)]
    median = statistics.median(known) if known else 0.0
    low = [
        (number, score) for number, score in zip(integrated, scores, strict=True) if score < share * median
    ]
    if not low:
        return []
    number, score = low[0]
    step = log.scans[number - 1].odometry.relative_to(log.scans[max(0, number - 2)].odometry)
    others = f", and {len(low) - 1} later scans like it" if len(low) > 1 else ""
    return [
        f"scan {number}: heading changed by {math.degrees(step.yaw):.0f} degrees and the place by "
        f"{math.hypot(step.x, step.y):.2f} m, score {score:.2f}, median {median:.2f}{others}: the map may be "
        "broken from there on"
    ]
