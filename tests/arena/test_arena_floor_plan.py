"""Arenas out of drawn plans: rectangles that are the dark cells, and a place for the guards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

from midnet_bench.arena.arena import MOST_BLOCKS, Arena, checked_arena
from midnet_bench.arena.drawn_plan import dark_cells, specks, without_specks
from midnet_bench.arena.floor_plan import (
    arena_of,
    arena_yaml,
    blocks_of,
    centred,
    coarser,
    cropped,
    rectangles,
    without_cracks,
)
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M, robot_starts
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.arena.starts import start_of_guards
from midnet_bench.errors import InputError
from midnet_bench.io.checked_yaml import parsed_yaml

ROOM = np.zeros((50, 70), dtype=np.bool_)
ROOM[:2] = ROOM[-2:] = True
ROOM[:, :2] = ROOM[:, -2:] = True


def drawn_arena(dark: np.ndarray, resolution_m: float = 0.05) -> Arena:
    grid = centred(dark, resolution_m)
    blocks = blocks_of(grid)
    assert blocks is not None
    return arena_of(grid, blocks, "drawn")


def written(arena: Arena) -> str:
    return arena_yaml(arena, ["From nowhere."])


@pytest.mark.slow
@given(dark=arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12)))
def test_rectangles_cover_the_dark_cells_and_no_other_and_none_could_grow(dark: np.ndarray) -> None:
    covered = np.zeros_like(dark)
    for low, left, high, right in rectangles(dark):
        assert dark[low:high, left:right].all()
        assert not covered[low:high, left:right].all()
        covered[low:high, left:right] = True
        edges = (
            dark[low - 1 : low, left:right],
            dark[high : high + 1, left:right],
            dark[low:high, left - 1 : left] if left else dark[low:high, :0],
            dark[low:high, right : right + 1],
        )
        sides = (low > 0, high < dark.shape[0], left > 0, right < dark.shape[1])
        assert not any(side and edge.all() for side, edge in zip(sides, edges, strict=True))
    assert np.array_equal(covered, dark)


def test_plain_walls_take_a_rectangle_each() -> None:
    dark = ROOM.copy()
    dark[2:30, 40:43] = True
    assert len(list(rectangles(dark))) == 5


@pytest.mark.parametrize("resolution_m", [0.02, 0.05, 0.11])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_arena_drawn_again_is_the_plan(resolution_m: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    dark = ROOM.copy()
    for _ in range(12):
        row, column = rng.integers(0, 45, 2)
        dark[row : row + rng.integers(1, 4), column : column + rng.integers(1, 9)] = True
    arena = drawn_arena(dark, resolution_m)
    assert checked_arena(parsed_yaml(written(arena), "drawn"), "drawn") == arena
    grid = render_exact(arena, resolution_m)
    margin = [(whole - part) // 2 for whole, part in zip(grid.data.shape, dark.shape, strict=True)]
    assert margin == [round(1.0 / resolution_m)] * 2 or resolution_m == 0.11
    if resolution_m != 0.11:  # a metre of ground is no whole number of cells then
        inside = grid.data[margin[0] : margin[0] + 50, margin[1] : margin[1] + 70]
        assert np.array_equal(inside == 100, dark)
        assert (grid.data == 100).sum() == dark.sum()
    points = np.argwhere(np.ones_like(dark))[:, ::-1] + 0.5
    points = points * resolution_m - np.array([35.0, 25.0]) * resolution_m
    inside_one = np.min([solid.distance_to(points) for solid in arena.wall_solids()], axis=0) < 0.0
    assert np.array_equal(inside_one, dark.reshape(-1))


def test_guards_start_in_the_largest_room_not_around_the_building() -> None:
    dark = np.pad(ROOM, 30)  # much white paper around it
    dark[30:80, 45] = True  # a small room on the left
    x, y = start_of_guards(drawn_arena(dark), 5).center_m
    assert -1.0 < x < 1.75
    assert abs(y) < 0.7
    dark = np.pad(ROOM, 10)
    dark[10:12, 30:60] = False  # with a door in its wall it is still the place
    assert abs(start_of_guards(drawn_arena(dark), 5).center_m[1]) < 1.0


def room_of(width_m: float, height_m: float) -> Arena:
    dark = np.ones((round(height_m / 0.05) + 4, round(width_m / 0.05) + 4), np.bool_)
    dark[2:-2, 2:-2] = False
    return drawn_arena(dark)


@pytest.mark.parametrize(
    ("sides_m", "team", "spacing_m"),
    [((4.0, 4.0), 5, 0.6), ((1.3, 1.3), 5, 0.45), ((1.1, 1.1), 5, 0.3), ((1.2, 0.85), 3, 0.3)],
)
def test_guards_start_as_wide_apart_as_there_is_room(
    sides_m: tuple[float, float], team: int, spacing_m: float
) -> None:
    arena = room_of(*sides_m)
    found = start_of_guards(arena, 5)
    assert (found.team, found.spacing_m) == (team, spacing_m)
    arena = arena.model_copy(update={"robots": found})
    for size in range(1, found.team + 1):
        starts = np.array([(pose.x, pose.y) for pose in robot_starts(arena, size)])
        assert min(solid.distance_to(starts).min() for solid in arena.wall_solids()) >= ROBOT_CLEARANCE_M
    assert start_of_guards(arena, 1).team == 1


def test_a_team_starts_where_it_fits_and_not_at_the_middle_of_a_narrow_room() -> None:
    dark = np.ones((100, 200), np.bool_)
    dark[45:65, 2:-2] = False  # a corridor of 1 m
    dark[20:90, 150:-2] = False  # and a hall at its end
    found = start_of_guards(drawn_arena(dark), 5)
    assert (found.team, found.spacing_m) == (5, 0.6)
    assert found.center_m[0] > 2.5


@pytest.mark.parametrize(
    ("sides_m", "said"),
    [((0.2, 0.2), "no floor in it that is 0.3 m wide"), ((5.0, 0.6), "no floor in it is 0.8 m")],
)
def test_no_room_for_a_guard_is_told(sides_m: tuple[float, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        start_of_guards(room_of(*sides_m), 5)


def test_coarser_cells_are_set_where_any_of_theirs_is() -> None:
    dark = np.zeros((5, 7), np.bool_)
    dark[4, 6] = dark[0, 1] = True
    grid = coarser(centred(dark, 0.1), 3)
    assert grid.data.tolist() == [[True, False, False], [False, False, True]]
    assert (grid.resolution, grid.origin) == (pytest.approx(0.3), centred(dark, 0.1).origin)


def test_floor_that_is_closed_and_narrow_becomes_wall() -> None:
    dark = ROOM.copy()
    dark[10:15, 10:40] = True
    dark[12, 12:38] = False  # a crack
    dark[30:46, 10:26] = True
    dark[31:45, 11:25] = False  # a closet of 0.7 m
    dark[20:24, 60:70] = True
    dark[21:23, 61:70] = False  # open at the grid's edge
    filled = without_cracks(centred(dark, 0.05)).data
    assert np.argwhere(filled & ~dark).tolist() == [[12, column] for column in range(12, 38)]


def test_what_is_dark_is_wall_and_what_is_transparent_is_floor() -> None:
    pixels = np.zeros((2, 3, 4), np.uint8)
    pixels[0, 0] = (127, 127, 127, 255)
    pixels[0, 1] = (128, 128, 128, 255)
    pixels[1, 2] = (255, 60, 60, 255)
    grid = dark_cells(pixels, 0.1)
    assert grid.data.tolist() == [[False, False, True], [True, False, False]]  # the lowest row first
    assert grid.extent == pytest.approx((-0.15, -0.1, 0.15, 0.1))
    assert dark_cells(np.array([[[0], [255]]], np.uint8), 0.1).data.tolist() == [[True, False]]


@pytest.mark.parametrize(
    ("dark", "said"),
    [
        (np.zeros((20, 20), np.bool_), "no wall"),
        (np.ones((20, 20), np.bool_), "no floor"),
        (np.ones((20, 4000), np.bool_), "it is 200 x 1 m large, and an arena has at most 198 m a side"),
    ],
)
def test_a_plan_of_which_no_arena_can_be_made(dark: np.ndarray, said: str) -> None:
    grid = centred(dark, 0.05)
    with pytest.raises(InputError, match=said):
        start_of_guards(arena_of(grid, blocks_of(grid) or [], "drawn"), 5)


def test_more_rectangles_than_an_arena_may_have_are_none() -> None:
    assert blocks_of(centred(np.indices((300, 300)).sum(axis=0) % 2 == 0, 0.05)) is None
    assert len(blocks_of(centred(np.indices((100, 100)).sum(axis=0) % 2 == 0, 0.05)) or []) == MOST_BLOCKS


def test_an_arena_needs_a_wall_and_blocks_that_are_some() -> None:
    values = parsed_yaml(written(drawn_arena(ROOM)), "drawn")
    for blocks, said in (
        ([], "walls: there is none"),
        ([[1.0, 0.0, 0.0, 1.0]], "blocks.0: give x_min, y_min, x_max, y_max"),
        ([[0.0, 0.0, 9.0, 1.0]], "blocks.0: it leaves the plane"),
        ([[0.0, 0.0, 1.0]], "blocks.0"),
    ):
        with pytest.raises(InputError, match=said):
            checked_arena({**values, "blocks": blocks}, "drawn")


def test_an_arena_without_blocks_is_written_as_ever() -> None:
    values = parsed_yaml(written(drawn_arena(ROOM)), "drawn")
    arena = checked_arena({**values, "blocks": [], "walls": [[[-1, 0], [1, 0]]]}, "drawn")
    assert "blocks" not in arena.model_dump_json()
    assert "blocks" in checked_arena(values, "drawn").model_dump_json()


def test_specks_are_the_small_pieces_that_touch_no_other_the_largest_first() -> None:
    dark = ROOM.copy()
    dark[20, 30:34] = True  # 0.2 m
    dark[30, 10] = dark[31, 11] = True  # one piece, corner to corner
    dark[2:6, 50] = True  # part of the wall below
    grid = centred(dark, 0.05)
    found = specks(grid, 0.2)
    assert [round(speck.size_m, 6) for speck in found] == [0.2, 0.1]
    np.testing.assert_allclose(found[0].at, (-0.15, -0.225), atol=1e-9)
    assert len(specks(grid, 0.15)) == 1
    kept = without_specks(grid, 0.2).data
    assert np.array_equal(
        np.argwhere(dark & ~kept), [(20, 30), (20, 31), (20, 32), (20, 33), (30, 10), (31, 11)]
    )
    assert np.array_equal(without_specks(grid, 0.0).data, dark)


def test_a_blank_margin_is_cropped_and_the_rest_is_centred() -> None:
    grid = cropped(centred(np.pad(ROOM, ((3, 9), (20, 0))), 0.05))
    assert np.array_equal(grid.data, ROOM)
    assert grid.origin == pytest.approx((-70 * 0.025, -50 * 0.025))
    blank = centred(np.zeros((4, 4), np.bool_), 0.05)
    assert cropped(blank) is blank
