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
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Floats, Scene, Setup, Truth
from midnet_bench.drawing.signs import DUPLICATE, FALSE_POSITIVE, MISS, NO_ERROR, TRUE_POSITIVE
from midnet_bench.geometry import Box, Pose2D

Mark = Callable[[Canvas, float, float], None]
"""draws what a legend explains on a canvas of one pixel a metre, about (x, y)"""
Entry = tuple[Mark, str]
MARK_PX = 7.0
"""half a side"""


def of_world(setup: Setup, scenes: Sequence[Scene] | None = None) -> list[Entry]:
    """The marks of the true world, in the order of a legend.

    Args:
        setup: of the trial.
        scenes: that are shown; None for a whole trial, which may show all that its setup allows.
    """
    bodies: list[tuple[Mark, str, bool]] = [
        (_guard, "guard", bool(setup.guards)),
        (_intruder, "mobile intruder", bool(setup.mobile_intruders)),
        (_stationary, "stationary intruder", bool(setup.plan.stationary)),
        (_legs, "person (two legs) or thing", bool(setup.other_intruders)),
    ]
    have_paths = scenes is None or any(robot.goal for scene in scenes for robot in scene.robots)
    path = _paths if setup.mobile_intruders else _path
    return [
        *[(mark, text) for mark, text, is_there in bodies if is_there],
        *signs(scenes),
        *([(path, "path and goal")] if have_paths else []),
        *([(_unknown, "unknown on the map")] if setup.plan.ground is not None else []),
        reach(setup),
        *returns(setup),
    ]


def signs(scenes: Sequence[Scene] | None) -> list[Entry]:
    """The signs about intruders without a detection."""
    truths = [truth for scene in scenes or () for truth in scene.truths]
    entries: list[tuple[Mark, str, bool]] = [
        (_missed, MISS, any(truth.is_missed for truth in truths)),
        (_out_of_range, NO_ERROR, any(truth.is_out_of_range for truth in truths)),
    ]
    return [(mark, text) for mark, text, is_there in entries if is_there or scenes is None]


def of_detections(scenes: Sequence[Scene] | None = None, numbered: bool = False) -> list[Entry]:
    """The boxes of detections; ``numbered`` where they have their guards' numbers."""
    boxes = [found for scene in scenes or () for found in scene.detections]
    is_labelled = scenes is None or any(scene.is_labelled for scene in scenes)
    own = (TRUE_POSITIVE if is_labelled else "detection") + ", with its guard's number" * numbered
    entries: list[tuple[Mark, str, bool]] = [
        (_detection, own, any(not (found.is_false or found.is_further) for found in boxes)),
        (_further, DUPLICATE, any(found.is_further for found in boxes)),
        (_false, FALSE_POSITIVE, any(found.is_false for found in boxes)),
    ]
    return [(mark, text) for mark, text, is_there in entries if is_there or scenes is None]


def of_grids() -> list[Entry]:
    """The shades of the prior map and of the guards' grids."""
    return [
        (_shade(FOREGROUND), "seen, not on the prior map (D)"),
        (_shade(COMMON), "seen, on the prior map (C)"),
        (_shade(INFLATED), "margin of the prior map (Eq. 1)"),
        (_shade(WALL), "wall on the prior map"),
    ]


def reach(setup: Setup) -> Entry:
    """The local costmap and the usable range of a guard."""
    return _reach, f"costmap {setup.local_size_m:g} m, LiDAR {setup.usable_range_m:g} m"


def returns(setup: Setup) -> list[Entry]:
    """The returns of scans, if the setup shows them."""
    return [(_returns, "LiDAR returns")] if setup.shows_scans else []


def outline(color: RGB, text: str) -> Entry:
    """A thin outline."""
    return lambda canvas, x, y: canvas.polygon(_swatch(x, y), None, color), text


def swatch(fill: RGB, text: str, edge: RGB | None = None) -> Entry:
    """A filled rectangle."""
    return lambda canvas, x, y: canvas.polygon(_swatch(x, y), fill, edge), text


WALLS = swatch(WOOD, "wall", WOOD_EDGE)


def write_legend(
    page: Picture, entries: Sequence[Entry], left: int, top: int, row_px: int, size_px: int
) -> None:
    """Write entries below each other; the middle of the first is at ``top``."""
    height, width = page.shape[:2]
    canvas = Canvas(page, Box(0.0, -float(height), float(width), 0.0))
    for row, (mark, text) in enumerate(entries):
        middle = top + row_px * row
        mark(canvas, left + 8.0, -float(middle))
        write(page, left + 29, middle - round(0.7 * size_px), text, size_px, INK)


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


def _guard(canvas: Canvas, x: float, y: float) -> None:
    paint_robot(canvas, Pose2D(x + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, GUARD)


def _intruder(canvas: Canvas, x: float, y: float) -> None:
    paint_robot(canvas, Pose2D(x + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, INTRUDER)


def _stationary(canvas: Canvas, x: float, y: float) -> None:
    canvas.polygon(_swatch(x, y), INTRUDER_FAINT, INTRUDER, 2)


def _legs(canvas: Canvas, x: float, y: float) -> None:
    for leg in (-4.0, 4.0):
        canvas.circle((x + leg, y), 3.0, INTRUDER, -1)


def _path(canvas: Canvas, x: float, y: float) -> None:
    paint_path(canvas, (x + 9.0, y), np.array([(x - 14.0, y), (x + 7.0, y)]), GUARD, True)


def _paths(canvas: Canvas, x: float, y: float) -> None:
    paint_path(canvas, (x - 6.0, y), np.array([(x - 14.0, y), (x - 8.0, y)]), GUARD, True)
    paint_path(canvas, (x + 9.0, y), np.array([(x + 1.0, y), (x + 7.0, y)]), INTRUDER, False)


def _missed(canvas: Canvas, x: float, y: float) -> None:
    paint_sign(canvas, Truth([np.array([(x, y)])], False, True), 0.0, MARK_PX)


def _out_of_range(canvas: Canvas, x: float, y: float) -> None:
    paint_sign(canvas, Truth([np.array([(x, y)])], False, False), 0.0, MARK_PX)


def _unknown(canvas: Canvas, x: float, y: float) -> None:
    canvas.polygon(_swatch(x, y), GROUND)


def _reach(canvas: Canvas, x: float, y: float) -> None:
    canvas.circle((x, y), MARK_PX - 2.0, GUARD_RANGE)
    canvas.box(Box.square(x, y, 2.0 * MARK_PX), GUARD)


def _returns(canvas: Canvas, x: float, y: float) -> None:
    paint_scans(canvas, [np.array([(x - 6.0, y), (x, y), (x + 6.0, y)])])


def _detection(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), False)


def _further(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), False, is_further=True)


def _false(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), True)


def _shade(code: int) -> Mark:
    red, green, blue = SHADES[code].tolist()
    return lambda canvas, x, y: canvas.polygon(_swatch(x, y), (red, green, blue))


def _swatch(x: float, y: float) -> Floats:
    return np.array([(x - 8.0, y - 6.0), (x + 8.0, y - 6.0), (x + 8.0, y + 6.0), (x - 8.0, y + 6.0)])
