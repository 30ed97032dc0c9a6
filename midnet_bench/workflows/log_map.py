"""``write_log_map``: what SLAM makes of a recorded log, as files."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from midnet_bench.campaign.provenance import collect
from midnet_bench.drawing.canvas import png_of
from midnet_bench.drawing.growth import MapHistory, MapSnapshot, log_page, write_log_video
from midnet_bench.drawing.stills import draw_map
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import write_atomically
from midnet_bench.io.scan_logs import ScanLog
from midnet_bench.io.trajectory import clock_fault, write_tum
from midnet_bench.mapping.gmapping.settings import RECORDED_LOG
from midnet_bench.mapping.gmapping.threads import cores
from midnet_bench.mapping.graph_slam.settings import GraphSlamSettings
from midnet_bench.mapping.log_mapping import MappingResult, Slam, map_scans
from midnet_bench.workflows.map_files import MapFiles, write_configuration, write_map, write_provenance


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
    log: ScanLog,
    particles: int | None,
    seed: int,
    output: Path,
    clip: bool,
    progress: Callable[[int, int], None],
) -> LogMap:
    """Map a log; write map and binary grid, trajectory (TUM), pictures, a video, and where they come from.

    Args:
        log: the scans.
        particles: of GMapping; None: graph SLAM.
        seed: of GMapping's motion noise and resampling.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.
        clip: whether to make an MP4 too.
        progress: called after each scan with the number of scans done and of all scans.

    Raises:
        InputError: the log cannot be mapped, or nothing can be written.
        MidnetBenchError: a file cannot be written.
    """
    provenance = collect(seed)
    name = log.path.name
    configuration = {
        "log": name,
        "sha256": hashlib.sha256(log.path.read_bytes()).hexdigest(),
        "seed": seed,
    }
    if particles is None:
        configuration["graph_slam"] = asdict(GraphSlamSettings())
        by = "graph SLAM"
    else:
        configuration["gmapping"] = asdict(replace(RECORDED_LOG, particles=particles))
        by = f"GMapping with {particles} particles, seed {seed}"
    files = MapFiles.at(output)
    files.refuse_another(configuration)
    history = MapHistory()
    result = map_scans(
        log, particles, seed, progress, lambda done, slam: history.take(log_snapshot(done, slam)), cores()
    )
    comment = f"{name}, {result.scans} scans, by {by}"
    configured = write_configuration(files, configuration)
    written = write_map(files, result.grid, comment)
    trajectory = files.named("trajectory.tum")
    warnings = result.warnings + write_trajectory(result, log.path, trajectory)
    picture, growth = files.map.with_suffix(".png"), files.named("growth.png")
    write_atomically(picture, png_of(draw_map(result.grid, [result.trajectory.poses], comment)))
    write_atomically(growth, png_of(log_page(history, comment)))
    written += [trajectory, picture, growth]
    if clip:
        video = files.named("growth.mp4")
        write_log_video(history, comment, video)
        written.append(video)
    written += [configured, write_provenance(files, provenance)]
    return LogMap(result.grid, result.scans, written, warnings)


def write_trajectory(result: MappingResult, log: Path, path: Path) -> list[str]:
    """Write the trajectory (TUM), numbered where the log's clock is wrong; a line that says so, or none."""
    fault = clock_fault(result.trajectory.stamps_s)
    if fault is None:
        write_tum(result.trajectory, path)
        return []
    index, what = fault
    write_tum(result.trajectory, path, result.integrated)
    where = f"{log}: scan {result.integrated[index]}"
    return [f"{where}: {what}; {path.name} has the numbers of scans in place of stamps"]


def log_snapshot(done: int, slam: Slam) -> MapSnapshot:
    """The map and path (of GMapping: the best particle's) after ``done`` scans, as plain data to be drawn."""
    grid = slam.occupancy()
    known_m2 = float(np.count_nonzero(grid.data >= 0)) * grid.resolution**2
    believed, path = np.array([slam.best_pose]), slam.trajectory.poses[:, :2]
    return MapSnapshot(float(done), known_m2, grid, np.empty((0, 3)), believed, [None], [path])
