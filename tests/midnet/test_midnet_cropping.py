import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid, cells_of
from midnet_bench.midnet.detection import (
    EMPTY_CROP,
    crop_to_prior,
    cropping_coordinates,
    robot_cell,
    window_around,
    window_at_origin,
)
from midnet_bench.navigation.costmap import RollingCostmap
from midnet_bench.navigation.navigation_settings import CostmapSettings
from tests.midnet.ascii_maps import characters, side_by_side

# cases a to j of the figure: ``.`` the prior map alone, ``o`` the local grid alone, ``X`` both
CASES = side_by_side(
    """
    .......   ooooooo   ~~.....   .......   .....~~   ~~.....   .....~~   oooo~~~   ~oooo~~   ~~~oooo
    ..XXX..   ooXXXoo   ooXX...   .XXXX..   ...XXoo   ooXX...   ...XXoo   ooXX...   .XXXX..   ...XXoo
    ..XXX..   ooXXXoo   ooXX...   .XXXX..   ...XXoo   ooXX...   ...XXoo   ooXX...   .XXXX..   ...XXoo
    .......   ooooooo   oooo~~~   ~oooo~~   ~~~oooo   ~~.....   .....~~   ~~.....   .......   .....~~
    """
)

LIDAR = LidarGeometry(1, 0.0, 0.01, 0.1, 1.0, Pose2D(0.0, 0.0, 0.0))
SIZES = st.integers(1, 12)
PLACES = st.integers(-20, 20)


def extent(cells: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = np.nonzero(cells)
    return columns.min(), rows.min(), columns.max() + 1, rows.max() + 1


@pytest.mark.parametrize("drawing", CASES, ids="abcdefghij")
def test_crop_of_the_figure(drawing: str) -> None:
    drawn = characters(drawing)
    both = np.array(extent(drawn == "X"))
    prior = np.array(extent((drawn == ".") | (drawn == "X")))
    local = np.array(extent((drawn == "o") | (drawn == "X")))
    x1, y1, x2, y2 = (local - np.tile(prior[:2], 2)).tolist()
    crop = cropping_coordinates((x1, y1, x2, y2), *(prior[2:] - prior[:2]).tolist())
    assert crop == (*(both - np.tile(local[:2], 2)), *(both - np.tile(prior[:2], 2)))
    assert not crop.is_empty


@pytest.mark.parametrize("dx", [-1, 0, 1])
@pytest.mark.parametrize("dy", [-1, 0, 1])
def test_window_wholly_outside_gives_an_empty_crop(dx: int, dy: int) -> None:
    # a 3 x 3 window on a 5 x 5 map: just beside it, and far away
    for gap in (0, 9):
        x1 = {-1: -3 - gap, 0: 1, 1: 5 + gap}[dx]
        y1 = {-1: -3 - gap, 0: 1, 1: 5 + gap}[dy]
        crop = cropping_coordinates((x1, y1, x1 + 3, y1 + 3), 5, 5)
        assert crop.is_empty == ((dx, dy) != (0, 0))
        if crop.is_empty:
            assert crop == EMPTY_CROP
            assert crop.of_local(np.zeros((3, 3), np.uint8)).size == 0
            assert crop.of_prior(np.zeros((5, 5), np.uint8)).size == 0


@given(PLACES, PLACES, SIZES, SIZES, SIZES, SIZES)
def test_crops_are_equal_in_size_lie_in_both_grids_and_pair_the_same_cells(
    x1: int, y1: int, width: int, height: int, prior_width: int, prior_height: int
) -> None:
    local = np.arange(height * width, dtype=np.uint8).reshape(height, width)
    prior = np.arange(prior_height * prior_width, dtype=np.uint8).reshape(prior_height, prior_width)
    crop = cropping_coordinates((x1, y1, x1 + width, y1 + height), prior_width, prior_height)

    assert 0 <= crop.x1_lmap <= crop.x2_lmap <= width
    assert 0 <= crop.y1_lmap <= crop.y2_lmap <= height
    assert 0 <= crop.x1_gmap <= crop.x2_gmap <= prior_width
    assert 0 <= crop.y1_gmap <= crop.y2_gmap <= prior_height
    a, b = crop.of_local(local), crop.of_prior(prior)
    assert a.shape == b.shape

    # cell by cell, without any cropping: which pairs of cells lie on one another
    pairs = [
        (local[row, column], prior[y1 + row, x1 + column])
        for row in range(height)
        for column in range(width)
        if 0 <= x1 + column < prior_width and 0 <= y1 + row < prior_height
    ]
    assert list(zip(a.ravel().tolist(), b.ravel().tolist(), strict=True)) == pairs


def blank(width: int, height: int, resolution: float, origin: tuple[float, float]) -> OccupancyGrid:
    return OccupancyGrid(np.zeros((height, width), np.int8), resolution, origin)


@pytest.mark.parametrize(
    ("x", "y", "cell"),
    [(-4.0, -3.0, (0, 0)), (-3.51, -2.51, (0, 0)), (-3.5, -2.5, (1, 1)), (-4.01, 0.0, (-1, 6))],
)
def test_robot_cell_is_the_floor_of_eq_4(x: float, y: float, cell: tuple[int, int]) -> None:
    prior = blank(10, 10, 0.5, (-4.0, -3.0))
    assert robot_cell(Pose2D(x, y, 1.0), prior) == cell


NEAT_ORIGINS = [(0.0, 0.0), (-10.0, -10.0), (-4.35, 2.15), (0.025, -0.01), (448262.25, 5411932.5)]


@pytest.mark.parametrize("resolution", [0.05, 0.1, 0.025, 0.2, 1.0 / 30.0])
@pytest.mark.parametrize("origin", NEAT_ORIGINS)
def test_a_pose_on_an_edge_is_on_the_upper_cell_for_all_that_ask(
    resolution: float, origin: tuple[float, float]
) -> None:
    prior = blank(8, 6, resolution, origin)
    cells = np.arange(-400, 400)
    # as a person writes them: in millimetres, where the grid is
    points = np.stack([np.round(start + cells * resolution, 9) for start in origin], axis=1)
    settings = CostmapSettings(resolution=resolution, size_m=2.0, centered=True)
    half = round(2.0 / resolution) // 2
    for cell, (x, y), found in zip(cells.tolist(), points.tolist(), cells_of(prior, points), strict=True):
        pose = Pose2D(x, y, 0.0)
        assert robot_cell(pose, prior) == prior.cell_at(x, y) == tuple(found) == (cell, cell)
        window = RollingCostmap(settings, origin)
        window.update(pose, np.full(LIDAR.beams, np.nan), LIDAR, 0.0)
        assert (window.column, window.row) == (cell - half, cell - half)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_a_pose_has_one_cell_for_all_that_ask(x: float, y: float) -> None:
    prior = blank(8, 6, 0.05, (-4.0, -3.0))
    found = tuple(cells_of(prior, np.array([[x, y]]))[0])
    assert robot_cell(Pose2D(x, y, 0.0), prior) == prior.cell_at(x, y) == found


def test_window_of_even_and_odd_size() -> None:
    assert window_around((10, 20), 4, 6) == (8, 17, 12, 23)
    assert window_around((10, 20), 5, 7) == (8, 17, 13, 24)
    assert window_around((0, 0), 1, 1) == (0, 0, 1, 1)


@pytest.mark.parametrize(("shift", "cell"), [(0.0, 2), (0.024, 2), (-0.024, 2), (0.026, 3), (-0.026, 1)])
def test_window_by_the_costmaps_own_origin_goes_to_the_nearest_cell(shift: float, cell: int) -> None:
    prior = blank(40, 40, 0.05, (-1.0, -1.0))
    costmap = blank(6, 4, 0.05, (-0.9 + shift, -0.9 + shift))
    assert window_at_origin(costmap, prior) == (cell, cell, cell + 6, cell + 4)


def test_alignments_differ_when_the_rolling_window_lags_behind_the_robot() -> None:
    prior = blank(40, 40, 0.05, (-1.0, -1.0))
    pose = Pose2D(0.026, 0.026, 0.0)  # cell (20, 20)
    lagging = blank(10, 10, 0.05, (-0.2, -0.25))  # begins at cell (16, 15)
    assert crop_to_prior(lagging, prior, pose, "floor")[4:] == (15, 15, 25, 25)
    assert crop_to_prior(lagging, prior, pose, "origin")[4:] == (16, 15, 26, 25)


def test_costmap_of_another_resolution_is_refused() -> None:
    prior = blank(40, 40, 0.05, (0.0, 0.0))
    with pytest.raises(
        InputError, match=r"costmap: resolution 0\.025 m differs from the prior map's 0\.05 m"
    ):
        crop_to_prior(blank(10, 10, 0.025, (0.0, 0.0)), prior, Pose2D(1.0, 1.0, 0.0))


def test_resolution_as_a_ros_message_rounds_it_is_accepted() -> None:
    prior = blank(40, 40, 0.05, (0.0, 0.0))
    single = float(np.float32(0.05))
    assert single != 0.05
    assert not crop_to_prior(blank(10, 10, single, (0.0, 0.0)), prior, Pose2D(1.0, 1.0, 0.0)).is_empty
