"""What a detection campaign says where no intruder came near, and of robots that stand side by side."""

import math
from collections.abc import Sequence
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Outcome, Row, Scalar, TrialResult, TrialSpec, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.conclusions import headline
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows.report import write_report
from tests.stores import NO_CAUSES, robot_row

NOBODY: Row = {"tp": 0, "fn": 0, "intruders_in_range": 0, "matched": 0, "duplicates": 0, "missed": 0}
EMPTY = {"arena": "empty", "intruders": 0}


def store(
    folder: Path,
    grid: dict[str, list[Scalar]],
    counts: dict[tuple[Scalar, ...], Row],
    recorded: Sequence[Row] = (),
    **given: Scalar,
) -> Path:
    """A campaign of one seed: the values of a cell -> what its one trial counted; ``recorded``: by each."""
    parameters: dict[str, Scalar] = {"arena": "map1", "robots": 1, "obstacle_range_m": 2.5, **given}
    parameters = {name: value for name, value in parameters.items() if name not in grid}
    folder.mkdir()
    with open_or_create(folder / "campaign.sqlite", Definition("detection", 1, 1, grid, parameters)) as made:
        run_id = made.begin_run(collect(1))
        for values, own in counts.items():
            row: Row = {"frames": 40, "tp": 8, "fp": 0, "fn": 4, "intruders_in_range": 12, "matched": 6}
            row |= {"duplicates": 2, "missed": 6, "error_sum_m": 0.6, "gospa_m": 5.0, **own}
            boxes = float(str(row["tp"])) + float(str(row["fp"]))
            scores = {
                "precision": float(str(row["tp"])) / boxes if boxes else math.nan,
                "recall": 0.5 if row["fn"] else math.nan,
                "f1": 0.5 if row["fn"] else math.nan,
            }
            frames: list[Row] = [{"frame": 1, **{key: row[key] for key in row if key != "frames"}}]
            tables = {
                "scores": [{**row, **scores, **NO_CAUSES}],
                "frames": frames,
                "robots": [robot_row("guard", 1.0, 0.0) | {"robot": "guard 1"}],
                **({"recorded": list(recorded)} if recorded else {}),
            }
            cell = {**parameters, **dict(zip(grid, values, strict=True))}
            spec = TrialSpec("detection", cell, 1)
            payload = encode_tables(TrialResult(tables, 8.0))
            made.record(run_id, spec, Outcome(spec.trial_id, 1.0, 8.0, payload))
    return folder


def said(folder: Path) -> list[str]:
    return headline(load_results(folder, tables_of)).conclusion


def shown(folder: Path) -> str:
    (table, *_) = headline(load_results(folder, tables_of)).tables
    return table.to_markdown()


ONE_TEAM: dict[str, list[Scalar]] = {"robots": [1]}


def test_no_intruder_in_range_is_an_answer(tmp_path: Path) -> None:
    folder = store(tmp_path / "a", ONE_TEAM, {(1,): {**NOBODY, "fp": 0}})
    assert said(folder) == [
        "No intruder came within 2.5 m of a guard in 40 frames: nothing to score; give more --frames or "
        "--intruders."
    ]
    assert "n/a" not in shown(folder)
    assert "no intruder in range, no false boxes" in shown(folder)


def test_one_false_box_and_no_intruder_says_so(tmp_path: Path) -> None:
    folder = store(tmp_path / "a", ONE_TEAM, {(1,): {**NOBODY, "fp": 1}})
    assert said(folder) == [
        "No intruder came within 2.5 m of a guard in 40 frames and 1 false box (5.00 in 200 frames): nothing "
        "to score; give more --frames or --intruders."
    ]
    assert "no intruder in range, 1 false box" in shown(folder)


@pytest.mark.parametrize(
    ("false", "words"), [(0, "No false boxes in 40 frames"), (3, "3 false boxes in 40 frames")]
)
def test_a_run_without_intruders_prints_its_false_boxes(tmp_path: Path, false: int, words: str) -> None:
    folder = store(tmp_path / "a", ONE_TEAM, {(1,): {**NOBODY, "fp": false}}, **EMPTY)
    assert said(folder) == [f"{words} without intruders: {5 * false}.00 in 200 frames."]


def test_cells_with_scores_stand_beside_those_without(tmp_path: Path) -> None:
    folder = store(tmp_path / "a", {"robots": [1, 2]}, {(1,): {**NOBODY, "fp": 0}, (2,): {}})
    found = said(folder)
    assert found[0] == "Two robots find 50 % of the intruders within 2.5 m."
    assert found[-1].startswith("1-robot: No intruder came within 2.5 m of a guard in 40 frames: nothing")


ROBOTS: list[Scalar] = ["burger", "burger(lidar=rplidar_a1)", "burger(lidar=utm_30lx)"]
RANGES = "2.5 | 12.0 | 30.0"


def robots_side_by_side(folder: Path) -> Path:
    counts = {(robot,): {"fn": number} for number, robot in enumerate(ROBOTS, 1)}
    return store(folder, {"robot": ROBOTS}, counts, obstacle_range_m=RANGES, local_size_m="3.5 | 24.0 | 60.0")


def test_robot_models_are_an_axis_of_the_grid_like_any_other(tmp_path: Path) -> None:
    folder = robots_side_by_side(tmp_path / "a")
    results = load_results(folder, tables_of)
    robots = results.table("robots")
    assert robots["robot"].tolist() == ROBOTS
    assert robots["trial_robot"].tolist() == ["guard 1"] * 3  # what the table itself calls robot
    assert "trial_robot" not in results.table("scores")
    text = shown(folder)
    assert all(str(robot) in text for robot in ROBOTS)
    assert said(folder)[1] == (
        "Intruders are in range within 2.5 m (burger), 12 m (burger(lidar=rplidar_a1)), "
        "30 m (burger(lidar=utm_30lx))."
    )
    part = results.by_value("robot")["burger(lidar=utm_30lx)"]
    assert part.table("scores")["fn"].tolist() == [3]


def test_the_files_of_such_a_campaign_are_read_as_its_store_is(tmp_path: Path) -> None:
    folder = robots_side_by_side(tmp_path / "a")
    write_report(folder, drawn_from=99)
    (folder / "campaign.sqlite").unlink()
    assert load_results(folder, tables_of).table("robots")["trial_robot"].tolist() == ["guard 1"] * 3


def test_frames_are_an_axis_and_a_column_at_once(tmp_path: Path) -> None:
    folder = store(tmp_path / "a", {"frames": [20, 40]}, {(20,): {"frames": 20}, (40,): {}})
    results = load_results(folder, tables_of)
    assert results.table("scores")["frames"].tolist() == [20, 40]
    assert "frames=20" in shown(folder)


def test_a_column_of_the_name_of_a_factor_that_holds_another_value_is_a_fault(tmp_path: Path) -> None:
    folder = store(tmp_path / "a", {"frames": [20]}, {(20,): {"frames": 21}})
    with pytest.raises(InputError, match="column 'frames': 21 is another's"):
        load_results(folder, tables_of)
