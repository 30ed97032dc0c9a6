"""A recorded log becomes a map."""

import math
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D
from midnet_bench.grid import cell_centers, values_at
from midnet_bench.io.scan_logs import ScanLog, half_circle, read_scan_log
from midnet_bench.mapping.gmapping import GMapping
from midnet_bench.mapping.log_mapping import MappingResult, collapse, map_scans
from tests.mapping.gmapping_room import ROOM, ROUND_TRIP, drive


def written(tmp_path: Path, *lines: str) -> Path:
    path = tmp_path / "some.log"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_log_whose_ranges_say_nothing_where_the_robot_moved(tmp_path: Path) -> None:
    lines = ["0 0 0 0 3 0 0 90", "1 0 0 0 3 0 0 90", "2 0 0 0 3 1 2 90"]
    with pytest.raises(InputError, match="no range of the scans after which the robot moved"):
        map_scans(read_scan_log(written(tmp_path, *lines)), particles=1)


@pytest.mark.slow
def test_a_log_becomes_a_map_and_the_same_seed_the_same_bytes(tmp_path: Path) -> None:
    lidar = half_circle(180)
    journey = drive(ROOM, lidar, Pose2D(1.0, 1.0, 0.0), ROUND_TRIP[:3], np.random.default_rng(5))
    lines = []
    for k in range(0, len(journey.stamps_s), 2):
        ranges = " ".join(f"{r:.2f}" for r in journey.ranges_m[k])
        x, y, yaw = journey.odometry[k]
        lines.append(f"{journey.stamps_s[k]:.6f} {x} {y} {yaw} 180 {ranges}")
    lines[5] = " ".join([*lines[5].split()[:-1], "nan"])
    path, seen = written(tmp_path, *lines), []
    log = read_scan_log(path)
    result = map_scans(log, particles=4, seed=3, progress=lambda done, total: seen.append((done, total)))
    looks: list[tuple[int, int]] = []

    def look(done: int, slam: GMapping) -> None:
        looks.append((done, np.count_nonzero(slam.occupancy().data >= 0)))

    again = map_scans(read_scan_log(path), particles=4, seed=3, look=look)

    assert (looks[0][0], looks[-1][0]) == (1, len(lines))
    assert looks[0][1] < looks[-1][1] == np.count_nonzero(result.grid.data >= 0)
    assert seen == [(k, len(lines)) for k in range(1, len(lines) + 1)]
    assert result.scans == len(lines)
    assert 20 < len(result.trajectory) < len(lines)
    assert result.warnings == [
        f"{path}: 1 of {180 * len(lines)} ranges are NaN or infinite and were left out"
    ]
    assert result.grid.data.tobytes() == again.grid.data.tobytes()
    assert result.trajectory.poses.tobytes() == again.trajectory.poses.tobytes()
    last = int(np.searchsorted(journey.stamps_s, result.trajectory.stamps_s[-1] - 1e-6))
    end = result.trajectory.pose(len(result.trajectory) - 1)
    assert (
        end.distance_to(journey.truth[last]) < 0.1 < journey.odometry[last].distance_to(journey.truth[last])
    )
    column, row = result.grid.cell_at(0.001, 3.0)
    assert (result.grid.data[row - 5 : row + 5, max(column - 2, 0) : column + 3] == 100).any(
        axis=1
    ).mean() > 0.7


def test_the_first_scan_that_does_not_fit_is_named(tmp_path: Path) -> None:
    lines = [f"{k} {0.5 * k} 0 {0.5 if k > 2 else 0} 3 1 2 3" for k in range(5)]
    log = read_scan_log(written(tmp_path, *lines))
    numbers = [1, 2, 4, 5]
    assert collapse(log, numbers, [math.nan, 0.8, 0.8 * 0.46, 0.8]) == []
    assert collapse(log, [1], [math.nan]) == []
    (said,) = collapse(log, numbers, [math.nan, 0.84, 0.31, 0.9])
    assert said == (
        "scan 4: heading changed by 29 degrees and the place by 0.50 m, score 0.31, median 0.84: "
        "the map may be broken from there on"
    )
    assert ", and 1 later scans like it: " in str(collapse(log, [*numbers, 5], [0.9, 0.84, 0.31, 0.2, 0.9]))


@pytest.mark.parametrize("turned_deg", [0, 60, 180])
def test_a_heading_that_jumps_is_told_with_its_scan(turned_deg: int, tmp_path: Path) -> None:
    lidar = half_circle(90)
    journey = drive(ROOM, lidar, Pose2D(1.0, 1.0, 0.0), ROUND_TRIP[:2], np.random.default_rng(5))
    lines = []
    turn = Pose2D(0.0, 0.0, math.radians(turned_deg))
    for k in range(0, len(journey.stamps_s), 5):
        at = journey.odometry[k]
        if k >= 60:
            at = journey.odometry[60].compose(turn).compose(at.relative_to(journey.odometry[60]))
        ranges = " ".join(f"{r:.2f}" for r in journey.ranges_m[k])
        lines.append(f"{journey.stamps_s[k]:.6f} {at.x} {at.y} {at.yaw} 90 {ranges}")
    log = read_scan_log(written(tmp_path, *lines))
    warnings = map_scans(replace(log, path=Path("run.log")), particles=5, seed=1).warnings
    if turned_deg == 0:
        assert warnings == []
    else:
        (warning,) = warnings
        assert warning.startswith("run.log: scan 13: heading changed by ")


def drive_log(tmp_path: Path, x: float, y: float) -> ScanLog:
    """Of one drive in a room, with odometry in a frame whose origin lies (-x, -y) m off the room's."""
    lidar = half_circle(90)
    journey = drive(ROOM, lidar, Pose2D(1.0, 1.0, 0.0), ROUND_TRIP[:2], np.random.default_rng(5))
    lines = []
    for k in range(0, len(journey.stamps_s), 5):
        ranges, at = " ".join(f"{r:.2f}" for r in journey.ranges_m[k]), journey.odometry[k]
        lines.append(f"{journey.stamps_s[k]:.6f} {at.x + x} {at.y + y} {at.yaw} 90 {ranges}")
    return read_scan_log(written(tmp_path, *lines))


@pytest.mark.parametrize("particles", [5, None])
def test_a_log_far_from_its_origin_gives_the_same_map_there_for_no_more_memory(
    particles: int | None, tmp_path: Path
) -> None:
    def made(x: float, y: float) -> tuple[MappingResult, int]:
        log = drive_log(tmp_path, x, y)
        tracemalloc.start()
        try:
            result = map_scans(log, particles, seed=1)
            return result, tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    made(0.0, 0.0)  # loads what is compiled
    near, near_bytes = made(0.0, 0.0)
    for x, y in ((448262.25, 5411932.5), (-1500.0, 0.0)):
        far, far_bytes = made(x, y)
        assert far_bytes < 1.5 * near_bytes + 1e6
        shift = far.trajectory.poses - near.trajectory.poses
        np.testing.assert_allclose(shift, np.broadcast_to((x, y, 0.0), shift.shape), atol=0.02)
        cells = np.rint((np.array(far.grid.origin) - near.grid.origin - (x, y)) / 0.05).astype(int)
        assert np.abs(cells).max() <= 1
        walls = far.grid.data == 100
        walls_there = values_at(
            cv2.dilate((near.grid.data == 100).astype(np.uint8), np.ones((3, 3), np.uint8)),
            near.grid,
            cell_centers(far.grid, walls) - (x, y),
            outside=0,
        )
        assert walls_there.mean() > 0.99
        assert np.count_nonzero(walls) == pytest.approx(np.count_nonzero(near.grid.data == 100), rel=0.02)
