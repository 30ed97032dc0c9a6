"""Scores over a numeric factor: numbers, what is drawn by itself, and what cannot be drawn."""

import csv
import math
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.workflows.compare import sweep
from midnet_bench.workflows.report import plot, write_report
from tests.stores import detection_store, labyrinth_store

SCORES = {
    robots: {seed: (0.9, 0.5, 0.1 * robots + 0.01 * seed) for seed in (1, 2, 3, 4)} for robots in (4, 1, 2)
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return detection_store(tmp_path_factory.mktemp("sweeps") / "sizes", SCORES)


def test_a_curve_has_the_means_over_seeds_in_the_factor_s_order(folder: Path) -> None:
    table, figure = sweep(load_results(folder), "robots", "f1")
    assert table.name == "f1_by_robots"
    assert [row["robots"] for row in table.rows] == [1.0, 2.0, 4.0]
    for row in table.rows:
        found, robots = row["mean"], row["robots"]
        assert isinstance(found, Estimate)
        assert isinstance(robots, float)
        assert found.value == pytest.approx(0.1 * robots + 0.025)
        assert found.low < found.value < found.high
        assert found.n == 4
    (axes,) = figure.axes
    (bars,) = axes.containers
    assert bars.lines[0].get_xydata()[:, 0].tolist() == [1.0, 2.0, 4.0]
    dots = axes.collections[-1].get_offsets()
    assert len(dots) == 12
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("security robots", "F1")
    assert axes.get_ylim() == (0.0, 1.03)
    assert figure.get_suptitle() == "Scores by security robots"
    counts, _ = sweep(load_results(folder), "robots", "fp")
    assert [row["mean"].value for row in counts.rows] == [2.0] * 3  # type: ignore[union-attr]


def test_the_other_factors_have_a_line_each(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [1, 2, 3], "robots": [1, 2]}
    labyrinth_store(
        tmp_path / "campaign.sqlite", lambda i, r, s: (s + r) % (i + 1), seeds=4, grid=grid
    ).close()
    table, figure = sweep(load_results(tmp_path), "intruders", "success_rate")
    assert [row["cell"] for row in table.rows] == ["robots=1"] * 3 + ["robots=2"] * 3
    assert len(figure.axes[0].containers) == 2
    for row in table.rows:
        assert isinstance(row["mean"], Estimate)
        assert math.isnan(row["mean"].high) or row["mean"].high <= 100.0


@pytest.mark.slow
def test_a_factor_of_three_values_is_drawn_by_itself_with_its_numbers(folder: Path, tmp_path: Path) -> None:
    write_report(folder, formats=("png",))
    assert (folder / "scores_by_robots.png").exists()
    with (folder / "scores_by_robots.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["measure", "cell", "robots", "mean", "low", "high", "seeds"]
    assert {row["measure"] for row in rows} >= {"precision", "recall", "f1", "gospa_per_frame_m"}
    few = detection_store(tmp_path / "few", {size: SCORES[size] for size in (1, 2)})
    assert [path.name for path in plot(few, formats=("pdf",))] == ["scores_by_team.pdf"], "none by robots"
    assert (few / "scores_by_team.pdf").read_bytes().startswith(b"%PDF-")
    with pytest.raises(InputError, match="figure format 'jpg': use png, svg, pdf"):
        plot(few, formats=("jpg",))


@pytest.mark.slow
def test_the_same_trials_give_the_same_picture(folder: Path, tmp_path: Path) -> None:
    first, again = (plot(folder, tmp_path / name, "robots", "f1") for name in ("a", "b"))
    assert [path.name for path in first[:3]] == ["f1_by_robots.png", "f1_by_robots.svg", "f1_by_robots.csv"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in again]


@pytest.mark.parametrize(
    ("x", "y", "told"),
    [
        ("robot", "f1", "--x robot: the grid has no such factor; did you mean 'robots'"),
        ("robots", "f2", "--y f2: no such column; the nearest of "),
        ("robots", "dispatched", "--y dispatched: no such column"),
        (None, "f1", "--y f1: say by --x"),
    ],
)
def test_a_missing_column_is_named(folder: Path, x: str | None, y: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        plot(folder, x=x, y=y)


def test_words_have_no_place_on_an_axis(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"engine": ["bullet", "fast"], "intruders": [1], "robots": [1]}
    caught = {"bullet": 1, "fast": 0}
    store = tmp_path / "campaign.sqlite"
    labyrinth_store(store, lambda i, r, s: 0, seeds=2, grid=grid, by_engine=caught).close()
    with pytest.raises(InputError, match=r"--x engine: its values are no numbers \(bullet, fast\)"):
        plot(tmp_path, x="engine", y="duration_s")
