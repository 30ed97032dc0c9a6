"""How a map grew, as it is kept and drawn."""

import numpy as np
import pytest

from midnet_bench.drawing.growth import (
    MAP_MARGIN_M,
    Growth,
    MapHistory,
    MapSnapshot,
    draw_map,
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


def snapshot(step: int, yaw: float = 0.0, known_columns: int | None = None) -> MapSnapshot:
    """Two robots drive to the right by 10 cm a step, and the map grows to the right."""
    data = np.full((60, 80), -1, dtype=np.int8)
    data[:, : known_columns if known_columns is not None else 20 * step] = 0
    data[57, :] = 100
    poses = np.array([[0.1 * step, 0.0, yaw], [0.1 * step, 1.0, 0.0]])
    grid = OccupancyGrid(data, 0.05, (-2.0, -1.5))
    believed = poses + np.array([0.0, 0.05, 0.0])
    return MapSnapshot(float(step), 0.25 * step, grid, poses, believed, [None, (1.0, 1.0)], [])


@pytest.fixture
def history() -> MapHistory:
    history = MapHistory()
    for step in range(1, 5):
        history.take(snapshot(step))
    return history


def test_a_history_gives_back_what_it_took(history: MapHistory) -> None:
    assert history.clocks == [1.0, 2.0, 3.0, 4.0]
    for step in range(1, 5):
        kept, taken = history.at(step), snapshot(step)
        np.testing.assert_array_equal(kept.grid.data, taken.grid.data)
        np.testing.assert_array_equal(kept.poses, taken.poses)
        assert kept.goals == taken.goals
        assert kept.known == taken.known
    assert history.known == 1.0


def test_between_two_snapshots_robots_go_straight_and_the_map_stays(history: MapHistory) -> None:
    between = history.at(2.5)
    np.testing.assert_allclose(between.believed[:, :2], [(0.25, 0.05), (0.25, 1.05)])
    np.testing.assert_array_equal(between.grid.data, snapshot(2).grid.data)
    assert [len(path) for path in between.paths] == [3, 3]
    np.testing.assert_allclose(between.paths[1], [(0.1, 1.05), (0.2, 1.05), (0.25, 1.05)])


def test_a_robot_turns_the_short_way_round() -> None:
    history = MapHistory()
    for step, yaw in ((1, 3.0), (2, -3.0)):
        history.take(snapshot(step, yaw))
    assert np.cos(history.at(1.5).poses[0, 2]) == pytest.approx(-1.0)


def test_the_view_shows_the_map_in_every_snapshot() -> None:
    history = MapHistory()
    for origin in ((-5.0, 0.0), (0.0, 0.0), (0.0, 7.0)):
        one = snapshot(1)
        grid = OccupancyGrid(one.grid.data, 0.05, origin)
        history.take(MapSnapshot(1.0, 0.0, grid, one.poses, one.believed, one.goals, []))
    assert history.view() == pytest.approx((-5.25, -0.25, 4.25, 10.25))


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
    shown = MapSnapshot(0.0, 1.0, grid, robot, robot, [None], [robot[:, :2]])
    paint_map(picture, Box(0.0, 0.0, 20.0, 20.0), shown)
    assert np.all(picture[20:100] == 40, axis=2).any(axis=0).sum() >= 10, "one of three cells is shown"
    assert np.all(picture == 255, axis=2).mean() > 0.8


def test_six_snapshots_fill_the_page_of_an_exploration(history: MapHistory) -> None:
    page = Growth(history, "room: explored by 2 Burgers", ROOM).page()
    tile_px = round(480 * 3.5 / 4.5)
    assert page.shape == (44 + 2 * (tile_px + 12 + 26), 3 * 492 + 12, 3)
    tiles = page[70 : 70 + tile_px, 12:492], page[-12 - tile_px : -12, -492:-12]
    known = [1.0 - np.all(tile == 205, axis=2).mean() for tile in tiles]
    assert known[0] < 0.3 < 0.5 < known[1]


def test_a_log_of_few_snapshots_makes_a_smaller_page(history: MapHistory) -> None:
    page = Growth(history, "room.log").page()
    assert page.shape[1] == 3 * 492 + 12
    assert page.shape[0] < 44 + 2 * (492 + 26), "the tiles are as high as the map needs"
    blank = page[-300:-12, 12 + 492 :]
    assert (blank == 255).all(), "four snapshots leave two places empty"


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
    view = Box(0.0, 0.0, 4.0, 3.0).shrunk(-MAP_MARGIN_M)
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
