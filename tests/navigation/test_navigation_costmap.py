import dataclasses
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from midnet_bench.errors import InputError
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import (
    LETHAL,
    NOWHERE,
    PUBLISHED,
    GlobalCostmap,
    RollingCostmap,
    clear_footprint,
    clear_line,
    inflate,
    inflation_costs,
    integrate_scan,
    is_open_line,
    published,
    reach_cells,
    static_costs,
    static_layer,
)
from midnet_bench.navigation.navigation_settings import (
    BURGER_COSTMAP,
    BURGER_PADDED,
    CostmapSettings,
    padded,
    radii,
)
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01
from tests.navigation.planar_world import bresenham

ONE_BEAM = LidarGeometry(1, 0.0, 0.1, 0.12, 3.5, Pose2D(0.0, 0.0, 0.0))
BARE = CostmapSettings(footprint_clearing=False, inflation_radius_m=0.0)
START = Pose2D(0.025, 0.025, 0.0)


def look(
    costmap: RollingCostmap | GlobalCostmap, ranges: list[float], pose: Pose2D = START, time_s: float = 0.0
) -> None:
    geometry = dataclasses.replace(ONE_BEAM, beams=len(ranges))
    costmap.update(pose, np.array(ranges), geometry, time_s)


def marked(costmap: RollingCostmap | GlobalCostmap) -> list[tuple[int, int]]:
    """(column, row) of the lethal cells, counted from the lattice's origin."""
    rows, columns = np.nonzero(costmap.costs == 254)
    return [(int(c) + costmap.column, int(r) + costmap.row) for c, r in zip(columns, rows, strict=True)]


def empty_map(cells: int = 20, value: int = 0) -> OccupancyGrid:
    return OccupancyGrid(np.full((cells, cells), value, dtype=np.int8), 0.05, (0.0, 0.0))


# Costs and settings


def test_published_values_follow_the_table_of_costmap_2d() -> None:
    assert [int(value) for value in PUBLISHED] == [
        0, *[1 + (97 * (cost - 1)) // 251 for cost in range(1, 253)], 99, 100, -1
    ]  # fmt: skip
    assert published(np.array([[0, 254], [253, 255]], dtype=np.uint8)).tolist() == [[0, 100], [99, -1]]


def test_inflation_around_one_cell_by_hand() -> None:
    settings = CostmapSettings(inflation_radius_m=1.0, cost_scaling_factor=3.0, inscribed_radius_m=0.051)
    grid = empty_map(61)
    grid.data[30, 30] = 100
    grid = static_costs(grid, settings)
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
    assert radii(BURGER.footprint) == pytest.approx((0.041, 0.142127), abs=1e-6)
    assert radii(BURGER_PADDED) == pytest.approx((0.051, 0.156205), abs=1e-6)
    assert BURGER_COSTMAP.inscribed_radius_m == pytest.approx(0.081)


def test_padding_leaves_zero_coordinates_alone() -> None:
    grown = padded(((0.0, 0.1), (-0.1, 0.0), (0.1, -0.1)), 0.02)
    assert np.array(grown) == pytest.approx(np.array([(0.0, 0.12), (-0.12, 0.0), (0.12, -0.12)]))


@pytest.mark.parametrize(
    "wrong",
    [{"resolution": 0.0}, {"obstacle_range_m": -1.0}, {"cost_scaling_factor": math.nan}, {"decay_s": -0.1},
     {"inflation_radius_m": 6.0}],
)  # fmt: skip
def test_impossible_settings_are_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        CostmapSettings(**wrong)


# Marking and clearing


@pytest.mark.parametrize(
    ("changed", "scans", "left"),
    [
        ({}, [1.0], [20]),
        ({"size_m": 6.0}, [2.5], []),  # the obstacle range exactly
        ({"size_m": 6.0}, [float(np.nextafter(2.5, 0.0))], [50]),
        ({"size_m": 1.0}, [2.0], []),  # off the window
        *(({"obstacle_range_m": 4.0, "size_m": 8.0}, [0.5, r], [10]) for r in (0.119, 3.5, math.nan, -1.0)),
        ({}, [1.0, 0.5], [10, 20]),
        ({}, [1.0, 0.5, 1.5], [30]),  # a beam passes both
        ({}, [1.0, math.inf], [20]),
        ({"inf_is_valid": True}, [1.0, math.inf], []),
        ({"raytrace_range_m": 0.5, "size_m": 6.0}, [0.5, 0.6, 2.0], [12, 40]),
        ({"memory": "single_scan"}, [1.0, 0.5], [10]),
        ({"memory": "decay", "decay_s": 1.0}, [1.0, 0.5], [10, 20]),
        ({"memory": "decay", "decay_s": 0.9}, [1.0, 0.5], [10]),
    ],
)
def test_what_scans_one_second_apart_leave_marked(
    changed: dict[str, Any], scans: list[float], left: list[int]
) -> None:
    costmap = RollingCostmap(dataclasses.replace(BARE, **changed))
    for second, distance in enumerate(scans):
        look(costmap, [distance], time_s=float(second))
    assert marked(costmap) == [(column, 0) for column in left]


@pytest.mark.parametrize(
    ("changed", "scans", "left"),
    [
        pytest.param(
            {"obstacle_range_m": 1.0},
            [(1.025, 0.525, 0.9), (0.525, 0.525, 1.4)],
            [],
            id="a hit beyond the obstacle range clears its own cell",
        ),
        pytest.param(
            {},
            [(0.025, 0.525, 0.5), (-0.1, 0.525, 0.9)],
            [(10, 10), (16, 10)],
            id="a sensor off the map does not clear",
        ),
        pytest.param(
            {"memory": "decay", "decay_s": 0.5, "obstacle_range_m": 0.6, "raytrace_range_m": 0.6},
            [(0.225, 0.225, 0.5), (4.0, 4.0, math.inf)],
            [],
            id="marks decay far from the sensor too",
        ),
    ],
)
def test_what_scans_from_places_leave_on_a_whole_map(
    changed: dict[str, Any], scans: list[tuple[float, float, float]], left: list[tuple[int, int]]
) -> None:
    costmap = GlobalCostmap(dataclasses.replace(BARE, **changed), empty_map(100))
    for second, (x, y, distance) in enumerate(scans):
        look(costmap, [distance], Pose2D(x, y, 0.0), float(second))
    assert marked(costmap) == left


def test_clearing_comes_before_marking_and_what_leaves_the_window_is_forgotten() -> None:
    geometry = dataclasses.replace(ONE_BEAM, beams=2, angle_increment_rad=0.001)
    costmap = RollingCostmap(dataclasses.replace(BARE, size_m=4.5))
    for ranges in ([1.0, 2.0], [2.0, 1.0]):
        costmap.update(START, np.array(ranges), geometry, 0.0)
        assert sorted(marked(costmap)) == [(20, 0), (40, 0)]
    look(costmap, [math.inf], pose=Pose2D(-0.475, 0.025, 0.0))
    assert marked(costmap) == [(20, 0)]
    look(costmap, [math.inf])
    assert marked(costmap) == [(20, 0)]


def test_beams_that_leave_the_map_are_clipped_to_its_edge() -> None:
    costmap = GlobalCostmap(BARE, empty_map())
    for row in range(20):
        look(costmap, [0.9], pose=Pose2D(0.025, 0.025 + 0.05 * row, 0.0))
    assert len(marked(costmap)) == 20
    # Two cells up for five to the right, from (0, 10): leaves the map in cell (19, 18), by way of (18, 18).
    look(costmap, [3.0], pose=Pose2D(0.025, 0.525, math.atan2(0.4, 1.0)))
    assert (18, 18) not in marked(costmap)
    assert len(marked(costmap)) == 19


@given(st.integers(-25, 25), st.integers(-25, 25), st.integers(0, 40))
def test_a_cleared_line_is_bresenhams(dx: int, dy: int, limit: int) -> None:
    cells = np.full((60, 60), 254, dtype=np.uint8)
    clear_line(cells.reshape(-1), cells.shape[1], 30, 30, 30 + dx, 30 + dy, limit)
    major = max(abs(dx), abs(dy))
    steps = int(min(1.0, limit / math.hypot(dx, dy)) * major) if major else 0
    expected = set(bresenham(30, 30, 30 + dx, 30 + dy)[: steps + 1])
    rows, columns = np.nonzero(cells == 0)
    assert set(zip(columns.tolist(), rows.tolist(), strict=True)) == expected


# Footprint


@pytest.mark.parametrize(
    ("half_m", "pose", "widths"),
    [
        (0.1, Pose2D(0.525, 0.525, 0.0), [0] * 8 + [5] * 5 + [0] * 7),
        # a square on its tip: half a diagonal is 5.66 cells, so the tips lie in rows 4 and 16
        (0.2, Pose2D(0.525, 0.525, math.pi / 4), [0] * 4 + [*range(1, 14, 2), *range(11, 0, -2)] + [0] * 3),
        (0.1, Pose2D(0.05, 0.5, 0.0), [0] * 20),  # partly off the map
    ],
)
def test_the_robot_frees_the_cells_it_stands_on(half_m: float, pose: Pose2D, widths: list[int]) -> None:
    square = tuple((half_m * x, half_m * y) for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1)))
    costmap = GlobalCostmap(dataclasses.replace(BARE, footprint=square, footprint_clearing=True), empty_map())
    costmap.marks[:] = 254
    look(costmap, [math.inf], pose=pose)
    assert (costmap.marks == 0).sum(axis=1).tolist() == widths


# A LiDAR on a robot


@given(st.integers(0, 2**32 - 1))
def test_a_scan_is_taken_from_where_the_lidar_is_mounted(seed: int) -> None:
    """The same cells as by ``Pose2D.compose`` and both steps one by one, on a grid that begins anywhere."""
    rng = np.random.default_rng(seed)
    pose, mount = (Pose2D(*rng.uniform(-reach, reach, 3).tolist()) for reach in (0.5, 0.2))
    lidar = dataclasses.replace(LDS_01, mount=mount)
    ranges = np.where(rng.random(lidar.beams) < 0.2, np.inf, rng.uniform(0.1, 3.6, lidar.beams))
    costmap = RollingCostmap(BURGER_COSTMAP, (0.013, -0.4))
    costmap.update(pose, ranges, lidar, 0.0)
    expected, sensor = np.zeros_like(costmap.marks), pose.compose(mount)
    limits, reach = (lidar.range_min_m, lidar.range_max_m, BURGER_COSTMAP.obstacle_range_m), 70
    at = (*costmap.to_cells(sensor.x, sensor.y), sensor.yaw)
    integrate_scan(expected, 0.05, at, ranges, lidar.directions, limits, reach, True)
    outline = np.array(BURGER_COSTMAP.footprint) / 0.05
    clear_footprint(expected, outline, (*costmap.to_cells(pose.x, pose.y), pose.yaw))
    np.testing.assert_array_equal(costmap.marks, expected)
    assert np.count_nonzero(expected) > 50


# Rolling


def window_offsets(xs: list[float], centered: bool) -> list[float]:
    costmap = RollingCostmap(dataclasses.replace(BARE, size_m=3.0, centered=centered))
    offsets = []
    for x in xs:
        look(costmap, [math.inf], pose=Pose2D(x, 0.0, 0.0))
        offsets.append(x / 0.05 - costmap.column)
    return offsets


def test_the_rolling_window_trails_behind_by_up_to_a_cell() -> None:
    forth = window_offsets([10.0, 10.02, 10.04, 10.06], centered=False)
    back = window_offsets([11.0, 10.08, 10.06, 10.04, 10.02, 10.0], centered=False)
    assert forth[0] == pytest.approx(30.0)  # wanted 29.75, shifted by trunc(170.25) = 170 cells
    assert back[-1] == pytest.approx(29.0)  # the same place, come from the other side
    assert all(abs(offset - 29.75) < 1.0 + 1e-9 for offset in forth + back)


@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=8))
def test_a_centered_window_has_the_robot_in_its_middle_cell(xs: list[float]) -> None:
    costmap = RollingCostmap(dataclasses.replace(BARE, size_m=1.0), (0.013, -0.4))
    for x in xs:
        look(costmap, [math.inf], pose=Pose2D(x, -x, 0.0))
        lattice = OccupancyGrid(np.zeros((1, 1), dtype=np.int8), 0.05, (0.013, -0.4))
        column, row = lattice.cell_at(x, -x)
        assert (costmap.column, costmap.row) == (column - 10, row - 10)
        assert costmap.origin == pytest.approx((0.013 + (column - 10) * 0.05, -0.4 + (row - 10) * 0.05))


def test_a_published_window_is_a_cut_of_the_lattice() -> None:
    costmap = RollingCostmap(CostmapSettings(), (-4.0, -4.0))
    look(costmap, [1.0], pose=Pose2D(0.31, -1.27, 0.4))
    grid = costmap.published()
    assert grid.data.dtype == np.int8
    assert (grid.width, grid.height) == (100, 100)
    x, y = 0.31 + math.cos(0.4), -1.27 + math.sin(0.4)
    column, row = grid.cell_at(x, y)
    assert grid.data[row, column] == 100
    assert ((grid.origin[0] + 4.0) / 0.05) == pytest.approx(round((grid.origin[0] + 4.0) / 0.05))


def test_unknown_cells_become_free_only_where_beams_went() -> None:
    costmap = RollingCostmap(dataclasses.replace(BARE, track_unknown=True, size_m=1.0))
    look(costmap, [0.3])
    assert (costmap.costs[10, 10:16] == 0).all()
    assert costmap.costs[10, 16] == 254
    assert (costmap.costs != 255).sum() == 7


# What a costmap refuses


def costmaps() -> list[RollingCostmap | GlobalCostmap]:
    settings = CostmapSettings()
    return [
        RollingCostmap(settings),
        RollingCostmap(dataclasses.replace(settings, centered=False)),
        GlobalCostmap(settings, empty_map()),
    ]


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("field", ["x", "y", "yaw"])
def test_a_pose_that_is_not_finite_is_refused(field: str, wrong: float) -> None:
    """A yaw that was no number ended the process with a segmentation fault."""
    bad = START._replace(**{field: wrong})
    for costmap in costmaps():
        for pose, mount in ((bad, START), (START, bad)):
            lidar = dataclasses.replace(LDS_01, mount=mount)
            with pytest.raises(ValueError, match="finite"):
                costmap.update(pose, np.full(LDS_01.beams, 1.0), lidar, 0.0)


@pytest.mark.parametrize("count", [0, 359, 361, 100_000])
def test_a_scan_needs_one_range_for_each_beam(count: int) -> None:
    """More of them were read with directions from behind the array's end."""
    for costmap in costmaps():
        with pytest.raises(ValueError, match="360 beams"):
            costmap.update(START, np.full(count, 1.0), LDS_01, 0.0)


def test_a_footprint_at_a_pose_that_is_no_number_frees_nothing() -> None:
    cells = np.full((20, 20), 254, dtype=np.uint8)
    triangle = np.array([(2.0, 2.0), (2.0, 5.0), (5.0, 2.0)])
    for pose in ((math.nan, 0.0, 0.0), (0.0, math.nan, 0.0), (0.0, 0.0, math.nan)):
        clear_footprint(cells, triangle, pose)
    assert (cells == 254).all()


# Global


def full_costs(costmap: GlobalCostmap) -> npt.NDArray[np.uint8]:
    static, seen = costmap.static, costmap.marks
    base = np.where((static == 255) | ((seen != 255) & (seen > static)), seen, static).astype(np.uint8)
    return inflate(base, inflation_costs(costmap.settings, costmap.settings.inflation_radius_m))


@pytest.mark.parametrize("track_unknown", [False, True])
def test_bounded_updates_equal_a_costmap_made_in_one_go(track_unknown: bool) -> None:
    rng = np.random.default_rng(3)
    data = rng.choice(np.array([0, 100, -1], dtype=np.int8), size=(150, 130), p=[0.96, 0.02, 0.02])
    settings = CostmapSettings(
        inflation_radius_m=0.4, track_unknown=track_unknown, obstacle_range_m=1.2, raytrace_range_m=1.5
    )
    costmap = GlobalCostmap(settings, OccupancyGrid(data, 0.05, (-1.0, 2.0)))
    geometry = LDS_01
    for step in range(25):
        pose = Pose2D(*rng.uniform((-1.2, 1.8), (5.7, 9.7)), rng.uniform(-3.0, 3.0))
        ranges = rng.uniform(0.1, 3.6, geometry.beams)
        costmap.update(pose, ranges, geometry, 0.2 * step)
        if step % 3 == 0:
            assert np.array_equal(costmap.costs, full_costs(costmap))
    costmap.clear_outside(2.0, 5.0, 3.0)
    assert np.array_equal(costmap.costs, full_costs(costmap))


@pytest.mark.parametrize(("footprint_m", "ahead_m"), [(0.1, 0.0), (0.1, 0.9), (2.5, 0.0), (2.5, -0.9)])
def test_what_a_scan_changes_lies_in_the_rectangles_that_it_touches(
    footprint_m: float, ahead_m: float
) -> None:
    corners = tuple((footprint_m * x, footprint_m * y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    reach = dict(obstacle_range_m=1.2, raytrace_range_m=1.5, footprint=corners, footprint_clearing=True)
    costmap = GlobalCostmap(dataclasses.replace(BARE, **reach), empty_map(200))
    lidar = dataclasses.replace(LDS_01, mount=Pose2D(ahead_m, 0.0, 0.0))
    rng, changed = np.random.default_rng(5), 0
    for step in range(30):
        costmap.marks[:] = np.where(rng.random(costmap.marks.shape) < 0.5, LETHAL, 0)
        before = costmap.marks.copy()
        costmap.touched[:] = NOWHERE
        pose = Pose2D(*rng.uniform(-0.5, 10.5, 2), rng.uniform(-3.0, 3.0))
        costmap.update(pose, rng.uniform(0.1, 3.6, lidar.beams), lidar, 0.2 * step)
        rows, columns = np.nonzero(costmap.marks != before)
        for x0, y0, x1, y1 in costmap.touched.tolist():
            assert ((x0 <= columns) & (columns < x1) & (y0 <= rows) & (rows < y1)).all()
            assert (x1 - x0) * (y1 - y0) < before.size
        changed += len(rows)
    assert changed > 1000


def test_clearing_keeps_what_lies_strictly_inside_the_square() -> None:
    costmap = GlobalCostmap(BARE, empty_map(40))
    costmap.marks[:] = 254
    costmap.clear_outside(1.025, 1.025, 0.5)
    kept = marked(costmap)
    # 1.025 -+ 0.25 lie in cells 15 and 25; both are outside.
    assert {c for c, _ in kept} == {r for _, r in kept} == set(range(16, 25))


def test_a_map_that_grows_keeps_the_marks_in_place() -> None:
    costmap = GlobalCostmap(BARE, empty_map(20))
    look(costmap, [0.5], pose=Pose2D(0.225, 0.525, 0.0))
    x, y = OccupancyGrid(costmap.costs, 0.05, costmap.origin).center_of(14, 10)
    grown = OccupancyGrid(np.full((40, 50), -1, dtype=np.int8), 0.05, (-0.5, -0.25))
    costmap.set_static(grown)
    assert costmap.costs.shape == (40, 50)
    column, row = OccupancyGrid(costmap.costs, 0.05, costmap.origin).cell_at(x, y)
    assert (column, row) == (24, 15)
    assert np.argwhere(costmap.costs == 254).tolist() == [[15, 24]]


def test_a_static_map_of_another_resolution_is_refused() -> None:
    with pytest.raises(InputError, match=r"0\.1 .*0\.05"):
        GlobalCostmap(BARE, OccupancyGrid(np.zeros((5, 5), dtype=np.int8), 0.1, (0.0, 0.0)))


@pytest.mark.slow
@settings(deadline=None)  # the first call compiles
@given(st.integers(0, 2**32 - 1))
def test_a_line_is_open_where_no_cell_that_a_beam_clears_is_lethal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((12, 17)) < 0.15, LETHAL, 0).astype(np.uint8)
    (x0, x1), (y0, y1) = rng.integers(17, size=2).tolist(), rng.integers(12, size=2).tolist()
    cleared = cells.copy()
    clear_line(cleared.reshape(-1), 17, x0, y0, x1, y1, 100)
    is_open = (cleared == cells).all()
    assert is_open_line(cells, x0 + 0.3, y0 + 0.9, x1 + 0.5, y1 + 0.1) == is_open
    assert not is_open_line(cells, x0 + 0.3, -0.1, x1 + 0.5, y1 + 0.1)


# What beams without a return, and beams to the very edge, leave


@pytest.mark.parametrize("range_max_m", [2.0, 2.49, 2.51, 3.5])
@pytest.mark.parametrize("obstacle_range_m", [2.5, 3.5, 4.0])
@pytest.mark.parametrize("whole_map", [False, True])
def test_a_beam_without_a_return_marks_nothing_and_clears_its_way(
    range_max_m: float, obstacle_range_m: float, whole_map: bool
) -> None:
    lidar = dataclasses.replace(LDS_01, range_max_m=range_max_m)
    chosen = dataclasses.replace(BARE, size_m=8.0, obstacle_range_m=obstacle_range_m, inf_is_valid=True)
    costmap = GlobalCostmap(chosen, empty_map(160)) if whole_map else RollingCostmap(chosen)
    pose = Pose2D(4.0, 4.0, 0.3)
    costmap.update(pose, np.full(lidar.beams, 1.0), lidar, 0.0)
    assert len(marked(costmap)) > 90
    costmap.update(pose, np.full(lidar.beams, math.inf), lidar, 0.2)
    assert marked(costmap) == []


@given(st.lists(st.sampled_from([math.inf, math.nan, 1.0, 1.9, 2.0, 2.5, 3.0]), min_size=24, max_size=24))
def test_a_scan_marks_where_its_returns_end_and_nowhere_else(ranges: list[float]) -> None:
    """A range at or above the sensor's largest, 2 m here, is no return: it neither marks nor clears."""
    lidar = LidarGeometry(24, 0.1, math.tau / 24, 0.12, 2.0, Pose2D(0.0, 0.0, 0.0))
    costmap = RollingCostmap(dataclasses.replace(BARE, size_m=8.0, obstacle_range_m=4.0, inf_is_valid=True))
    costmap.update(START, np.array(ranges), lidar, 0.0)
    ends = [
        (math.floor(20 * (0.025 + r * math.cos(a))), math.floor(20 * (0.025 + r * math.sin(a))))
        for r, a in zip(ranges, lidar.angles_rad, strict=True)
        if r < 2.0
    ]
    assert set(marked(costmap)) == set(ends)


@pytest.mark.parametrize("angle", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_beam_that_ends_on_the_windows_edge_clears_its_way(angle: float) -> None:
    chosen = dataclasses.replace(BARE, size_m=2.0, raytrace_range_m=10.0)
    lidar = LidarGeometry(1, angle, 0.01, 0.0, 10.0, Pose2D(0.0, 0.0, 0.0))
    freed = []
    for length in (1.0, 1.0 + 1e-6):
        costmap = RollingCostmap(chosen)
        costmap.update(Pose2D(0.0, 0.0, 0.0), np.array([math.nan]), lidar, 0.0)
        costmap.marks.fill(LETHAL)
        costmap.update(Pose2D(0.0, 0.0, 0.0), np.array([length]), lidar, 0.0)
        freed.append(int(np.count_nonzero(costmap.marks == 0)))
    assert freed[0] >= 20
    assert freed[1] - freed[0] in (0, 1)  # the cell of a hit on the lower or left edge, which is inside


@given(
    st.tuples(st.integers(1, 39), st.integers(1, 39)),
    st.tuples(st.integers(-40, 40), st.integers(-40, 40)),
    st.floats(0.5, 3.0),
)
@example((20, 20), (20, 20), 1.0)
@example((20, 20), (20, 20), 2.0)
@example((20, 20), (-20, 20), 1.0)
@example((20, 20), (-20, -20), 1.0)
@example((20, 20), (20, -20), 1.0)
@example((20, 20), (20, 7), 1.0)
@example((20, 20), (7, 20), 1.0)
def test_a_beam_clears_up_to_where_it_leaves_the_grid(
    start: tuple[int, int], step: tuple[int, int], times: float
) -> None:
    """From a lattice point, to others inside, on every edge, at corners and beyond: whole cells."""
    cells = np.full((40, 40), LETHAL, dtype=np.uint8)
    length = math.hypot(*step) * times
    if length == 0.0:
        return
    beam = np.array([[step[0] / math.hypot(*step), step[1] / math.hypot(*step)]])
    sensor = (float(start[0]), float(start[1]), 0.0)
    integrate_scan(cells, 1.0, sensor, np.array([length]), beam, (0.0, 1e3, 0.0), 99, True)
    rows, columns = np.nonzero(cells != LETHAL)
    assert cells[start[1], start[0]] == 0
    inside = 1.0  # of the way, up to where the beam leaves the grid
    for place, move in zip(start, step, strict=True):
        if move != 0:
            room = (40 - place) if move > 0 else place
            inside = min(inside, room / abs(move * times))
    end = [place + move * times * inside for place, move in zip(start, step, strict=True)]
    nearest = np.hypot(columns + 0.5 - end[0], rows + 0.5 - end[1]).min()
    assert nearest <= math.hypot(0.5, 0.5) + 1e-6


@pytest.mark.parametrize("resolution", [0.05, 0.05000000074505806, 0.0499999])
def test_a_static_map_may_have_a_rounded_resolution(resolution: float) -> None:
    cells = np.zeros((40, 60), np.int8)
    cells[10, 20] = 100
    costmap = GlobalCostmap(BURGER_COSTMAP, OccupancyGrid(cells, resolution, (-1.0, 2.0)))
    known = GlobalCostmap(BURGER_COSTMAP, OccupancyGrid(cells, 0.05, (-1.0, 2.0)))
    assert (costmap.costs == known.costs).all()
    assert costmap.published().extent == known.published().extent
    with pytest.raises(InputError, match=r"resolution 0\.051 differs"):
        costmap.set_static(OccupancyGrid(cells, 0.051, (-1.0, 2.0)))


@pytest.mark.parametrize("size_m", [3.5, 12.0])
@pytest.mark.parametrize("track_unknown", [False, True])
def test_a_window_is_inflated_as_a_whole_would_be(track_unknown: bool, size_m: float) -> None:
    settings_of = dataclasses.replace(CostmapSettings(), size_m=size_m, track_unknown=track_unknown)
    rng = np.random.default_rng(3)
    for marks in (0, 1, 40):
        costmap = RollingCostmap(settings_of)
        cells = rng.integers(0, len(costmap.marks), (marks, 2))
        costmap.marks[cells[:, 0], cells[:, 1]] = LETHAL
        if marks:  # and one in a corner
            costmap.marks[0, -1] = LETHAL
        whole = inflate(costmap.marks, inflation_costs(settings_of, settings_of.inflation_radius_m))
        np.testing.assert_array_equal(costmap.costs, whole)
        np.testing.assert_array_equal(costmap.published().data, published(whole))


def test_a_lidar_of_two_metres_sees_no_ring_of_obstacles() -> None:
    lidar = dataclasses.replace(LDS_01, range_max_m=2.0)
    for settings_of in (CostmapSettings(inf_is_valid=True, size_m=3.5).of_lidar(lidar), BURGER_COSTMAP):
        costmap = RollingCostmap(settings_of)
        costmap.update(START, np.full(360, np.inf), lidar, 0.0)
        assert not marked(costmap)
