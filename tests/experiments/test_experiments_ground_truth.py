"""Each oracle takes its cause of error from the detector, and changes nothing of the motion."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.trial import TrialResult, TrialSpec, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters, result_key, simulation_key
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.experiments.guarded.guarded_arena import ScoredFrame
from midnet_bench.experiments.guarded.inputs import arena_from
from midnet_bench.experiments.guarded.parameters import OVERRIDING, Oracle
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.io.map_server import save_map

ORACLES: tuple[Oracle, ...] = get_args(Oracle)
SEED = 5
EMPTY = json.loads(load_arena("empty").model_dump_json())
HALL = {
    **EMPTY,
    "enclosure_m": [10, 10],
    "plane_m": [12, 12],
    "walls": [[[-5, -5], [5, -5], [5, 5], [-5, 5], [-5, -5]]],
}
"""nothing near its middle, where a single guard starts and looks along x"""


def box(x_m: float, y_m: float, side_m: float = 0.2) -> dict[str, Any]:
    return {"shape": "box", "x_m": x_m, "y_m": y_m, "size_m": [side_m, side_m]}


def hall(*placed: dict[str, Any], **more: Any) -> str:
    return json.dumps({**HALL, "stationary_intruders": {"placed": placed}, **more})


def of(**values: Any) -> DetectionParameters:
    return DetectionParameters.of(
        **{
            "engine": "fast",
            "prior_map": "exact",
            "intruders": 0,
            "lidar_noise": "none",
            "require_line_of_sight": False,
            **values,
        }
    )


@contextmanager
def trial(frames: int = 2, **values: Any) -> Iterator[tuple[DetectionTrial, ScoredFrame]]:
    """A trial of ``of`` and its last frame."""
    with DetectionTrial(of(frames=frames, **values), SEED) as made:
        *_, last = made.frames(explain=True)
        yield made, last


def found(frames: int = 2, **values: Any) -> tuple[list[bool], int]:
    """Whether each truth is found at the last frame, and how many boxes are on none."""
    with trial(frames, **values) as (_, last):
        boxes = last.midnet.detections
        on = [[box.intersection_area(truth.box) > 0.0 for truth in last.truths] for box in boxes]
        hit = np.array(on, dtype=bool).reshape(len(boxes), len(last.truths))
        return hit.any(axis=0).tolist(), int((~hit.any(axis=1)).sum())


def specs(**common: Any) -> list[TrialSpec]:
    """A trial for each oracle."""
    base = {"engine": "fast", "robots": 2, "frames": 3, "start_error_m": 0.1, **common}
    oracles = [oracle for oracle in ORACLES if oracle != "fusion" or "detector" not in common]
    return [
        TrialSpec("detection", DetectionParameters.of(**base, oracle=oracle).flat_values(), SEED)
        for oracle in oracles
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    "common", [{"detector": "clusters"}, {"lidar_dropout": 0.2, "dying_guards": 1, "dying_after_s": 0.4}]
)
def test_trials_that_differ_in_the_oracle_move_alike_and_are_alone_what_they_are_together(
    common: dict[str, Any],
) -> None:
    wanted = specs(**common)
    together = registry.run_trials(wanted)
    tables = [result.tables for result in together if isinstance(result, TrialResult)]
    assert all(table["robots"] == tables[0]["robots"] for table in tables)
    shared = [encode_tables(result) for result in together if isinstance(result, TrialResult)]
    assert len(shared) == len(wanted)
    assert len(set(shared)) > len(wanted) // 2
    assert shared == [encode_tables(registry.run_trials([spec])[0]) for spec in wanted]


def test_motion_is_the_same_under_each_oracle_and_few_watch_the_scans() -> None:
    assert set(OVERRIDING) < set(ORACLES)
    for oracle in ORACLES:
        assert simulation_key(of(oracle=oracle)) == simulation_key(of())
        with DetectionTrial(of(oracle=oracle), SEED) as made:
            assert bool(made.fleet.scan_callbacks) == (oracle in OVERRIDING)


def test_with_true_poses_boxes_are_where_intruders_are() -> None:
    wrong = {"arena": hall(box(1.0, 0.0)), "start_error_m": 0.5}
    assert found(**wrong) == ([False], 1)
    assert found(**wrong, oracle="pose") == ([True], 0)
    with trial(**wrong, oracle="pose") as (made, _):
        (told,) = made.observations(made.detector)
        (guard,) = made.guards
        assert told.scan is not None
        assert told.pose.distance_to(made.world.pose(0)) < 0.03, "it moved since it last localised"
        assert guard.pose.distance_to(told.pose) == pytest.approx(0.5, abs=0.01), "it is as wrong as before"


def test_with_the_exact_map_a_wall_that_the_prior_map_lacks_is_no_intruder(tmp_path: Path) -> None:
    room = {**EMPTY, "walls": [*EMPTY["walls"], [[1.0, -0.5], [1.0, 0.5]]]}
    exact = render_exact(arena_from(json.dumps(room)), 0.05)
    data = exact.data.copy()
    column, row = exact.cell_at(0.8, -0.8)
    data[row : row + 32, column : column + 8] = 0
    save_map(exact.with_data(data), tmp_path / "faulty.yaml")
    faulty = {"arena": json.dumps(room), "prior_map": str(tmp_path / "faulty.yaml")}
    assert found(**faulty)[1] > 0
    assert found(**faulty, oracle="map") == ([], 0)
    with trial(**faulty, oracle="map") as (made, _):
        np.testing.assert_array_equal(made.prior_map.data, data, "guards drive by what they were given")


def test_without_delay_the_newest_scan_is_of_the_frame_s_instant() -> None:
    ages = {}
    for oracle in ("none", "delay"):
        with trial(robots=5, arena=hall(), oracle=oracle) as (made, _):
            time_s = made.fleet.time_s
            told = made.observations(made.detector)
            ages[oracle] = [time_s - one.scan.stamp_s for one in told if one.scan is not None]
    assert len(ages["none"]) == 5
    assert max(ages["none"]) > 0.0
    assert ages["delay"] == [0.0] * 5


def test_without_delay_a_scan_lies_where_things_are_now() -> None:
    """Of a guard that drives: no return is farther from the box than its error of the pose, which stays."""
    with trial(frames=25, arena=hall(box(1.0, 0.0, 0.5)), oracle="delay") as (made, _):
        (told,) = made.observations(made.detector)
        assert told.pose == told.scan.pose
        assert made.world.pose(0).distance_to(made.layout.robots[0]) > 0.1, "it has moved"
        _, points = told.scan.returns(2.0)
        off_m = made.layout.stationary[0].distance_to(points)
        assert len(points)
        error_m = told.pose.distance_to(made.world.pose(0))
        assert np.abs(off_m).max() < error_m + 0.03


def test_a_window_holds_the_range() -> None:
    far = {"arena": hall(box(2.3, 0.0), box(-2.2, 0.9))}
    assert found(**far) == ([False, False], 0)
    assert found(**far, oracle="window") == ([True, True], 0)
    wide = of(oracle="window", obstacle_range_m=3.0, raytrace_range_m=3.5).local_costmap
    assert wide.size_m > 6.0
    assert of(oracle="window", local_size_m=9.0).local_costmap.size_m == 9.0
    assert of(oracle="window", obstacle_range_m=10.0).local_costmap.size_m > 20.0


def test_crop_marks_and_window_are_what_options_can_say() -> None:
    assert result_key(of(oracle="crop")) == result_key(of(align="origin"))
    size_m = of(oracle="window").local_costmap.size_m
    for oracle, options in (("marks", {"local_map": "single_scan"}), ("window", {"local_size_m": size_m})):
        assert result_key(of(oracle=oracle)) == result_key(of(**options))
        one, other = (run_detection(of(frames=3, **said), SEED) for said in ({"oracle": oracle}, options))
        assert encode_tables(one) == encode_tables(other)


def test_allies_are_known_by_identity() -> None:
    """With a small ``ally_diameter_m`` Algorithm 2 takes no ally for one."""
    team = {"arena": hall(), "robots": 3, "ally_diameter_m": 0.05, "iou_ally": 0.9}
    assert found(**team)[1] > 0
    assert found(**team, oracle="allies")[1] == 0
    with (
        trial(robots=3, arena=hall()) as (_, plain),
        trial(robots=3, arena=hall(), oracle="allies") as (made, last),
    ):
        assert plain.midnet.explanation.removed
        assert not last.midnet.explanation.removed
        assert not any(view.found for view in last.midnet.explanation.views)
        scan = made.observations(made.detector)[0].scan
        own = made.guards[0].scan
        void = np.isnan(scan.ranges_m)
        assert void.any()
        np.testing.assert_array_equal(scan.ranges_m[~void], own.ranges_m[~void])
        ends = own.lidar.directions[void] * own.ranges_m[void, None]
        points = own.pose.compose(own.lidar.mount).transform(ends)
        others = np.array([guard.pose[:2] for guard in made.guards[1:]])
        assert np.linalg.norm(points[:, None] - others, axis=2).min(axis=1).max() < 0.15
    alone = [result_key(of(robots=1, oracle=oracle)) for oracle in ("allies", "map")]
    assert alone == [result_key(of(robots=1))] * 2


def test_algorithm_2_takes_no_intruder_beside_a_guard() -> None:
    """An intruder near a guard that has died is removed as that guard, unless allies are known."""
    arena = hall(box(0.6, 0.45, 0.3), robots={"spacing_m": 1.2})
    team = {"arena": arena, "robots": 2, "ally_diameter_m": 1.2, "dying_guards": 1, "dying_after_s": 0.0}
    assert found(**team, ally_remove="all")[0] == [False]
    assert found(**team, ally_remove="all", oracle="allies")[0] == [True]


def test_intruders_are_seen_through() -> None:
    row = {"arena": hall(box(0.6, 0.0, 0.3), box(1.0, 0.0), box(1.3, 0.0, 0.1))}
    assert found(**row) == ([True, False, False], 0)
    for memory in ("decay", "single_scan"):
        every = found(**row, oracle="occlusion", local_map=memory, min_area_cells=1)
        assert every == ([True, True, True], 0)
    assert found(**row, oracle="occlusion", detector="subtraction")[0] == [True, True, True]


def test_what_is_seen_through_far_away_needs_a_window_too() -> None:
    row = hall(box(0.6, 0.0, 0.3), box(1.9, 0.0))
    for oracle, seen in {"none": False, "occlusion": False, "window": False, "sight": True}.items():
        hit, false = found(arena=row, oracle=oracle)
        assert hit == [True, seen], oracle
        assert false == 0


def test_without_noise_ranges_are_true() -> None:
    with trial(oracle="noise", lidar_noise="gazebo", arena=hall(box(1.0, 0.0))) as (made, _):
        (scan,) = made.detector.scans
        (true,) = made.lidars.newest.ranges_m
        assert np.array_equal(scan.ranges_m, true)
        met = np.isfinite(true)
        assert 0.0 < np.abs(made.guards[0].scan.ranges_m[met] - true[met]).max() < 0.1


@pytest.mark.slow
def test_boxes_are_fused_by_whose_intruder_they_touch() -> None:
    team = {"robots": 5, "frames": 15, "intruders": None}
    wanted = [
        TrialSpec("detection", of(**team, oracle=oracle).flat_values(), 1) for oracle in ("none", "fusion")
    ]
    before, after = (result.tables["scores"][0] for result in registry.run_trials(wanted))
    assert before["duplicates"] > 0  # type: ignore[operator]
    assert after["duplicates"] == 0
    assert after["missed"] == after["fn"] == before["fn"]
    assert after["fp"] == before["fp"]
    with pytest.raises(InputError, match="oracle: fusion goes with detector=midnet only"):
        of(oracle="fusion", detector="clusters")


def test_walls_and_guards_still_hide() -> None:
    """From (1, 0) along -x: an intruder, a guard if there are two, and a narrow intruder behind it."""
    wall = [[0.9, -0.5], [0.9, 0.5]]
    arena = hall(box(0.6, 0.0), box(1.2, 0.0), walls=[*HALL["walls"], wall])
    assert found(arena=arena, oracle="occlusion") == ([True, False], 0)
    row = (box(0.5, 0.0, 0.1), box(-1.5, 0.0, 0.05))
    for robots, start, is_seen in ((1, {"center_m": [1, 0]}, True), (2, {"spacing_m": 2.0}, False)):
        with trial(robots=robots, arena=hall(*row, robots=start), oracle="occlusion") as (made, _):
            scan = made.observations(made.detector)[0].scan
            _, points = scan.returns(3.0)
            first, last = made.layout.stationary
            assert (np.abs(first.distance_to(points)) < 0.02).any()
            assert (np.abs(last.distance_to(points)) < 0.02).any() == is_seen


def test_echoes_are_where_things_stand() -> None:
    people = [{"kind": "person", "behaviour": "stand", "starts_m": [[1.2, 0.0]]}]
    arena = hall(box(0.6, 0.0, 0.3), other_intruders=people)
    with trial(arena=arena, oracle="occlusion") as (made, last):
        told, own = made.observations(made.detector)[0].scan, made.guards[0].scan
        beams = own.lidar.beams
        np.testing.assert_array_equal(told.ranges_m[:beams], own.ranges_m)
        np.testing.assert_allclose(told.lidar.directions, np.tile(own.lidar.directions, (3, 1)))
        second, third = told.ranges_m[beams:].reshape(2, -1)
        assert np.isnan(second[own.ranges_m == np.inf]).all(), "nothing is behind nothing"
        number, points = told.returns(3.0)
        (person,) = made.crowd.members
        off_m = np.min([leg.distance_to(points[number >= beams]) for leg in person.solids()], axis=0)
        assert len(off_m) > 3
        assert np.abs(off_m).max() < 0.02
        behind = third[np.isfinite(second)]
        assert set(behind.tolist()) == {np.inf}, "in this hall nothing stands behind the person"
        assert all(any(b.intersection_area(t.box) > 0.0 for b in last.midnet.detections) for t in last.truths)


def test_a_beam_that_drops_out_has_no_echo() -> None:
    arena = hall(box(0.6, 0.0, 0.3), box(1.2, 0.0))
    with trial(arena=arena, oracle="occlusion", lidar_dropout=0.5) as (made, _):
        told, own = made.observations(made.detector)[0].scan, made.guards[0].scan
        behind = told.ranges_m[own.lidar.beams :].reshape(-1, own.lidar.beams)
        lost = np.isinf(own.ranges_m)
        assert not np.isfinite(behind[:, lost]).any()
        assert np.isfinite(behind[:, ~lost]).any()


def test_mobile_intruders_are_seen_through_until_they_are_gone() -> None:
    parameters = LabyrinthParameters.of(engine="fast", robots=2, intruders=3, oracle="occlusion")
    with LabyrinthTrial(parameters, SEED) as made:
        made.next_frame()
        made.fleet.remove(made.intruders[0])
        for _ in range(3):
            made.next_frame()
        assert all(one.scan is not None for one in made.observations(made.detector))


def causes_under(oracles: tuple[Oracle, ...], **values: Any) -> list[set[str]]:
    """Those of a recorded trial's errors, oracle by oracle."""
    results = [run_detection(of(record=True, oracle=oracle, **values), SEED) for oracle in oracles]
    return [{str(row["cause"]) for row in result.tables.get("errors", [])} for result in results]


def test_a_recorded_cause_goes_with_its_oracle() -> None:
    """The referee notes what the detector was given: echoes, void beams and all."""
    row = hall(box(0.6, 0.0, 0.3), box(1.0, 0.0))
    none, seen_through = causes_under(("none", "occlusion"), arena=row, frames=3)
    assert "occluded" in none
    assert "occluded" not in seen_through
    far = hall(box(2.2, 0.0))
    none, window = causes_under(("none", "window"), arena=far, frames=3)
    assert "outside_window" in none
    assert "outside_window" not in window
    team = {"arena": hall(), "robots": 3, "ally_diameter_m": 0.05, "iou_ally": 0.9}
    none, allies, pose, delay = causes_under(("none", "allies", "pose", "delay"), **team, frames=3)
    assert "ally_left" in none & pose & delay
    assert not allies


def test_a_network_goes_with_the_oracles_whose_scans_are_the_guards_own() -> None:
    for oracle in OVERRIDING:
        with pytest.raises(InputError, match=rf"oracle: {oracle} .*map, window or marks"):
            of(oracle=oracle, message_loss=0.1)
    for oracle in ("map", "window", "marks"):
        with trial(oracle=oracle, message_loss=0.1, arena=hall(box(1.0, 0.0))) as (_, last):
            assert isinstance(last.midnet.detections, list)
