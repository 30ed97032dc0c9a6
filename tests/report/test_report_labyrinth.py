import csv
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.campaign.store import Store, open_store
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.labyrinth.figures import DODGE, png_and_svg, success_figure
from midnet_bench.experiments.labyrinth.tables import (
    cells_table,
    health_table,
    speed_table,
    success,
    success_table,
    write_labyrinth_comparison,
    write_labyrinth_report,
)
from midnet_bench.experiments.labyrinth.trials import (
    Cells,
    intruder_counts,
    pooled_time,
    rates_by_seed,
    team_sizes,
    variants_of,
)
from tests.report.labyrinth_stores import Caught, labyrinth_store

SMALL: dict[str, list[Scalar]] = {"intruders": [1, 2], "robots": [1, 3]}


def alternating(intruders: int, robots: int, seed: int) -> int:
    """Half of the trials catch everybody with one robot, three in four with more."""
    return intruders if seed % (4 if robots > 1 else 2) else 0


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with labyrinth_store(tmp_path / "campaign.sqlite", alternating, seeds=8, grid=SMALL) as made:
        yield made


def only(store: Store) -> Cells:
    (cells,) = variants_of(store).values()
    return cells


def test_trials_are_read_into_their_cells(store: Store) -> None:
    cells = only(store)

    assert list(cells) == [(1, 1), (1, 3), (2, 1), (2, 3)]
    assert (intruder_counts(cells), team_sizes(cells)) == ([1, 2], [1, 3])
    trial = cells[2, 3][0]
    assert (trial.seed, trial.success_rate, trial.detected_not_caught) == (1, 100.0, 0.0)
    assert trial.capture_times_s == (20.0, 20.0)
    assert trial.detection_times_s == (10.0, 10.0)
    missed = cells[2, 3][3]
    assert (missed.seed, missed.success_rate, missed.detected_not_caught) == (4, 0.0, 100.0)
    assert missed.capture_times_s == ()
    assert [robot.role for robot in trial.health] == ["guard"] * 3 + ["intruder"] * 2
    assert trial.health[0].stuck_percent == pytest.approx(100 * 6 / 20)
    assert trial.health[0].metres_per_minute == pytest.approx(12.0)


def test_an_intruders_time_ends_with_its_capture_or_escape(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [2], "robots": [1]}
    with labyrinth_store(tmp_path / "campaign.sqlite", lambda k, q, seed: 1, seeds=1, grid=grid) as store:
        (trial,) = only(store)[2, 1]

    assert [robot.present_s for robot in trial.health] == [60.0, 20.0, 60.0]


def test_the_wide_table_is_the_papers_figure_in_numbers(store: Store) -> None:
    table = success_table(variants_of(store))

    assert table.columns == ["intruders", "1 robot", "3 robots", "n"]
    assert [row["intruders"] for row in table.rows] == ["1", "2", "all"]
    assert all(str(row["1 robot"]).startswith("50.0 (") for row in table.rows)
    assert all(str(row["3 robots"]).startswith("75.0 (") for row in table.rows)
    assert all(row["n"] == "8" for row in table.rows)
    assert "| intruders | 1 robot | 3 robots | n |" in table.to_markdown()
    assert table.to_latex().startswith(r"\begin{tabular}{lrrr}")
    assert next(csv.DictReader(table.to_csv().splitlines()))["1 robot"] == table.rows[0]["1 robot"]


def test_intervals_are_over_trials_and_near_the_binomials(tmp_path: Path) -> None:
    """One intruder makes a trial a coin: the bootstrap must come close to the exact binomial spread."""
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [1]}
    with labyrinth_store(tmp_path / "campaign.sqlite", alternating, seeds=20, grid=grid) as store:
        rate = success(only(store), 1, 1)

    assert (rate.value, rate.n) == (50.0, 20)
    half_width = 1.96 * 100 * math.sqrt(0.25 / 20)
    assert rate.low == pytest.approx(50 - half_width, abs=5.0)
    assert rate.high == pytest.approx(50 + half_width, abs=5.0)


def test_a_perfect_score_is_not_certain(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [2], "robots": [1, 2]}

    def caught(intruders: int, robots: int, seed: int) -> int:
        return intruders if robots == 2 else 0

    with labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=20, grid=grid) as store:
        nobody, everybody = success(only(store), 2, 1), success(only(store), 2, 2)

    assert (everybody.value, everybody.high) == (100.0, 100.0)
    assert everybody.low == pytest.approx(100 / (1 + 1.96**2 / 20), abs=0.1)  # Wilson at 20 of 20
    assert (nobody.value, nobody.low) == (0.0, 0.0)
    assert nobody.high == pytest.approx(100 - everybody.low)


def test_over_all_intruders_the_seed_is_the_unit(tmp_path: Path) -> None:
    """Seeds that fail all their trials together are 4 of 8 units, not 8 of 16."""
    with labyrinth_store(
        tmp_path / "campaign.sqlite", alternating, seeds=8, grid=SMALL, failed=(2, 1, 3)
    ) as store:
        cells = only(store)

    assert rates_by_seed(cells, None, 1) == {1: 100, 2: 0, 4: 0, 5: 100, 6: 0, 7: 100, 8: 0}
    assert success(cells, None, 1).n == 7
    assert success(cells, 2, 1).n == 7  # the failed trial is no zero
    assert success(cells, 1, 1).n == 8


def test_times_are_means_over_intruders_with_trials_drawn_whole(store: Store) -> None:
    captured = pooled_time(only(store)[2, 1], "capture_times_s")

    assert captured[:3] == (20.0, 20.0, 20.0)
    assert captured.n == 4
    assert math.isnan(pooled_time([], "capture_times_s").value)


def test_a_long_capture_weighs_as_its_trial_does(tmp_path: Path) -> None:
    """Of 8 trials, 4 catch two intruders each; the mean is over captures, the interval over trials."""
    grid: dict[str, list[Scalar]] = {"intruders": [3], "robots": [1]}

    def caught(intruders: int, robots: int, seed: int) -> int:
        return 2 if seed <= 4 else 0

    with labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=8, grid=grid) as store:
        trials = only(store)[3, 1]
    later = [replace(trial, capture_times_s=(10.0 * trial.seed, 30.0)) for trial in trials[:4]]

    captured = pooled_time([*later, *trials[4:]], "capture_times_s")

    assert captured.value == pytest.approx((10 + 20 + 30 + 40 + 4 * 30) / 8)
    assert 20.0 < captured.low < captured.value < captured.high < 35.0
    assert captured.n == 4


def test_every_cell_has_a_row_of_plain_numbers(store: Store) -> None:
    rows = cells_table(variants_of(store)).rows

    assert [(row["intruders"], row["robots"], row["trials"]) for row in rows] == [
        (1, 1, 8),
        (1, 3, 8),
        (2, 1, 8),
        (2, 3, 8),
    ]
    assert [row["detected_not_caught"] for row in rows] == [50.0, 25.0, 50.0, 25.0]
    assert all(row["time_to_detect_s"] == 10.0 for row in rows)
    for row in rows:
        assert isinstance(row["success_rate_low"], float)
        assert row["success_rate_low"] < 75.0 < float(row["success_rate_high"] or 0) + 25.0


def test_health_is_per_robot_and_tells_the_worst(store: Store) -> None:
    rows: dict[tuple[Scalar, Scalar], Row] = {
        (row["robots"], row["role"]): row for row in health_table(variants_of(store)).rows
    }

    guards = rows[3, "guard"]
    assert guards["robot_trials"] == 3 * 16
    assert guards["stuck_percent"] == pytest.approx(100 * 6 / (0.75 * 20 + 0.25 * 60))
    assert guards["most_stuck_percent"] == pytest.approx(30.0)
    assert guards["goals_given_up"] == 1.0
    assert rows[3, "intruder"]["robot_trials"] == 3 * 8
    assert rows[3, "intruder"]["stuck_percent"] == 0.0


def test_speed_is_by_robots_in_the_arena(store: Store) -> None:
    rows = {row["robots_in_arena"]: row for row in speed_table(variants_of(store)).rows}

    assert list(rows) == ["2", "3", "4", "5", "all"]
    assert rows["2"]["simulated_s"] == 4 * 20 + 4 * 60
    assert rows["2"]["wall_per_simulated"] == pytest.approx(48 / 320)
    assert rows["all"]["real_time_factor"] == pytest.approx((320 + 320 + 240 + 240) / (4 * 48))


def test_the_report_is_made_of_the_store_alone_and_repeats_its_bytes(store: Store, tmp_path: Path) -> None:
    printed = write_labyrinth_report(store, tmp_path / "one")
    with open_store(store.path) as again:
        write_labyrinth_report(again, tmp_path / "two")

    names = {path.name for path in (tmp_path / "one").iterdir()}
    tables = ("success_rate", "success_rate_cells", "labyrinth_health", "labyrinth_speed")
    assert names == {f"{stem}{ending}" for stem in tables for ending in (".csv", ".md", ".tex")} | {
        f"{stem}{ending}" for stem in ("success_rate", "labyrinth_details") for ending in (".png", ".svg")
    }
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name
    assert printed[0].rows == success_table(variants_of(store)).rows


def test_a_second_factor_makes_variants_with_a_panel_each(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"capture": ["within", "detected"], **SMALL}
    with labyrinth_store(tmp_path / "campaign.sqlite", alternating, seeds=4, grid=grid) as store:
        variants = variants_of(store)
        write_labyrinth_report(store, tmp_path)

    assert list(variants) == ["capture=within", "capture=detected"]
    assert [row["variant"] for row in success_table(variants).rows] == ["capture=within"] * 3 + [
        "capture=detected"
    ] * 3
    figure = success_figure(variants)
    assert [axes.get_title() for axes in figure.axes] == list(variants)
    assert (tmp_path / "labyrinth_details_capture-within.svg").exists()


def test_two_campaigns_stand_side_by_side(tmp_path: Path) -> None:
    folders = [tmp_path / "default", tmp_path / "weakest"]
    for folder in folders:
        folder.mkdir()
        labyrinth_store(folder / "campaign.sqlite", alternating, seeds=4, grid=SMALL).close()

    (table,) = write_labyrinth_comparison(folders, tmp_path / "both")

    assert [row["variant"] for row in table.rows] == ["default"] * 3 + ["weakest"] * 3
    assert (tmp_path / "both" / "success_comparison.png").exists()
    with pytest.raises(InputError, match="another one is named 'default' too"):
        write_labyrinth_comparison([folders[0], folders[0]], tmp_path)


def test_a_campaign_without_finished_trials_has_no_report_yet(tmp_path: Path) -> None:
    with labyrinth_store(tmp_path / "campaign.sqlite", alternating, seeds=0, grid=SMALL) as store:
        assert write_labyrinth_report(store, tmp_path) == []


@pytest.mark.parametrize("seeds", [1, 2])
def test_few_trials_give_a_figure_without_intervals_they_do_not_have(tmp_path: Path, seeds: int) -> None:
    with labyrinth_store(tmp_path / "campaign.sqlite", alternating, seeds=seeds, grid=SMALL) as store:
        write_labyrinth_report(store, tmp_path)
        row = success_table(variants_of(store)).rows[0]
    assert ("(" in str(row["1 robot"])) == (seeds > 1)


def growing(intruders: int, robots: int, seed: int) -> int:
    return min(intruders, (seed * robots) % (intruders + 1))


def test_the_figure_tells_its_lines_apart_in_three_ways(tmp_path: Path) -> None:
    caught: Caught = growing
    with labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=4) as store:
        cells = only(store)
    figure = success_figure({"": cells})
    (axes,) = figure.axes
    containers = axes.containers
    lines = [container.lines[0] for container in containers]  # type: ignore[attr-defined]

    assert [container.get_label() for container in containers] == [
        "1 intruder",
        *(f"{k} intruders" for k in (2, 3, 4, 5)),
    ]
    for property_of in ("get_color", "get_marker", "get_linestyle"):
        looks = [str(getattr(line, property_of)()) for line in lines]
        assert len(set(looks)) >= (5 if property_of != "get_linestyle" else 4)
    for k, line in enumerate(lines, 1):
        assert line.get_ydata() == pytest.approx([success(cells, k, q).value for q in range(1, 6)])
        assert line.get_xdata() == pytest.approx(np.arange(1, 6) + DODGE * (k - 3))


def test_the_files_are_a_picture_and_a_drawing(store: Store) -> None:
    files = png_and_svg(success_figure(variants_of(store)))

    image = cv2.imdecode(np.frombuffer(files[".png"], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape[1] >= 1000
    assert ElementTree.fromstring(files[".svg"]).tag.endswith("svg")
