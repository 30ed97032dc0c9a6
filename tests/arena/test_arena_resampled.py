"""Maps in cells of another size: occupied wins over unknown, unknown over free, and no wall gets lost."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from midnet_bench.arena.prior_maps import resampled
from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid

VALUES = st.sampled_from([-1, 0, 100])
MAPS = arrays(
    np.int8, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.sampled_from([-1, 0, 100])
)
SIZES = st.sampled_from([0.02, 0.025, 0.03, 0.05, 0.07, 0.1, 0.13])


def expected(grid: OccupancyGrid, row: int, column: int, side_m: float) -> int:
    """What a cell must be, from the areas of all cells that it shares some with."""
    low, left, old = row * side_m, column * side_m, grid.resolution
    met = set()
    for r in range(grid.height):
        for c in range(grid.width):
            high = min(low + side_m, (r + 1) * old) - max(low, r * old)
            wide = min(left + side_m, (c + 1) * old) - max(left, c * old)
            if high > 1e-7 and wide > 1e-7:
                met.add(int(grid.data[r, c]))
    beyond = low + side_m > grid.height * old + 1e-7 or left + side_m > grid.width * old + 1e-7
    return 100 if 100 in met else -1 if -1 in met or beyond else 0


@given(data=MAPS, old=SIZES, new=SIZES)
def test_each_cell_is_what_it_shares_area_with(data: np.ndarray, old: float, new: float) -> None:
    grid = OccupancyGrid(data, old, (-3.0, 1.5))
    made = resampled(grid, new)
    assert (made.resolution, made.origin, made.data.dtype) == (new, grid.origin, np.int8)
    assert made.data.shape == tuple(math.ceil(cells * old / new - 1e-6) for cells in data.shape)
    wanted = [
        [expected(grid, row, column, new) for column in range(made.width)] for row in range(made.height)
    ]
    assert made.data.tolist() == wanted


@given(data=MAPS, old=SIZES, new=SIZES)
def test_no_wall_gets_lost_on_the_way_there_and_back(data: np.ndarray, old: float, new: float) -> None:
    grid = OccupancyGrid(data, old, (0.0, 0.0))
    back = resampled(resampled(grid, new), old)
    kept = back.data[: grid.height, : grid.width]
    assert (kept[data == 100] == 100).all()
    assert (kept[data == -1] != 0).all()


def test_costs_between_free_and_occupied_take_the_greatest() -> None:
    grid = OccupancyGrid(np.array([[0, 30], [64, 0], [65, -1]], np.int8), 0.05, (0.0, 0.0))
    assert resampled(grid, 0.1).data.tolist() == [[64], [100]]
    assert resampled(grid, 0.05) is grid


def test_a_map_of_too_many_cells_is_refused() -> None:
    grid = OccupancyGrid(np.zeros((1000, 1000), np.int8), 0.2, (0.0, 0.0))
    with pytest.raises(InputError, match=r"resolution_m: 0\.02 m makes 10000 x 10000 cells"):
        resampled(grid, 0.02)


@pytest.mark.parametrize(
    ("written", "new"), [(0.05000000074505806, 0.05), (0.033333, 1.0 / 30.0), (1.0 / 30.0, 0.033333)]
)
def test_a_resolution_that_was_rounded_changes_no_cell(written: float, new: float) -> None:
    cells = np.random.default_rng(1).choice(np.array([-1, 0, 50, 100], np.int8), size=(300, 400))
    made = resampled(OccupancyGrid(cells, written, (-3.0, 1.0)), new)
    assert made.resolution == new
    assert (made.data == cells).all()
