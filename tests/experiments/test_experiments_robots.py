"""Trials with another robot than a Burger."""

import numpy as np
import pytest

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial
from midnet_bench.robots.turtlebot3 import WAFFLE


@pytest.mark.slow
def test_waffles_find_intruders_and_keep_out_of_walls() -> None:
    parameters = DetectionParameters.of(engine="fast", robot="waffle", robots=2, frames=20)
    with DetectionTrial(parameters, 3) as trial:
        assert trial.world.robot == WAFFLE
        found, fastest = 0, 0.0
        corners = np.array(WAFFLE.body)
        walls = trial.arena.wall_solids()
        for frame in trial.frames():
            found += frame.counts.tp
            fastest = max(fastest, float(np.nanmax(trial.world.velocities()[:, 0])))
            for index in range(len(trial.fleet.robots)):
                body = trial.world.pose(index).transform(corners)
                assert min(wall.distance_to(body).min() for wall in walls) > -0.015
        assert found > 15
        assert 0.23 < fastest < 0.27  # a Burger ends at 0.22
        assert trial.fleet.health.crossings.sum() == 0


@pytest.mark.slow
def test_waffles_guard_a_labyrinth() -> None:
    parameters = LabyrinthParameters.of(
        engine="fast", robot="waffle", robots=2, intruders=1, time_limit_s=5.0, capture="contact"
    )
    with LabyrinthTrial(parameters, 2) as trial:
        frames = sum(1 for _ in trial.frames())
        assert frames == 25
        assert trial.fleet.health.distances_m.min() > 0.4
        assert trial.fleet.health.crossings.sum() == 0


@pytest.mark.slow
def test_waffles_explore_by_their_own_lidar() -> None:
    parameters = MappingParameters.of(engine="fast", robot="waffle", robots=1, time_limit_s=3.0)
    with ExplorationTrial(parameters, 2) as trial:
        for _ in trial.snapshots():
            pass
        score = trial.result().score
    assert score.occupied_precision > 0.9
    assert score.free_covered > 0.2
