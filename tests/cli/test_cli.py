"""The real command line on tiny campaigns, and what it says to wrong input."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command import (
    REPOSITORY,
    in_its_own_process,
    midnet_bench,
    one_line_of_complaint,
    rows,
    unpainted,
    worked,
)

HEADER = "trial,frames,tp,fp,fn,precision,recall,f1"


@pytest.fixture(scope="module")
def detection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("detection")
    with unpainted():
        done = worked("detection", "--frames", 3, "--seeds", 2, "-o", "out", folder=folder)
    assert "paper" in done.stdout
    return folder / "out"


def test_detection_writes_the_papers_table_in_three_forms_and_what_it_was_made_of(detection: Path) -> None:
    lines = (detection / "detection_scores.csv").read_text().splitlines()
    assert lines[0] == HEADER
    assert [line.split(",")[0] for line in lines[1:]] == ["1-robot", "5-robot"]
    assert [line.split(",")[1] for line in lines[1:]] == ["6", "6"]
    assert "| 5-robot |" in (detection / "detection_scores.md").read_text()
    assert r"\begin{tabular}" in (detection / "detection_scores.tex").read_text()
    configuration = json.loads((detection / "configuration.json").read_text())
    assert configuration["parameters"]["frames"] == 3
    assert configuration["parameters"]["thresh_local"] == 99
    (run,) = json.loads((detection / "provenance.json").read_text())
    assert run["libraries"]["pybullet"]
    assert run["seed"] == 1
    assert {row["role"] for row in rows(detection / "robots.csv")} == {"guard", "intruder"}


def test_the_table_pools_what_the_seeds_counted(detection: Path) -> None:
    pooled = {row["trial"]: row for row in rows(detection / "detection_scores.csv")}
    by_seed = rows(detection / "scores_by_seed.csv")
    assert sorted({row["seed"] for row in by_seed}) == ["1", "2"]
    for name, row in pooled.items():
        own = [one for one in by_seed if one["trial"] == name]
        assert int(row["tp"]) == sum(int(one["tp"]) for one in own)
        frames = [one for one in rows(detection / "frames.csv") if one["robots"] == name[0]]
        assert int(row["fp"]) == sum(int(one["fp"]) for one in frames)
        assert len(frames) == 6


def test_results_that_cannot_be_written_are_one_line_and_exit_code_2(detection: Path) -> None:
    folder = detection.parent
    (folder / "file").touch()
    shutil.copytree(detection, folder / "other")
    for place in ("file", "/proc/nowhere"):
        done = midnet_bench("compare", "out", "other", "-o", place, folder=folder)
        assert place in one_line_of_complaint(done)


def test_the_same_command_again_runs_nothing_and_prints_the_same(detection: Path) -> None:
    run = ("detection", "--frames", 3, "--seeds", 2)
    with unpainted():
        done = worked(*run, "--json", "-o", detection, folder=detection.parent)
    told = json.loads(done.stdout)
    assert (told["schema"], told["experiment"]) == (1, "detection")
    assert [row["trial"] for row in told["tables"]["detection_scores"]] == ["1-robot", "5-robot"]
    mean = told["tables"]["detection_summary"][1]["precision"]
    assert (mean["low"], mean["high"], mean["n"]) == (None, None, 2), "two seeds cannot tell"
    assert 0.0 < mean["value"] <= 1.0
    assert len(json.loads((detection / "provenance.json").read_text())) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "code", "complaint"),
    [
        (">/dev/full", 1, "error: the output cannot be written: No space left on device\n"),
        (">&-", 1, "error: standard output is closed; direct it somewhere, such as to /dev/null\n"),
        ("| true; exit ${PIPESTATUS[0]}", 141, ""),
        ("2>&- >/dev/null", 0, ""),
    ],
)
def test_an_output_that_cannot_be_written_is_at_most_one_line(where: str, code: int, complaint: str) -> None:
    # all three print inside the same block
    for command in ("parameters", "--version", *(["parameters --json"] if "|" in where else [])):
        line = f"{sys.executable} -m midnet_bench {command} {where}"
        done = subprocess.run(["bash", "-c", line], cwd=REPOSITORY, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (code, complaint), command


@pytest.mark.slow
def test_a_worker_with_standard_error_closed_gives_the_same_bytes_and_another_seed_gives_others(
    tmp_path: Path,
) -> None:
    run = "detection --frames 2 --robots 1"
    line = f"{sys.executable} -m midnet_bench {run} -o {tmp_path}/worker 2>&-"
    done = subprocess.run(["bash", "-c", line], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert worked(*run.split(), "-o", "here", folder=tmp_path).stdout == done.stdout
    for file in (tmp_path / "worker").glob("*.csv"):
        if file.name != "timing.csv":
            assert file.read_bytes() == (tmp_path / "here" / file.name).read_bytes(), file.name
    worked(*run.split(), "--seed", 7, "-o", "other", folder=tmp_path)
    ways = [{row["distance_m"] for row in rows(tmp_path / at / "robots.csv")} for at in ("here", "other")]
    assert not (ways[0] & ways[1]) - {"0.0"}


@pytest.mark.slow
def test_letters_that_the_output_lacks_cost_no_table() -> None:
    ascii_only = {"PYTHONIOENCODING": "ascii"}
    done = in_its_own_process("parameters", "detection", folder=REPOSITORY, environment=ascii_only)
    assert (done.returncode, done.stderr) == (0, "")
    assert "frames" in done.stdout


@pytest.mark.slow
def test_labyrinth_then_report_power_and_verify(labyrinth_campaign: Path) -> None:
    folder, name = labyrinth_campaign.parent, labyrinth_campaign.name
    with unpainted():
        worked("report", name, folder=folder)
    assert (labyrinth_campaign / "success_rate.csv").exists()
    assert len(rows(labyrinth_campaign / "trial.csv")) == 4
    worked("verify", name, "--robots", "1,2", "--difference", 20, folder=folder)
    verdict = midnet_bench("verify", name, folder=folder)
    assert verdict.returncode in (0, 3, 4), verdict.stderr
    assert "inconclusive" in verdict.stdout


@pytest.mark.slow
def test_labyrinth_goes_on_with_a_store_of_the_same_trials(labyrinth_campaign: Path) -> None:
    run = ("labyrinth", "--robots", "1,2", "--intruders", 1, "--set", "time_limit_s=4")
    with unpainted():
        worked(*run, "--trials", 2, "-o", labyrinth_campaign, folder=labyrinth_campaign.parent)
    assert (labyrinth_campaign / "success_rate.csv").exists()
    assert len(json.loads((labyrinth_campaign / "provenance.json").read_text())) == 1, "nothing was run"


def test_input_that_no_trial_can_use_is_named_at_the_end(tmp_path: Path) -> None:
    grid = ("--robots", 1, "--intruders", 1, "--trials", 1)
    run = ("labyrinth", *grid, "--set", "escape_distance_m=26.5", "-o", "out")
    for _ in range(2):  # the second time from the store
        done = midnet_bench(*run, folder=tmp_path)
        *_, reason, count = done.stderr.splitlines()
        assert done.returncode == 2
        assert reason.startswith("error: arena: no free point is 26.5 m away")
        assert reason.endswith("; lower escape_distance_m (1 trial)")
        assert count == "1 trial could not use the input: see out/failures.csv"
        assert "Traceback" not in done.stderr
    assert len(rows(tmp_path / "out" / "failures.csv")) == 1


def test_one_parameter_is_explained_for_each_experiment_with_the_papers_gap(tmp_path: Path) -> None:
    for name, told in {
        "localization": (
            "localization Which pose is used to crop the map",
            "default: ukf allowed: ukf | ukf+map | truth experiments: detection, labyrinth",
            "source: paper: II.B, robot_localization",
            "The paper leaves open (item 10): which pose the crop uses.",
        ),
        "robots": (
            "Number of security robots. default: 1 allowed: 1 to 20 experiments: detection, labyrinth",
            "Number of exploring robots. default: 1 allowed: 1 to 20 experiments: mapping",
        ),
    }.items():
        text = " ".join(worked("parameters", name, folder=tmp_path).stdout.split())
        assert [one for one in told if one not in text] == []


def test_a_list_of_parameters_has_their_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    done = midnet_bench("parameters", "detection", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "paper: V.A, 1999 frames" in done.stdout
    listed = json.loads(midnet_bench("parameters", "detection", "--json", folder=tmp_path).stdout)
    sources = {one["key"]: one["source"] for one in listed["parameters"]}
    assert sources["local_size_m"] == "turtlebot3: local_costmap_params.yaml, width"
    assert sources["obstacle_range_m"] == "paper: V.A, 2.5 metres"


def test_one_parameter_is_explained_to_programs(tmp_path: Path) -> None:
    told = json.loads(midnet_bench("parameters", "wheel_slip", "--json", folder=tmp_path).stdout)
    assert (told["schema"], told["parameter"]) == (1, "wheel_slip")
    assert {one["experiment"]: one["default"] for one in told["experiments"]} == dict.fromkeys(
        ("detection", "labyrinth", "mapping"), 0.002
    )
    assert told["experiments"][0]["maximum"] == 0.2
    assert told["readings"] == []
