"""Sections IV.A, IV.B.2 to B.4: binary grids, what is in one alone, and the boxes around it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.errors import InputError
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import binary_map, bounding_boxes, common_occupancy, foreground
from midnet_bench.midnet.midnet_settings import Unknown
from tests.midnet.ascii_maps import binary

SHAPES = hnp.array_shapes(min_dims=2, max_dims=2, max_side=9)
CELLS = st.sampled_from([0, 255])
COSTS = hnp.arrays(np.int8, SHAPES, elements=st.integers(-1, 100))
# cells of one metre from (0, 0), so that metres are cells
PRIOR = OccupancyGrid(np.full((50, 50), 255, np.uint8), 1.0, (0.0, 0.0))


@given(COSTS, st.integers(1, 100), st.sampled_from(["free", "occupied"]))
def test_each_cell_follows_eq_1(costs: np.ndarray, thresh: int, unknown: Unknown) -> None:
    before = costs.copy()
    grid = binary_map(costs, thresh, unknown)
    assert grid.dtype == np.uint8
    for x, e in zip(costs.ravel().tolist(), grid.ravel().tolist(), strict=True):
        assert e == (255 if (unknown == "free" if x == -1 else x < thresh) else 0)
    np.testing.assert_array_equal(costs, before)


def test_unsigned_costs_are_refused_because_unknown_would_be_255() -> None:
    with pytest.raises(InputError, match="costmap: its values are uint8; int8 is needed"):
        binary_map(np.zeros((2, 2), np.uint8), 50)  # type: ignore[arg-type]


@given(SHAPES.flatmap(lambda shape: st.tuples(*[hnp.arrays(np.uint8, shape, elements=CELLS)] * 2)))
def test_eqs_5_and_6_are_occupied_in_a_and_free_in_b(pair: tuple[np.ndarray, np.ndarray]) -> None:
    a, b = pair
    c = common_occupancy(a, b)
    d = foreground(a, c)
    assert c.dtype == d.dtype == np.uint8
    np.testing.assert_array_equal(c, np.where((a == 0) & (b == 0), 0, 255))
    np.testing.assert_array_equal(d, np.where((a == 0) & (b == 255), 255, 0))


BLOBS = {
    "one cell is one resolution wide": (["....", "..#.", "...."], [(2, 1, 3, 2)]),
    "all of a bent blob": (["......", ".#....", ".#....", ".####.", "......"], [(1, 1, 5, 4)]),
    "cells that touch at a corner are one blob": ([".#..", "..#."], [(1, 0, 3, 2)]),
    "blobs come highest start first": (
        ["....#", "#....", "....#", "#...."],
        [(4, 3, 5, 4), (0, 2, 1, 3), (4, 1, 5, 2), (0, 0, 1, 1)],
    ),
    "a hole and what is inside belong to the outer blob": (
        ["#######", "#.....#", "#..#..#", "#.....#", "#######"],
        [(0, 0, 7, 5)],
    ),
}


@pytest.mark.parametrize(("lines", "boxes"), BLOBS.values(), ids=BLOBS.keys())
def test_boxes_of_blobs(lines: list[str], boxes: list[tuple[int, int, int, int]]) -> None:
    found = bounding_boxes(255 - binary("\n".join(lines)), (0, 0), PRIOR)
    assert [tuple(box) for box in found.tolist()] == boxes


@pytest.mark.parametrize(("least", "boxes"), [(1, 2), (2, 1), (4, 1), (5, 0)])
def test_small_blobs_are_dropped_only_when_asked(least: int, boxes: int) -> None:
    found = bounding_boxes(255 - binary("#...##\n....##"), (0, 0), PRIOR, least)
    assert len(found) == boxes


def test_boxes_are_in_metres_from_the_prior_maps_origin() -> None:
    prior = OccupancyGrid(np.full((200, 200), 255, np.uint8), 0.05, (-4.0, -3.0))
    d = np.zeros((10, 10), np.uint8)
    d[2:6, 1:4] = 255
    (box,) = bounding_boxes(d, (20, 40), prior)
    assert box == pytest.approx((-4.0 + 21 * 0.05, -3.0 + 42 * 0.05, -4.0 + 24 * 0.05, -3.0 + 46 * 0.05))


@given(st.integers(0, 90), st.integers(0, 90), st.integers(0, 9), st.integers(0, 9))
def test_same_cells_give_equal_boxes_whichever_crop_they_were_found_in(
    column: int, row: int, dx: int, dy: int
) -> None:
    prior = OccupancyGrid(np.full((200, 200), 255, np.uint8), 0.05, (-4.03, -2.97))
    near, far = np.zeros((15, 15), np.uint8), np.zeros((15, 15), np.uint8)
    near[9:12, 9:13] = 255
    far[9 - dy : 12 - dy, 9 - dx : 13 - dx] = 255
    found = [bounding_boxes(near, (column, row), prior), bounding_boxes(far, (column + dx, row + dy), prior)]
    np.testing.assert_array_equal(*found)


def flood(seeds: set[tuple[int, int]], cells: set[tuple[int, int]], diagonal: bool) -> set[tuple[int, int]]:
    """All of ``cells`` that steps within ``cells`` reach from ``seeds``."""
    reached, front = set(seeds), list(seeds)
    while front:
        x, y = front.pop()
        for dx in (-1, 0, 1):
            for dy in (-1, 0, 1):
                step = (x + dx, y + dy)
                if (diagonal or 0 in (dx, dy)) and step in cells and step not in reached:
                    reached.add(step)
                    front.append(step)
    return reached


@given(hnp.arrays(np.uint8, SHAPES, elements=CELLS))
def test_boxes_are_those_of_the_blobs_that_a_flood_fill_finds(d: np.ndarray) -> None:
    height, width = d.shape
    white = {(int(x), int(y)) for y, x in zip(*np.nonzero(d), strict=True)}
    padded = {(x, y) for x in range(-1, width + 1) for y in range(-1, height + 1)}
    outside = flood({(-1, -1)}, padded - white, diagonal=False)
    expected, left = [], set(white)
    while left:
        blob = flood({next(iter(left))}, white, diagonal=True)
        left -= blob
        if any((x + dx, y) in outside or (x, y + dx) in outside for x, y in blob for dx in (-1, 1)):
            xs, ys = [x for x, _ in blob], [y for _, y in blob]
            expected.append(Box(min(xs), min(ys), max(xs) + 1, max(ys) + 1))
    assert sorted(Box(*box) for box in bounding_boxes(d, (0, 0), PRIOR).tolist()) == sorted(expected)
