"""Campaigns by name: listed, found from any folder, and told apart from files."""

import json
import time
from pathlib import Path

import pytest
import yaml

from tests.cli.command import REPOSITORY, midnet_bench, one_line_of_complaint, rows, unpainted, worked

CAMPAIGNS = sorted((REPOSITORY / "campaigns").glob("*.yaml"))


def test_campaigns_lists_every_file_with_its_first_sentence(tmp_path: Path) -> None:
    done = midnet_bench("run", folder=tmp_path)
    files = sorted(path.stem for path in CAMPAIGNS)
    assert [line.split()[0] for line in done.stdout.splitlines() if line[0] != " "] == files
    assert "labyrinth The paper's 500 labyrinth trials, section V.B." in " ".join(done.stdout.split())
    told = json.loads(midnet_bench("run", "--json", folder=tmp_path).stdout)
    assert list(told) == files
    assert all(text.endswith(".") and len(text) < 160 for text in told.values())


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, marks=() if path.stem == "labyrinth" else pytest.mark.slow, id=path.stem)
        for path in CAMPAIGNS
    ],
)
def test_every_packaged_campaign_can_be_planned_from_any_folder(path: Path, tmp_path: Path) -> None:
    done = worked("run", path.stem, "-n", "--json", folder=tmp_path)
    written = yaml.safe_load(path.read_text())
    cells = len(written.get("variants", {})) or 1
    for values in written.get("grid", {}).values():
        cells *= len(values)
    told = json.loads(done.stdout)
    (plan,) = told["tables"]["plan"]
    trials = cells * written["trials"]
    assert (plan["cells"], plan["trials"], plan["to_run"]) == (cells, trials, trials)
    assert told["directory"] == f"results/{path.stem}"


@pytest.mark.slow
def test_a_sweep_over_both_ranges_is_reported_and_compared(tmp_path: Path) -> None:
    options = ("--frames", 5, "--engine", "fast", "--robots", 1, "--set", "in_range=centre,edge")
    with unpainted():
        worked("detection", *options, "-o", "ranges", folder=tmp_path)
    scores = rows(tmp_path / "ranges" / "scores.csv")
    assert [row["in_range"] for row in scores] == ["centre", "edge"]
    near = [int(row["intruders_in_range"]) for row in scores]
    assert near[0] < near[1]
    worked("compare", "ranges", "--by", "in_range", folder=tmp_path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("labyrinth --trials 20", "25 cells, 500 trials"),
        ("labyrinth --trials 1000000", "25 cells, 25000000 trials, 25000000 of them to run"),
        ("labyrinth --seeds 3 --robots 2", "5 cells, 15 trials"),
        ("detection --robots 1", "1 cell, 1 trial, 1 of them to run"),
        ("detection --set robots=3 --set frames=20", "1 cell, 1 trial"),
        ("detection --robots 2,3,4 --intruders 1,2", "6 cells"),
        ("run detection --robots 3 --frames 20 --arena map2 --preset best", "1 cell, 1 trial"),
        ("run mapping", "6 cells, 60 trials, 60 of them to run"),
    ],
)
def test_a_dry_run_says_what_would_run_and_leaves_no_file(line: str, said: str, tmp_path: Path) -> None:
    start_s = time.monotonic()
    done = midnet_bench(*line.split(), "--dry-run", folder=tmp_path)
    assert done.stdout.startswith(said), done.stderr
    assert list(tmp_path.iterdir()) == []
    assert time.monotonic() - start_s < 30


def test_a_folder_of_that_name_does_not_hide_the_campaign_but_a_file_does(tmp_path: Path) -> None:
    (tmp_path / "labyrinth").mkdir()
    assert midnet_bench("run", "labyrinth", "-n", folder=tmp_path).stdout.startswith("25 cells, 500 trials")
    (tmp_path / "labyrinth").rmdir()
    (tmp_path / "labyrinth").write_text("experiment: detection\ngrid: {robots: [1, 2, 3]}\n")
    done = midnet_bench("run", "labyrinth", "-n", folder=tmp_path)
    assert done.stdout.startswith("3 cells, 3 trials")


@pytest.mark.slow
def test_smoke_agrees_with_the_expected_numbers(tmp_path: Path) -> None:
    with unpainted():
        worked("run", "smoke-labyrinth", "-o", "smoke-labyrinth", "-q", folder=tmp_path)
    done = worked("compare", "--exact", "smoke-labyrinth", folder=tmp_path)
    assert done.stdout.startswith("0 differences")
    scores = tmp_path / "smoke-labyrinth" / "trial.csv"
    scores.write_text("".join(scores.read_text().splitlines(keepends=True)[:-1]))
    done = midnet_bench("compare", "--exact", "smoke-labyrinth", folder=tmp_path)
    assert (done.returncode, "trial.csv: 1 rows, golden 2" in done.stdout) == (1, True)


@pytest.mark.slow
def test_a_campaign_of_variants_from_end_to_end(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(
        "experiment: detection\n"
        "variants:\n"
        "  none:\n"
        "  half the beams: {lidar_dropout: 0.5}\n"
        "  slow network: {message_delay_s: 0.4, message_loss: 0.1}\n"
        "grid: {robots: [2]}\n"
        "compare: {measures: [recall, f1_one_to_one]}\n"
        "base_seed: 2001\n"
        "parameters: {engine: fast, frames: 4}\n"
    )
    done = worked("run", "mine.yaml", "-o", "out", folder=tmp_path)
    assert "2 robots, slow network" in done.stdout
    drawn = [tmp_path / "out" / f"differences_by_variant.{ending}" for ending in ("png", "svg")]
    before = [file.read_bytes() for file in drawn]
    worked("report", "out", "--format", "png,svg", "-q", folder=tmp_path)
    assert [file.read_bytes() for file in drawn] == before
    differences = rows(tmp_path / "out" / "differences_by_variant.csv")
    assert len(differences) == 2 * 2
    assert {row["variant"] for row in differences} == {"half the beams", "slow network"}
    wrong = midnet_bench("run", "mine.yaml", "--set", "variant=half", "-n", folder=tmp_path)
    assert "half the beams" in one_line_of_complaint(wrong)
