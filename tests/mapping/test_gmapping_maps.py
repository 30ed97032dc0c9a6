"""The particles' maps (shared patches, forgetting) and the published map (hits and visits)."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from midnet_bench.mapping.gmapping import EMPTY, PATCH_CELLS, ParticleMaps
from midnet_bench.mapping.grid_slam import VisitMap

CELL_M = 0.05
Points = npt.NDArray[np.float64]


def hit_points(maps: ParticleMaps, particle: int) -> set[tuple[float, float]]:
    """The mean hit points of a particle's map in metres, rounded to the millimetre."""
    points = set()
    for row, column in np.argwhere(maps.tables[particle]):
        means = maps.means[maps.tables[particle, row, column]]
        corner = maps.origin_cells + np.array([column, row]) * PATCH_CELLS
        for x, y in (means[means[..., 0] < EMPTY / 2] + corner) * CELL_M:
            points.add((round(float(x), 3), round(float(y), 3)))
    return points


def test_a_cell_holds_the_mean_of_its_hit_points() -> None:
    maps = ParticleMaps(1, CELL_M)
    maps.register(np.zeros((1, 3)), np.array([[1.01, 0.01], [1.03, 0.02], [1.02, 0.03], [-2.0, 0.01]]), 4)
    assert hit_points(maps, 0) == {(1.02, 0.02), (-2.0, 0.01)}


def test_copies_share_patches_until_one_is_written() -> None:
    maps = ParticleMaps(4, CELL_M)
    poses = np.array([[0.0, 0.1 * n, 0.0] for n in range(4)])
    maps.register(poses, np.array([[1.0, 0.02]]), 1)
    assert [hit_points(maps, n) for n in range(4)] == [{(1.0, round(0.1 * n + 0.02, 3))} for n in range(4)]

    maps.resample(np.array([2, 2, 2, 0]))
    patch = maps.tables[maps.tables > 0]
    assert len(set(patch)) == 2
    poses = np.array([[0.0, 0.3, 0.0], [0.0, 0.4, 0.0], [0.0, 0.5, 0.0], [0.0, 0.6, 0.0]])
    maps.register(poses, np.array([[1.0, 0.02]]), 1)
    heirs = [{(1.0, 0.22)}, {(1.0, 0.22)}, {(1.0, 0.22)}, {(1.0, 0.02)}]
    assert [hit_points(maps, n) for n in range(4)] == [
        old | {(1.0, new)} for old, new in zip(heirs, (0.32, 0.42, 0.52, 0.62), strict=True)
    ]


def test_patches_that_nobody_uses_are_used_again() -> None:
    maps = ParticleMaps(8, CELL_M)
    rng = np.random.default_rng(0)
    ends = rng.uniform(-3.0, 3.0, (300, 2))
    for _ in range(40):
        maps.register(rng.normal(0.0, 0.02, (8, 3)), ends, len(ends))
        maps.resample(rng.integers(0, 8, 8))
    used = len(np.unique(maps.tables))
    patches_of_one_map = np.count_nonzero(maps.tables[0])
    assert used <= 8 * patches_of_one_map + 1
    assert len(maps.means) <= 4 * 8 * patches_of_one_map


def test_the_map_grows_on_every_side_and_keeps_what_it_held() -> None:
    maps = ParticleMaps(2, CELL_M)
    ends = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    expected: set[tuple[float, float]] = set()
    for x, y in ((0.02, 0.02), (-20.03, 0.02), (0.02, -31.03), (17.02, 12.02)):
        maps.register(np.array([[x, y, 0.0]] * 2), ends, 4)
        expected |= {(round(x + dx, 3), round(y + dy, 3)) for dx, dy in ends}
        assert hit_points(maps, 0) == hit_points(maps, 1) == expected


def test_what_moved_away_is_forgotten_once_nine_rays_passed_through() -> None:
    """GMapping matches a person who stood there once for ever."""
    maps = ParticleMaps(1, CELL_M)
    pose = np.zeros((1, 3))
    person, wall = (2.01, 0.01), (4.01, 0.01)
    maps.register(pose, np.array([person]), 1)
    for _ in range(8):
        maps.register(pose, np.array([wall]), 1)
    assert hit_points(maps, 0) == {person, wall}
    maps.register(pose, np.array([wall]), 1)
    assert hit_points(maps, 0) == {wall}
    maps.register(pose, np.array([person]), 1)
    assert hit_points(maps, 0) == {person, wall}


def test_rays_that_only_clear_make_no_hits_but_forget_them() -> None:
    maps = ParticleMaps(1, CELL_M)
    maps.register(np.zeros((1, 3)), np.zeros((0, 2)), 0)
    assert hit_points(maps, 0) == set()
    maps.register(np.zeros((1, 3)), np.array([[2.01, 0.01]]), 1)
    for _ in range(9):
        maps.register(np.zeros((1, 3)), np.array([[3.0, 0.01]]), 0)
    assert hit_points(maps, 0) == set()


def test_published_cells_by_hand() -> None:
    """One ray of four cells that hits, one that only clears: the origin is the corner of the first cell."""
    visits = VisitMap(1.0)
    visits.add(np.array([0.5, 0.5, 0.0]), np.array([[3.0, 0.0], [0.0, 2.0]]), 1)
    grid = visits.occupancy(0.25)
    assert grid.data.dtype == np.int8
    assert grid.data.tolist() == [[0, 0, 0, 100], [0, -1, -1, -1]]
    assert grid.origin == (0.0, 0.0)
    assert grid.center_of(3, 0) == (3.5, 0.5)


@pytest.mark.parametrize(("passes", "value"), [(2, 100), (3, 0)])
def test_a_cell_is_occupied_above_a_quarter_of_its_visits(passes: int, value: int) -> None:
    visits = VisitMap(1.0)
    pose = np.array([0.5, 0.5, 0.0])
    visits.add(pose, np.array([[2.0, 0.0]]), 1)
    for _ in range(passes):
        visits.add(pose, np.array([[5.0, 0.0]]), 1)
    assert visits.occupancy(0.25).data[0, 2] == value


def test_the_published_map_grows_on_the_lattice_of_the_map_frame() -> None:
    visits = VisitMap(CELL_M)
    for x in (0.0, -13.0, 40.0):
        visits.add(np.array([x, 1.0, 0.3]), np.array([[2.0, 0.0], [0.0, 1.0]]), 2)
    grid = visits.occupancy(0.25)
    for x in (0.0, -13.0, 40.0):
        for ahead, left in ((2.0, 0.0), (0.0, 1.0)):
            end_x = x + ahead * math.cos(0.3) - left * math.sin(0.3)
            end_y = 1.0 + ahead * math.sin(0.3) + left * math.cos(0.3)
            column, row = grid.cell_at(end_x, end_y)
            assert grid.data[row, column] == 100
    assert grid.origin[0] / CELL_M == pytest.approx(round(grid.origin[0] / CELL_M), abs=1e-6)
    assert grid.data.any(axis=0)[[0, -1]].all()  # cut to what is known


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_scan_that_is_taken_back_leaves_no_trace(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scans = [
        (rng.uniform(-5.0, 5.0, 3), rng.uniform(-4.0, 4.0, (20, 2)), int(rng.integers(0, 21)))
        for _ in range(4)
    ]
    kept, both = VisitMap(CELL_M), VisitMap(CELL_M)
    for scan in scans[:2]:
        kept.add(*scan)
    for scan in scans:
        both.add(*scan)
    for scan in scans[2:]:
        both.add(*scan, -1)
    one, other = kept.occupancy(0.25), both.occupancy(0.25)
    assert one.origin == other.origin
    assert np.array_equal(one.data, other.data)
