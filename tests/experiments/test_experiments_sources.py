"""Where each default is from: the declarations, TurtleBot3's files, and the page that names them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

import pytest

from midnet_bench.cli.inputs import READINGS
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.navigation import dwa, navigator, trajectory_rollout
from midnet_bench.navigation.navigation_settings import TRAJECTORY_ROLLOUT_LIMITS
from midnet_bench.recording.setup import ReplaySettings
from midnet_bench.settings import Settings, all_values

EVERY = (DetectionParameters, LabyrinthParameters, MappingParameters, ReplaySettings)

RELEASES: Mapping[str, Mapping[str, Mapping[str, float | str]]] = {
    "turtlebot3": {
        "turtlebot3_navigation.launch": {"base_local_planner": "dwa_local_planner/DWAPlannerROS"},
        "costmap_common_params_burger.yaml": {"obstacle_range": 2.5, "raytrace_range": 3.5},
        "local_costmap_params.yaml": {"width": 3.5, "resolution": 0.05},
        "move_base_params.yaml": {
            "planner_patience": 1.0,
            "oscillation_timeout": 10.0,
            "oscillation_distance": 0.2,
            "conservative_reset_dist": 0.10,
        },
        "dwa_local_planner_params.yaml": {
            "max_vel_x": 0.18,
            "min_vel_x": -0.18,
            "max_trans_vel": 0.18,
            "min_trans_vel": 0.05,
            "max_rot_vel": 1.8,
            "min_rot_vel": 0.7,
            "acc_lim_x": 2.0,
            "acc_lim_theta": 2.0,
            "yaw_goal_tolerance": 0.15,
            "xy_goal_tolerance": 0.05,
            "vx_samples": 20,
            "vtheta_samples": 40,
            "path_distance_bias": 32.0,
            "forward_point_distance": 0.325,
            "oscillation_reset_dist": 0.05,
        },
        "base_local_planner_params.yaml": {
            "max_vel_x": 0.18,
            "min_vel_x": 0.08,
            "max_vel_theta": 1.0,
            "min_in_place_vel_theta": 1.0,
            "xy_goal_tolerance": 0.10,
            "yaw_goal_tolerance": 0.05,
            "vx_samples": 18,
            "vtheta_samples": 20,
        },
    },
    "turtlebot3 1.0.0": {
        "costmap_common_params_burger.yaml": {"inflation_radius": 1.0, "cost_scaling_factor": 3.0},
        "move_base_params.yaml": {"controller_patience": 15.0, "planner_frequency": 5.0},
        "dwa_local_planner_params_burger.yaml": {
            "sim_time": 1.5,
            "goal_distance_bias": 20.0,
            "occdist_scale": 0.02,
        },
    },
}
"""release -> file -> key -> value, read in the files, not in the code"""

CONSTANTS: Mapping[str, Mapping[str, float]] = {
    "move_base_params.yaml": {
        "planner_patience": navigator.PLANNER_PATIENCE_S,
        "oscillation_timeout": navigator.OSCILLATION_TIMEOUT_S,
        "oscillation_distance": navigator.OSCILLATION_DISTANCE_M,
        "conservative_reset_dist": navigator.CLEARED_OUTSIDE_M[0] or 0.0,
    },
    "dwa_local_planner_params.yaml": {
        "vx_samples": dwa.VX_SAMPLES,
        "vtheta_samples": dwa.VTH_SAMPLES,
        "path_distance_bias": dwa.PATH_DISTANCE_BIAS,
        "forward_point_distance": dwa.FORWARD_POINT_DISTANCE_M,
        "oscillation_reset_dist": dwa.OSCILLATION_RESET_DIST_M,
    },
    "base_local_planner_params.yaml": {
        "max_vel_x": TRAJECTORY_ROLLOUT_LIMITS.max_vel_x_mps,
        "min_vel_x": TRAJECTORY_ROLLOUT_LIMITS.min_vel_x_mps,
        "max_vel_theta": TRAJECTORY_ROLLOUT_LIMITS.max_vel_theta_radps,
        "min_in_place_vel_theta": TRAJECTORY_ROLLOUT_LIMITS.min_vel_theta_radps,
        "xy_goal_tolerance": TRAJECTORY_ROLLOUT_LIMITS.xy_goal_tolerance_m,
        "yaw_goal_tolerance": TRAJECTORY_ROLLOUT_LIMITS.yaw_goal_tolerance_rad,
        "vx_samples": trajectory_rollout.VX_SAMPLES,
        "vtheta_samples": trajectory_rollout.VTHETA_SAMPLES,
    },
}
"""file of release 0.2.1 -> key -> value that no option sets"""


@pytest.mark.parametrize("parameters", EVERY)
def test_every_option_has_a_source(parameters: type[Settings]) -> None:
    missing = [leaf.path for leaf in all_values(parameters) if not leaf.source]
    assert missing == []


@pytest.mark.parametrize("parameters", EVERY)
def test_a_default_that_a_group_changes_has_its_source_there(parameters: type[Settings]) -> None:
    untold = [".".join(path) for path in _changed_without_source(parameters(), (), ())]
    assert untold == []


def _changed_without_source(
    settings: Any, path: tuple[str, ...], told: tuple[str, ...]
) -> Iterator[tuple[str, ...]]:
    """Paths of options whose value is not the one of their class; ``told``: relative paths with sources."""
    for one in fields(settings):
        value, at = getattr(settings, one.name), (*path, one.name)
        if "source" in one.metadata and value != one.default and one.name not in told:
            yield at
        elif "group" in one.metadata:
            within = tuple(name.partition(".")[2] for name in told if name.startswith(f"{one.name}."))
            yield from _changed_without_source(value, at, (*one.metadata["group"].sources, *within))


def test_values_that_name_a_file_of_turtlebot3_are_the_files() -> None:
    read: dict[str, set[tuple[str, str]]] = {release: set() for release in RELEASES}
    for leaf in (leaf for one in EVERY for leaf in all_values(one)):
        release, _, place = leaf.source.partition(": ")
        if release in RELEASES:
            file, name = place.partition(";")[0].split(", ")
            value = RELEASES[release][file][name]
            assert leaf.default == value or str(value).startswith(f"{leaf.default}_"), (leaf.path, value)
            read[release].add((file, name))
    for file, constants in CONSTANTS.items():
        assert constants == {name: RELEASES["turtlebot3"][file][name] for name in constants}
        read["turtlebot3"] |= {(file, name) for name in constants}
    assert read == {
        release: {(file, name) for file, values in files.items() for name in values}
        for release, files in RELEASES.items()
    }


def test_the_page_gives_each_option_the_source_that_is_declared() -> None:
    """A row's fourth column names the kind of each option in its fifth."""
    kinds: dict[str, set[str]] = {}
    for leaf in (leaf for parameters in EVERY[:3] for leaf in all_values(parameters)):
        kinds.setdefault(leaf.key or "", set()).add(leaf.source.partition(":")[0])
    compared = 0
    for line in READINGS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and cells[0][:1].isdigit():
            for key in set(re.findall(r"`(\w+)`", cells[4])) & kinds.keys():
                compared += 1
                found = [kind for kind in kinds[key] if re.search(rf"\b{kind}\b", cells[3])]
                assert found, (cells[0], key, kinds[key])
    assert compared > 40
