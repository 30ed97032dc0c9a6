"""The report of a mapping campaign whose trials were written down, so that every number is known."""

import itertools
import math
from pathlib import Path

import cv2
import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Outcome, Row, Scalar, TrialResult, TrialSpec, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments.mapping.tables import (
    choice_table,
    health_table,
    measures_table,
    speedup_table,
    teams_of,
    teams_table,
    walls_table,
)
from midnet_bench.workflows.report import write_report
from midnet_bench.workflows.verify import verify
from tests.cli.command import rows
from tests.stores import robot_row

SEEDS = range(1, 5)


def map_row(robots: int, seed: int, **changes: Scalar) -> Row:
    return {
        "coverage": 0.99,
        "occupied_precision": 0.96,
        "occupied_recall": 0.96,
        "wall_error_m": 0.01,
        "time_s": (100.0 if robots == 1 else 40.0) + seed,
        "distance_m": 50.0,
        "finished": True,
        "merge_confidence": math.nan,
        **changes,
    }


def mapping_store(
    folder: Path,
    changes: dict[tuple[str, int, int], Row],
    failed: tuple[str, int, int] | None = None,
    gap: tuple[str, int, int] | None = None,
) -> Results:
    """Two arenas, one and three robots, four seeds; ``changes`` by arena, team size and seed."""
    arenas = ["map1", '{"name": "My flat"}']
    grid: dict[str, list[Scalar]] = {"arena": [*arenas], "robots": [1, 3]}
    store = open_or_create(folder / "campaign.sqlite", Definition("mapping", 1, len(SEEDS), grid, {}))
    run_id = store.begin_run(collect(1))
    for arena, robots, seed in itertools.product(arenas, (1, 3), SEEDS):
        spec = TrialSpec("mapping", {"arena": arena, "robots": robots}, seed)
        if (arena, robots, seed) == failed:
            store.record(run_id, spec, Outcome(spec.trial_id, 1.0, failure="ValueError: no"))
            continue
        row = map_row(robots, seed, **changes.get((arena, robots, seed), {}))
        explorer = robot_row("explorer", 100.0, stuck_s=3.0) | {"recoveries": 2}
        explorer.pop("role")  # all are explorers
        team = [explorer | {"pose_error_m": 0.01 * number} for number in range(1, robots + 1)]
        tables = {"maps": [row], "robots": team}
        if (arena, robots, seed) == gap:
            tables["gaps"] = [{"length_m": 0.15, "x_m": -1.0, "y_m": 2.0}]
        result = TrialResult(tables, 100.0)
        store.record(run_id, spec, Outcome(spec.trial_id, 6.0, 100.0, encode_tables(result)))
    store.close()
    return load_results(folder)


def test_trials_stand_under_their_arenas_names_and_team_sizes(tmp_path: Path) -> None:
    maps = teams_of(mapping_store(tmp_path, {}, failed=("map1", 3, 2)), "maps")
    assert list(maps) == [("map1", 1), ("map1", 3), ("My flat", 1), ("My flat", 3)]
    assert maps["map1", 3]["seed"].tolist() == [1, 3, 4]


def test_a_teams_rows_count_what_finished_and_give_walls_in_centimetres(tmp_path: Path) -> None:
    changes: dict[tuple[str, int, int], Row] = {
        ("map1", 1, 1): {"finished": False, "coverage": 0.9, "wall_error_m": 0.05},
        ("map1", 1, 2): {"coverage": 0.979},
    }
    maps = teams_of(mapping_store(tmp_path, changes), "maps")
    first, *_ = teams_table(maps).flat_rows()
    assert (first["trials"], first["finished"], first["covered_98_percent"]) == (4, 3, 2)
    assert first["covered_percent"] == pytest.approx(100 * (0.9 + 0.979 + 2 * 0.99) / 4)
    assert (first["time_s"], first["time_s_n"]) == (102.5, 4)
    walls, *_ = walls_table(maps).flat_rows()
    assert (walls["wall_error_cm"], walls["wall_error_cm_low"]) == pytest.approx((2.0, 0.0))
    assert walls["wall_error_cm_high"] > 4.0
    assert walls["occupied_precision"] == pytest.approx(0.96)
    assert math.isnan(walls["occupied_precision_high"]), "the same in all trials"


def test_the_ratio_of_times_is_paired_by_seed(tmp_path: Path) -> None:
    changes: dict[tuple[str, int, int], Row] = {("map1", 3, 4): {"time_s": 200.0}}
    found = mapping_store(tmp_path, changes, failed=("map1", 1, 1))
    ours, flat = speedup_table(teams_of(found, "maps")).flat_rows()
    assert ours["time_ratio"] == pytest.approx((42 + 43 + 200) / (102 + 103 + 104))
    assert (ours["baseline"], ours["faster_seeds"], ours["seeds"]) == (1, 2, 3)
    assert (flat["faster_seeds"], flat["seeds"]) == (4, 4)
    # both times of a seed go up together: the ratio hardly moves with the seeds
    low, value, high = (float(str(flat[name])) for name in ("low", "time_ratio", "high"))
    assert value == pytest.approx((41 + 42 + 43 + 44) / (101 + 102 + 103 + 104))
    assert low < value < high
    assert high - low < 0.03


def test_the_map_that_is_kept_is_the_best_of_those_that_are_whole(tmp_path: Path) -> None:
    changes: dict[tuple[str, int, int], Row] = {
        ("map1", 1, 2): {"occupied_precision": 1.0, "occupied_recall": 1.0, "coverage": 0.97},
        ("map1", 3, 3): {"occupied_precision": 0.99, "occupied_recall": 0.97, "wall_error_m": 0.02},
        ("map1", 1, 4): {"occupied_precision": 0.97, "occupied_recall": 0.99, "wall_error_m": 0.01},
        ("map1", 3, 4): {"occupied_precision": math.nan, "occupied_recall": math.nan},
        ("map1", 1, 1): {"occupied_precision": 1.0, "occupied_recall": 1.0, "finished": False},
        ("map1", 3, 1): {"occupied_precision": 1.0, "occupied_recall": 1.0},
    }
    for robots, seed in itertools.product((1, 3), SEEDS):
        changes['{"name": "My flat"}', robots, seed] = {"finished": False}
    found = mapping_store(tmp_path, changes, gap=("map1", 3, 1))
    choice = choice_table(teams_of(found, "maps"), teams_of(found, "gaps")).rows
    assert [(row["arena"], row["choice"], row["robots"], row["seed"]) for row in choice] == [
        ("map1", "chosen", 1, 4),
        ("map1", "2.", 3, 3),
        ("map1", "3.", 1, 3),
        ("map1", "worst", 3, 1),
    ]
    assert (choice[0]["gaps_m"], choice[-1]["gaps_m"]) == (0.0, 0.15)
    assert choice[0]["occupied_f1"] == pytest.approx(2 * 0.97 * 0.99 / 1.96)


def test_the_worst_seed_is_named_and_undefined_numbers_are_left_out(tmp_path: Path) -> None:
    changes: dict[tuple[str, int, int], Row] = {
        ("map1", 1, 3): {"coverage": 0.5, "time_s": 999.0},
        ("map1", 1, 2): {"wall_error_m": math.nan},
    }
    measures = measures_table(teams_of(mapping_store(tmp_path, changes), "maps")).flat_rows()
    mine = {row["measure"]: row for row in measures if (row["arena"], row["robots"]) == ("map1", 1)}
    assert (mine["coverage"]["worst"], mine["coverage"]["worst_seed"]) == (0.5, 3)
    assert (mine["time_s"]["worst"], mine["time_s"]["median"]) == (999.0, 103.0)
    assert (mine["wall_error_m"]["n"], mine["wall_error_m"]["mean"]) == (3, pytest.approx(0.01))


def test_the_robots_health_is_pooled_over_a_team(tmp_path: Path) -> None:
    three = health_table(teams_of(mapping_store(tmp_path, {}), "robots")).rows[1]
    assert (three["robots"], three["robot_trials"], three["recoveries"]) == (3, 12, 24)
    assert three["pose_error_m"] == pytest.approx(0.02)
    assert three["most_pose_error_m"] == pytest.approx(0.03)


@pytest.mark.slow
def test_a_report_writes_tables_and_a_figure(tmp_path: Path) -> None:
    mapping_store(tmp_path, {})
    printed = write_report(tmp_path).printed
    assert [table.name for table in printed][1:3] == ["mapping_walls", "mapping_speedup"]
    stems = ("", "_walls", "_speedup", "_choice", "_measures", "_health")
    tables = {f"{stem}{end}" for stem in stems for end in (".csv", ".md", ".tex")}
    written = {path.name.removeprefix("mapping") for path in tmp_path.glob("mapping*")}
    assert written == {*tables, ".png", ".svg"}
    assert cv2.imread(str(tmp_path / "mapping.png")) is not None
    assert len(rows(tmp_path / "maps.csv")) == 16
    with pytest.raises(InputError, match="paper states"):
        verify(tmp_path)
