"""Maps as files: explored, by SLAM of a log, drawn of an arena, or resampled; each with its binary grid."""

import hashlib
import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import midnet_bench
from midnet_bench.analysis.tables import Table, csv_text
from midnet_bench.arena.prior_maps import resampled
from midnet_bench.campaign.provenance import Provenance, collect, now_utc
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.drawing.map_pictures import MapHistory, MapSnapshot, draw_map, film_map, percent
from midnet_bench.drawing.painter import Picture, png_of
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.guarded.inputs import EXACT, arena_from, prior_map_from
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial, Snapshot
from midnet_bench.geometry import Floats
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import cannot_be_written, write_atomically
from midnet_bench.io.map_server import load_map, save_binary_map, save_map
from midnet_bench.io.scan_logs import ScanLog, clock_fault, write_tum
from midnet_bench.mapping.gmapping import cores
from midnet_bench.mapping.graph_slam import parameters
from midnet_bench.mapping.grid_slam import GridSlam
from midnet_bench.mapping.log_mapping import MappingResult, map_scans
from midnet_bench.mapping.map_score import reachable_free
from midnet_bench.mapping.mapping_settings import RECORDED_LOG
from midnet_bench.robots.model import RobotModel
from midnet_bench.workflows.library import PRIOR_MAP_PARAMETERS, prior_map

DIGITS = {"coverage": 4, "wall_error_m": 4, "time_s": 1, "distance_m": 1}
CONFIGURATION = "configuration.json"
SET_BY_EXACT = ("resolution_m", *PRIOR_MAP_PARAMETERS)
"""what an exact map and its binary grid depend on, beside the arena"""


class MadeMap(NamedTuple):
    """A map that was made and written."""

    grid: OccupancyGrid  # int8: 100 occupied, 0 free, -1 unknown, map frame
    files: list[Path]  # the map first
    warnings: list[str]
    scores: Table | None = None  # one row, of an exploration


@dataclass(frozen=True)
class MapFiles:
    """The paths of a map's files, and what the map is made from."""

    map: Path  # its YAML file
    prefix: str  # of the names of all files that are not called after the map
    configuration: Mapping[str, Any]

    @classmethod
    def at(cls, output: Path, configuration: Mapping[str, Any]) -> "MapFiles":
        """``output``/map.yaml and so on; or, if ``output`` names a YAML file, that one and files beside it.

        The folder is made. Raises InputError if the map cannot be written there, or one of another
        configuration is there, which is not overwritten; MidnetBenchError if the disk is full.
        """
        is_map = output.suffix in (".yaml", ".yml")
        folder = output.parent if is_map else output
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise cannot_be_written(folder, error) from error
        at, prefix = (output, f"{output.stem}_") if is_map else (output / "map.yaml", "")
        files = cls(at, prefix, configuration)
        for yaml_path in (files.map, files.binary):
            for path in (yaml_path, yaml_path.with_suffix(".pgm")):
                if path.is_dir():
                    raise InputError(f"{path}: a folder is where the map goes; give another place with -o")
        path = files.named(CONFIGURATION)
        try:
            found = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            found = None
        if found != json.loads(json.dumps(configuration)) and (path.exists() or at.exists()):
            raise InputError(
                f"{at}: the map of another run is there; give another place with -o, or remove it first"
            )
        return files

    @property
    def binary(self) -> Path:
        """The YAML file of the binary grid."""
        return self.map.with_stem(f"{self.map.stem}_binary")

    def named(self, name: str) -> Path:
        """The file of that name; beside a map of a given name, led by the map's."""
        return self.map.with_name(f"{self.prefix}{name}")

    def write_map(self, grid: OccupancyGrid, comment: str, **parameters: Scalar) -> list[Path]:
        """Write the configuration, the map and the binary grid; the two YAML files.

        ``parameters`` are those of :func:`prior_map` that are not to have their default.
        """
        # the configuration first: it says what the files after it are
        write_atomically(self.named(CONFIGURATION), json.dumps(self.configuration, indent=1) + "\n")
        save_map(grid, self.map, comment=comment)
        save_binary_map(prior_map(grid, **parameters), self.binary)
        return [self.map, self.binary]

    def write_provenance(self, started: Provenance) -> list[Path]:
        """Write by which code, where and when; the run ends now. The configuration's file, and this one."""
        path = self.named("provenance.json")
        write_atomically(path, json.dumps([{**started, "ended_utc": now_utc()}], indent=1) + "\n")
        return [self.named(CONFIGURATION), path]

    def write_pictures(
        self, picture: Picture, history: MapHistory, title: str, clip: bool, walls: Sequence[Floats] = ()
    ) -> list[Path]:
        """Write ``map.png`` and, with ``clip``, ``map.mp4``, the same picture of the growing map."""
        picture_file, film = self.map.with_suffix(".png"), self.map.with_suffix(".mp4")
        write_atomically(picture_file, png_of(picture))
        if clip:
            film_map(film, history, title, walls)
        return [picture_file, *[film] * clip]


def explore(
    parameters: MappingParameters,
    seed: int,
    output: Path,
    clip: bool,
    progress: Callable[[float, float], None],
) -> MadeMap:
    """Explore an arena; write the map and its binary grid, scores, pictures, and where they come from.

    Args:
        parameters: which arena, how many robots and so on.
        seed: of everything random.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.
        clip: whether to make an MP4 too.
        progress: called after each simulated second: that time, and the known share of free space.

    Raises:
        InputError: the robots do not fit into the arena, or nothing can be written.
        MidnetBenchError: a file cannot be written.
    """
    provenance = collect(seed)
    configuration = {"experiment": "mapping", "seed": seed, "parameters": parameters.flat_values()}
    with ExplorationTrial(parameters, seed, threads=cores()) as trial:
        files = MapFiles.at(output, configuration)
        history, start = MapHistory(), trial.layout.robots[0]
        within_reach = reachable_free(trial.truth(), (start.x, start.y), trial.robot.radius_m)
        for snapshot in trial.snapshots():
            known = float(np.mean(snapshot.grid.data[within_reach] >= 0))
            history.take(map_snapshot(snapshot, known, trial.robot))
            progress(snapshot.time_s, known)
        found = trial.result()
        plan = FloorPlan.of(trial.arena, trial.layout, seed)
        kind = trial.robot.name.removeprefix("TurtleBot3 ")
        team = f"explored by {parameters.robots} {kind}{'s' if parameters.robots > 1 else ''}"
        title = f"{plan.title}: {team}"
        picture = draw_map(found.grid, history.paths(), title, plan.walls)
        written = files.write_map(found.grid, f"{title}; midnet-bench {midnet_bench.__version__}")
        written += files.write_pictures(picture, history, title, clip, plan.walls)
        robots = trial.rows_of_robots()
    row: Row = {"arena": trial.arena.name, "robots": parameters.robots, "seed": seed}
    scores = Table("scores", "The map against the arena", [{**row, **found.row()}], DIGITS)
    written += scores.write(files.map.parent, files.named("scores").name)
    write_atomically(files.named("robots.csv"), csv_text(robots))
    written += [files.named("robots.csv"), *files.write_provenance(provenance)]
    return MadeMap(found.grid, written, found.warnings, scores)


def map_snapshot(at: Snapshot, known: float, model: RobotModel) -> MapSnapshot:
    """A snapshot of a trial as plain data to be drawn; ``known``: share of the free cells in reach."""
    caption = f"{at.time_s:.0f} s: {percent(known)} explored"
    return MapSnapshot(caption, at.grid, at.believed, at.goals, [], model)


def map_log(
    log: ScanLog,
    particles: int | None,
    seed: int,
    output: Path,
    clip: bool,
    progress: Callable[[int, int], None],
) -> MadeMap:
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
    provenance, name = collect(seed), log.path.name
    files_read = sorted(log.path.rglob("*")) if log.path.is_dir() else [log.path]
    digest = hashlib.sha256(b"".join(one.read_bytes() for one in files_read)).hexdigest()
    configuration: dict[str, Any] = {"log": name, "sha256": digest, "seed": seed}
    if particles is None:
        configuration["graph_slam"] = parameters()
        by = "graph SLAM"
    else:
        configuration["gmapping"] = asdict(replace(RECORDED_LOG, particles=particles))
        by = f"GMapping with {particles} particles, seed {seed}"
    files, history = MapFiles.at(output, configuration), MapHistory()
    result = map_scans(
        log, particles, seed, progress, lambda done, slam: history.take(log_snapshot(done, slam)), cores()
    )
    comment = f"{name}, {result.scans} scans, by {by}"
    written = files.write_map(result.grid, comment)
    trajectory = files.named("trajectory.tum")
    warnings = result.warnings + write_trajectory(result, log.path, trajectory)
    picture = draw_map(result.grid, [result.trajectory.poses], comment)
    written += [trajectory, *files.write_pictures(picture, history, comment, clip)]
    written += files.write_provenance(provenance)
    return MadeMap(result.grid, written, warnings)


def write_trajectory(result: MappingResult, log: Path, path: Path) -> list[str]:
    """Write the trajectory (TUM), numbered where the log's clock is wrong; a line that says so, or none."""
    fault = clock_fault(result.trajectory.stamps_s)
    write_tum(result.trajectory, path, None if fault is None else result.integrated)
    if fault is None:
        return []
    index, what = fault
    scan = f"{log}: scan {result.integrated[index]}"
    return [f"{scan}: {what}; {path.name} has the numbers of scans in place of stamps"]


def log_snapshot(done: int, slam: GridSlam) -> MapSnapshot:
    """The map and path (of GMapping: the best particle's) after ``done`` scans, as plain data to be drawn."""
    grid = slam.occupancy()
    known_m2 = float(np.count_nonzero(grid.data >= 0)) * grid.resolution**2
    believed, path = np.array([slam.best_pose]), slam.trajectory.poses[:, :2]
    return MapSnapshot(f"{done} scans: {known_m2:.0f} m² known", grid, believed, [None], [path])


def draw(settings: Mapping[str, Scalar], output: Path) -> MadeMap:
    """Draw an arena's walls as a map, and write it with its binary grid and what it was made from.

    Args:
        settings: the ``arena``, and any of ``SET_BY_EXACT``.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.

    Raises:
        InputError: a setting is wrong or changes nothing, or nothing can be written.
        MidnetBenchError: there is no room.
    """
    chosen, values = _exact_settings(settings, "an exact map", ("arena", *SET_BY_EXACT))
    grid = prior_map_from(EXACT, chosen.arena, chosen.resolution_m)
    comment = f"{arena_from(chosen.arena).name}, drawn exactly"
    return _write_exact(grid, {"map": EXACT, **values}, comment, output)


def resample(path: Path, settings: Mapping[str, Scalar], output: Path) -> MadeMap:
    """Write a map_server map in cells of another size, as :func:`draw` does.

    Args:
        path: the map's YAML file.
        settings: any of ``SET_BY_EXACT``; ``resolution_m`` is the size.
        output: where to, as ``MapFiles`` takes it; no other run's map may be there.

    Raises:
        InputError: the map or a setting is wrong or changes nothing, or nothing can be written.
        MidnetBenchError: there is no room.
    """
    chosen, values = _exact_settings(settings, "a resampled map", SET_BY_EXACT)
    found = load_map(path)
    grid = resampled(found, chosen.resolution_m)
    comment = f"{path.name}, resampled from {found.resolution:g} m to {grid.resolution:g} m"
    return _write_exact(grid, {"map": str(path), **values}, comment, output)


def _exact_settings(
    settings: Mapping[str, Scalar], what: str, allowed: tuple[str, ...]
) -> tuple[DetectionParameters, dict[str, Scalar]]:
    """The parameters, and the ``allowed`` ones by key. Raises InputError for one that changes nothing."""
    for name in settings.keys() & DetectionParameters.defaults().keys() - {*allowed}:
        keys = ", ".join(key for key in allowed if key != "arena")
        raise InputError(f"--set {name}: changes nothing of {what}; --set takes {keys}")
    chosen = DetectionParameters.parse({"prior_map": EXACT, **settings}, "command line")
    return chosen, {key: value for key, value in chosen.flat_values().items() if key in allowed}


def _write_exact(
    grid: OccupancyGrid, configuration: Mapping[str, Scalar], comment: str, output: Path
) -> MadeMap:
    files = MapFiles.at(output, configuration)
    binary = {name: configuration[name] for name in PRIOR_MAP_PARAMETERS}
    written = files.write_map(grid, comment, **binary)
    return MadeMap(grid, [*written, files.named(CONFIGURATION)], [])
