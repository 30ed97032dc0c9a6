"""What ``make smoke`` runs, and which numbers differ from the golden ones too much, here and elsewhere."""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import load_campaign
from midnet_bench.errors import InputError
from midnet_bench.workflows.verify import PLATFORM, compare_exactly, differences_from_golden, update_golden

REPOSITORY = Path(__file__).parents[2]
GOLDEN = REPOSITORY / "results" / "reference" / "smoke"
TABLES = {"smoke-detection": ("robots", "scores"), "smoke-labyrinth": ("intruders", "robots", "trial")}


@pytest.fixture(params=sorted(TABLES))
def golden(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy of the committed numbers, as if they had been made here."""
    committed = GOLDEN / request.param
    update_golden(committed, tmp_path / request.param, TABLES[request.param])
    return tmp_path / request.param


def from_elsewhere(golden: Path) -> None:
    platform = json.loads((golden / PLATFORM).read_text())
    (golden / PLATFORM).write_text(json.dumps({**platform, "processor": "another"}))


def run_with(golden: Path, table: str, column: str, value: object, row: int = 0) -> Path:
    """A run whose numbers are the golden ones but for one cell."""
    run = golden.parent / "run"
    shutil.copytree(golden, run)
    with (run / f"{table}.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    rows[row][column] = str(value)
    with (run / f"{table}.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return run


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(TABLES))
def test_the_trials_give_the_golden_numbers(name: str, tmp_path: Path) -> None:
    """Whatever changes a rule of a trial changes a number here."""
    pytest.importorskip("pybullet", reason="the golden numbers are PyBullet's")
    for command in (["run", name, "--fresh", "-q", "-o", name], ["compare", "--exact", name]):
        line = [sys.executable, "-m", "midnet_bench", *command]
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_the_golden_numbers_agree_with_themselves_on_any_platform(golden: Path) -> None:
    tables = TABLES[golden.name]
    assert differences_from_golden(golden, golden, tables) == (True, [])
    from_elsewhere(golden)
    assert differences_from_golden(golden, golden, tables) == (False, [])


@pytest.mark.parametrize("golden", ["smoke-detection"], indirect=True)
def test_on_the_same_platform_the_last_digit_counts(golden: Path) -> None:
    run = run_with(golden, "scores", "recall", 0.5850622406639006)
    (line,) = differences_from_golden(run, golden, ("scores",))[1]
    assert line.startswith("scores.csv: row 1: recall 0.58506224066390")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("golden", "table", "column", "row", "near", "far"),
    [
        ("smoke-detection", "scores", "recall", 0, 0.73, 0.72),
        ("smoke-detection", "scores", "precision", 0, 0.91, 0.89),
        ("smoke-detection", "scores", "tp", 0, 526, 527),
        ("smoke-detection", "scores", "fp", 0, 20, 21),
        ("smoke-detection", "scores", "fp", 1, 45, 46),
        ("smoke-detection", "scores", "fn", 1, 99, 100),
        ("smoke-detection", "scores", "intruders_in_range", 0, 579, 580),
        ("smoke-detection", "robots", "distance_m", 0, 5.0, 2.0),
        ("smoke-detection", "robots", "pose_error_m", 0, 0.1, 0.2),
        ("smoke-labyrinth", "trial", "caught", 1, 2, 3),
        ("smoke-labyrinth", "trial", "success_rate", 0, 50.0, 100.0),
        ("smoke-labyrinth", "trial", "detected", 0, 1, 2),
        ("smoke-labyrinth", "intruders", "straight_m", 0, 15.3659526226005, 15.4),
    ],
    indirect=["golden"],
)
def test_elsewhere_a_number_may_lie_off_by_so_much(
    golden: Path, table: str, column: str, row: int, near: float, far: float
) -> None:
    from_elsewhere(golden)
    run = run_with(golden, table, column, near, row)
    assert differences_from_golden(run, golden, (table,)) == (False, [])
    shutil.rmtree(run)
    run = run_with(golden, table, column, far, row)
    (line,) = differences_from_golden(run, golden, (table,))[1]
    assert line.startswith(f"{table}.csv: row {row + 1}: {column} {far}, golden ")


@pytest.mark.parametrize(
    ("golden", "table", "column", "value"),
    [
        ("smoke-detection", "scores", "frames", 149),
        ("smoke-detection", "scores", "seed", 2),
        ("smoke-detection", "scores", "recall", ""),
        ("smoke-detection", "robots", "walls_crossed", 1),
        ("smoke-detection", "robots", "role", "intruder"),
        ("smoke-labyrinth", "trial", "robots", 3),
    ],
    indirect=["golden"],
)
def test_what_no_platform_may_change_is_the_same_everywhere(
    golden: Path, table: str, column: str, value: object
) -> None:
    from_elsewhere(golden)
    run = run_with(golden, table, column, value)
    assert len(differences_from_golden(run, golden, (table,))[1]) == 1


@pytest.mark.parametrize("golden", ["smoke-labyrinth"], indirect=True)
def test_a_missing_row_is_a_difference(golden: Path) -> None:
    from_elsewhere(golden)
    run = run_with(golden, "trial", "caught", 0)
    lines = (run / "trial.csv").read_text().splitlines(keepends=True)
    (run / "trial.csv").write_text("".join(lines[:-1]))
    assert differences_from_golden(run, golden, ("trial",))[1] == ["trial.csv: 1 rows, golden 2"]


def test_the_smoke_campaigns_are_those_of_the_golden_numbers() -> None:
    for name in TABLES:
        campaign = load_campaign(REPOSITORY / "campaigns" / f"{name}.yaml")
        with (GOLDEN / name / "robots.csv").open(newline="") as file:
            cells = {tuple(row[key] for key in campaign.grid) for row in csv.DictReader(file)}
        grid = 1
        for values in campaign.grid.values():
            grid *= len(values)
        assert len(cells) == grid


def test_two_campaigns_are_compared_value_by_value(tmp_path: Path) -> None:
    """Without a platform's file every byte counts, of all tables but the times that trials took."""
    golden = GOLDEN / "smoke-labyrinth"
    for name in ("one", "other"):
        shutil.copytree(golden, tmp_path / name)
        (tmp_path / name / PLATFORM).unlink()
        (tmp_path / name / "configuration.json").write_text("{}")
        (tmp_path / name / "timing.csv").write_text(f"wall_s\n{name}\n")
    assert compare_exactly(tmp_path / "one", tmp_path / "other") == ([], "compared to the byte")
    trial = tmp_path / "other" / "trial.csv"
    trial.write_text(trial.read_text().replace("1", "2"))
    lines, _ = compare_exactly(tmp_path / "one", tmp_path / "other")
    assert lines
    assert all(line.startswith("one: trial.csv: row ") for line in lines)
    trial.unlink()
    (tmp_path / "one" / "trial.csv").rename(trial)
    with pytest.raises(InputError, match=r"trial\.csv: no such table"):
        compare_exactly(tmp_path / "one", tmp_path / "other")


def test_numbers_that_are_not_there_are_named_and_replace_none(tmp_path: Path) -> None:
    (tmp_path / "golden").mkdir()
    with pytest.raises(InputError, match="scores"):
        update_golden(tmp_path, tmp_path / "golden", ("scores",))
    assert not list((tmp_path / "golden").iterdir())
    with pytest.raises(InputError, match="--update"):
        differences_from_golden(tmp_path, tmp_path / "golden", ("scores",))
