"""``write_log_map``: what GMapping makes of a recorded log, as files."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from midnet_bench.campaign.files import write_atomically
from midnet_bench.campaign.provenance import collect
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.gmapping_settings import RECORDED_LOG
from midnet_bench.mapping.log_mapping import map_scans, read_scan_log
from midnet_bench.mapping.trajectory import write_tum
from midnet_bench.report.figures import png_of
from midnet_bench.report.map_files import MapFiles, write_map, write_origin
from midnet_bench.report.map_picture import draw_map


@dataclass(frozen=True)
class LogMap:
    """What was made of a log."""

    grid: OccupancyGrid
    """int8: 100 occupied, 0 free, -1 unknown"""
    scans: int
    files: list[Path]
    """the map first"""
    warnings: list[str]


def write_log_map(
    log: Path, particles: int, seed: int, output: Path, progress: Callable[[int, int], None]
) -> LogMap:
    """Map a log; write the map, its binary grid, the trajectory (TUM), a picture, and where they come from.

    Args:
        log: as ``mapping.log_mapping.read_scan_log`` takes it.
        particles: of GMapping.
        seed: of the motion noise and the resampling.
        output: where to, as ``MapFiles`` takes it; nothing is made there unless the log can be read.
        progress: called after each scan with the number of scans done and of all scans.

    Raises:
        InputError: the log cannot be used, or nothing can be written.
    """
    provenance = collect(seed)
    scans = read_scan_log(log)
    files = MapFiles.at(output)
    result = map_scans(scans, particles, seed, progress)
    comment = f"{log.name}, {result.scans} scans, by GMapping with {particles} particles, seed {seed}"
    written = write_map(files, result.grid, comment)
    trajectory = files.named("trajectory.tum")
    write_tum(result.trajectory, trajectory)
    picture = files.map.with_suffix(".png")
    write_atomically(picture, png_of(draw_map(result.grid, [result.trajectory.poses], comment)))
    configuration = {
        "log": log.name,
        "sha256": hashlib.sha256(log.read_bytes()).hexdigest(),
        "seed": seed,
        "gmapping": asdict(replace(RECORDED_LOG, particles=particles)),
    }
    origin = write_origin(files, configuration, provenance)
    return LogMap(result.grid, result.scans, [*written, trajectory, picture, *origin], result.warnings)
