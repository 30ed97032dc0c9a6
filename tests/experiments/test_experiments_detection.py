import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import Row, TrialResult, TrialSpec
from midnet_bench.detectors.detector_node import binary_prior
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.experiments.registry import run_trials
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from midnet_bench.navigation.navigation_settings import TRAJECTORY_ROLLOUT_LIMITS
from midnet_bench.scoring.frame_counts import Causes


@cache
def detection(seed: int = 3, **changes: object) -> TrialResult:
    """A short trial; the same one again is not simulated anew."""
    return run_detection(
        DetectionParameters.of(**{"robots": 2, "frames": 10, "engine": "fast", **changes}), seed
    )


def as_bytes(result: TrialResult) -> bytes:
    return json.dumps(result.tables, sort_keys=True).encode()


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"engine": "bullet"}, marks=pytest.mark.slow),
        {"localization": "ukf+map", "odometry": "encoder"},
        {"localization": "ukf+map", "odometry": "world"},
    ],
)
def test_the_seed_decides_every_byte(options: dict[str, object]) -> None:
    options = {**options, "frames": 5}
    assert as_bytes(detection.__wrapped__(**options)) == as_bytes(detection(**options))
    assert as_bytes(detection(**options)) != as_bytes(detection(seed=4, **options))


def test_a_spec_says_all_that_a_trial_needs() -> None:
    parameters = DetectionParameters.of(robots=2, frames=10, engine="fast").flat_values()
    assert as_bytes(run_trials([TrialSpec("detection", parameters, 3)])[0]) == as_bytes(detection(seed=3))


def test_teams_of_one_seed_meet_the_same_intruders() -> None:
    def start(robots: int) -> tuple[object, ...]:
        with DetectionTrial(DetectionParameters.of(robots=robots), 5) as trial:
            return trial.layout.stationary, trial.layout.intruders

    assert start(1) == start(5)


@pytest.mark.slow
def test_everybody_drives_and_eight_intruders_are_scored() -> None:
    with DetectionTrial(DetectionParameters.of(robots=5, frames=25, engine="fast"), 7) as trial:
        frames = list(trial.frames())
        rows = trial.rows_of_robots()
    assert [len(frame.truths) for frame in frames] == [8] * 25
    assert len(rows) == 10
    assert min(row["distance_m"] for row in rows) > 0.25
    assert all(row["walls_crossed"] == 0 for row in rows)
    assert sum(frame.counts.tp for frame in frames) > 75


def test_causes_are_parts_of_the_errors_and_a_hidden_intruder_is_none_where_sight_is_asked() -> None:
    def row(**changes: object) -> Row:
        (scores,) = detection(seed=7, frames=25, **changes).tables["scores"]
        return scores

    scores, seen = row(), row(require_line_of_sight=True)
    counts = {
        name: int(value or 0) for name, value in scores.items() if name in (*Causes._fields, "fn", "fp")
    }
    assert counts["looked_at"] == 25 // 10
    assert 0 < counts["fn_hidden"] <= counts["fn"]
    assert counts["fn_new"] <= counts["fn"]
    assert counts["fp_left"] <= counts["fp"]
    assert counts["reordered"] <= counts["looked_at"]
    assert seen["fn_hidden"] == 0
    assert int(seen["fn"] or 0) <= counts["fn"] - counts["fn_hidden"]


@pytest.mark.slow
def test_trajectory_rollout_drives_at_its_own_speeds() -> None:
    own = TRAJECTORY_ROLLOUT_LIMITS
    parameters = DetectionParameters.of(
        engine="fast",
        robots=1,
        intruders=1,
        frames=40,
        controller="trajectory_rollout",
        intruder_speed_mps=0.1,
    )
    with DetectionTrial(parameters, 3) as trial:
        assert trial.guards[0].navigator.settings.rollout_limits == own
        slower = trial.intruders[0].navigator.settings.rollout_limits
        assert (slower.max_vel_x_mps, slower.max_vel_theta_radps) == (0.1, own.max_vel_theta_radps)
        assert slower.min_vel_x_mps == pytest.approx(own.min_vel_x_mps * 0.1 / own.max_vel_x_mps)
        speeds = [trial.guards[0].velocity[0] for _ in trial.frames()]
        rows = trial.rows_of_robots()
    assert 0.17 < max(speeds) < own.max_vel_x_mps + 0.01
    assert rows[0]["distance_m"] > 0.6
    assert 0.4 < max(row["distance_m"] for row in rows[1:]) < 0.1 * 8.0 + 0.05


def test_how_an_intruder_is_scored_does_not_change_who_is_in_range() -> None:
    def in_range(**changes: object) -> list[object]:
        return [row["intruders_in_range"] for row in detection(**changes).tables["frames"]]

    assert in_range(truth_box="inflated") == in_range()


def test_an_arena_without_intruders_has_no_detection() -> None:
    scores = detection(arena="empty", robots=1, frames=50).tables["scores"][0]
    assert scores["tp"] == scores["fp"] == scores["fn"] == 0
    assert math.isnan(float(scores["recall"]))


@pytest.mark.slow
def test_guards_alone_leave_ghosts_of_each_other_where_marks_are_kept() -> None:
    # costmap_2d keeps what an ally leaves behind until a beam passes; the large square removes the allies
    team = {"seed": 4, "arena": "empty", "robots": 5, "frames": 40, "ally_diameter_m": 0.42, "iou_ally": 0.1}
    kept = detection(**team).tables["scores"][0]
    forgotten = detection(**team, local_map="single_scan").tables["scores"][0]
    assert forgotten["fp"] <= 2 < kept["fp"] <= 40


@pytest.mark.parametrize(
    ("thresh", "reach_m"),
    [(99, 0.105), (50, 0.173), (10, 0.339), (100, 0.0)],
)
def test_a_threshold_stands_for_a_distance(thresh: int, reach_m: float) -> None:
    # the figures of item 1, for k = 10 and an inscribed radius of 0.105 m
    assert DetectionParameters().local_costmap.reach_m(thresh) == pytest.approx(reach_m, abs=0.004)


def test_the_prior_map_is_fatter_than_the_local_one() -> None:
    parameters = DetectionParameters()
    exact = render_exact(load_arena("map1"))
    prior = binary_prior(exact, parameters)
    thinner = DetectionParameters.of(thresh_global=parameters.midnet.thresh_local)
    local = binary_prior(exact, thinner)
    assert ((local.data == 0) <= (prior.data == 0)).all()
    assert (prior.data == 0).sum() > (local.data == 0).sum() > (exact.data == 100).sum()


def test_a_trial_of_files_is_that_of_their_contents_and_does_not_read_them_again(tmp_path: Path) -> None:
    arena, map_file = tmp_path / "mine.yaml", tmp_path / "map.yaml"
    arena.write_text(load_arena("map1").model_dump_json())
    save_map(render_exact(load_arena("map1")), map_file)
    files = {"arena": str(arena), "prior_map": str(map_file)}
    values = DetectionParameters.of(robots=2, frames=10, engine="fast", **files).flat_values()
    for file in tmp_path.iterdir():
        file.unlink()
    (result,) = run_trials([TrialSpec("detection", values, 3)])
    assert as_bytes(result) == as_bytes(detection(prior_map="exact"))


def test_a_file_counts_by_its_contents(tmp_path: Path) -> None:
    def trial_id() -> str:
        values = DetectionParameters.of(prior_map=str(tmp_path / "map.yaml")).flat_values()
        return TrialSpec("detection", values, 1).trial_id

    save_map(render_exact(load_arena("map1")), tmp_path / "map.yaml")
    before = trial_id()
    assert trial_id() == before
    save_map(render_exact(load_arena("empty")), tmp_path / "map.yaml")
    assert trial_id() == before  # the same walls
    save_map(OccupancyGrid(np.zeros((160, 160), np.int8), 0.05, (-4.0, -4.0)), tmp_path / "map.yaml")
    assert trial_id() != before


def worst_late_error_m(**changes: object) -> float:
    """Of a guard with slipping wheels, in the second half of 30 s."""
    parameters = DetectionParameters.of(
        **{"engine": "fast", "arena": "empty", "prior_map": "exact", "robots": 1, "intruders": 0},
        **{"frames": 150, "odometry": "encoder", **changes},
    )
    with DetectionTrial(parameters, 1006) as trial:
        guard = trial.guards[0]
        errors_m: list[float] = []
        observe = guard.observe

        def observe_and_compare(*scan: Any) -> None:
            observe(*scan)
            x, y = trial.world.poses()[guard.index, :2].tolist()
            errors_m.append(math.hypot(guard.pose.x - x, guard.pose.y - y))

        guard.observe = observe_and_compare  # type: ignore[method-assign]
        for _ in trial.frames():
            pass
    assert len(errors_m) > 145
    return max(errors_m[75:])


@pytest.mark.slow
def test_the_prior_map_takes_the_drift_out_of_a_guards_pose() -> None:
    drifting, held = (worst_late_error_m(localization=one) for one in ("ukf", "ukf+map"))
    assert drifting > 0.015
    assert held < 0.01
    assert held < drifting / 3.0
