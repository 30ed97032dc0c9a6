"""An exploration as it is kept and drawn, on a small room."""

from pathlib import Path

import numpy as np
import pytest

from midnet_bench.drawing.canvas import Canvas
from midnet_bench.drawing.exploration_view import ExplorationRecording, exploration_page, painter_of, percent
from midnet_bench.drawing.growth_view import MapPainter
from midnet_bench.drawing.map_picture import coarsened, known_corners
from midnet_bench.drawing.recording import Moment, Recording
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial, Snapshot
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.workflows.map_files import MapFiles

ROOM = """
name: room
plane_m: [5, 4]
enclosure_m: [4, 3]
wall_thickness_m: 0.15
wall_height_m: 0.5
walls: [[[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5], [-2, -1.5]]]
"""


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> "Taken":
    path = tmp_path_factory.mktemp("room") / "room.yaml"
    path.write_text(ROOM)
    with ExplorationTrial(MappingParameters(arena=str(path), robots=2, time_limit_s=4), 1) as trial:
        recording, snapshots, coverage = ExplorationRecording(trial), [], []
        for snapshot in trial.snapshots():
            coverage.append(recording.take_snapshot(snapshot))
            snapshots.append(snapshot)
        assert coverage == sorted(coverage)
        assert 0.3 < coverage[0] <= coverage[-1] <= 1.0
        return trial, recording, snapshots


Taken = tuple[ExplorationTrial, Recording, list[Snapshot]]


def test_a_recording_gives_back_what_it_took(taken: Taken) -> None:
    _, recording, snapshots = taken
    assert recording.clocks == [snapshot.time_s for snapshot in snapshots]
    for snapshot in snapshots:
        moment = recording.at(snapshot.time_s)
        np.testing.assert_array_equal(moment.grid.data, snapshot.grid.data)
        np.testing.assert_array_equal(moment.poses, snapshot.poses)
        assert moment.goals == snapshot.goals


def test_between_two_snapshots_robots_go_straight(taken: Taken) -> None:
    _, recording, snapshots = taken
    one, two = snapshots[1:3]
    moment = recording.at((one.time_s + two.time_s) / 2.0)
    np.testing.assert_allclose(moment.believed[:, :2], (one.believed + two.believed)[:, :2] / 2.0)
    assert [len(way) for way in moment.ways] == [3, 3]
    np.testing.assert_array_equal(moment.ways[1][0], snapshots[0].believed[1, :2])
    np.testing.assert_array_equal(moment.ways[1][-1], moment.believed[1, :2])


def test_a_robot_turns_the_short_way_round(taken: Taken) -> None:
    grid = taken[2][0].grid
    recording = Recording()
    for yaw, time_s in ((3.0, 1.0), (-3.0, 2.0)):
        poses = np.array([[0.0, 0.0, yaw], [1.0, 0.0, 0.0]])
        recording.take(Moment(time_s, 0.5, grid, poses, poses, [None, None], ways=[]))
    assert np.cos(recording.at(1.5).poses[0, 2]) == pytest.approx(-1.0)


def test_a_picture_shows_what_is_known_white_and_the_rest_grey(taken: Taken) -> None:
    trial, recording, _ = taken
    picture = np.empty((300, 300, 3), dtype=np.uint8)
    painter = painter_of(trial, 300)
    moment = recording.at(recording.clocks[-1])
    painter.paint(picture, moment)

    def at(x: float, y: float) -> list[int]:
        column, row = Canvas(picture, painter.view).pixels([(x, y)])[0].astype(int)
        return picture[row, column].tolist()

    assert at(0.0, 1.2) == [255, 255, 255]
    assert at(0.0, -1.55) == [205, 205, 205]  # inside the wall
    column, row = moment.grid.cell_at(0.0, 1.43)
    assert moment.grid.data[row, column] == 100
    assert at(*moment.grid.center_of(column, row)) == [40, 40, 40]


def test_thin_walls_are_seen_where_a_pixel_shows_many_cells() -> None:
    data = np.zeros((400, 400), dtype=np.int8)
    data[:, ::40] = 100
    robot = np.array([[0.5, 0.5, 0.0]])
    grid = OccupancyGrid(data, 0.05, (0.0, 0.0))
    picture = np.empty((150, 150, 3), dtype=np.uint8)
    painter = MapPainter(Box(0.0, 0.0, 20.0, 20.0), 150, 150)
    painter.paint(picture, Moment(0.0, 1.0, grid, robot, robot, [None], [robot[:, :2]]))
    assert np.all(picture[20:100] == 40, axis=2).any(axis=0).sum() >= 10, "one of three cells is shown"
    assert np.all(picture == 255, axis=2).mean() > 0.8


def test_six_moments_fill_a_page(taken: Taken) -> None:
    trial, recording, _ = taken
    page = exploration_page(trial, recording)
    assert page.shape == (44 + 2 * (492 + 26), 3 * 492 + 12, 3)


def test_nothing_is_called_whole_that_is_not() -> None:
    assert (percent(0.99996), percent(1.0), percent(0.5)) == ("99.9 %", "100.0 %", "50.0 %")


def test_the_known_part_of_a_map_is_what_a_picture_shows() -> None:
    data = np.full((20, 30), -1, dtype=np.int8)
    data[5, 10] = 0
    data[7, 12] = 100
    assert known_corners(OccupancyGrid(data, 0.5, (-1.0, 2.0))) == ((4.0, 4.5), (5.5, 6.0))
    nothing = OccupancyGrid(np.full((2, 4), -1, dtype=np.int8), 0.5, (0.0, 0.0))
    assert known_corners(nothing) == ((0.0, 0.0), (2.0, 1.0))


def test_a_large_map_is_drawn_with_larger_cells() -> None:
    data = np.full((5, 9), -1, dtype=np.int8)
    data[0, 3], data[1, 2], data[4, 8] = 0, 100, 0
    coarse = coarsened(OccupancyGrid(data, 0.5, (1.0, 2.0)), 5)
    assert coarse.data.tolist() == [[-1, 100, -1, -1, -1], [-1] * 5, [-1, -1, -1, -1, 0]]
    assert (coarse.resolution, coarse.origin) == (1.0, (1.0, 2.0))
    assert coarsened(coarse, 5) is coarse


def test_a_folder_gets_plain_names_and_a_named_map_has_its_name_on_all(tmp_path: Path) -> None:
    folder = MapFiles.at(tmp_path / "flat")
    assert (folder.map.name, folder.binary.name, folder.named("robots.csv").name) == (
        "map.yaml",
        "map_binary.yaml",
        "robots.csv",
    )
    beside = MapFiles.at(tmp_path / "new" / "flat.yml")
    assert (tmp_path / "new").is_dir()
    assert [path.relative_to(tmp_path / "new").name for path in (beside.map, beside.binary)] == [
        "flat.yml",
        "flat_binary.yml",
    ]
    assert beside.named("robots.csv") == tmp_path / "new" / "flat_robots.csv"
