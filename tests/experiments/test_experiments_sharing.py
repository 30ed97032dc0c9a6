"""Detection trials in one simulation: the bytes that each has alone; and options that change nothing."""

from pathlib import Path
from typing import Any

import pytest

from midnet_bench.campaign.trial import TrialResult, TrialSpec, encode_tables
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key, simulation_key
from midnet_bench.experiments.guarded import parameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.parameters import result_key as labyrinth_key
from midnet_bench.experiments.registry import run_trials
from midnet_bench.plugins import PluginError

VARIANTS: list[dict[str, Any]] = [
    {},
    {"thresh_local": 60},
    {"thresh_global": 60, "require_line_of_sight": True},
    {"obstacle_range_m": 1.5, "raytrace_range_m": 2.0, "in_range": "edge"},
    {"local_map": "single_scan", "deflate_boxes": True},
    {"detector": "clusters", "fusion": "tracks"},
    {"detector": "background", "truth_box": "inflated"},
    {"fusion": "components", "tp_boxes": "one_per_intruder"},
]
"""all of them move alike"""
MINE = """
class Scribbling:
    def __init__(self, prior_map, range_m):
        pass
    def detect(self, team):
        for robot in team:
            if robot.scan is not None:
                robot.scan.ranges_m[:] = 0.2
        return [[] for _ in team]

class Leaving:
    def __init__(self, prior_map, range_m):
        self.frames = 0
    def detect(self, team):
        self.frames += 1
        if self.frames == 5:
            raise RuntimeError("enough")
        return [[] for _ in team]

class Unmade:
    def __init__(self, prior_map, range_m):
        raise OSError("no lens")
    def detect(self, team):
        return []
"""


def specs(variants: list[dict[str, Any]], **common: Any) -> list[TrialSpec]:
    base = {"engine": "fast", "robots": 2, "frames": 5, **common}
    return [
        TrialSpec("detection", DetectionParameters.of(**{**base, **one}).flat_values(), seed=5)
        for one in variants
    ]


def payload(result: TrialResult | Exception) -> bytes:
    assert isinstance(result, TrialResult), result
    return encode_tables(result)


@pytest.mark.slow
@pytest.mark.parametrize("network", [{}, {"message_delay_s": 0.3, "message_loss": 0.2}])
def test_trials_of_one_simulation_have_the_bytes_that_they_have_alone(network: dict[str, float]) -> None:
    wanted = specs(VARIANTS[::2] if network else VARIANTS, **network)
    shared = [payload(result) for result in run_trials(wanted)]
    assert len(set(shared)) > len(shared) // 2  # the variants differ
    assert shared == [payload(run_trials([spec])[0]) for spec in wanted]
    some = [3, 0, 2]
    assert [payload(result) for result in run_trials([wanted[k] for k in some])] == [shared[k] for k in some]


@pytest.mark.slow
def test_a_detector_that_fails_costs_no_other_trial(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    names = ("Scribbling", "Leaving", "Unmade")
    wanted = specs([*({"detector": f"{tmp_path}/mine.py:{name}"} for name in names), {}])
    *failed, sound = run_trials(wanted)
    assert payload(sound) == payload(run_trials(wanted[-1:])[0])
    for result, said in zip(failed, ("read-only", "enough", "no lens"), strict=True):
        assert isinstance(result, PluginError)
        assert said in str(result)
    assert str(run_trials(wanted[1:2])[0]) == str(failed[1])


def test_what_moves_robots_is_not_shared() -> None:
    exact = {"prior_map": "exact"}
    base = DetectionParameters.of(**exact)
    for changes in VARIANTS:
        assert simulation_key(DetectionParameters.of(**exact, **changes)) == simulation_key(base), changes
    for change in (
        {"robots": 2},
        {"patrol": "cyclic"},
        {"frames": 5},
        {"resolution_m": 0.1},
        {"message_loss": 0.1},
    ):
        assert simulation_key(DetectionParameters.of(**exact, **change)) != simulation_key(base), change


@pytest.mark.slow
@pytest.mark.parametrize(
    ("same", "common"),
    [
        ([{"thresh_local": 97}, {"thresh_local": 98}], {}),
        ([{"thresh_local": 20}, {"thresh_local": 90, "align": "origin"}], {"detector": "clusters"}),
        ([{"iou_fuse": 0.1}, {"iou_fuse": 0.9}], {"fusion": "none", "robots": 3}),
        ([{"iou_ally": 0.1}, {"ally_remove": "all", "ally_diameter_m": 0.2}], {}),
        ([{"decay_s": 1.0}, {"decay_s": 2.0}], {"local_map": "persistent"}),
    ],
)
def test_options_that_change_nothing_give_the_same_trial(
    same: list[dict[str, Any]], common: dict[str, Any]
) -> None:
    one, other = (DetectionParameters.of(**common, **changes) for changes in same)
    assert one != other
    assert result_key(one) == result_key(other)
    wanted = specs(same, **{"robots": 1, **common})
    first, second = (payload(run_trials([spec])[0]) for spec in wanted)
    assert first == second


@pytest.mark.parametrize(
    ("first", "second", "common"),
    [
        ({"thresh_local": 99}, {"thresh_local": 60}, {}),
        ({"thresh_local": 97}, {"thresh_local": 98}, {"truth_box": "inflated"}),
        ({"iou_fuse": 0.1}, {"iou_fuse": 0.9}, {"robots": 2}),
        ({"iou_ally": 0.1}, {"iou_ally": 0.9}, {"robots": 2, "fusion": "none"}),
        ({"decay_s": 1.0}, {"decay_s": 2.0}, {"local_map": "decay"}),
        ({"obstacle_range_m": 1.0}, {"obstacle_range_m": 2.0}, {"detector": "clusters"}),
    ],
)
def test_options_that_may_change_something_do_not(
    first: dict[str, Any], second: dict[str, Any], common: dict[str, Any]
) -> None:
    one, other = (DetectionParameters.of(**common, **changes) for changes in (first, second))
    assert result_key(one) != result_key(other)


@pytest.mark.parametrize(
    ("changes", "is_same"),
    [
        ({}, False),  # one guard's own square keeps boxes from its pursuit
        ({"pursuit": "none"}, False),  # and from the targets that are counted
        ({"pursuit_ignores_allies": False}, True),
        ({"pursuit": "oracle"}, True),
    ],
)
def test_the_size_of_one_guard_counts_where_its_pursuit_ignores_boxes_on_it(
    changes: dict[str, Any], is_same: bool
) -> None:
    one, other = (
        labyrinth_key(LabyrinthParameters.of(ally_diameter_m=size_m, **changes)) for size_m in (0.2, 0.4)
    )
    assert (one == other) == is_same


def test_a_pursuit_by_the_referees_truth_ignores_no_box() -> None:
    keys = {
        rule: [
            labyrinth_key(LabyrinthParameters.of(pursuit=rule, pursuit_ignores_allies=on))
            for on in (False, True)
        ]
        for rule in ("oracle", "nearest")
    }
    assert {rule: one == other for rule, (one, other) in keys.items()} == {"oracle": True, "nearest": False}


def test_the_registry_knows_what_a_labyrinth_depends_on() -> None:
    one, other = (
        registry.LABYRINTH.sharing(LabyrinthParameters.of(ally_diameter_m=size_m)) for size_m in (0.2, 0.4)
    )
    assert one.result_key != other.result_key


def test_a_threshold_stands_for_the_least_cost_from_there_on() -> None:
    """Cells 5 cm apart cost 100, 99 up to 0.105 m from an obstacle, then 91 at 0.112 m, then 82 at 0.12 m."""
    found = [
        parameters.result_key(LabyrinthParameters.of(thresh_local=thresh)).midnet.thresh_local
        for thresh in (100, 99, 98, 92, 91, 90, 83)
    ]
    assert found == [100, 99, 99, 99, 91, 91, 91]
