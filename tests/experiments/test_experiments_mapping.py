import json
import math

import numpy as np
import pytest

from midnet_bench.campaign.trial import TrialSpec
from midnet_bench.errors import InputError
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import Exploration, ExplorationTrial, Snapshot, run_mapping
from midnet_bench.experiments.registry import run_trials

# a hall with a wall across it, so that the far side has to be driven to; the door in the east leads outside
HALL = {
    "name": "hall",
    "plane_m": [9.0, 4.0],
    "enclosure_m": [7.0, 3.0],
    "wall_thickness_m": 0.15,
    "wall_height_m": 1.0,
    "walls": [
        [[3.5, -0.6], [3.5, -1.5], [-3.5, -1.5], [-3.5, 1.5], [3.5, 1.5], [3.5, 0.6]],
        [[0.5, -1.5], [0.5, 0.3]],
    ],
    "robots": {"center_m": [-2.0, 0.0], "spacing_m": 0.6},
    "stationary_intruders": {"placed": [{"shape": "box", "x_m": -0.5, "y_m": 0.5, "size_m": [0.4, 0.4]}]},
    "mobile_intruders": {"count": 2},
}
CELLAR = {
    **HALL,
    "name": "hall with a cellar that has no door",
    "walls": [[[-3.5, -1.5], [3.5, -1.5], [3.5, 1.5], [-3.5, 1.5], [-3.5, -1.5]], [[1.5, -1.5], [1.5, 1.5]]],
    "stationary_intruders": {},
}


def hall(arena: object = HALL, **changes: object) -> MappingParameters:
    return MappingParameters.of(**{"arena": json.dumps(arena), "particles": 10, "engine": "fast", **changes})


def explore(parameters: MappingParameters, seed: int) -> tuple[Exploration, list[Snapshot]]:
    with ExplorationTrial(parameters, seed) as trial:
        snapshots = list(trial.snapshots())
        return trial.result(), snapshots


@pytest.fixture(scope="module")
def alone() -> tuple[Exploration, list[Snapshot]]:
    return explore(hall(), 1001)


def test_one_robot_maps_the_hall_and_nothing_beyond_its_door(
    alone: tuple[Exploration, list[Snapshot]],
) -> None:
    exploration, _ = alone
    assert exploration.finished
    assert exploration.warnings == []
    assert exploration.score.free_covered > 0.98
    assert exploration.score.occupied_precision > 0.95
    assert exploration.score.occupied_recall > 0.99
    assert exploration.gaps == []
    assert math.isnan(exploration.merge_confidence)
    assert exploration.grid.extent == pytest.approx((-4.5, -2.0, 4.5, 2.0))
    # it had to go round the wall, and did not leave through the door
    assert exploration.distance_m > 2.0


def test_nobody_is_in_the_building_while_it_is_mapped(alone: tuple[Exploration, list[Snapshot]]) -> None:
    grid = alone[0].grid
    column, row = grid.cell_at(-0.5, 0.5)
    assert (grid.data[row - 6 : row + 7, column - 6 : column + 7] == 0).all()


def test_snapshots_show_a_map_that_grows(alone: tuple[Exploration, list[Snapshot]]) -> None:
    exploration, snapshots = alone
    assert [snapshot.time_s for snapshot in snapshots[:3]] == [1.0, 2.0, 3.0]
    assert snapshots[-1].time_s == exploration.time_s
    known = [int((snapshot.grid.data >= 0).sum()) for snapshot in snapshots]
    assert known[0] < known[-1]
    assert snapshots[-1].grid.data.tobytes() == exploration.grid.data.tobytes()
    assert snapshots[0].goals[0] is not None
    assert snapshots[-1].goals == [None]
    for snapshot in snapshots:
        assert np.hypot(*(snapshot.poses - snapshot.believed)[0, :2]) < 0.1
        assert snapshot.poses[0, 0] < 3.5


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others() -> None:
    first, again, other = (explore(hall(time_limit_s=3.0), seed)[0] for seed in (1001, 1001, 1002))
    assert again.grid.data.tobytes() == first.grid.data.tobytes()
    assert again.distance_m == first.distance_m
    assert other.grid.data.tobytes() != first.grid.data.tobytes()


@pytest.mark.slow
def test_two_robots_share_one_map() -> None:
    exploration, snapshots = explore(hall(robots=2, particles=5), 1001)
    assert exploration.score.free_covered > 0.98
    assert exploration.score.occupied_precision > 0.95
    merged = np.maximum(exploration.parts[0].data, exploration.parts[1].data)
    assert exploration.grid.data.tobytes() == merged.tobytes()
    assert snapshots[0].poses.shape == snapshots[0].believed.shape == (2, 3)


@pytest.mark.slow
def test_a_team_whose_maps_do_not_match_keeps_the_largest_and_says_so() -> None:
    exploration, _ = explore(hall(robots=2, particles=5, merge="features", time_limit_s=8.0), 1001)
    assert "the maps of robots 1 and 2 were not merged" in exploration.warnings[-1]
    assert exploration.merge_confidence < 0.7
    known = [int((part.data >= 0).sum()) for part in exploration.parts]
    assert int((exploration.grid.data >= 0).sum()) == max(known) > min(known)


def test_a_room_without_a_door_is_left_out_with_a_warning() -> None:
    exploration, _ = explore(hall(CELLAR), 1001)
    assert exploration.finished
    assert exploration.score.free_covered > 0.98
    (warning,) = exploration.warnings
    # 1.8 x 2.8 m in whole cells
    assert warning == "no robot can enter 5.0 m2 of free space inside the enclosure"


def test_the_time_limit_leaves_half_a_map_and_says_so() -> None:
    exploration, snapshots = explore(hall(time_limit_s=1.5), 1001)
    assert not exploration.finished
    assert exploration.time_s == pytest.approx(1.5)
    assert [round(snapshot.time_s, 3) for snapshot in snapshots] == [1.0, 1.5]
    assert exploration.warnings[0] == "stopped at the time limit of 1.5 s, frontiers left"
    assert exploration.warnings[1].startswith("only ")
    longest, (x_m, y_m) = exploration.gaps[0]
    assert f"{longest:.2f} m at ({x_m:.2f}, {y_m:.2f})" in exploration.warnings[2]


def test_the_registry_runs_it_and_its_tables_are_whole() -> None:
    parameters = hall(time_limit_s=3.0).flat_values()
    (result,) = run_trials([TrialSpec("mapping", parameters, 1003)])
    assert result.simulated_s == pytest.approx(3.0)
    (row,) = result.tables["maps"]
    assert list(row)[:4] == ["coverage", "occupied_precision", "occupied_recall", "wall_error_m"]
    assert row["finished"] is False
    (robot,) = result.tables["robots"]
    assert robot["walls_crossed"] == 0
    assert robot["distance_m"] == row["distance_m"]
    again = run_mapping(hall(time_limit_s=3.0), 1003)
    assert json.dumps(again.tables) == json.dumps(result.tables)


def test_wrong_parameters_are_named() -> None:
    with pytest.raises(InputError, match="merge"):
        MappingParameters.parse({"merge": "by eye"}, "test")
    with pytest.raises(InputError, match="no arena is called"):
        MappingParameters.of(arena="map3")
