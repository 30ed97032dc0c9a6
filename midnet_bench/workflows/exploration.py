"""``write_exploration``: an exploration with everything that is to be seen of it, as files."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

import midnet_bench
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.export import csv_text
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.trial import Row
from midnet_bench.drawing.canvas import png_of
from midnet_bench.drawing.growth import (
    MapHistory,
    MapSnapshot,
    exploration_page,
    write_exploration_video,
)
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.drawing.stills import draw_map
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import Exploration, ExplorationTrial, Snapshot
from midnet_bench.io.files import write_atomically
from midnet_bench.mapping.gmapping.threads import cores
from midnet_bench.mapping.map_score import reachable_free
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.workflows.map_files import MapFiles, write_configuration, write_map, write_provenance

DIGITS = {"coverage": 4, "wall_error_m": 4, "time_s": 1, "distance_m": 1}

Progress = Callable[[float, float], None]
"""Called after each simulated second: simulated seconds, and the share of the free space that is known."""


@dataclass(frozen=True)
class ExplorationFiles:
    """What came of an exploration, and where it lies."""

    exploration: Exploration
    scores: Table
    """one row"""
    files: list[Path]
    """the map first"""

    def in_words(self) -> Table:
        """The scores as a terminal has room for them: a line for each."""
        (row,), (cells,) = self.scores.rows, self.scores.cells()
        lines = [{"": name, "value": cell} for name, cell in zip(row, cells, strict=True)]
        return Table(self.scores.name, self.scores.title, lines)


def write_exploration(
    parameters: MappingParameters, seed: int, output: Path, clip: bool, progress: Progress
) -> ExplorationFiles:
    """Explore an arena and write the map and its binary grid, scores, pictures, and where they come from.

    Args:
        parameters: which arena, how many robots and so on.
        seed: of everything random.
        output: where to, as ``MapFiles`` takes it; nothing is made there unless the robots fit, and no other
            run's map may be there.
        clip: whether to make an MP4 too.
        progress: called with how far it is.

    Raises:
        InputError: the robots do not fit into the arena, or nothing can be written.
        MidnetBenchError: a file cannot be written.
    """
    provenance = collect(seed)
    configuration = {"experiment": "mapping", "seed": seed, "parameters": parameters.flat()}
    with ExplorationTrial(parameters, seed, threads=cores()) as trial:
        files = MapFiles.at(output)
        files.refuse_another(configuration)
        history, start = MapHistory(), trial.layout.robots[0]
        within_reach = reachable_free(trial.truth(), (start.x, start.y), trial.robot.radius_m)
        for snapshot in trial.snapshots():
            history.take(map_snapshot(snapshot, within_reach, trial.robot))
            progress(snapshot.time_s, history.known)
        exploration = trial.result()
        plan = FloorPlan.of(trial.arena, trial.layout, seed)
        kind = trial.robot.name.removeprefix("TurtleBot3 ")
        team = f"explored by {parameters.robots} {kind}{'s' if parameters.robots > 1 else ''}"
        comment = f"{plan.title}: {team}; midnet-bench {midnet_bench.__version__}"
        configured = write_configuration(files, configuration)
        written = write_map(files, exploration.grid, comment)
        written += _write_pictures(plan, team, history, exploration, files, clip)
        robots = trial.rows_of_robots()
    place: Row = {"arena": trial.arena.name, "robots": parameters.robots, "seed": seed}
    scores = Table("scores", "The map against the arena", [{**place, **exploration.row()}], DIGITS)
    written += scores.write(files.named("scores").parent, files.named("scores").name)
    write_atomically(files.named("robots.csv"), csv_text(robots))
    written += [files.named("robots.csv"), configured, write_provenance(files, provenance)]
    return ExplorationFiles(exploration, scores, written)


def map_snapshot(
    snapshot: Snapshot, within_reach: npt.NDArray[np.bool_], model: RobotModel = BURGER
) -> MapSnapshot:
    """A snapshot of a trial as plain data to be drawn.

    Args:
        snapshot: of the trial.
        within_reach: (rows, columns) which cells of its map a robot can reach and are truly free.
        model: what the robots are.
    """
    known = float(np.mean(snapshot.grid.data[within_reach] >= 0))
    at = snapshot
    return MapSnapshot(at.time_s, known, at.grid, at.poses, at.believed, at.goals, paths=[], model=model)


def _write_pictures(
    plan: FloorPlan, team: str, history: MapHistory, exploration: Exploration, files: MapFiles, clip: bool
) -> list[Path]:
    """``map.png``, ``growth.png`` and ``growth.mp4``."""
    final, growth, video = (
        files.map.with_suffix(".png"),
        files.named("growth.png"),
        files.named("growth.mp4"),
    )
    picture = draw_map(exploration.grid, history.paths(), f"{plan.title}: {team}", plan.walls)
    write_atomically(final, png_of(picture))
    write_atomically(growth, png_of(exploration_page(plan, team, history)))
    if clip:
        write_exploration_video(plan, team, history, video)
    return [final, growth, video] if clip else [final, growth]
