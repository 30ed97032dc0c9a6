"""Arenas out of drawn plans: rectangles that are the dark cells, and a place for the guards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

from midnet_bench.arena.arena import MOST_BLOCKS, Arena, checked_arena
from midnet_bench.arena.floor_plan import (
    arena_yaml,
    centred,
    cropped,
    dark_cells,
    rectangles,
    specks,
    start_of_guards,
    without_specks,
)
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.errors import InputError
from midnet_bench.io.checked_yaml import parsed_yaml

ROOM = np.zeros((50, 70), dtype=np.bool_)
ROOM[:2] = ROOM[-2:] = True
ROOM[:, :2] = ROOM[:, -2:] = True


def arena_of(dark: np.ndarray, resolution_m: float = 0.05) -> Arena:
    text = arena_yaml(centred(dark, resolution_m), "drawn", ["From nowhere."])
    return checked_arena(parsed_yaml(text, "drawn"), "drawn")


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
    arena = arena_of(dark, resolution_m)
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
    x, y = start_of_guards(centred(dark, 0.05))
    assert -1.0 < x < 1.75
    assert abs(y) < 0.7
    dark = np.pad(ROOM, 10)
    dark[10:12, 30:60] = False  # with a door in its wall it is still the place
    assert abs(start_of_guards(centred(dark, 0.05))[1]) < 1.0


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
        (np.indices((300, 300)).sum(axis=0) % 2 == 0, f"more than {MOST_BLOCKS} rectangles"),
    ],
)
def test_a_plan_of_which_no_arena_can_be_made(dark: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said):
        arena_of(dark)


def test_an_arena_needs_a_wall_and_blocks_that_are_some() -> None:
    values = parsed_yaml(arena_yaml(centred(ROOM, 0.05), "drawn", []), "drawn")
    for blocks, said in (
        ([], "walls: there is none"),
        ([[1.0, 0.0, 0.0, 1.0]], "blocks.0: give x_min, y_min, x_max, y_max"),
        ([[0.0, 0.0, 9.0, 1.0]], "blocks.0: it leaves the plane"),
        ([[0.0, 0.0, 1.0]], "blocks.0"),
    ):
        with pytest.raises(InputError, match=said):
            checked_arena({**values, "blocks": blocks}, "drawn")


def test_an_arena_without_blocks_is_written_as_ever() -> None:
    values = parsed_yaml(arena_yaml(centred(ROOM, 0.05), "drawn", []), "drawn")
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
