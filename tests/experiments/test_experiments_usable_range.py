"""An intruder counts as missed only within the usable range: 2.5 m, or what obstacle_range_m says."""

import json

import pytest

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.robots.turtlebot3 import LDS_01

SIDE_M = 0.4
FARTHER = {"obstacle_range_m": 3.0, "raytrace_range_m": 3.5}


def hall(gap_m: float, rule: str) -> str:
    """An arena whose one intruder, a box, stands ``gap_m`` ahead of the only guard's LiDAR."""
    beyond_m = SIDE_M / 2.0 if rule == "edge" else 0.0
    box = {"shape": "box", "x_m": LDS_01.mount.x + gap_m + beyond_m, "y_m": 0.0, "size_m": [SIDE_M, SIDE_M]}
    corners = [[-4, -1.5], [4, -1.5], [4, 1.5], [-4, 1.5], [-4, -1.5]]
    arena = {
        "name": "hall",
        "plane_m": [9.0, 4.0],
        "enclosure_m": [8.0, 3.0],
        "wall_thickness_m": 0.15,
        "wall_height_m": 0.5,
        "walls": [corners],
        "stationary_intruders": {"placed": [box]},
    }
    return json.dumps(arena)


def is_in_range(gap_m: float, rule: str, **changes: object) -> bool:
    parameters = DetectionParameters.of(
        engine="fast", arena=hall(gap_m, rule), prior_map="exact", in_range=rule, **changes
    )
    with DetectionTrial(parameters, 1) as trial:
        (answer,) = trial.in_range()
    return answer


@pytest.mark.parametrize("rule", ["edge", "centre"])
def test_usable_range_is_two_and_a_half_metres_by_default(rule: str) -> None:
    assert is_in_range(2.45, rule)
    assert not is_in_range(2.55, rule)


@pytest.mark.parametrize("rule", ["edge", "centre"])
def test_usable_range_follows_obstacle_range(rule: str) -> None:
    assert is_in_range(2.95, rule, **FARTHER)
    assert not is_in_range(3.05, rule, **FARTHER)
    assert not is_in_range(2.05, rule, obstacle_range_m=2.0)


@pytest.mark.parametrize("rule", ["edge", "centre"])
def test_usable_range_ends_where_the_lidar_does(rule: str) -> None:
    farther = {"obstacle_range_m": 3.9, "raytrace_range_m": 3.9}
    assert is_in_range(LDS_01.range_max_m - 0.05, rule, **farther)
    assert not is_in_range(LDS_01.range_max_m + 0.05, rule, **farther)


def test_line_of_sight_reaches_as_far_as_the_usable_range() -> None:
    exact = {"require_line_of_sight": True, "lidar_noise": "none"}
    assert is_in_range(2.45, "edge", **exact)
    assert is_in_range(2.95, "edge", **exact, **FARTHER)
