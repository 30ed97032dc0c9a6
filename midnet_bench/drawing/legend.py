"""What the marks of a trial's pictures mean: one legend for stills, films and storyboards."""

from collections.abc import Callable, Sequence

import numpy as np

from midnet_bench.drawing.canvas import (
    Canvas,
    Picture,
    paint_detection,
    paint_path,
    paint_robot,
    paint_scans,
    paint_sign,
    text_mask,
    write,
)
from midnet_bench.drawing.palette import (
    GROUND,
    GUARD,
    GUARD_RANGE,
    INK,
    INTRUDER,
    INTRUDER_FAINT,
    RGB,
    WOOD,
    WOOD_EDGE,
)
from midnet_bench.drawing.panels import COMMON, FOREGROUND, INFLATED, SHADES, WALL
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Detection, Scene, Setup, Truth
from midnet_bench.drawing.signs import DUPLICATE, FALSE_POSITIVE, MISS, NO_ERROR, TRUE_POSITIVE
from midnet_bench.geometry import Box, Pose2D

Mark = Callable[[Canvas], object]
"""draws what a legend explains on a canvas of one pixel a metre, about its origin"""
Entry = tuple[Mark, str]
MARK_PX = 7.0
"""half a side"""
SQUARE = Box.square(0.0, 0.0, 2.0 * MARK_PX)
SWATCH = Box(-8.0, -6.0, 8.0, 6.0)


def of_world(setup: Setup, scenes: Sequence[Scene] | None = None) -> list[Entry]:
    """The marks of the true world, in the order of a legend.

    Args:
        setup: of the trial.
        scenes: that are shown; None for a whole trial, which may show all that its setup allows.
    """
    have_paths = scenes is None or any(robot.goal for scene in scenes for robot in scene.robots)
    return [
        *_if(setup.guards, burger(GUARD, 4.0), "guard"),
        *_if(setup.mobile_intruders, burger(INTRUDER, 4.0), "mobile intruder"),
        *_if(setup.plan.stationary, _swatch(INTRUDER_FAINT, INTRUDER, 2), "stationary intruder"),
        *_if(setup.other_intruders, _legs, "person (two legs) or thing"),
        *signs(scenes),
        *_if(have_paths, _paths if setup.mobile_intruders else _path, "path and goal"),
        *_if(setup.plan.ground is not None, _swatch(GROUND), "unknown on the map"),
        reach(setup),
        *returns(setup),
    ]


def signs(scenes: Sequence[Scene] | None) -> list[Entry]:
    """The signs about intruders without a detection."""
    truths = [truth for scene in scenes or () for truth in scene.truths]
    is_missed = scenes is None or any(truth.is_missed for truth in truths)
    is_out_of_range = scenes is None or any(truth.is_out_of_range for truth in truths)
    return [*_if(is_missed, _sign(True), MISS), *_if(is_out_of_range, _sign(False), NO_ERROR)]


def of_detections(scenes: Sequence[Scene] | None = None, numbered: bool = False) -> list[Entry]:
    """The boxes of detections; ``numbered`` where they have their guards' numbers."""
    boxes = [found for scene in scenes or () for found in scene.detections]
    shown = {(found.is_false, found.is_further) for found in boxes}
    is_labelled = scenes is None or any(scene.is_labelled for scene in scenes)
    own = (TRUE_POSITIVE if is_labelled else "detection") + ", with its guard's number" * numbered
    kinds = {(False, False): own, (False, True): DUPLICATE, (True, False): FALSE_POSITIVE}
    return [
        entry
        for kind, text in kinds.items()
        for entry in _if(scenes is None or kind in shown, _detection(*kind), text)
    ]


def of_grids() -> list[Entry]:
    """The shades of the prior map and of the guards' grids."""
    texts = {
        FOREGROUND: "seen, not on the prior map (D)",
        COMMON: "seen, on the prior map (C)",
        INFLATED: "margin of the prior map (Eq. 1)",
        WALL: "wall on the prior map",
    }
    return [swatch(SHADES[code], text) for code, text in texts.items()]


def reach(setup: Setup) -> Entry:
    """The local costmap and the usable range of a guard."""
    return _reach, f"costmap {setup.local_size_m:g} m, LiDAR {setup.usable_range_m:g} m"


def returns(setup: Setup) -> list[Entry]:
    """The returns of scans, if the setup shows them."""
    points = np.array([(-6.0, 0.0), (0.0, 0.0), (6.0, 0.0)])
    return _if(setup.shows_scans, lambda canvas: paint_scans(canvas, [points]), "LiDAR returns")


def outline(color: RGB, text: str) -> Entry:
    """A thin outline."""
    return lambda canvas: canvas.box(SWATCH, color), text


def swatch(fill: RGB, text: str, edge: RGB | None = None) -> Entry:
    """A filled rectangle."""
    return _swatch(fill, edge), text


def write_legend(
    page: Picture, entries: Sequence[Entry], left: int, top: int, row_px: int, size_px: int
) -> None:
    """Write entries below each other; the middle of the first is at ``top``."""
    height, width = page.shape[:2]
    for row, (mark, text) in enumerate(entries):
        x, y = left + 8.0, float(top + row_px * row)
        mark(Canvas(page, Box(-x, y - height, width - x, y)))
        write(page, left + 29, top + row_px * row - round(0.7 * size_px), text, size_px, INK)


def beside(entries: Sequence[Entry], left: int, right: int, size_px: int) -> list[tuple[Entry, int, int]]:
    """Each entry with its pixels from the left and its row: as many in a row as there is room for."""
    placed, at, row = [], left, 0
    for entry in entries:
        wide = 52 + text_mask(entry[1], size_px).shape[1]
        if at + wide > right and at > left:
            at, row = left, row + 1
        placed.append((entry, at, row))
        at += wide
    return placed


def write_beside(
    page: Picture, placed: Sequence[tuple[Entry, int, int]], top: int, row_px: int, size_px: int
) -> None:
    """Write what :func:`beside` placed; the middle of its first row is at ``top``."""
    for entry, left, row in placed:
        write_legend(page, [entry], left, top + row_px * row, 0, size_px)


def burger(color: RGB, ahead_px: float = 0.0) -> Mark:
    """A Burger, its axle ``ahead_px`` on the right."""
    return lambda canvas: paint_robot(canvas, Pose2D(ahead_px, 0.0, 0.0), 18.0 / BURGER_LENGTH_M, color)


def _if(is_there: object, mark: Mark, text: str) -> list[Entry]:
    return [(mark, text)] if is_there else []


def _swatch(fill: RGB, edge: RGB | None = None, width: int = 1) -> Mark:
    return lambda canvas: canvas.box(SWATCH, edge, width, fill)


def _sign(in_range: bool) -> Mark:
    truth = Truth([np.zeros((1, 2))], False, in_range)
    return lambda canvas: paint_sign(canvas, truth, 0.0, MARK_PX)


def _detection(is_false: bool, is_further: bool) -> Mark:
    return lambda canvas: paint_detection(canvas, Detection(SQUARE, 0, is_false, is_further))


def _legs(canvas: Canvas) -> None:
    for leg in (-4.0, 4.0):
        canvas.circle((leg, 0.0), 3.0, INTRUDER, -1)


def _path(canvas: Canvas) -> None:
    paint_path(canvas, (9.0, 0.0), np.array([(-14.0, 0.0), (7.0, 0.0)]), GUARD, True)


def _paths(canvas: Canvas) -> None:
    paint_path(canvas, (-6.0, 0.0), np.array([(-14.0, 0.0), (-8.0, 0.0)]), GUARD, True)
    paint_path(canvas, (9.0, 0.0), np.array([(1.0, 0.0), (7.0, 0.0)]), INTRUDER, False)


def _reach(canvas: Canvas) -> None:
    canvas.circle((0.0, 0.0), MARK_PX - 2.0, GUARD_RANGE)
    canvas.box(SQUARE, GUARD)


WALLS = swatch(WOOD, "wall", WOOD_EDGE)
