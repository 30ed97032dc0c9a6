from pathlib import Path

import numpy as np
import pytest

from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import TrialResult, TrialSpec
from midnet_bench.campaign.worker import Outcome, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.workflows.compare import names_of, write_comparison
from tests.report.labyrinth_stores import labyrinth_store

SMALL = {"intruders": [1, 2], "robots": [1, 2]}


def detection_store(folder: Path, precision: dict[int, float]) -> Path:
    """Trials of one robot, whose precision at each seed is given."""
    folder.mkdir(parents=True)
    definition = Definition("detection", min(precision), len(precision), {"robots": [1]}, {})
    with open_or_create(folder / "campaign.sqlite", definition) as store:
        run_id = store.begin_run(collect(1))
        for seed, value in precision.items():
            spec = TrialSpec("detection", {"robots": 1}, seed)
            scores = {"frames": 10, "precision": value, "recall": 0.5, "f1": float("nan")}
            outcome = Outcome(
                spec.trial_id, 1.0, 2.0, encode_tables(TrialResult({"scores": [scores], "robots": []}, 2.0))
            )
            store.record(run_id, spec, outcome)
    return folder


def test_detection_campaigns_are_paired_by_seed(tmp_path: Path) -> None:
    exact = detection_store(tmp_path / "exact", {1: 0.9, 2: 0.5, 3: 0.7})
    explored = detection_store(tmp_path / "explored", {2: 0.4, 3: 0.65, 4: 1.0})
    (table,) = write_comparison([exact, explored], tmp_path / "out")
    rows = {row["measure"]: row for row in table.rows}
    assert rows["precision"]["seeds"] == 2, "seeds 2 and 3 are in both"
    assert rows["precision"]["exact"] == pytest.approx(0.6)
    assert rows["precision"]["explored"] == pytest.approx(0.525)
    assert rows["precision"]["difference"] == pytest.approx(-0.075)
    assert (rows["precision"]["low"], rows["precision"]["high"]) == pytest.approx((-0.1, -0.05))
    assert rows["recall"]["difference"] == 0.0
    assert np.isnan(rows["f1"]["difference"])
    assert (tmp_path / "out" / "differences.md").exists()


def test_labyrinths_get_their_figure_and_differences_over_all_intruders(tmp_path: Path) -> None:
    folders = [tmp_path / "all", tmp_path / "half"]
    for folder, caught in zip(folders, (lambda i, r, s: i, lambda i, r, s: i // 2), strict=True):
        folder.mkdir()
        labyrinth_store(folder / "campaign.sqlite", caught, seeds=4, grid=SMALL).close()
    *_, table = write_comparison(folders, tmp_path / "out")
    assert [row["trial"] for row in table.rows] == ["1-robot", "2-robot"]
    assert {row["difference"] for row in table.rows} == {-75.0}, "one of one missed, and one of two"
    assert (tmp_path / "out" / "success_comparison.png").exists()


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    first = detection_store(tmp_path / "first", {1: 0.9})
    labyrinth = tmp_path / "labyrinth"
    labyrinth.mkdir()
    labyrinth_store(labyrinth / "campaign.sqlite", lambda i, r, s: i, seeds=1, grid=SMALL).close()
    with pytest.raises(InputError, match="not detection and labyrinth"):
        write_comparison([first, labyrinth], tmp_path)
    for folders in ([first], [first, first], [first, tmp_path / "other" / ".." / "first"]):
        with pytest.raises(InputError, match="two or more different folders"):
            write_comparison(folders, tmp_path)


def test_nothing_in_common_is_told(tmp_path: Path) -> None:
    first, other = (
        detection_store(tmp_path / name, {seed: 0.9}) for name, seed in (("first", 1), ("other", 2))
    )
    with pytest.raises(InputError, match="first and other have no finished trials with a cell and a seed"):
        write_comparison([first, other], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_campaigns_are_called_by_the_ends_of_their_paths(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [Path("runs/one/d1"), Path("runs/two/d1")]
    assert names_of(paths) == ["one/d1", "two/d1"]
    assert names_of([Path("runs/trial"), Path("runs/low"), Path("b")])[:2] == ["runs/trial", "runs/low"]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert names_of([Path("."), Path("../there")]) == ["here", "there"]


def test_a_folder_called_as_a_column_does_not_replace_it(tmp_path: Path) -> None:
    folders = [detection_store(tmp_path / "runs" / name, {1: 0.9}) for name in ("trial", "NaN")]
    (table,) = write_comparison(folders, tmp_path / "out")
    assert [row["trial"] for row in table.rows] == ["1-robot"] * 3
    assert table.rows[0]["runs/trial"] == table.rows[0]["runs/NaN"] == 0.9


def test_labyrinths_of_one_folder_name_are_told_apart(tmp_path: Path) -> None:
    folders = [tmp_path / "one" / "maze", tmp_path / "two" / "maze"]
    for folder in folders:
        folder.mkdir(parents=True)
        labyrinth_store(folder / "campaign.sqlite", lambda i, r, s: i, seeds=2, grid=SMALL).close()
    rates, _ = write_comparison(folders, tmp_path / "out")
    assert {row["variant"] for row in rates.rows} == {"one/maze", "two/maze"}
