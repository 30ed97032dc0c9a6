"""`midnet-bench map` on a tiny arena, a tiny log, and wrong input."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from midnet_bench.io.map_server import load_map
from tests.cli.command import midnet_bench, one_line_of_complaint, rows, worked

ROOM = {
    "name": "two small rooms",
    "plane_m": [5.0, 4.0],
    "enclosure_m": [4.0, 3.0],
    "wall_thickness_m": 0.15,
    "wall_height_m": 0.5,
    "walls": [
        [[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5], [-2, -1.5]],
        [[0.8, -1.5], [0.8, 0.3]],
    ],
    "robots": {"center_m": [-0.6, 0], "spacing_m": 0.6},
}


def write_arena(folder: Path, **changes: object) -> Path:
    path = folder / "rooms.yaml"
    path.write_text(yaml.safe_dump({**ROOM, **changes}))
    return path


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("explored")
    write_arena(folder)
    done = worked("map", "rooms.yaml", "--robots", 2, "--no-clip", "-o", "out", folder=folder)
    assert "explored" in done.stderr.splitlines()[-1]
    assert "two small rooms" in done.stdout
    named = {Path(line).name for line in done.stdout.splitlines() if line.startswith("out/")}
    assert named == {path.name for path in (folder / "out").iterdir()} - {"map.pgm", "map_binary.pgm"}
    return folder / "out"


@pytest.mark.slow
def test_an_explored_map_is_the_arena(explored: Path) -> None:
    grid = load_map(explored / "map.yaml")
    assert set(np.unique(grid.data).tolist()) == {-1, 0, 100}
    column, row = grid.cell_at(1.4, -1.0)  # behind the inner wall
    assert grid.data[row, column] == 0
    (score,) = rows(explored / "scores.csv")
    assert float(score["coverage"]) > 0.98
    assert float(score["occupied_precision"]) > 0.9
    assert (explored / "map.yaml").read_text().startswith("# two small rooms, seed 1: explored by 2 Burgers")


@pytest.mark.slow
def test_an_exploration_leaves_scores_robots_configuration_and_provenance(explored: Path) -> None:
    assert "|twosmallrooms|2|1|" in (explored / "scores.md").read_text().replace(" ", "")
    assert [row["robot"] for row in rows(explored / "robots.csv")] == ["explorer 1", "explorer 2"]
    configuration = json.loads((explored / "configuration.json").read_text())
    assert configuration["seed"] == 1
    assert configuration["parameters"]["particles"] == 30
    (run,) = json.loads((explored / "provenance.json").read_text())
    assert run["ended_utc"] >= run["started_utc"]
    assert run["libraries"]["pybullet"]


@pytest.mark.slow
def test_an_exploration_is_drawn(explored: Path) -> None:
    final = cv2.imread(str(explored / "map.png"))
    assert final is not None


@pytest.mark.slow
def test_an_exploration_is_filmed_and_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    write_arena(tmp_path)
    run = ("map", "rooms.yaml", "--robots", 2, "--set", "time_limit_s=3")
    worked(*run, "-o", "filmed", folder=tmp_path)
    folder = tmp_path / "filmed"
    film = cv2.VideoCapture(str(folder / "map.mp4"))
    (score,) = rows(folder / "scores.csv")
    assert (
        film.get(cv2.CAP_PROP_FRAME_COUNT) == 1 + round(float(score["time_s"])) + 20
    )  # the start, and the end

    told = json.loads(worked(*run, "--no-clip", "--json", "-o", "again.yaml", folder=tmp_path).stdout)
    assert told["tables"]["scores"][0]["robots"] == 2
    assert told["tables"]["scores"][0]["merge_confidence"] is None
    assert "again.png" in told["files"]
    assert not (tmp_path / "again.mp4").exists()
    pairs = {"map.pgm": "again.pgm", "map.png": "again.png"}
    pairs |= {name: f"again_{name}" for name in ("scores.csv", "robots.csv", "configuration.json")}
    for one, other in pairs.items():
        assert (folder / one).read_bytes() == (tmp_path / other).read_bytes(), one


@pytest.mark.slow
def test_a_campaigns_trial_is_the_exploration_of_that_seed(explored: Path) -> None:
    folder = explored.parent
    teams = "experiment: mapping\ngrid: {robots: [2]}\ntrials: 1\nparameters: {arena: rooms.yaml}\n"
    (folder / "teams.yaml").write_text(teams)
    assert "Best maps" in worked("run", "teams.yaml", "-o", "teams", folder=folder).stdout
    (team,), (alone,) = rows(folder / "teams" / "maps.csv"), rows(explored / "scores.csv")
    for name in ("coverage", "wall_error_m", "time_s", "distance_m"):
        assert team[name] == alone[name]


@pytest.mark.slow
def test_guards_take_an_explored_map(explored: Path) -> None:
    run = ("detection", "--engine", "fast", "--arena", "rooms.yaml", "--frames", 2, "-o", "detection")
    worked(*run, "--map", "out/map.yaml", folder=explored.parent)


def test_an_arena_of_ones_own_has_no_explored_map_yet(tmp_path: Path) -> None:
    write_arena(tmp_path)
    run = ("detection", "--arena", "rooms.yaml", "--frames", 5, "--set", "prior_map=explored")
    complaint = one_line_of_complaint(midnet_bench(*run, folder=tmp_path))
    assert "midnet-bench map" in complaint
    assert "--map" in complaint


def test_an_exploration_that_runs_out_of_time_says_so(tmp_path: Path) -> None:
    write_arena(tmp_path)
    run = ("map", "rooms.yaml", "--no-clip", "--set", "time_limit_s=2")
    done = worked(*run, folder=tmp_path)
    assert any(line.startswith("warning: ") and "time limit" in line for line in done.stderr.splitlines())
    (score,) = rows(tmp_path / "results" / "map-rooms" / "scores.csv")
    assert score["finished"] == "False"
    assert load_map(tmp_path / "results" / "map-rooms" / "map.yaml").data.max() == 100


def test_a_room_without_a_door_is_left_out_with_a_warning(tmp_path: Path) -> None:
    closed = [ROOM["walls"][0], [[0.8, -1.5], [0.8, 1.5]]]
    write_arena(tmp_path, walls=closed)
    done = worked("map", "rooms.yaml", "--no-clip", "-o", "out", folder=tmp_path)
    assert any(line.startswith("warning: no robot can enter") for line in done.stderr.splitlines())
    grid = load_map(tmp_path / "out" / "map.yaml")
    column, row = grid.cell_at(1.4, 0.0)
    assert grid.data[row, column] == -1
    (score,) = rows(tmp_path / "out" / "scores.csv")
    assert float(score["coverage"]) > 0.98


@pytest.mark.slow
def test_the_exact_map_is_a_pair_that_detection_takes(tmp_path: Path) -> None:
    worked("map", "--exact", "map1", "-o", "m.yaml", folder=tmp_path)
    assert set(load_map(tmp_path / "m.yaml").data.ravel().tolist()) == {0, 100}
    assert (load_map(tmp_path / "m_binary.yaml").data == 100).sum() > (
        load_map(tmp_path / "m.yaml").data == 100
    ).sum()
    run = ("detection", "--engine", "fast", "--frames", 5, "--robots", 1)
    worked(*run, "--map", "m.yaml", "-o", "mapped", folder=tmp_path)
    worked(*run, "--set", "prior_map=exact", "-o", "exact", folder=tmp_path)
    scores = [(tmp_path / out / "scores.csv").read_bytes() for out in ("mapped", "exact")]
    assert scores[0] == scores[1]


def square_room_log(path: Path, first_range: str = "") -> None:
    """A robot in a square room of 6 m that drives half a metre between scans."""
    lines = []
    for step in range(8):
        x = 0.5 * step - 2.0
        ranges = []
        for beam in range(180):
            angle = math.radians(beam - 90.0)
            along = (3.0 - x) / math.cos(angle) if abs(math.cos(angle)) > 1e-9 else math.inf
            across = 3.0 / abs(math.sin(angle)) if abs(math.sin(angle)) > 1e-9 else math.inf
            ranges.append(f"{min(along, across):.3f}")
        ranges[0] = first_range or ranges[0]
        place = f"{x} 0 0 {x} 0 0 {step} host {step}"
        lines.append(f"FLASER 180 {' '.join(ranges)} {place}")
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.slow
def test_a_recorded_log_becomes_a_map_a_trajectory_and_a_picture(tmp_path: Path) -> None:
    square_room_log(tmp_path / "run.log")
    run = ("map", "--from-log", "run.log", "--particles", 5)
    worked(*run, "-o", "out", folder=tmp_path)
    grid = load_map(tmp_path / "out" / "map.yaml")
    assert (grid.data == 100).sum() > 100
    assert (grid.data == 0).sum() > 5000
    binary = load_map(tmp_path / "out" / "map_binary.yaml")
    assert binary.data[grid.data == 100].min() == 100
    assert set(np.unique(binary.data).tolist()) == {0, 100}
    assert len(np.loadtxt(tmp_path / "out" / "trajectory.tum")) >= 4
    assert cv2.imread(str(tmp_path / "out" / "map.png")) is not None
    film = cv2.VideoCapture(str(tmp_path / "out" / "map.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 8 + 20, "each scan, and two seconds of the last"
    configuration = json.loads((tmp_path / "out" / "configuration.json").read_text())
    assert configuration["gmapping"]["particles"] == 5
    worked(*run, "--no-clip", "-o", "again.yaml", folder=tmp_path)
    assert not (tmp_path / "again.mp4").exists()
    for one, other in (("map.pgm", "again.pgm"), ("trajectory.tum", "again_trajectory.tum")):
        assert (tmp_path / "out" / one).read_bytes() == (tmp_path / other).read_bytes()


@pytest.mark.slow
def test_a_log_is_mapped_by_graph_slam_unless_gmapping_is_asked_for(tmp_path: Path) -> None:
    square_room_log(tmp_path / "run.log")
    used = {}
    slams: dict[str, tuple[str, ...]] = {"default": (), "graph": ("--slam", "graph")}
    for name, arguments in {**slams, "old": ("--slam", "gmapping")}.items():
        worked("map", "--from-log", "run.log", "--no-clip", *arguments, "-o", name, folder=tmp_path)
        used[name] = json.loads((tmp_path / name / "configuration.json").read_text())
        assert len(np.loadtxt(tmp_path / name / "trajectory.tum")) >= 4
    assert used["default"] == used["graph"]
    assert used["graph"]["graph_slam"]["running_scans"] == 20
    assert len(used["graph"]["graph_slam"]) == 24
    assert "gmapping" not in used["graph"]
    assert used["old"]["gmapping"]["particles"] == 30


def test_ranges_that_say_nothing_are_left_out_with_a_warning(tmp_path: Path) -> None:
    square_room_log(tmp_path / "run.log", first_range="nan")
    run = ("map", "--from-log", "run.log", "--particles", 2, "--no-clip")
    done = worked(*run, "--json", folder=tmp_path)
    warning = "run.log: 8 of 1440 ranges are NaN or infinite and were left out"
    assert done.stderr.splitlines()[-1] == f"warning: {warning}"
    told = json.loads(done.stdout)
    assert told["warnings"] == [warning]
    assert all((tmp_path / file).exists() for file in told["files"])
    assert (tmp_path / "results" / "map-run" / "map.yaml").exists()


@pytest.fixture
def complaint(tmp_path: Path) -> Callable[..., str]:
    """What ``midnet-bench map`` says to wrong input."""

    def complain(*arguments: object) -> str:
        done = midnet_bench("map", *arguments, folder=tmp_path)
        assert done.stdout == ""
        return one_line_of_complaint(done)

    return complain


@pytest.mark.slow
def test_a_bad_log_is_refused_before_the_slow_rooms_are_loaded(tmp_path: Path) -> None:
    (tmp_path / "run.log").write_text("nothing\n")
    command = [sys.executable, "-X", "importtime", "-m", "midnet_bench", "map", "--from-log", "run.log"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "numpy" in done.stderr
    assert not any(f"| {room}" in done.stderr.replace("  ", "") for room in ("numba", "matplotlib"))


@pytest.mark.slow
def test_maps_of_two_runs_do_not_mix(tmp_path: Path, complaint: Callable[..., str]) -> None:
    for name in ("run.2020.log", "run.2021.log"):
        square_room_log(tmp_path / name)
        run = ("map", "--from-log", name, "--particles", 1, "--no-clip")
        worked(*run, folder=tmp_path)
    made = tmp_path / "results" / "map-run.2020"
    assert sorted(path.name for path in (tmp_path / "results").iterdir()) == [made.name, "map-run.2021"]
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    again = ("--from-log", "run.2020.log", "--particles", 1, "--no-clip", "-o", made)
    assert "another run" in complaint(*again, "--seed", 2)
    assert "another run" in complaint("map1", "--exact", "-o", made)
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before
    worked("map", *again, folder=tmp_path)  # the same run once more
    (made / "configuration.json").unlink()
    assert "another run" in complaint(*again), "nobody knows whose map that is"


def test_an_arenas_exact_map_goes_beside_its_explored_one(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    write_arena(tmp_path / "a")
    done = worked("map", "a/rooms.yaml", "--exact", "--json", folder=tmp_path)
    told = json.loads(done.stdout)
    folder = Path("results/map-rooms-exact")
    assert told["files"] == [
        str(folder / name) for name in ("map.yaml", "map_binary.yaml", "configuration.json")
    ]
    grid = load_map(tmp_path / folder / "map.yaml")
    assert (told["cells"], told["resolution_m"]) == ([grid.width, grid.height], 0.05)
