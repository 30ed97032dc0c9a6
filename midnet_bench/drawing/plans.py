"""``draw_plan``: what of a drawn plan became wall, and what was left out."""

from collections.abc import Sequence

import numpy as np

from midnet_bench.arena.arena import Arena
from midnet_bench.arena.drawn_plan import Kind, Plan
from midnet_bench.arena.floor_plan import coarser
from midnet_bench.arena.layout import robot_starts
from midnet_bench.drawing.painter import MARGIN_M, SWATCH, Canvas, Entry, Labels, Picture, swatch
from midnet_bench.drawing.palette import (
    DETECTION,
    FALSE_DETECTION,
    GROUND,
    GUARD,
    GUARD_FAINT,
    INK,
    INTRUDER,
    OUT_OF_RANGE,
    RGB,
    WHITE,
    WOOD,
)
from midnet_bench.drawing.stills import LABEL_PX, plot_page
from midnet_bench.geometry import Box, Point
from midnet_bench.grid import OccupancyGrid

LOOKS: dict[Kind, tuple[RGB, str]] = {
    Kind.FLOOR: (WHITE, "floor"),
    Kind.WALL: (INK, "wall"),
    Kind.FILLED: (WOOD, "wall: closed all around, too narrow"),
    Kind.COLOURED: (INTRUDER, "left out: in colour"),
    Kind.THIN: (GUARD_FAINT, "left out: thin"),
    Kind.SPECK: (DETECTION, "left out: small piece"),
    Kind.BESIDE: ((230, 159, 0), "left out: beside the building"),
    Kind.PALE: (OUT_OF_RANGE, "left out: lighter than the threshold"),
}
"""what a pixel looks like, and what the legend calls it"""
_LINES = (Kind.FLOOR, Kind.PALE, Kind.FILLED, Kind.WALL, Kind.BESIDE, Kind.SPECK, Kind.THIN, Kind.COLOURED)
"""where several pixels share one of the picture, the last of these shows"""
_DOOR_M = 0.25  # radius of the circle about a door that is too narrow


def draw_plan(plan: Plan, arena: Arena, narrow: Sequence[tuple[Point, float]]) -> Picture:
    """A plan's pixels by what became of them, where the guards start, and doors that no robot passes.

    ``narrow``: such a door's place, metres, map frame, and its width, metres.
    """
    view = Box(*plan.kinds.extent).shrunk(-MARGIN_M)
    found = {Kind(value) for value in np.unique(plan.kinds.data)}
    entries: list[Entry] = [swatch(*LOOKS[kind], INK) for kind in LOOKS if kind in found]
    entries += [
        (lambda canvas: canvas.dashed_box(SWATCH, GUARD), "edge of what is guarded"),
        (lambda canvas: canvas.circle((0.0, 0.0), 5.0 / canvas.scale, GUARD, -1), "guards' starts"),
    ]
    if narrow:
        entries.append(
            (lambda canvas: canvas.circle((0.0, 0.0), 7.0 / canvas.scale, FALSE_DETECTION, 2), "too narrow")
        )

    def paint(picture: Picture) -> None:
        picture[:] = GROUND
        canvas = Canvas(picture, view, LABEL_PX)
        canvas.cells(_thinned(plan.kinds, canvas.scale), [LOOKS[kind][0] for kind in Kind])
        half_x, half_y = arena.enclosure_m[0] / 2.0, arena.enclosure_m[1] / 2.0
        canvas.dashed_box(Box(-half_x, -half_y, half_x, half_y), GUARD)
        labels = Labels(canvas)
        for pose in robot_starts(arena, arena.robots.team):
            canvas.circle((pose.x, pose.y), max(0.1, 3.0 / canvas.scale), GUARD, -1)
        for at, width_m in narrow:
            canvas.circle(at, max(_DOOR_M, 8.0 / canvas.scale), FALSE_DETECTION, 2)
            labels.put(at, f"{width_m:.2f} m", FALSE_DETECTION, 22.0)

    return plot_page(view, [f"{arena.name}: what became wall"], entries, paint)


def _thinned(kinds: OccupancyGrid, scale: float) -> OccupancyGrid:
    """Cells no smaller than the picture's pixels: of several, what is drawn, not what is blank."""
    times = int(1.0 / (kinds.resolution * scale))
    if times < 2:
        return kinds
    ranks = np.empty(len(Kind), np.uint8)
    ranks[[*_LINES]] = np.arange(len(_LINES))
    shown = coarser(kinds.with_data(ranks[kinds.data]), times)
    return shown.with_data(np.array(_LINES, np.uint8)[shown.data])
