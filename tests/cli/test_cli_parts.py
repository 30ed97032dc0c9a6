"""Parts of one's own on the command line, from a file outside the package."""

import contextlib
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from tests.cli.command import REPOSITORY, midnet_bench, one_line_of_complaint, rows, unpainted, worked
from tests.simulation.scenes import OWN_ENGINE, OWN_ROBOT

MINE = '''
import numpy as np

class Returns:
    """A box around each return that is far from every wall of the map."""
    def __init__(self, prior_map, range_m, away_m=0.3):
        rows, columns = np.nonzero(prior_map.data == 100)
        self.walls = np.column_stack([prior_map.x_centers[columns], prior_map.y_centers[rows]])
        self.range_m, self.away_m = range_m, away_m
    def detect(self, team):
        return [self.boxes(robot.scan) for robot in team]
    def boxes(self, scan):
        if scan is None:
            return []
        points = scan.returns(self.range_m)[1]
        gaps = np.linalg.norm(points[:, None] - self.walls, axis=2).min(axis=1, initial=np.inf)
        return [(x - 0.05, y - 0.05, x + 0.05, y + 0.05) for x, y in points[gaps > self.away_m]]

class Largest:
    def fuse(self, found, time_s):
        every = np.concatenate(found)
        areas = (every[:, 2:] - every[:, :2]).prod(axis=1)
        return every[np.argsort(areas, kind="stable")[-1:]]

class Failing:
    def __init__(self, prior_map, range_m):
        pass
    def detect(self, team):
        raise RuntimeError("the lens is dirty")

class First:
    """Every guard goes after the target that was there first."""
    def __init__(self, prior_map, rng, guards=9):
        self.guards = guards
    def pursue(self, team, targets, time_s):
        return dict.fromkeys(range(min(self.guards, len(team))), min(targets))

class Lost(First):
    def pursue(self, team, targets, time_s):
        return {len(team): min(targets)}
'''
METRIC = """
class Boxes:
    def __init__(self, factor=1.0):
        self.factor = factor
    def frame(self, seen):
        return {"boxes": self.factor * len(seen.boxes)}
"""


OWN_NAMES = (
    "stub.py:World",
    "robot.py:ROBOT",
    "mine.py:Returns(away_m=0.4)",
    "mine.py:Largest",
    "counts.py:Boxes",
)
OWN = (
    *("detection", "--frames", "5", "--robots", "2", "--seeds", "3", "-q", "--metric", "ospa"),
    *("--engine", "stub.py:World", "--robot-model", "robot.py:ROBOT", "--metric", "counts.py:Boxes"),
    *("--detector", "mine.py:Returns(away_m=0.4)", "--fusion", "mine.py:Largest"),
)


def write_parts(folder: Path) -> None:
    (folder / "mine.py").write_text(MINE)
    (folder / "counts.py").write_text(METRIC)
    (folder / "stub.py").write_text(OWN_ENGINE)
    (folder / "robot.py").write_text(OWN_ROBOT)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_parts(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a campaign in which each part is of one's own."""
    place = tmp_path_factory.mktemp("parts")
    write_parts(place)
    with unpainted():
        worked(*OWN, "-o", "whole", folder=place)
    return place / "whole"


@pytest.mark.slow
def test_a_campaign_with_parts_of_ones_own_says_which_they_were(whole: Path) -> None:
    said = (whole / "configuration.json").read_text()
    for name in OWN_NAMES:
        assert f"{name}#" in said
    scores = rows(whole / "scores.csv")
    assert [row["frames"] for row in scores] == ["5", "5", "5"]
    assert all(float(row["recall"]) > 0.1 and float(row["precision"]) > 0.5 for row in scores)
    assert sum(float(row["distance_m"]) for row in rows(whole / "robots.csv")) > 0.5


@pytest.mark.slow
def test_a_campaign_does_not_go_on_with_a_part_that_has_changed(whole: Path, folder: Path) -> None:
    shutil.copytree(whole, folder / "whole")
    (folder / "mine.py").write_text(MINE + "# changed")
    complaint = one_line_of_complaint(midnet_bench(*OWN, "-o", "whole", folder=folder))
    assert "detector mine.py:Returns(away_m=0.4)#" in complaint
    assert (folder / "whole" / "scores.csv").read_bytes() == (whole / "scores.csv").read_bytes()


FAILING = {
    "engine": (
        "grid: {engine: [stub.py:World, 'lost.py:World(slip=0.1)']}",
        "lost.py:World(slip=0.1)#",
        "poses: a number of a robot that is there is not finite",
    ),
    "detector": (
        "grid: {detector: [midnet, mine.py:Failing]}",
        "mine.py:Failing#",
        "RuntimeError: the lens is dirty",
    ),
}
"""extension point -> a grid with a plug-in that fails, its name, and why"""


@pytest.mark.slow
@pytest.mark.parametrize("point", FAILING)
def test_one_that_fails_costs_its_own_trials_and_is_named(point: str, folder: Path) -> None:
    grid, name, reason = FAILING[point]
    stub = (folder / "stub.py").read_text()
    (folder / "lost.py").write_text(stub.replace("return self.states", "return self.states * float('nan')"))
    parameters = "{engine: fast, frames: 2, robots: 1}" if point != "engine" else "{frames: 2, robots: 1}"
    (folder / "two.yaml").write_text(f"experiment: detection\ntrials: 1\nparameters: {parameters}\n{grid}\n")
    done = midnet_bench("run", "two.yaml", "-o", "out", folder=folder)
    assert done.returncode == 1
    assert len(rows(folder / "out" / "scores.csv")) == 1
    (failure,) = rows(folder / "out" / "failures.csv")
    assert f"{point} {name}" in str(failure)
    assert reason in str(failure)


@pytest.mark.slow
def test_parts_stand_in_a_campaign_s_grid(folder: Path) -> None:
    (folder / "both.yaml").write_text(
        "experiment: detection\ntrials: 1\nparameters: {engine: fast, frames: 4, robots: 2}\n"
        "grid:\n  detector: [midnet, mine.py:Returns]\n"
        "  fusion: [paper, components(iou=0.2), mine.py:Largest]\n"
    )
    with unpainted():
        worked("run", "both.yaml", "-o", "out", folder=folder)
    table = rows(folder / "out" / "scores.csv")
    assert len(table) == 6
    fusions = {row["fusion"].partition("#")[0] for row in table}
    assert fusions == {"paper", "components(iou=0.2)", "mine.py:Largest"}


@pytest.mark.slow
def test_metrics_of_ones_own_stand_in_a_grid_and_are_reported(folder: Path) -> None:
    (folder / "measured.yaml").write_text(
        "experiment: detection\ntrials: 2\nparameters: {engine: fast, frames: 4, robots: 2}\n"
        "grid:\n  metrics: [none, counts.py:Boxes; ospa, counts.py:Boxes(factor=2)]\n"
    )
    with unpainted():
        worked("run", "measured.yaml", "-o", "out", folder=folder)
    boxes: dict[tuple[str, str], float] = {
        (row["metrics"], row["seed"]): float(row["value"])
        for row in rows(folder / "out" / "metrics.csv")
        if row["metric"] == "boxes"
    }
    found = {
        row["seed"]: (int(row["tp"]) + int(row["fp"])) / 4
        for row in rows(folder / "out" / "scores.csv")
        if row["metrics"] == "none"
    }
    assert len(boxes) == 4
    for (metrics, seed), value in boxes.items():
        assert value == found[seed] * (2.0 if "factor=2" in metrics else 1.0)
    summary = rows(folder / "out" / "metrics_summary.csv")
    assert {row["metric"] for row in summary} == {"boxes", "ospa_m"}
    assert all(row["value_n"] == "2" for row in summary)


@pytest.mark.slow
def test_a_pursuit_of_ones_own_stands_in_a_grid_and_one_that_fails_costs_its_own_trials(folder: Path) -> None:
    (folder / "chase.yaml").write_text(
        "experiment: labyrinth\ntrials: 1\nbase_seed: 3001\n"
        "parameters: {engine: fast, arena: map1, escape_distance_m: 2, time_limit_s: 5,\n"
        "             robots: 3, intruders: 3}\n"
        "grid: {pursuit: [nearest, assignment, mine.py:First(guards=2), mine.py:Lost]}\n"
    )
    with unpainted():
        done = midnet_bench("run", "chase.yaml", "-o", "out", folder=folder)
    assert done.returncode == 1
    table = rows(folder / "out" / "trial.csv")
    assert [row["pursuit"].partition("#")[0] for row in table] == [
        "nearest",
        "assignment",
        "mine.py:First(guards=2)",
    ]
    (failure,) = rows(folder / "out" / "failures.csv")
    assert "pursuit mine.py:Lost#" in str(failure)
    assert "pursue gave a guard 3; there are 0 to 2" in str(failure)


@pytest.mark.parametrize(
    ("command", "option", "value", "says"),
    [
        ("detection", "--set", "metrics=opsa", "unknown name 'opsa'; did you mean 'ospa'?"),
        ("detection", "--metric", "mine.py:Largest", "expected a class with a method 'frame'"),
        ("labyrinth", "--pursuit", "nearst", "unknown name 'nearst'; did you mean 'nearest'?"),
        ("labyrinth", "--pursuit", "oracle(x=1)", "'oracle' goes by keys"),
        ("labyrinth", "--pursuit", "mine.py:First(guard=1)", "no option 'guard'; did you mean 'guards'?"),
        ("detection", "--detector", "mine.py:Retruns", "no 'Retruns' in mine.py; did you mean 'Returns'?"),
        ("detection", "--detector", "mine.py:Largest", "expected a class with a method 'detect'"),
        ("detection", "--fusion", "compnents", "unknown name 'compnents'; did you mean 'components'?"),
        ("detection", "--engine", "stub.py:Wrold", "no 'Wrold' in stub.py; did you mean 'World'?"),
        ("detection", "--engine", "fast(slip=1)", "'fast' goes by keys"),
    ],
)
def test_a_part_that_is_not_there_is_one_line(
    folder: Path, command: str, option: str, value: str, says: str
) -> None:
    complaint = one_line_of_complaint(midnet_bench(command, option, value, folder=folder))
    assert f"{option.removeprefix('--')}: " in complaint or option in ("--metric", "--set")
    assert says in complaint


def stored_trials(directory: Path) -> int:
    """How many trials a campaign that is under way has finished."""
    if not list(directory.glob("campaign.sqlite*")):
        return 0
    with contextlib.closing(sqlite3.connect(directory / "campaign.sqlite")) as store:
        try:
            return int(store.execute("SELECT count(*) FROM trials").fetchone()[0])
        except sqlite3.OperationalError:  # the campaign is just making its tables
            return 0


@pytest.mark.slow
def test_a_campaign_with_parts_of_ones_own_goes_on_after_kill_9(whole: Path, folder: Path) -> None:
    command = [sys.executable, "-m", "midnet_bench", *OWN, "--jobs", "1", "-o", "killed"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    process = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True)
    deadline_s = time.monotonic() + 120
    while not stored_trials(folder / "killed"):
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()

    with unpainted():
        worked(*OWN, "-o", "killed", folder=folder)
    for table in ("scores.csv", "frames.csv", "metrics.csv"):
        assert (folder / "killed" / table).read_bytes() == (whole / table).read_bytes()


@pytest.mark.slow
def test_a_campaign_runs_on_the_engine_asked_for_and_goes_on_there_alone(tmp_path: Path) -> None:
    small = ["detection", "--robots", "1", "--frames", "2", "-o", "out", "-q"]
    worked(*small, "--engine", "fast", folder=tmp_path)
    assert load_results(tmp_path / "out").definition.parameters["engine"] == "fast"
    other = midnet_bench(*small, folder=tmp_path)
    assert other.returncode == 2
    assert "engine fast -> bullet" in other.stderr
