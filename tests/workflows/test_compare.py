import math
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows.compare import compare, names_of, sweeps, worse
from midnet_bench.workflows.report import write_comparison
from tests.conftest import campaign_folder
from tests.stores import Caught, detection_store, labyrinth_store

SMALL: dict[str, list[Scalar]] = {"intruders": [1, 2], "robots": [1, 2]}


def one_robot(folder: Path, precision: dict[int, float]) -> Path:
    """Trials of one robot, whose precision at each seed is given."""
    return detection_store(folder, {1: {seed: (value, 0.5, math.nan) for seed, value in precision.items()}})


def labyrinth_in(
    folder: Path,
    caught: Caught = lambda i, r, s: i,
    *,
    seeds: int = 2,
    grid: dict[str, list[Scalar]] = SMALL,
    by_engine: dict[str, int] | None = None,
) -> Path:
    folder.mkdir(parents=True)
    labyrinth_store(folder / "campaign.sqlite", caught, seeds=seeds, grid=grid, by_engine=by_engine).close()
    return folder


def compared(*directories: Path, output: Path | None = None) -> dict[str, Table]:
    found = compare(directories)
    if output is not None:
        write_comparison(found, output)
    return {table.name: table for table in found.tables}


def test_detection_campaigns_are_paired_by_seed(tmp_path: Path) -> None:
    exact = one_robot(tmp_path / "exact", {1: 0.9, 2: 0.5, 3: 0.7, 5: 0.6})
    explored = one_robot(tmp_path / "explored", {2: 0.4, 3: 0.65, 4: 1.0, 5: 0.4})
    table = compared(exact, explored, output=tmp_path / "out")["differences"]
    rows = {row["measure"]: row for row in table.flat_rows()}
    assert rows["precision"]["seeds"] == 3, "seeds 2, 3 and 5 are in both"
    assert rows["precision"]["exact"] == pytest.approx(0.6)
    assert rows["precision"]["explored"] == pytest.approx(1.45 / 3)
    assert rows["precision"]["difference"] == pytest.approx(-0.35 / 3)
    assert rows["precision"]["low"] < -0.2
    assert rows["precision"]["high"] > 0.0
    assert rows["precision"]["verdict"] == "no clear difference"
    assert rows["recall"]["difference"] == 0.0
    assert (math.isnan(rows["f1"]["difference"]), rows["f1"]["n"]) == (True, 0)
    assert (tmp_path / "out" / "differences.md").exists()


def test_a_seed_that_makes_an_interval_wide_is_named_and_no_interval_leaves_what_can_be(
    tmp_path: Path,
) -> None:
    first = one_robot(tmp_path / "first", dict.fromkeys(range(1, 9), 0.0))
    other = one_robot(tmp_path / "other", {**dict.fromkeys(range(1, 8), 0.0), 8: 1.0})
    table = compared(first, other)["differences"]
    rows = {row["measure"]: row for row in table.flat_rows()}
    assert (rows["precision"]["outlier_seed"], rows["precision"]["high"]) == (8, 1.0)
    assert rows["recall"]["outlier_seed"] is None
    (note,) = table.notes
    assert note.startswith("outlier_seed: the difference at this seed is far from")
    assert (
        compared(first, one_robot(tmp_path / "same", dict.fromkeys(range(1, 9), 0.5)))["differences"].notes
        == []
    )


@pytest.mark.slow
def test_the_values_of_a_factor_are_paired_by_seed(tmp_path: Path) -> None:
    """One campaign over both engines says what two campaigns say, each on one of them."""
    caught = {"bullet": 1, "fast": 0}
    both = {"engine": [*caught], **SMALL}
    one = labyrinth_in(tmp_path / "one", seeds=3, grid=both, by_engine=caught)
    bullet, fast = (
        labyrinth_in(tmp_path / f"engine={engine}", lambda i, r, s, n=number: n, seeds=3)
        for engine, number in caught.items()
    )
    together = {table.name: table for table in compare([one], by="engine").tables}
    apart = compared(bullet, fast)
    assert str(together["differences"].flat_rows()) == str(apart["differences"].flat_rows())  # NaN is NaN
    assert {row["difference"] for row in together["differences"].flat_rows()} == {-75.0, 20.0}
    assert [row["setting"] for row in together["settings"].rows] == ["engine"]
    for by, folders, told in (
        ("robot", [one], "no factor 'robot'; did you mean 'robots'"),
        ("engine", [one, one], "give one folder"),
        ("engine", [fast], "no factor 'engine'"),
    ):
        with pytest.raises(InputError, match=told):
            compare(folders, by=by)


SIZES = {
    robots: {
        seed: (0.9, 0.5, f1 + 0.01 * (seed % 3) + 0.002 * (robots == 2) * (seed % 4)) for seed in range(1, 11)
    }
    for robots, f1 in ((1, 0.7), (2, 0.6), (3, 0.7))
}
"""f1 by team size"""


def test_the_values_of_a_factor_are_compared_with_the_baseline(tmp_path: Path) -> None:
    folder = detection_store(tmp_path / "sizes", SIZES)
    found = compare([folder], by="robots", baseline="3")
    rows = [row for row in found.differences.rows if row["measure"] == "f1"]
    assert [list(row)[3] for row in rows] == ["robots=1", "robots=2"]
    assert all(list(row)[2] == "robots=3" for row in rows)
    (line,) = worse(found, "f1")
    assert line.startswith("f1 is worse: robots=2: -0.097 [")
    assert worse(found, "precision") == []
    for measure, told in (("f2", "no such score; .* f1"), ("frames", "no such score")):
        with pytest.raises(InputError, match=f"--fail-if-worse {measure}: {told}"):
            worse(found, measure)


def test_gospa_is_worse_when_it_is_higher(tmp_path: Path) -> None:
    def counted(robots: int, seed: int) -> Row:
        return {"gospa_m": 5.0 * robots + 0.1 * (seed % 3) * robots}

    folder = detection_store(tmp_path / "sizes", SIZES, counted=counted)
    for baseline, expected in (("1", ["robots=2", "robots=3"]), ("3", [])):
        found = compare([folder], by="robots", baseline=baseline)
        lines = worse(found, "gospa_per_frame_m")
        assert [line.split(": ")[1] for line in lines] == expected


def test_a_baseline_that_is_not_there_is_refused(tmp_path: Path) -> None:
    folder = detection_store(tmp_path / "sizes", SIZES)
    with pytest.raises(InputError, match="--baseline 4: no such value of robots"):
        compare([folder], by="robots", baseline="4")
    with pytest.raises(InputError, match="--baseline 4: say by --by of which factor"):
        compare([folder, folder], baseline="4")


def test_a_verdict_says_which_campaign_is_better(tmp_path: Path) -> None:
    """Recall is 0.5 at every seed of both."""
    seeds = range(1, 11)
    low = one_robot(tmp_path / "low", {seed: 0.5 + 0.01 * (seed % 3) for seed in seeds})
    high = one_robot(tmp_path / "high", {seed: 0.6 + 0.01 * (seed % 4) for seed in seeds})
    for first, second, verdict in ((low, high, "better"), (high, low, "worse")):
        rows = {row["measure"]: row for row in compared(first, second)["differences"].flat_rows()}
        assert (rows["precision"]["verdict"], rows["recall"]["verdict"]) == (verdict, "identical")
        assert 0.0 <= float(rows["precision"]["p_holm"] or 0.0) < 0.001


@pytest.mark.slow
def test_labyrinths_get_their_figure_and_differences_over_all_intruders(tmp_path: Path) -> None:
    folders = [
        labyrinth_in(tmp_path / "all", lambda i, r, s: i, seeds=4),
        labyrinth_in(tmp_path / "half", lambda i, r, s: i // 2, seeds=4),
    ]
    table = compared(*folders, output=tmp_path / "out")["differences"]
    rows = {(row["trial"], row["measure"]): row["difference"] for row in table.flat_rows()}
    # one of one missed, and one of two; caught ones are gone after 20 s, escaped ones after 60 s
    caught = {(cell, "caught_percent"): -75.0 for cell in ("1-robot", "2-robot", "all cells")}
    times = {("all cells", "duration_s"): 40.0, ("all cells", "time_to_capture_s"): 0.0}
    assert rows == {**caught, **times}
    assert (tmp_path / "out" / "success_comparison.png").exists()


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    first = one_robot(tmp_path / "first", {1: 0.9})
    labyrinth = labyrinth_in(tmp_path / "labyrinth")
    with pytest.raises(InputError, match="not detection and labyrinth"):
        compare([first, labyrinth])
    for folders in ([first], [first, first], [first, tmp_path / "other" / ".." / "first"]):
        with pytest.raises(InputError, match="two or more different folders"):
            compare(folders)


@pytest.mark.parametrize(
    ("seeds", "reason"),
    [
        ((1,), "first has seeds 2 to 4, other has seed 1; run other with --seed 2"),
        ((1, 3, 5), "first has seeds 2 to 4, other has seeds 1 to 5; run other with --seed 2"),
    ],
)
def test_campaigns_without_a_shared_seed_are_refused(
    seeds: tuple[int, ...], reason: str, tmp_path: Path
) -> None:
    first = one_robot(tmp_path / "first", {2: 0.9, 4: 0.9})
    other = one_robot(tmp_path / "other", dict.fromkeys(seeds, 0.9))
    with pytest.raises(InputError, match=f"nothing to pair: {reason}"):
        compared(first, other, output=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_campaigns_without_a_shared_cell_are_refused(tmp_path: Path) -> None:
    scores = {1: (0.9, 0.5, 0.6)}
    folders = [detection_store(tmp_path / f"of{robots}", {robots: scores}) for robots in (1, 2)]
    with pytest.raises(InputError, match="nothing to pair: of1 and of2 have no cell in common"):
        compare(folders)


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
    folders = [one_robot(tmp_path / "runs" / name, {1: 0.9}) for name in ("trial", "NaN")]
    table = compared(*folders)["differences"]
    assert [row["trial"] for row in table.rows] == ["1-robot"] * 5
    assert table.rows[0]["runs/trial"] == table.rows[0]["runs/NaN"] == 0.9


def test_labyrinths_of_one_folder_name_get_different_names(tmp_path: Path) -> None:
    rates = compared(*(labyrinth_in(tmp_path / name / "maze") for name in ("one", "two")))
    assert {row["variant"] for row in rates["success_comparison"].rows} == {"one/maze", "two/maze"}


def test_the_settings_that_differ_are_named(tmp_path: Path) -> None:
    same, more = (
        one_robot(tmp_path / name, dict.fromkeys(seeds, 0.9)) for name, seeds in (("a", [1]), ("b", [1, 2]))
    )
    (row,) = compared(same, more)["settings"].rows
    assert row == {"setting": "trials", "a": "1", "b": "2"}
    assert compared(same, one_robot(tmp_path / "c", {1: 0.1}))["settings"].title == "No setting differs"


def test_variants_that_set_the_team_s_size_are_compared(tmp_path: Path) -> None:
    folder = campaign_folder(
        tmp_path / "teams",
        experiment="detection",
        variants={"one": {"robots": 1}, "two": {"robots": 2}},
        trials=2,
        parameters={"frames": 3, "engine": "fast"},
        compare={"measures": ["recall", "recal"]},
    )
    found = compare([folder], by="variant")
    assert [row["trial"] for row in found.differences.rows] == [""] * 5
    results = load_results(folder, tables_of)
    scores = results.tables["scores"].set_index(["variant", "seed"])
    (recall,) = [row for row in found.differences.flat_rows() if row["measure"] == "recall"]
    assert recall["variant=two"] == pytest.approx(float(scores.loc["two"].recall.mean()))
    ((table, _),) = sweeps(results)
    assert [row["variant"] for row in table.rows] == ["two"]
    assert "compare.measures: there is no score 'recal'; did you mean 'recall'?" in table.notes
