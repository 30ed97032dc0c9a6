import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from midnet_bench.errors import InputError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation import navigation_settings as footprint
from midnet_bench.navigation.costmap import (
    PUBLISHED,
    inflate,
    inflation_costs,
    published,
    reach_cells,
    static_costs,
    static_layer,
)
from midnet_bench.navigation.navigation_settings import BURGER_COSTMAP, CostmapSettings
from midnet_bench.robots.burger import BURGER


def one_obstacle(settings: CostmapSettings, cells: int = 61) -> OccupancyGrid:
    data = np.zeros((cells, cells), dtype=np.int8)
    data[cells // 2, cells // 2] = 100
    return static_costs(OccupancyGrid(data, settings.resolution, (0.0, 0.0)), settings)


def test_published_values_follow_the_table_of_costmap_2d() -> None:
    assert [int(value) for value in PUBLISHED] == [
        0, *[1 + (97 * (cost - 1)) // 251 for cost in range(1, 253)], 99, 100, -1
    ]  # fmt: skip
    assert published(np.array([[0, 254], [253, 255]], dtype=np.uint8)).tolist() == [[0, 100], [99, -1]]


@pytest.mark.parametrize(
    ("scaling", "threshold", "reach_m"),
    [(3.0, 10, 0.821), (3.0, 30, 0.446), (3.0, 50, 0.277), (3.0, 70, 0.163), (3.0, 90, 0.079),
     (10.0, 10, 0.282), (10.0, 30, 0.170), (10.0, 50, 0.119), (10.0, 70, 0.085), (10.0, 90, 0.059)],
)  # fmt: skip
def test_a_threshold_reaches_as_far_as_the_formula_says(
    scaling: float, threshold: int, reach_m: float
) -> None:
    settings = CostmapSettings(
        resolution=0.01, inflation_radius_m=0.9, cost_scaling_factor=scaling, inscribed_radius_m=0.051
    )
    grid = one_obstacle(settings, cells=201)
    row = grid.data[100, 100:]
    assert (np.flatnonzero(row >= threshold).max() * 0.01) == pytest.approx(reach_m, abs=0.0101)


def test_inflation_around_one_cell_by_hand() -> None:
    grid = one_obstacle(
        CostmapSettings(inflation_radius_m=1.0, cost_scaling_factor=3.0, inscribed_radius_m=0.051)
    )
    row = grid.data[30, 30:]
    assert row[0] == 100
    assert row[1] == 99  # 0.05 m, within 0.051
    cost_at_two_cells = math.floor(252 * math.exp(-3.0 * (0.10 - 0.051)))
    assert cost_at_two_cells == 217
    assert row[2] == 1 + 97 * 216 // 251
    assert row[20] == 1 + 97 * (math.floor(252 * math.exp(-3.0 * (1.0 - 0.051))) - 1) // 251 > 0
    assert row[21] == 0  # the step at the end of the reach, in whole cells rounded up
    assert [reach_cells(radius_m, 0.05) for radius_m in (0.51, 0.55, 0.56)] == [11, 11, 12]
    assert grid.data[31, 31] == PUBLISHED[math.floor(252 * math.exp(-3.0 * (0.05 * math.sqrt(2) - 0.051)))]


@given(st.integers(0, 2**32 - 1), st.integers(0, 9), st.floats(0.0, 0.2))
def test_inflation_equals_an_exact_distance_transform(seed: int, reach: int, lethal_share: float) -> None:
    rng = np.random.default_rng(seed)
    base = rng.choice(
        np.array([0, 255, 254], dtype=np.uint8),
        size=rng.integers(1, 30, size=2),
        p=[0.8 - lethal_share, 0.2, lethal_share],
    )
    costs = inflation_costs(CostmapSettings(inscribed_radius_m=0.08, cost_scaling_factor=4.0), 0.05 * reach)
    distance = distance_transform_edt(base != 254) if (base == 254).any() else np.full(base.shape, np.inf)
    expected = base.copy()
    for cell in np.ndindex(*base.shape):
        if distance[cell] <= reach:
            metres = distance[cell] * 0.05
            cost = (
                254 if metres == 0 else 253 if metres <= 0.08 else int(252 * math.exp(-4.0 * (metres - 0.08)))
            )
            if base[cell] != 255 or cost >= 253:
                expected[cell] = cost if base[cell] == 255 else max(cost, int(base[cell]))
    assert np.array_equal(inflate(base, costs), expected)


def test_the_static_layer_is_trinary_and_keeps_unknown_only_when_asked() -> None:
    grid = OccupancyGrid(np.array([[-1, 0, 50, 99, 100]], dtype=np.int8), 0.05, (0.0, 0.0))
    assert static_layer(grid, track_unknown=True).tolist() == [[255, 0, 0, 0, 254]]
    assert static_layer(grid, track_unknown=False).tolist() == [[0, 0, 0, 0, 254]]


def test_a_binary_image_is_not_taken_for_an_occupancy_grid() -> None:
    grid = OccupancyGrid(np.zeros((3, 3), dtype=np.uint8), 0.05, (0.0, 0.0))
    with pytest.raises(ValueError, match="int8"):
        static_layer(grid, track_unknown=False)


def test_footprint_radii_of_the_burger() -> None:
    assert footprint.radii(BURGER.footprint) == pytest.approx((0.041, 0.142127), abs=1e-6)
    assert footprint.radii(footprint.BURGER_PADDED) == pytest.approx((0.051, 0.156205), abs=1e-6)
    assert BURGER_COSTMAP.inscribed_radius_m == pytest.approx(0.081)


def test_padding_leaves_zero_coordinates_alone() -> None:
    grown = footprint.padded(((0.0, 0.1), (-0.1, 0.0), (0.1, -0.1)), 0.02)
    assert np.array(grown) == pytest.approx(np.array([(0.0, 0.12), (-0.12, 0.0), (0.12, -0.12)]))


@pytest.mark.parametrize(
    "wrong",
    [{"resolution": 0.0}, {"obstacle_range_m": -1.0}, {"cost_scaling_factor": math.nan}, {"decay_s": -0.1},
     {"inflation_radius_m": 6.0}],
)  # fmt: skip
def test_impossible_settings_are_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        CostmapSettings(**wrong)
