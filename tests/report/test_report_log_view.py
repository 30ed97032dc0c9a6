"""A log's mapping as it is kept and drawn, in a square room."""

from pathlib import Path

import numpy as np
import pytest

from midnet_bench.drawing.log_view import LogRecording, log_page
from midnet_bench.geometry import Pose2D
from midnet_bench.io.scan_logs import LoggedScan, ScanLog, half_circle
from midnet_bench.mapping.log_mapping import MappingResult, map_scans

Mapped = tuple[LogRecording, MappingResult]


@pytest.fixture(scope="module")
def mapped() -> Mapped:
    """A room of 6 m, of which a robot sees the half before it; it turns round once on its place."""
    lidar, scans = half_circle(180), []
    for step in range(9):
        yaw = step * np.pi / 4
        beams = yaw + lidar.angles_rad
        ranges = 3.0 / np.maximum(np.abs(np.cos(beams)), np.abs(np.sin(beams)))
        scans.append(LoggedScan(float(step), Pose2D(0.0, 0.0, yaw), ranges))
    recording = LogRecording()
    return recording, map_scans(ScanLog(Path("room.log"), lidar, scans), 3, 1, look=recording.look)


def test_moments_lead_to_the_map(mapped: Mapped) -> None:
    recording, result = mapped
    assert recording.clocks == list(range(1, 10))
    first, last = recording.at(1), recording.at(9)
    np.testing.assert_array_equal(last.grid.data, result.grid.data)
    assert first.known == pytest.approx(18.0, abs=2.0)
    assert last.known == pytest.approx(36.0, abs=3.0)
    assert len(last.ways[0]) == len(result.trajectory) + 1
    assert last.poses.shape == (0, 3)


def test_the_view_shows_the_map_at_every_moment(mapped: Mapped) -> None:
    recording, _ = mapped
    view = recording.view()
    for clock in recording.clocks:
        x_min, y_min, x_max, y_max = recording.at(clock).grid.extent
        assert view.x_min < x_min < x_max < view.x_max
        assert view.y_min < y_min < y_max < view.y_max


def test_a_page_shows_six_moments(mapped: Mapped) -> None:
    page = log_page(mapped[0], "room.log")
    assert page.shape[1] == 3 * 492 + 12
    tiles = page[70 : 70 + 440, 12:492], page[-450:-12, -492:-12]
    known = [1.0 - np.all(tile == 205, axis=2).mean() for tile in tiles]
    assert known[0] < 0.6 < 0.7 < known[1]
