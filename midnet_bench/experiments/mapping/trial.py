"""Map construction of section II.A: robots explore an arena that they do not know."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from weakref import proxy

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.explorer import Explorer, hand_out_frontiers
from midnet_bench.arena.arena import Arena, MobileIntruders, StationaryIntruders
from midnet_bench.arena.layout import place
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import Row, TrialResult
from midnet_bench.experiments.guarded.inputs import arena_from
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.robot_trial import RobotTrial
from midnet_bench.geometry import Point, Pose2D
from midnet_bench.grid import MapWindow, OccupancyGrid
from midnet_bench.localization.ukf import PlanarUkf
from midnet_bench.mapping.frontier import Gap, wall_gaps
from midnet_bench.mapping.gmapping import GMapping
from midnet_bench.mapping.map_score import MapScore, closed_spaces, score_map
from midnet_bench.mapping.merge import by_features, by_known_starts, confidence, largest, refusals
from midnet_bench.navigation.navigator import Navigator
from midnet_bench.rng import stream
from midnet_bench.simulation.fleet import SCAN_HZ, ScanTicks

MAP_PERIOD_S = 2
"""How often maps are published, merged and planned on: TurtleBot3's map_update_interval and merging_rate."""
SNAPSHOT_PERIOD_S = 1
ENOUGH = 0.98  # A map that knows less of the free space within reach carries a warning.
NAMED = 5  # gaps in walls that a warning names, the longest


@dataclass(frozen=True, eq=False)
class Snapshot:
    """How far an exploration has come."""

    time_s: float
    poses: npt.NDArray[np.float64]  # (n, 3) true x, y, yaw, map frame
    believed: npt.NDArray[np.float64]  # (n, 3) what the robots take for it
    goals: list[Point | None]
    grid: OccupancyGrid  # int8 over the plane, map frame: the newest merged map, or the largest single one


@dataclass(frozen=True, eq=False)
class Exploration:
    """What came of an exploration."""

    grid: OccupancyGrid  # int8 over the plane, map frame: 100 occupied, 0 free, -1 unknown
    parts: list[OccupancyGrid]  # the same of each robot alone
    score: MapScore
    gaps: list[Gap]  # in its walls, longest first
    time_s: float
    distance_m: float  # driven by all robots together
    finished: bool
    """whether no frontier and no gap was left within the time limit but those that were given up"""
    merge_confidence: float
    """of the features: of the worst pair that was merged, or of the best if all were refused; NaN where
    nothing had to be matched"""
    warnings: list[str]

    def row(self) -> Row:
        """``maps.csv``: the map's quality and its cost."""
        return {
            "coverage": self.score.free_covered,
            "occupied_precision": self.score.occupied_precision,
            "occupied_recall": self.score.occupied_recall,
            "wall_error_m": self.score.wall_error_m,
            "time_s": self.time_s,
            "distance_m": self.distance_m,
            "finished": self.finished,
            "merge_confidence": self.merge_confidence,
        }


class ExplorationTrial(RobotTrial):
    """An arena without intruders and the robots that map it."""

    def __init__(self, parameters: MappingParameters, seed: int, threads: int = 1) -> None:
        """Place the robots at their known starts; time is 0 and the maps are empty.

        ``threads``: that each robot's GMapping shares its particles between; any number gives the same bytes.
        """
        self.parameters = parameters
        self._threads = threads
        self.seed = seed
        self.arena = _empty(arena_from(parameters.arena))
        self.robot = parameters.simulation.robot_model
        self.layout = place(self.arena, seed, parameters.robots, reach_m=self.robot.body_reach_m)
        resolution_m, thickness_m = parameters.resolution_m, self.arena.wall_thickness_m
        width_m, height_m = (side + thickness_m for side in self.arena.enclosure_m)
        self._plane = MapWindow.around_origin(*self.arena.plane_m, resolution_m)
        self._area = MapWindow.around_origin(width_m, height_m, resolution_m)
        self.explorers = [self._make_explorer(i, pose) for i, pose in enumerate(self.layout.robots)]
        self._knows_starts = parameters.merge == "start_poses"
        if self._knows_starts:
            for explorer in self.explorers:
                explorer.mates = [proxy(mate) for mate in self.explorers if mate is not explorer]
        super().__init__(self.layout, self.explorers, parameters.simulation, seed)
        self._newest = self._plane.empty()
        self._is_finished = False

    @property
    def time_s(self) -> float:
        """Simulated seconds since the start."""
        return self.fleet.time_s

    def snapshots(self) -> Iterator[Snapshot]:
        """One per simulated second and a last one, until every explorer is done or the time is up."""
        scans = ScanTicks.of(min(SCAN_HZ, self.parameters.simulation.lidar.hz), self.step_hz)
        # every explorer has scanned by then
        first = min(scans.longest_gap, MAP_PERIOD_S * self.step_hz - 1)
        while not self._is_finished and self.time_s < self.parameters.time_limit_s - 1e-9:
            self.fleet.step()
            if self.world.tick % (MAP_PERIOD_S * self.step_hz) == first:
                self._is_finished = all(explorer.is_done for explorer in self.explorers)
                self._publish()
            if self.world.tick % (SNAPSHOT_PERIOD_S * self.step_hz) == 0:
                yield self._snapshot()
        self._publish()
        yield self._snapshot()

    def result(self) -> Exploration:
        """The map so far and its quality."""
        parts = self._parts()
        starts, truth = self.layout.robots, self.truth()
        merged, matches = (by_known_starts(parts), {}) if self._knows_starts else by_features(parts, starts)
        grid = self._plane.cut(merged)
        score = score_map(grid, truth, starts[0][:2], self.robot.radius_m)
        gaps = wall_gaps(self._area.cut(grid))
        return Exploration(
            grid=grid,
            parts=parts,
            score=score,
            gaps=gaps,
            time_s=self.time_s,
            distance_m=math.fsum(self.fleet.health.distances_m.tolist()),
            finished=self._is_finished,
            merge_confidence=confidence(matches),
            warnings=self._warnings(score, gaps, truth) + refusals(matches),
        )

    def truth(self) -> OccupancyGrid:
        """The arena's true grid, unknown outside the area that is to be explored."""
        exact = render_exact(self.arena, self.parameters.resolution_m)
        return self._plane.cut(self._area.cut(exact))

    def _publish(self) -> None:
        """Let every robot go by the newest map: the team's, or its own if starts are not known."""
        parts = self._parts()
        self._newest = by_known_starts(parts) if self._knows_starts else largest(parts)
        for explorer, part in zip(self.explorers, parts, strict=True):
            explorer.take_map(self._newest if self._knows_starts else part)
        if self._knows_starts and len(self.explorers) > 1:
            hand_out_frontiers(self.explorers, self.time_s)

    def _parts(self) -> list[OccupancyGrid]:
        return [self._plane.cut(explorer.slam.occupancy()) for explorer in self.explorers]

    def _warnings(self, score: MapScore, gaps: list[Gap], truth: OccupancyGrid) -> list[str]:
        """What keeps the map from being whole, a line each."""
        closed = closed_spaces(truth, self.layout.robots[0][:2], self.robot.radius_m)
        closed_m2 = float(np.count_nonzero(closed)) * (truth.resolution * truth.resolution)
        warnings = []
        if not self._is_finished:
            warnings.append(
                f"stopped at the time limit of {self.parameters.time_limit_s:g} s, frontiers left"
            )
        if score.free_covered < ENOUGH:
            warnings.append(f"only {score.free_covered:.1%} of what a robot can reach is mapped")
        if gaps:
            named = [
                f"{gap.length_m:.2f} m at ({gap.place[0]:.2f}, {gap.place[1]:.2f})" for gap in gaps[:NAMED]
            ]
            more = f" and {len(gaps) - NAMED} more" if len(gaps) > NAMED else ""
            warnings.append(f"the walls have gaps: {', '.join(named)}{more}")
        if closed_m2 > 0.0:
            warnings.append(f"no robot can enter {closed_m2:.1f} m2 of free space inside the enclosure")
        return warnings

    def _snapshot(self) -> Snapshot:
        return Snapshot(
            self.time_s,
            self.world.poses(),
            np.array([explorer.pose for explorer in self.explorers]),
            [explorer.goal for explorer in self.explorers],
            self._newest,
        )

    def _make_explorer(self, index: int, start: Pose2D) -> Explorer:
        parameters = self.parameters
        name = f"explorer {index + 1}"
        return Explorer(
            index,
            name,
            start,
            Navigator(self._area.empty(), parameters.explorer_navigator),
            PlanarUkf(start, parameters.pose_filter),
            lambda robot: None,
            parameters.goals.timeout_s,
            slam=GMapping(
                self.robot.lidar, parameters.slam, start, stream(self.seed, "gmapping", name), self._threads
            ),
            area=self._area,
        )


def run_mapping(parameters: MappingParameters, seed: int) -> TrialResult:
    """One trial: ``maps`` (one row: the map's quality), ``robots``, and ``gaps`` if its walls have some."""
    with ExplorationTrial(parameters, seed) as trial:
        for _ in trial.snapshots():
            pass
        exploration = trial.result()
        tables = {"maps": [exploration.row()], "robots": trial.rows_of_robots()}
        if exploration.gaps:
            tables["gaps"] = [
                {"length_m": length_m, "x_m": x_m, "y_m": y_m} for length_m, (x_m, y_m) in exploration.gaps
            ]
        return TrialResult(tables, exploration.time_s)


def _empty(arena: Arena) -> Arena:
    """The building without intruders: they have no place in a prior map."""
    return arena.model_copy(
        update={
            "stationary_intruders": StationaryIntruders(),
            "mobile_intruders": MobileIntruders(),
            "other_intruders": (),
        }
    )
