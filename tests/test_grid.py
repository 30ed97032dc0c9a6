import cv2
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from midnet_bench.grid import (
    MapWindow,
    OccupancyGrid,
    as_written,
    cell_centers,
    cells_to_unset,
    connected_to,
    same_resolution,
)

WALLED = np.array(
    [[character == "." for character in line] for line in ("..#.", "..#.", "##..", "...#")], dtype=np.bool_
)
"""Row 0 first; two rooms that touch at corners only."""


def test_a_grid_prints_its_place_and_not_its_cells() -> None:
    grid = OccupancyGrid(np.zeros((200, 300), dtype=np.int8), 0.05, (-4.0, 2.5))
    assert repr(grid) == "OccupancyGrid(300 x 200 cells of 0.05 m, int8, origin (-4, 2.5))"


def test_centers_are_those_of_the_cells() -> None:
    grid = OccupancyGrid(np.zeros((2, 3), dtype=np.int8), 0.5, (-1.0, 4.0))
    assert grid.x_centers.tolist() == [-0.75, -0.25, 0.25]
    assert grid.y_centers.tolist() == [4.25, 4.75]
    cells = np.array([[False, False, True], [True, False, False]])
    assert cell_centers(grid, cells).tolist() == [[0.25, 4.25], [-0.75, 4.75]]
    for column, row in ((2, 0), (0, 1)):
        assert grid.center_of(column, row) == (grid.x_centers[column], grid.y_centers[row])


def test_cells_are_connected_by_steps_in_x_and_y_and_not_over_corners() -> None:
    found = connected_to(0, 0, WALLED)
    assert found.tolist() == [[True, True, False, False]] * 2 + [[False] * 4] * 2
    assert connected_to(3, 1, WALLED).tolist() == (WALLED & ~found).tolist()


@pytest.mark.parametrize(("column", "row"), [(2, 0), (-1, 0), (0, 4), (4, 0)])
def test_nothing_is_connected_to_a_cell_that_is_not_set_or_off_the_grid(column: int, row: int) -> None:
    assert not connected_to(column, row, WALLED).any()


def test_a_window_holds_its_rectangle_in_whole_cells() -> None:
    window = MapWindow.around_origin(8.0, 6.15, 0.05).empty()
    assert (window.width, window.height, window.origin) == (160, 124, (-4.0, pytest.approx(-3.1)))
    assert (window.data == -1).all()


def test_a_window_cuts_what_reaches_beyond_it_and_pads_what_does_not_fill_it() -> None:
    window = MapWindow(column=-1, row=0, width=4, height=2, resolution_m=0.5)
    rows = [[100, 100, 100], [-1, 100, 100], [100, 0, 100]]
    cut = window.cut(OccupancyGrid(np.array(rows[::-1], dtype=np.int8), 0.5, (0.5, -0.5)))
    assert cut.origin == (-0.5, 0.0)
    assert cut.data.tolist() == [[-1, -1, -1, 100], [-1, -1, 100, 100]]
    far = OccupancyGrid(np.array([[100]], dtype=np.int8), 0.5, (9.0, 9.0))
    assert (window.cut(far).data == -1).all()


@pytest.mark.parametrize("cell_m", [0.01, 0.02, 0.025, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0, 0.033333, 0.0125])
def test_a_resolution_that_went_through_32_bits_is_the_one_that_was_written(cell_m: float) -> None:
    message = float(np.float32(cell_m))
    assert as_written(message) == as_written(float(f"{message:.9g}")) == as_written(cell_m) == cell_m
    assert as_written(0.0333334567) == 0.0333334567
    assert as_written(1.0 / 30.0) == 1.0 / 30.0


@pytest.mark.parametrize("cell_m", [0.01, 0.02, 0.025, 1.0 / 30.0, 0.05, 1.0 / 15.0, 0.1, 0.2, 0.5])
def test_resolutions_are_the_same_whatever_files_and_messages_round(cell_m: float) -> None:
    for other in (float(np.float32(cell_m)), round(cell_m, 6), float(np.float32(round(cell_m, 6)))):
        assert same_resolution(cell_m, other)
        assert same_resolution(other, cell_m)
        grid = OccupancyGrid(np.zeros((2, 3), dtype=np.int8), other, (-1.0, 4.0)).at_resolution(cell_m)
        assert (grid.resolution, grid.data.shape, grid.origin) == (cell_m, (2, 3), (-1.0, 4.0))
    for other in (cell_m * 1.001, cell_m / 1.001, cell_m + 0.001):
        assert not same_resolution(cell_m, other)
        with pytest.raises(ValueError, match="are not of"):
            OccupancyGrid(np.zeros((2, 3), dtype=np.int8), other, (-1.0, 4.0)).at_resolution(cell_m)


def test_distances_are_the_exact_ones_however_many_threads_opencv_has():
    cells = np.random.default_rng(1).random((420, 430)) > 0.004
    exact = distance_transform_edt(cells).astype(np.float32)
    before = cv2.getNumThreads()
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            assert (cells_to_unset(cells) == exact).all()
    finally:
        cv2.setNumThreads(before)


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0), (1, 1), (1, 20), (20, 1)])
def test_grids_of_one_row_or_column_and_of_no_cells(shape: tuple[int, int]) -> None:
    for share in (0.3, 1.0):
        cells = np.random.default_rng(1).random(shape) < share
        found = cells_to_unset(cells)
        assert found.shape == connected_to(0, 0, cells).shape == shape
        if not cells.all():
            assert (found == distance_transform_edt(cells).astype(np.float32)).all()
