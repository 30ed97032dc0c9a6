"""What of a drawn plan became wall, as a picture."""

import cv2
import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.drawn_plan import Kind, Plan
from midnet_bench.arena.floor_plan import centred
from midnet_bench.drawing.painter import MARGIN_M
from midnet_bench.drawing.palette import FALSE_DETECTION, GUARD, RGB
from midnet_bench.drawing.plans import LOOKS, draw_plan
from midnet_bench.drawing.stills import plot_area
from midnet_bench.geometry import Box


@pytest.fixture
def arena() -> Arena:
    return load_arena("map1")


def plan_of(kinds: np.ndarray, resolution_m: float) -> Plan:
    grid = centred(kinds.astype(np.uint8), resolution_m)
    return Plan(grid, grid.with_data(grid.data == Kind.WALL))


def columns_with(color: RGB, plan: Plan, page: np.ndarray) -> np.ndarray:
    """Which columns of the picture's middle rows have a pixel of this colour."""
    rows, columns = plot_area(Box(*plan.kinds.extent).shrunk(-MARGIN_M), 1)
    height = rows.stop - rows.start
    middle = slice(rows.start + height // 2 - 60, rows.start + height // 2 - 40)
    return np.all(page[middle, columns] == color, axis=2).any(axis=0)


@pytest.mark.parametrize("pixels", [400, 4000], ids=["small", "large"])
@pytest.mark.parametrize("kind", [Kind.THIN, Kind.COLOURED, Kind.PALE, Kind.WALL])
def test_a_line_of_one_pixel_is_seen_in_a_plan_of_any_size(kind: Kind, pixels: int, arena: Arena) -> None:
    kinds = np.full((pixels, pixels), Kind.FLOOR)
    kinds[:, pixels // 4 + 1] = kind
    plan = plan_of(kinds, 8.0 / pixels)
    shown = columns_with(LOOKS[kind][0], plan, draw_plan(plan, arena, []))
    share = np.flatnonzero(shown) / len(shown)
    assert share.size
    assert share == pytest.approx((2.0 + MARGIN_M) / (8.0 + 2.0 * MARGIN_M), abs=0.01)


def test_a_door_that_is_too_narrow_is_marked_at_its_place(arena: Arena) -> None:
    plan = plan_of(np.full((80, 80), Kind.FLOOR), 0.1)
    rows, columns = plot_area(Box(*plan.kinds.extent).shrunk(-MARGIN_M), 1)
    bare, marked = (draw_plan(plan, arena, narrow) for narrow in ([], [((2.0, -1.0), 0.22)]))
    red = [np.all(page[rows, columns] == FALSE_DETECTION, axis=2) for page in (bare, marked)]
    assert not red[0].any()
    found_rows, found_columns = np.nonzero(red[1])
    scale = (columns.stop - columns.start) / (8.0 + 2.0 * MARGIN_M)
    assert found_columns.min() / scale - 4.0 - MARGIN_M == pytest.approx(2.0 - 0.25, abs=0.06)
    assert 4.0 + MARGIN_M - found_rows.max() / scale == pytest.approx(-1.0 - 0.25, abs=0.06)


def test_the_legend_names_the_edge_of_what_is_guarded_beside_the_starts(arena: Arena) -> None:
    plan = plan_of(np.full((80, 80), Kind.FLOOR), 0.1)
    page = draw_plan(plan, arena, [])
    page[plot_area(Box(*plan.kinds.extent).shrunk(-MARGIN_M), 1)] = 255
    signs, _ = cv2.connectedComponents(np.all(page == GUARD, axis=2).astype(np.uint8))
    assert signs - 1 > 4  # a dot for the starts, and dashes
