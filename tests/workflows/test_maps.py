"""Maps as files: explored, and of a recorded log, which needs no simulator."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.drawing.map_pictures import MapHistory
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.geometry import Pose2D
from midnet_bench.io.map_server import load_map
from midnet_bench.io.scan_logs import LoggedScan, ScanLog, half_circle
from midnet_bench.mapping.log_mapping import MappingResult, map_scans
from midnet_bench.workflows.maps import MapFiles, explore, log_snapshot, write_trajectory

SIDE_M = 6.0
TURNS = 9


def room_log(path: Path) -> ScanLog:
    """A square room, of which a robot sees the half before it; it turns round once on its place."""
    lidar, scans = half_circle(180), []
    for step in range(TURNS):
        yaw = step * np.pi / 4
        beams = yaw + lidar.angles_rad
        ranges = SIDE_M / 2.0 / np.maximum(np.abs(np.cos(beams)), np.abs(np.sin(beams)))
        scans.append(LoggedScan(float(step), Pose2D(0.0, 0.0, yaw), ranges))
    return ScanLog(path, lidar, scans)


def carmen_text(log: ScanLog) -> str:
    """The log as CARMEN writes it."""
    lines = []
    for scan in log.scans:
        ranges = " ".join(f"{range_m:.3f}" for range_m in scan.ranges_m.tolist())
        x, y, yaw = scan.odometry
        place = f"{x} {y} {yaw} {x} {y} {yaw} {scan.stamp_s} host {scan.stamp_s}"
        lines.append(f"FLASER {len(scan.ranges_m)} {ranges} {place}")
    return "\n".join(lines) + "\n"


@pytest.mark.slow
def test_map_from_log_needs_no_pybullet(tmp_path: Path) -> None:
    (tmp_path / "room.log").write_text(carmen_text(room_log(tmp_path / "room.log")))
    code = """
import sys
sys.modules["pybullet"] = None
from midnet_bench.cli import main
sys.argv = ["midnet-bench", "map", "--from-log", "room.log", "--particles", "2", "--no-clip", "-o", "made"]
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    made = {path.name for path in (tmp_path / "made").iterdir()}
    assert {"map.yaml", "map_binary.yaml", "map.png", "trajectory.tum"} <= made
    grid = load_map(tmp_path / "made" / "map.yaml")
    assert np.count_nonzero(grid.data >= 0) * grid.resolution**2 == pytest.approx(SIDE_M**2, abs=3.0)


@pytest.fixture(scope="module")
def mapped() -> tuple[MapHistory, MappingResult]:
    history = MapHistory()
    result = map_scans(
        room_log(Path("room.log")),
        3,
        1,
        look=lambda done, slam: history.take(log_snapshot(done, slam)),
    )
    return history, result


def test_snapshots_lead_to_the_map(mapped: tuple[MapHistory, MappingResult]) -> None:
    history, result = mapped
    snapshots = list(history.snapshots(2 * TURNS))
    assert [int(one.caption.split()[0]) for one in snapshots] == list(range(1, TURNS + 1))
    first, last = snapshots[0], snapshots[-1]
    np.testing.assert_array_equal(last.grid.data, result.grid.data)
    known_m2 = [int(one.caption.split()[2]) for one in (first, last)]
    assert known_m2 == pytest.approx([SIDE_M**2 / 2.0, SIDE_M**2], abs=3.0)
    assert len(last.paths[0]) == len(result.trajectory)
    view = history.view()
    for one in snapshots:
        x_min, y_min, x_max, y_max = one.grid.extent
        assert view.x_min <= x_min < x_max <= view.x_max
        assert view.y_min <= y_min < y_max <= view.y_max


@pytest.mark.parametrize(("stamp_s", "what"), [(3.0, "stands still"), (-1.0, "runs backwards")])
def test_a_clock_that_is_wrong_gives_a_numbered_trajectory(stamp_s: float, what: str, tmp_path: Path) -> None:
    log = room_log(Path("room.log"))
    log.scans[4:] = [scan._replace(stamp_s=stamp_s) for scan in log.scans[4:]]
    path = tmp_path / "trajectory.tum"
    (warning,) = write_trajectory(map_scans(log, 1, 1), log.path, path)
    assert (
        warning
        == f"room.log: scan 5: the clock {what}; trajectory.tum has the numbers of scans in place of stamps"
    )
    assert np.loadtxt(path)[:, 0].tolist() == list(range(1, TURNS + 1))


ROOM = """
name: room
plane_m: [5, 4]
enclosure_m: [4, 3]
wall_thickness_m: 0.15
wall_height_m: 0.5
walls: [[[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5], [-2, -1.5]]]
"""


def test_progress_is_the_share_of_what_can_be_known(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    parameters = MappingParameters(arena=str(tmp_path / "room.yaml"), robots=2, time_limit_s=2)
    told: list[tuple[float, float]] = []
    made = explore(parameters, 1, tmp_path / "made", clip=False, progress=lambda *of: told.append(of))
    times_s, known = zip(*told, strict=True)
    assert times_s == pytest.approx([1.0, 2.0, 2.0])
    assert list(known) == sorted(known)
    assert 0.3 < known[0] <= known[-1] <= 1.0
    assert made.scores is not None
    assert known[-1] == pytest.approx(made.scores.rows[0]["coverage"], abs=0.02)
    np.testing.assert_array_equal(load_map(made.files[0]).data, made.grid.data)


@pytest.mark.parametrize(
    ("output", "names"),
    [
        ("flat", ("map.yaml", "map_binary.yaml", "robots.csv")),
        ("new/flat.yml", ("flat.yml", "flat_binary.yml", "flat_robots.csv")),
    ],
)
def test_a_folder_gets_plain_names_and_a_named_map_has_its_name_on_all(
    output: str, names: tuple[str, ...], tmp_path: Path
) -> None:
    files = MapFiles.at(tmp_path / output, {})
    assert files.map.parent.is_dir()
    assert (files.map.name, files.binary.name, files.named("robots.csv").name) == names
