"""A map, and how it grew, as they are kept and drawn."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.drawing.map_pictures import (
    MARGIN_M,
    MapHistory,
    MapSnapshot,
    draw_map,
    film_map,
    known_corners,
    paint_map,
    percent,
)
from midnet_bench.drawing.painter import Canvas
from midnet_bench.drawing.palette import GUARD, INTRUDER
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.drawing.stills import plot_area
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid

ROOM = FloorPlan("room, seed 1", Box(-2.0, -1.5, 2.0, 1.5), [], [])


def snapshot(step: int) -> MapSnapshot:
    """Two robots drive to the right by 10 cm a step, and the map grows to the right."""
    data = np.full((60, 80), -1, dtype=np.int8)
    data[:, : 20 * step] = 0
    data[57, :] = 100
    believed = np.array([[0.1 * step, 0.05, 0.0], [0.1 * step, 1.05, 0.0]])
    grid = OccupancyGrid(data, 0.05, (-2.0, -1.5))
    return MapSnapshot(f"{step} s: {25 * step} % explored", grid, believed, [None, (1.0, 1.0)], [])


@pytest.fixture
def history() -> MapHistory:
    history = MapHistory()
    for step in range(1, 5):
        history.take(snapshot(step))
    return history


def test_a_history_gives_back_what_it_took(history: MapHistory) -> None:
    for step, kept in enumerate(history.snapshots(9), start=1):
        taken = snapshot(step)
        np.testing.assert_array_equal(kept.grid.data, taken.grid.data)
        assert (kept.caption, kept.goals) == (taken.caption, taken.goals)
        np.testing.assert_allclose(kept.paths[1], [(0.1 * k, 1.05) for k in range(1, step + 1)])
    assert [one.caption[:3] for one in history.snapshots(2)] == ["1 s", "4 s"]


def test_the_view_shows_the_map_in_every_snapshot() -> None:
    history = MapHistory()
    for origin in ((-5.0, 0.0), (0.0, 0.0), (0.0, 7.0)):
        one = snapshot(1)
        grid = OccupancyGrid(one.grid.data, 0.05, origin)
        history.take(MapSnapshot("", grid, one.believed, one.goals, []))
    assert history.view() == pytest.approx((-5.0, 0.0, 4.0, 10.0))


def test_a_picture_shows_free_white_walls_dark_and_the_rest_grey() -> None:
    picture = np.empty((300, 300, 3), dtype=np.uint8)
    view = ROOM.view(0.25)
    paint_map(picture, view, snapshot(2))

    def at(x: float, y: float) -> list[int]:
        column, row = Canvas(picture, view).pixels([(x, y)])[0].astype(int)
        return picture[row, column].tolist()

    assert at(-1.0, 0.0) == [255, 255, 255]
    assert at(1.0, 0.0) == [205, 205, 205]
    assert at(-1.0, 1.375) == [40, 40, 40]
    assert at(1.0, 1.0) not in ([255, 255, 255], [205, 205, 205]), "no goal is drawn"


def test_thin_walls_are_seen_where_a_pixel_shows_many_cells() -> None:
    data = np.zeros((400, 400), dtype=np.int8)
    data[:, ::40] = 100
    robot = np.array([[0.5, 0.5, 0.0]])
    grid = OccupancyGrid(data, 0.05, (0.0, 0.0))
    picture = np.empty((150, 150, 3), dtype=np.uint8)
    shown = MapSnapshot("", grid, robot, [None], [robot[:, :2]])
    paint_map(picture, Box(0.0, 0.0, 20.0, 20.0), shown)
    assert np.all(picture[20:100] == 40, axis=2).any(axis=0).sum() >= 10, "one of three cells is shown"
    assert np.all(picture == 255, axis=2).mean() > 0.8


def test_a_film_shows_the_map_s_picture_as_it_grew(history: MapHistory, tmp_path: Path) -> None:
    film_map(tmp_path / "map.mp4", history, "room: explored by 2 Burgers")
    film, pictures = cv2.VideoCapture(str(tmp_path / "map.mp4")), []
    while (read := film.read())[0]:
        pictures.append(read[1])
    assert len(pictures) == 4 + 20, "each snapshot, and two seconds of the last"
    rows, columns = plot_area(history.view().shrunk(-MARGIN_M), 2)
    grey = [(np.abs(one[rows, columns].astype(int) - 205).max(axis=2) < 6).mean() for one in pictures]
    assert grey[0] > grey[1] + 0.1 > grey[2] + 0.2 > grey[3] + 0.3
    assert grey[3] == pytest.approx(grey[-1], abs=0.01)


def test_nothing_is_called_complete_that_is_not() -> None:
    assert (percent(0.99996), percent(1.0), percent(0.5)) == ("99.9 %", "100.0 %", "50.0 %")


def test_a_map_shows_walls_path_and_truth() -> None:
    data = np.zeros((60, 80), dtype=np.int8)
    data[:, 0] = 100
    data[40:, 40:] = -1
    grid = OccupancyGrid(data, 0.05, (0.0, 0.0))
    path = np.array([(1.0, 1.0), (1.0, 2.0)])
    wall = np.array([(3.5, 0.5), (3.6, 0.5), (3.6, 1.5), (3.5, 1.5)])
    page = draw_map(grid, [path], "a map", [wall])
    view = Box(0.0, 0.0, 4.0, 3.0).shrunk(-MARGIN_M)
    rows, columns = plot_area(view, 1)
    canvas = Canvas(page[rows, columns], view)

    def near(x: float, y: float) -> list[list[int]]:
        row, column = np.floor(canvas.pixels((x, y))).astype(int)[::-1].tolist()
        around = canvas.picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3)
        return [[int(value) for value in color] for color in around]

    assert [40, 40, 40] in near(0.025, 1.0)
    assert near(2.0, 0.5) == [[255, 255, 255]] * 9
    assert near(3.0, 2.5) == [[205, 205, 205]] * 9
    assert list(GUARD) in near(1.0, 1.5)
    assert min(abs(red - INTRUDER[0]) + abs(blue - INTRUDER[2]) for red, _, blue in near(3.5, 1.0)) < 100


def test_the_known_part_of_a_map_is_what_a_picture_shows() -> None:
    data = np.full((20, 30), -1, dtype=np.int8)
    data[5, 10] = 0
    data[7, 12] = 100
    assert known_corners(OccupancyGrid(data, 0.5, (-1.0, 2.0))).tolist() == [[4.0, 4.5], [5.5, 6.0]]
    nothing = OccupancyGrid(np.full((2, 4), -1, dtype=np.int8), 0.5, (0.0, 0.0))
    assert known_corners(nothing).tolist() == [[0.0, 0.0], [2.0, 1.0]]
