"""The two maps as the paper describes them, the exact prior map, and free space."""

import math

import cv2
import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.free_space import doors, free_space
from midnet_bench.arena.layout import place
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.errors import InputError
from midnet_bench.geometry import Solid
from midnet_bench.rng import stream

MAP1, MAP2 = load_arena("map1"), load_arena("map2")


def inside_walls(arena) -> np.ndarray:
    """The exact map of the enclosure's inside, True where free; its doors are left out."""
    grid = render_exact(arena)
    half = [round(side / 2.0 / grid.resolution) - 1 for side in arena.enclosure_m]
    middle = (grid.height // 2, grid.width // 2)
    inside = grid.data[middle[0] - half[1] : middle[0] + half[1], middle[1] - half[0] : middle[1] + half[0]]
    return inside == 0


def test_map_2_has_two_doors_of_a_person_s_width_in_opposite_walls() -> None:
    (east_x, east_y), (west_x, west_y) = found = doors(MAP2)
    assert (east_x, west_x) == (10.0, -10.0)
    assert east_y == pytest.approx(-west_y)
    to_walls_m = np.min([wall.distance_to(np.array(found)) for wall in MAP2.wall_solids()], axis=0)
    np.testing.assert_allclose(2.0 * to_walls_m, 1.25, atol=0.02)


def test_every_corridor_of_map_2_is_at_least_1_2_m_wide_and_leads_everywhere() -> None:
    free = inside_walls(MAP2)
    walled = cv2.copyMakeBorder(free.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    clearance_m = cv2.distanceTransform(walled, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * 0.05
    wide = (clearance_m >= 0.6).astype(np.uint8)
    assert cv2.connectedComponents(wide, connectivity=4)[0] == 2, "background and one walk through it all"
    # A square corner is at most 0.6 * sqrt(2) from the middle of a disc in it; a narrow pocket is further.
    to_walk_m = cv2.distanceTransform(1 - wide, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * 0.05
    assert to_walk_m[free].max() <= 0.6 * math.sqrt(2.0) + 0.1


def test_half_a_turn_leaves_map_2_as_it_is() -> None:
    data = render_exact(MAP2).data
    assert np.array_equal(data, data[::-1, ::-1])


def test_map_2_is_a_labyrinth_around_an_open_court() -> None:
    free = free_space(MAP2, 0.3)
    court = [(x / 10.0, y / 10.0) for x in range(-12, 13) for y in range(-12, 13)]
    assert all(free.contains(x, y) for x, y in court), "room for five robots and more"
    inner = [wall for wall in MAP2.wall_solids() if max(abs(wall.pose.x), abs(wall.pose.y)) < 9.99]
    assert sum(wall.length_m for wall in inner) > 80.0
    # From door to door one cannot see through: the straight line is cut by many walls.
    line = np.column_stack((np.linspace(-9.9, 9.9, 2000), np.linspace(4.95, -4.95, 2000)))
    blocked = np.min([wall.distance_to(line) for wall in inner], axis=0) < 0.0
    assert np.count_nonzero(np.diff(blocked.astype(int)) == 1) >= 4


def test_escapes_12_m_away_exist_from_everywhere_in_map_2() -> None:
    free = free_space(MAP2, 0.4)
    rng = stream(1, "test")
    for _ in range(20):
        start = free.draw(rng)
        escape = free.draw(rng, away_from=start, at_least_m=12.0)
        assert math.dist(start, escape) >= 12.0
        assert free.contains(*escape)
    with pytest.raises(InputError, match=r"40 m away from \(0, 0\); lower escape_distance_m"):
        free.draw(rng, away_from=(0.0, 0.0), at_least_m=40.0)


def test_free_space_keeps_its_distance_exactly() -> None:
    layout = place(MAP1, 4, 5)
    free = free_space(MAP1, 0.4, layout.stationary)
    grid = free.grid
    centers = np.stack(np.meshgrid(grid.x_centers, grid.y_centers), axis=-1).reshape(-1, 2)
    distance = np.min([solid.distance_to(centers) for solid in layout.solids], axis=0)
    inside = np.abs(centers).max(axis=1) < 3.0
    assert np.array_equal(grid.data.ravel(), (distance >= 0.4 - 1e-9) & inside)
    assert not free.contains(*layout.stationary[0].pose[:2])
    assert free_space(MAP1, 0.4).contains(*layout.stationary[0].pose[:2]), "guards do not know of it"


def test_free_space_ends_where_a_robot_cannot_go_on() -> None:
    cut = Solid.segment((1.0, -3.0), (1.0, 3.0), 0.1, 1.0)
    free = free_space(MAP1, 0.2, (cut,))
    assert free.contains(0.0, 0.0)
    assert not free.contains(2.0, 0.0)
    with pytest.raises(InputError, match=r"robots\.center_m: less than 0\.2 m"):
        free_space(MAP1, 0.2, (Solid.segment((-1.0, 0.0), (1.0, 0.0), 0.1, 1.0),))


def test_draws_are_uniform_over_the_free_cells() -> None:
    free = free_space(MAP1, 0.5)
    rng = stream(2, "test")
    drawn = np.array([free.draw(rng) for _ in range(4000)])
    side = 2.0 * (2.925 - 0.5)
    np.testing.assert_allclose(drawn.mean(axis=0), 0.0, atol=4 * side / math.sqrt(12 * 4000))
    np.testing.assert_allclose(drawn.std(axis=0), side / math.sqrt(12.0), rtol=0.03)


def test_the_exact_map_fills_the_cells_that_walls_share() -> None:
    grid = render_exact(MAP1)
    assert (grid.data.shape, grid.data.dtype, grid.origin) == ((160, 160), np.int8, (-4.0, -4.0))
    assert set(np.unique(grid.data)) == {0, 100}
    # Faces at 2.925 and 3.075 m lie in the middle of the first and last of four cells.
    row = grid.data[grid.cell_at(0.0, 0.01)[1]]
    filled = [grid.center_of(int(column), 0)[0] for column in np.flatnonzero(row)]
    wall = [2.925, 2.975, 3.025, 3.075]
    np.testing.assert_allclose(filled, [-x for x in reversed(wall)] + wall)
    assert np.count_nonzero(grid.data) == 124**2 - 116**2


def test_a_slanted_wall_fills_what_points_on_it_fill() -> None:
    walls = (((-3.0, -2.0), (2.5, 3.1)),)
    arena = MAP1.model_copy(update={"walls": walls})
    grid = render_exact(arena)
    (wall,) = arena.wall_solids()
    sides = np.linspace(-0.5, 0.5, 4001) * wall.length_m, np.linspace(-0.5, 0.5, 81) * wall.width_m
    x, y = wall.pose.transform(np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)).T
    expected = np.zeros_like(grid.data)
    expected[((y + 4.0) / 0.05).astype(int), ((x + 4.0) / 0.05).astype(int)] = 100
    differing = np.argwhere(expected != grid.data)
    assert np.all(grid.data[expected == 100] == 100)
    assert len(differing) <= 5, "only cells that a corner of the wall merely grazes"
