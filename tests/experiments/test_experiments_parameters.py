"""What users can set of the experiments: flat keys, trial ids, help, and what each option reaches."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign.trial import Scalar
from midnet_bench.cli.inputs import READINGS, readings_of
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key, simulation_key
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial
from midnet_bench.experiments.registry import names, parameters_model
from midnet_bench.settings import all_values, leaves
from tests.conftest import campaign_folder


@pytest.mark.parametrize("experiment", names())
def test_a_trial_has_every_parameter(experiment: str) -> None:
    model = parameters_model(experiment)
    assert list(model.parse({}, "test").flat_values()) == list(leaves(model))


@pytest.mark.parametrize("experiment", names())
def test_each_help_is_a_sentence_that_stands_alone(experiment: str) -> None:
    for key, leaf in leaves(parameters_model(experiment)).items():
        help = leaf.help
        assert re.fullmatch(r"[A-Zd].{15,}\.", help), (key, help)
        assert not re.search(r"\bitems? \d", help), (key, help)


def test_the_page_of_readings_names_options_that_there_are() -> None:
    known = {key for name in names() for key in leaves(parameters_model(name))}
    rows = [line.strip("|").split("|") for line in READINGS.read_text().splitlines() if line.startswith("| ")]
    named = {option for row in rows for option in re.findall(r"`(\w+)`", row[-1])}
    assert {"thresh_local", "z_factor", "unknown_in_local"} <= named <= known
    assert [one.item for one in readings_of("localization")] == ["10"]
    assert readings_of("dying_guards") == []


def test_each_option_is_somewhere_to_be_set_and_they_are_few() -> None:
    """Of the classes that the experiments nest; what no user turns is declared by ``fixed``."""
    every = [leaf for name in names() for leaf in all_values(parameters_model(name))]
    open_at = {(leaf.path[-1], leaf.help) for leaf in every if leaf.key}
    assert {leaf.path for leaf in every if leaf.help and (leaf.path[-1], leaf.help) not in open_at} == set()
    assert len({leaf.key for leaf in every if leaf.key}) <= MOST_OPTIONS


def test_what_several_parts_share_reaches_each_of_them() -> None:
    guards = DetectionParameters.from_flat(
        {
            "resolution_m": 0.1,
            "unknown_in_local": "occupied",
            "thresh_local": 80,
            "deflate_boxes": True,
            "intruder_speed_mps": 0.1,
            "localization": "truth",
            "odometry": "encoder",
        }
    )
    assert guards.local_costmap.resolution == guards.prior_costmap.resolution == 0.1
    assert guards.guard_navigator.global_costmap.resolution == 0.1
    assert guards.local_costmap.track_unknown
    assert not guards.prior_costmap.track_unknown
    assert guards.midnet_settings.unknown == "occupied"
    assert guards.midnet_settings.deflate_boxes_m == pytest.approx(0.125, abs=0.004)
    assert guards.intruder_navigator.dwa.limits.max_vel_x_mps == 0.1
    assert guards.guard_navigator.dwa.limits.max_vel_x_mps == 0.18
    assert guards.robot_simulation.odometry.source == "world"
    assert guards.pose_filter is None
    explorers = MappingParameters.from_flat({"resolution_m": 0.1})
    assert explorers.slam.resolution_m == explorers.explorer_navigator.global_costmap.resolution == 0.1


def test_the_pose_filter_suits_its_odometry() -> None:
    filters = [
        DetectionParameters.from_flat({"odometry": odometry}).pose_filter for odometry in ("world", "encoder")
    ]
    assert [one.twist_variance for one in filters if one is not None] == [(0.0, 0.0, 0.0), (1e-4, 1e-4, 1e-2)]
    assert [one.twist_is_mean for one in filters if one is not None] == [False, True]


def test_values_that_do_not_go_together_are_told_before_any_trial() -> None:
    values = {"resolution_m": 0.02, "inflation_radius_m": 2.5}
    with pytest.raises(
        InputError, match=r"grid: .*costmap: inflation_radius_m 2\.5 spans more than 100 cells"
    ):
        DetectionParameters.parse({**values, "prior_map": "exact"}, "grid")


MOST_OPTIONS = 120
SHORT: dict[str, Scalar] = {
    **{"engine": "fast", "robots": 2, "frames": 10},
    **{"prior_map": "exact", "odometry": "encoder"},
}


@pytest.fixture(scope="module")
def usual() -> str:
    return _tables({})


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"wheel_slip": 0.1},
        {"wheel_radius_error": 0.1},
        {"wheel_separation_error": 0.1},
        {"imu_noise": "none", "ukf_imu_yaw_variance": 0.01},
        {"ukf_imu_yaw_variance": 0.01},
        {"step_hz": 120},
        {"dwa_max_vel_x_mps": 0.1},
        {"nav_local_inflation_radius_m": 0.2},
        {"patrol_clearance_m": 1.0},
        {"unknown_in_local": "occupied"},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_a_newer_option_reaches_a_trial(changes: dict[str, Scalar], usual: str) -> None:
    assert _tables(changes) != usual


def _tables(changes: dict[str, Scalar]) -> str:
    return json.dumps(run_detection(DetectionParameters.of(**SHORT, **changes), 3).tables)


def test_a_team_works_on_maps_of_another_resolution() -> None:
    parameters = DetectionParameters.of(robots=1, frames=2, prior_map="exact", resolution_m=0.1)
    with DetectionTrial(parameters, 1) as trial:
        assert [frame.number for frame in trial.frames()] == [1, 2]
        assert trial.prior.resolution == 0.1


def test_settings_of_explorers_and_pursuers_reach_their_code() -> None:
    explorers = MappingParameters.of(robots=2, particles=7, merge="features", nav_goal_tolerance_m=0.1)
    with ExplorationTrial(explorers, 1) as exploration:
        explorer = exploration.explorers[0]
        assert explorer.navigator.settings.goal_tolerance_m == 0.1
        assert explorer.slam.settings.particles == 7
    with LabyrinthTrial(LabyrinthParameters.of(pursuit_retarget_m=1.0), 1) as trial:
        assert trial.pursuit._settings.retarget_m == 1.0


def test_a_preset_is_a_set_of_defaults_beside_which_what_is_given_comes_first() -> None:
    paper, best = DetectionParameters.of(), DetectionParameters.of(preset="best")
    assert (best.costmap.size_m, best.fusion, best.midnet.align) == (6.0, "components(iou=0.02)", "origin")
    assert DetectionParameters.of(preset="best", local_size_m=5.0).costmap.size_m == 5.0
    assert DetectionParameters.of(preset="best", fusion="paper").fusion == "paper"
    assert DetectionParameters.from_flat(best.flat_values()) == best
    spelt_out = DetectionParameters.of(
        local_size_m=6.0, local_map="decay", decay_s=0.5, fusion="components(iou=0.02)", align="origin"
    )
    assert result_key(best) == result_key(spelt_out) != result_key(paper)
    assert simulation_key(best) == simulation_key(paper)


def test_a_preset_s_campaign_runs_in_a_grid(tmp_path: Path) -> None:
    folder = campaign_folder(
        tmp_path / "presets",
        experiment="detection",
        grid={"preset": ["paper", "best"]},
        parameters={"robots": 1, "frames": 3, "engine": "fast"},
    )
    scores = load_results(folder).table("scores")
    assert scores["preset"].tolist() == ["paper", "best"]


def test_hidden_intruders_count_in_the_paper_s_arenas_alone_unless_it_is_said() -> None:
    assert DetectionParameters.of().counts_hidden
    assert not DetectionParameters.of(require_line_of_sight=True).counts_hidden
    office = DetectionParameters.of(arena="office", prior_map="exact")
    assert not office.counts_hidden
    assert replace(office, require_line_of_sight=False).counts_hidden
