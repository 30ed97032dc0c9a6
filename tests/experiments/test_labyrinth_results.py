"""The results of a labyrinth campaign whose trials were written down, so that every number is known."""

import csv
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from midnet_bench.analysis.frames import Results, load_results, records
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.campaign.trial import Scalar
from midnet_bench.drawing.charts import DODGE
from midnet_bench.experiments.figures import details_figure, labyrinth_figures, success_figure
from midnet_bench.experiments.labyrinth.tables import (
    Variant,
    cells_table,
    health_table,
    pooled_time,
    speed_table,
    success_table,
    tables,
    variants_of,
)
from midnet_bench.workflows.report import write_report
from tests.stores import Caught, labyrinth_store

SMALL: dict[str, list[Scalar]] = {"intruders": [1, 2], "robots": [1, 3]}


def alternating(intruders: int, robots: int, seed: int) -> int:
    """Half of the trials catch everybody with one robot, three in four with more."""
    return intruders if seed % (4 if robots > 1 else 2) else 0


def growing(intruders: int, robots: int, seed: int) -> int:
    return min(intruders, (seed * robots) % (intruders + 1))


def made(folder: Path, caught: Caught, seeds: int = 8, **more: Any) -> Results:
    folder.mkdir(exist_ok=True)
    labyrinth_store(folder / "campaign.sqlite", caught, seeds=seeds, **{"grid": SMALL, **more}).close()
    return load_results(folder)


def only(results: Results) -> Variant:
    (variant,) = variants_of(results).values()
    return variant


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return made(tmp_path_factory.mktemp("alternating"), alternating)


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Variant:
    """All 25 cells."""
    folder = tmp_path_factory.mktemp("growing")
    labyrinth_store(folder / "campaign.sqlite", growing, seeds=2).close()
    return only(load_results(folder))


def test_trials_are_read_into_their_cells(results: Results) -> None:
    variant = only(results)
    cells = {(k, q): cell for k, q, cell in variant.cells()}
    assert [(*key, len(cell)) for key, cell in cells.items()] == [(k, q, 8) for k in (1, 2) for q in (1, 3)]
    caught, _, _, missed = records(cells[2, 3])[:4]
    assert (caught["seed"], caught["success_rate"], caught["detected_not_caught"]) == (1, 100.0, 0.0)
    assert (caught["capture_times"], caught["capture_times_s"]) == (2, 40.0)
    assert (caught["detection_times"], caught["detection_times_s"]) == (2, 20.0)
    assert (missed["seed"], missed["success_rate"], missed["detected_not_caught"]) == (4, 0.0, 100.0)
    assert missed["capture_times"] == 0
    robots = variant.robots.query("intruders == 2 and robots == 3 and seed == 1")
    assert robots["role"].tolist() == ["guard"] * 3 + ["intruder"] * 2
    assert robots["stuck_percent"].iloc[0] == pytest.approx(100 * 6 / 20)
    assert robots["metres_per_minute"].iloc[0] == pytest.approx(12.0)


def test_an_intruders_time_ends_with_its_capture_or_escape(tmp_path: Path) -> None:
    one = only(made(tmp_path, lambda k, q, seed: 1, seeds=1, grid={"intruders": [2], "robots": [1]}))
    assert one.robots["present_s"].tolist() == [60.0, 20.0, 60.0]


def test_the_wide_table_is_the_papers_figure_in_numbers(results: Results) -> None:
    table = success_table(variants_of(results))
    assert table.columns == ["intruders", "1 robot", "3 robots", "n"]
    assert [row["intruders"] for row in table.rows] == [1, 2, "all"]
    rows = list(csv.DictReader(table.to_csv().splitlines()))
    assert {(row["1 robot"], row["1 robot_n"]) for row in rows} == {("50.0", "8")}
    assert {(row["3 robots"], row["n"]) for row in rows} == {("75.0", "8")}
    assert all(float(row["1 robot_low"]) < 50.0 < float(row["1 robot_high"]) for row in rows)
    low, high = (float(rows[0][f"1 robot_{end}"]) for end in ("low", "high"))
    assert table.cells()[0][1] == f"50.0 [{low:.1f}, {high:.1f}]"


def test_intervals_are_over_trials_and_a_perfect_score_is_not_certain(tmp_path: Path) -> None:
    """One robot makes a trial a coin, near the binomial spread; two and three always give one result."""
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [1, 2, 3]}
    found = only(made(tmp_path, lambda k, q, seed: seed % 2 if q == 1 else int(q == 2), seeds=20, grid=grid))
    coin, everybody, nobody = (found.success(1, q) for q in (1, 2, 3))
    assert (coin.value, coin.n) == (50.0, 20)
    half_width = 1.96 * 100 * math.sqrt(0.25 / 20)
    assert (coin.low, coin.high) == pytest.approx((50 - half_width, 50 + half_width), abs=5.0)
    assert (everybody.value, everybody.high) == (100.0, 100.0)
    assert everybody.low == pytest.approx(100 / (1 + 2.093**2 / 20), abs=0.1)  # Wilson at 20 of 20
    assert (nobody.value, nobody.low) == (0.0, 0.0)
    assert nobody.high == pytest.approx(100 - everybody.low)


def test_over_all_intruders_the_seed_is_the_unit(tmp_path: Path) -> None:
    """Seeds that fail all their trials together are 4 of 8 units, not 8 of 16."""
    variant = only(made(tmp_path, alternating, failed=(2, 1, 3)))
    assert variant.by_seed("success_rate", None, 1) == {1: 100, 2: 0, 4: 0, 5: 100, 6: 0, 7: 100, 8: 0}
    assert variant.success(None, 1).n == 7
    assert variant.success(2, 1).n == 7  # the failed trial is no zero
    assert variant.success(1, 1).n == 8


def test_times_are_means_over_intruders_and_a_long_capture_weighs_as_its_trial_does(
    results: Results, tmp_path: Path
) -> None:
    """Of 8 trials, 4 catch two intruders each; the mean is over captures, the interval over trials."""
    _, _, cell = only(results).cells()[2]
    captured = pooled_time(cell, "capture_times")
    assert (captured.value, captured.n) == (20.0, 4)
    assert math.isnan(captured.low), "all at 20 s: nothing tells how far such times spread"
    assert math.isnan(pooled_time(cell[:0], "capture_times").value)
    found = made(tmp_path, lambda k, q, seed: 2 * (seed <= 4), grid={"intruders": [3], "robots": [1]})
    trials = only(found).trials
    trials.loc[trials["seed"] <= 4, "capture_times_s"] = [40.0, 50.0, 60.0, 70.0]
    captured = pooled_time(trials, "capture_times")
    assert captured.value == pytest.approx((10 + 20 + 30 + 40 + 4 * 30) / 8)
    assert 15.0 < captured.low < captured.value < captured.high < 40.0
    assert captured.n == 4


def test_every_cell_has_a_row_of_plain_numbers(results: Results) -> None:
    rows = cells_table(variants_of(results)).flat_rows()
    keys = ("intruders", "robots", "trials", "time_to_detect_s", "detected_not_caught")
    assert [tuple(row[key] for key in keys) for row in rows] == [
        (k, q, 8, 10.0, missed) for k in (1, 2) for q, missed in ((1, 50.0), (3, 25.0))
    ]
    assert all(row["success_rate_low"] < row["success_rate"] < row["success_rate_high"] for row in rows)


def test_time_spent_on_false_targets_is_a_share_of_all_guards_time(results: Results) -> None:
    one = only(results)
    false = one.trials.assign(targets=4, ghost_targets=3, false_target_s=6.0)
    row = next(
        row
        for row in cells_table({"": replace(one, trials=false)}).rows
        if (row["intruders"], row["robots"]) == (1, 3)
    )
    targets, time = row["ghost_targets"], row["false_target_time"]
    assert isinstance(targets, Estimate)
    assert isinstance(time, Estimate)
    # three guards, for 20 s in six trials and for 60 s in two; 6 s in each
    assert (targets.value, time.value) == pytest.approx((75.0, 100 * 8 * 6 / (3 * (6 * 20 + 2 * 60))))
    assert time.n == 8


def test_campaigns_of_before_have_no_time_spent_on_false_targets(results: Results) -> None:
    one = only(results)
    before = cells_table({"": replace(one, trials=one.trials.assign(false_target_s=float("nan")))})
    assert "ghost_targets" in before.columns
    assert "false_target_time" not in before.columns


def test_health_is_per_robot_and_tells_the_worst(results: Results) -> None:
    rows = {(row["robots"], row["role"]): row for row in health_table(variants_of(results)).flat_rows()}
    guards = rows[3, "guard"]
    assert guards["robot_trials"] == 3 * 16
    assert guards["stuck_percent"] == pytest.approx(100 * 6 / (0.75 * 20 + 0.25 * 60))
    assert guards["most_stuck_percent"] == pytest.approx(30.0)
    assert guards["goals_given_up"] == 1.0
    assert (rows[3, "intruder"]["robot_trials"], rows[3, "intruder"]["stuck_percent"]) == (3 * 8, 0.0)


def test_speed_is_by_robots_in_the_arena(results: Results) -> None:
    rows = {row["robots_in_arena"]: row for row in speed_table(variants_of(results)).rows}
    assert list(rows) == [2, 3, 4, 5, "all"]
    assert rows[2]["simulated_s"] == 4 * 20 + 4 * 60
    assert rows[2]["wall_per_simulated"] == pytest.approx(48 / 320)
    assert rows["all"]["real_time_factor"] == pytest.approx((320 + 320 + 240 + 240) / (4 * 48))


@pytest.mark.slow
def test_a_report_repeats_its_bytes_also_without_the_store(tmp_path: Path) -> None:
    made(tmp_path, alternating, grid={"intruders": [1], "robots": [1, 3]})
    printed = write_report(tmp_path).printed
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.name != "campaign.sqlite"}
    (tmp_path / "campaign.sqlite").unlink()
    write_report(tmp_path)

    stems = ("success_rate", "success_rate_cells", "labyrinth_health", "labyrinth_speed", "claims")
    drawn = {f"{stem}{end}" for stem in ("success_rate", "labyrinth_details") for end in (".png", ".svg")}
    raw = {"trial.csv", "intruders.csv", "robots.csv", "timing.csv", "configuration.json", "provenance.json"}
    made_of_them = {f"{stem}{end}" for stem in stems for end in (".csv", ".md", ".tex")}
    assert set(first) == drawn | raw | made_of_them | {"report.html"}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == first
    image = cv2.imdecode(np.frombuffer(first["success_rate.png"], np.uint8), cv2.IMREAD_COLOR)
    assert image.shape[1] >= 900
    assert ElementTree.fromstring(first["success_rate.svg"]).tag.endswith("svg")
    names = [table.name for table in printed]
    assert names == ["success_rate", "labyrinth_health", "labyrinth_speed"]


def test_a_second_factor_makes_variants_with_a_line_each(tmp_path: Path) -> None:
    found = made(tmp_path, alternating, seeds=4, grid={"capture": ["within", "detected"], **SMALL})
    variants = variants_of(found)
    assert list(variants) == ["capture=within", "capture=detected"]
    names = [row["variant"] for row in success_table(variants).rows]
    assert names == ["capture=within"] * 3 + ["capture=detected"] * 3
    drawn = labyrinth_figures(found)
    panels = drawn["success_rate"].axes
    assert [axes.get_title() for axes in panels] == ["1 intruder", "2 intruders"]
    assert all([one.get_label() for one in axes.containers] == list(variants) for axes in panels)
    assert list(drawn)[1:] == ["labyrinth_details_capture-within", "labyrinth_details_capture-detected"]


def test_a_campaign_without_finished_trials_has_no_report_yet(tmp_path: Path) -> None:
    found = made(tmp_path, alternating, seeds=0)
    assert (tables(found), labyrinth_figures(found), found.finished) == ([], {}, 0)


@pytest.mark.slow
def test_few_trials_give_a_figure_without_intervals_they_do_not_have(tmp_path: Path) -> None:
    for seeds in (2, 3):
        found = made(tmp_path / str(seeds), alternating, seeds=seeds)
        assert ("[" in success_table(variants_of(found)).cells()[0][1]) == (seeds > 2)
    assert labyrinth_figures(made(tmp_path / "drawn", alternating, seeds=2))["labyrinth_details"].axes


def test_the_figure_has_a_panel_for_each_number_of_intruders(full: Variant) -> None:
    figure = success_figure({"": full})
    panels = figure.axes
    assert [axes.get_title() for axes in panels] == ["1 intruder", *(f"{k} intruders" for k in (2, 3, 4, 5))]
    assert {axes.get_xlabel() for axes in panels} == {"security robots"}
    for k, axes in enumerate(panels, 1):
        (bars,) = axes.containers
        line = bars.lines[0]  # type: ignore[attr-defined]
        assert line.get_xdata() == pytest.approx(np.arange(1, 6))
        assert line.get_ydata() == pytest.approx([full.success(k, q).value for q in range(1, 6)])


def test_details_tell_their_lines_apart_in_three_ways_and_leave_out_what_is_0(full: Variant) -> None:
    figure = details_figure(replace(full, robots=full.robots.assign(stuck_percent=0.0)))
    by_label = {axes.get_ylabel(): axes for axes in figure.axes}
    assert "time stuck, %" not in by_label
    assert "time stuck, %" in figure.get_supxlabel()
    first, last = by_label["time to capture, s"], by_label["driven, m per minute"]
    colours = [{one.lines[0].get_color() for one in axes.containers} for axes in (first, last)]  # type: ignore[attr-defined]
    assert not colours[0] & colours[1], "a role looks like a number of intruders"
    lines = [container.lines[0] for container in first.containers]  # type: ignore[attr-defined]
    for property_of, least in (("get_color", 5), ("get_marker", 5), ("get_linestyle", 4)):
        assert len({str(getattr(line, property_of)()) for line in lines}) >= least
    for k, line in enumerate(lines, 1):
        assert line.get_xdata() == pytest.approx(np.arange(1, 6) + DODGE * (k - 3))
