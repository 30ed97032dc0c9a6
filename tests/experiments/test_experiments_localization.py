import math

import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import run_labyrinth
from midnet_bench.io.map_server import save_map


def worst_late_error_m(**changes):
    """Of a guard with slipping wheels, in the second half of 60 s."""
    parameters = DetectionParameters.of(
        engine="fast", arena="empty", prior_map="exact", robots=1, frames=300, odometry="encoder", **changes
    )
    with DetectionTrial(parameters, 1001) as trial:
        guard, errors_m = trial.guards[0], []
        observe = guard.observe

        def observe_and_compare(*scan):
            observe(*scan)
            x, y = trial.world.poses()[guard.index, :2].tolist()
            errors_m.append(math.hypot(guard.pose.x - x, guard.pose.y - y))

        guard.observe = observe_and_compare
        for _ in trial.frames():
            pass
    assert len(errors_m) > 290
    return max(errors_m[150:])


@pytest.mark.slow
def test_the_prior_map_takes_the_drift_out_of_a_guards_pose():
    drifting, held = (worst_late_error_m(localization=one) for one in ("ukf", "ukf+map"))
    assert drifting > 0.015
    assert held < 0.01
    assert held < drifting / 3.0


@pytest.mark.slow
def test_the_labyrinth_takes_it_and_a_map_from_a_file(tmp_path):
    save_map(render_exact(load_arena("map2")), tmp_path / "map.yaml")
    parameters = LabyrinthParameters.of(
        prior_map=str(tmp_path / "map.yaml"),
        engine="fast",
        robots=2,
        time_limit_s=8.0,
        localization="ukf+map",
        odometry="encoder",
    )
    robots = run_labyrinth(parameters, 1001).tables["robots"]
    assert len(robots) == 3
    assert max(row["pose_error_m"] for row in robots) < 0.05
