import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet import detection
from tests.midnet.ascii_maps import binary

# cells of one metre from (0, 0), so that metres are cells
PRIOR = OccupancyGrid(np.full((50, 50), 255, np.uint8), 1.0, (0.0, 0.0))


def bounding_boxes(
    d: np.ndarray, first_cell: tuple[int, int], prior: OccupancyGrid, min_area_cells: int = 1
) -> list[Box]:
    return [Box(*box) for box in detection.bounding_boxes(d, first_cell, prior, min_area_cells).tolist()]


def boxes_of(drawing: str, min_area_cells: int = 1) -> list[Box]:
    d = 255 - binary(drawing)
    return bounding_boxes(d, (0, 0), PRIOR, min_area_cells)


def test_one_cell_is_one_resolution_wide() -> None:
    assert boxes_of(
        """
        ....
        ..#.
        ....
        """
    ) == [Box(2.0, 1.0, 3.0, 2.0)]


def test_box_goes_around_the_whole_of_a_bent_blob() -> None:
    assert boxes_of(
        """
        ......
        .#....
        .#....
        .####.
        ......
        """
    ) == [Box(1.0, 1.0, 5.0, 4.0)]


def test_cells_that_touch_at_a_corner_are_one_blob() -> None:
    assert boxes_of(
        """
        .#..
        ..#.
        """
    ) == [Box(1.0, 0.0, 3.0, 2.0)]


def test_blobs_come_highest_start_first() -> None:
    assert boxes_of(
        """
        ....#
        #....
        ....#
        #....
        """
    ) == [Box(4, 3, 5, 4), Box(0, 2, 1, 3), Box(4, 1, 5, 2), Box(0, 0, 1, 1)]


def test_hole_and_what_is_inside_it_belong_to_the_outer_blob() -> None:
    assert boxes_of(
        """
        #######
        #.....#
        #..#..#
        #.....#
        #######
        """
    ) == [Box(0.0, 0.0, 7.0, 5.0)]


def test_small_blobs_are_dropped_only_when_asked() -> None:
    drawing = """
        #...##
        ....##
        """
    assert len(boxes_of(drawing)) == 2
    assert boxes_of(drawing, min_area_cells=2) == [Box(4.0, 0.0, 6.0, 2.0)]
    assert boxes_of(drawing, min_area_cells=4) == [Box(4.0, 0.0, 6.0, 2.0)]
    assert boxes_of(drawing, min_area_cells=5) == []


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
    assert bounding_boxes(near, (column, row), prior) == bounding_boxes(far, (column + dx, row + dy), prior)


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


@given(
    hnp.arrays(
        np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.sampled_from([0, 255])
    )
)
def test_boxes_are_those_of_the_blobs_that_a_flood_fill_finds(d: np.ndarray) -> None:
    height, width = d.shape
    white = {(int(x), int(y)) for y, x in zip(*np.nonzero(d), strict=True)}
    padded = {(x, y) for x in range(-1, width + 1) for y in range(-1, height + 1)}
    outside = flood({(-1, -1)}, padded - white, diagonal=False)
    expected = []
    left = set(white)
    while left:
        blob = flood({next(iter(left))}, white, diagonal=True)
        left -= blob
        touches_outside = any(
            (x + dx, y) in outside or (x, y + dx) in outside for x, y in blob for dx in (-1, 1)
        )
        if touches_outside:
            xs, ys = [x for x, _ in blob], [y for _, y in blob]
            expected.append(Box(min(xs), min(ys), max(xs) + 1, max(ys) + 1))
    assert sorted(bounding_boxes(d, (0, 0), PRIOR)) == sorted(expected)


def boxes_of_opencv(d: np.ndarray) -> list[Box]:
    """The rectangles around the contours that OpenCV finds, in its order."""
    contours, _ = cv2.findContours(d, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [Box(x, y, x + width, y + height) for x, y, width, height in map(cv2.boundingRect, contours)]


@given(
    hnp.arrays(
        np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, max_side=24), elements=st.sampled_from([0, 255])
    ),
    st.integers(1, 9),
)
def test_boxes_are_those_of_opencvs_contours_in_their_order(d: np.ndarray, least: int) -> None:
    expected = [box for box in boxes_of_opencv(d) if box.area >= least]
    assert bounding_boxes(d, (0, 0), PRIOR, least) == expected


@pytest.mark.parametrize("share", [0.01, 0.1, 0.3, 0.5, 0.6, 0.8, 0.95])
def test_boxes_of_large_noisy_grids_are_opencvs(share: float) -> None:
    noise = np.random.default_rng(5)
    for side in (60, 100):
        d = np.where(noise.random((side, side + 7)) < share, 255, 0).astype(np.uint8)
        assert bounding_boxes(d, (0, 0), PRIOR) == boxes_of_opencv(d)
