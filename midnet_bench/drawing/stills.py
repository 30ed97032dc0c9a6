"""Pictures of one instant: an arena, the grids of MIDNet, its detections, a map."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from midnet_bench.drawing import legend
from midnet_bench.drawing.canvas import (
    OUTSIDE,
    Canvas,
    Picture,
    blank_page,
    paint_grid,
    paint_removed,
    text_mask,
    write,
)
from midnet_bench.drawing.growth import CELLS, MapSnapshot, color_of, paint_map
from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, GUARD_RANGE, INK, INTRUDER, TRUTH
from midnet_bench.drawing.panels import MARGIN_M, DetectionPanel, WorldPanel
from midnet_bench.drawing.scene import Floats, Scene, Setup
from midnet_bench.geometry import Box, Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Explanation

PLOT_PX, LABEL_PX, TEXT_PX, TITLE_PX, ROW_PX = 940, 15, 15, 20, 26
LEFT_PX, BOTTOM_PX, GAP_PX, LEGEND_PX = 52, 46, 18, 335
STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
TICK_GAP_PX = 70.0
"""two numbers of an axis are no nearer"""
MAP_MARGIN_M = 0.3
TILE_PX, TILE_GAP_PX = 300, 16
COLUMNS = (
    "A: local grid (Eq. 1), boxes from D",
    "B: prior map, cropped",
    "C: occupied in both (Eq. 5)",
    "D: occupied in A only (Eq. 6)",
)


def draw_arena(setup: Setup, scene: Scene, faults: Mapping[int, Point] | None = None) -> Picture:
    """Walls, intruders, guards with their local costmap and LiDAR range, paths, goals and detections.

    ``faults``: what is wrong with the arena by its number, where it is, metres, map frame.
    """
    view = setup.plan.view(MARGIN_M)
    entries = [legend.WALLS, *legend.of_world(setup, [scene]), *legend.of_detections([scene])]
    if faults:
        entries.append((lambda canvas: canvas.cross((0.0, 0.0), FALSE_DETECTION), "fault, by its number"))

    def paint(picture: Picture) -> None:
        height, width = picture.shape[:2]
        WorldPanel(setup, width, height, LABEL_PX).paint(picture, scene)
        canvas = Canvas(picture, view, LABEL_PX)
        for number, at in (faults or {}).items():
            canvas.cross(at, FALSE_DETECTION)
            canvas.label(at, str(number), FALSE_DETECTION, 11, -11)

    return _page(view, [f"{setup.plan.title}, t = {scene.time_s:.1f} s"], entries, paint)


def draw_detections(setup: Setup, scene: Scene) -> Picture:
    """The fused detections on the prior map and the guards' grids, with the true outlines thin underneath.

    Both kinds of error stand out: a detection that touches no intruder, and an intruder in range that no
    detection touches. One that is out of range has a quieter sign.
    """
    entries = [
        *legend.of_detections([scene], numbered=True),
        *legend.signs([scene]),
        *([legend.outline(INTRUDER, "true outline of an intruder")] if scene.truths else []),
        *([legend.outline(GUARD, "true outline of a guard")] if scene.guards else []),
        *([legend.reach(setup)] if scene.guards else []),
        *legend.returns(setup),
        *legend.of_grids(),
    ]
    title = f"{setup.plan.title}: detections of frame {scene.frame}, t = {scene.time_s:.1f} s"
    panel = DetectionPanel(setup, LABEL_PX, shows_outlines=True)
    view = setup.plan.view(MARGIN_M)
    return _page(view, [title, scene.counter], entries, lambda picture: panel.paint(picture, scene))


def draw_map(
    grid: OccupancyGrid, paths: Sequence[Floats], title: str, walls: Sequence[Floats] = ()
) -> Picture:
    """The known part of a map, and all true walls, with each robot's path on it, metres of the map frame.

    Args:
        grid: int8, 100 occupied, 0 free, -1 unknown.
        paths: of each robot, (k, 3) or (k, 2) poses in driving order.
        title: stands above.
        walls: outlines of the true walls, (n, 2) each, where they are known.
    """
    corners = np.array([*known_corners(grid), *(corner for outline in walls for corner in outline)])
    view = Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()).shrunk(-MAP_MARGIN_M)
    ends = np.array([path[-1] if path.shape[1] == 3 else (*path[-1], 0.0) for path in paths])
    driven = [path[:, :2] for path in paths]
    snapshot = MapSnapshot(0.0, 0.0, grid, np.empty((0, 3)), ends.reshape(-1, 3), [], driven)
    entries = [
        *CELLS,
        *([legend.outline(TRUTH, "true walls")] if walls else []),
        (_path, "a robot's path, start (ring) and end"),
    ]

    def paint(picture: Picture) -> None:
        paint_map(picture, view, snapshot)
        canvas = Canvas(picture, view, LABEL_PX)
        for outline in walls:
            canvas.polygon(outline, None, TRUTH)
        for robot, path in enumerate(driven):
            canvas.circle(path[0].tolist(), 5.0 / canvas.scale, color_of(robot), 2)

    return _page(view, [title], entries, paint)


def draw_grids(setup: Setup, scene: Scene, explanation: Explanation) -> Picture:
    """Grids A to D of each guard, a row per guard, in the paper's colours: 0 black, 255 white.

    On A, the boxes around the blobs of D: those that were kept, and those that were taken for an ally. A
    row shows the whole window of the guard's costmap; where it leaves the prior map there is no grid.
    """
    step, top = TILE_PX + TILE_GAP_PX, 70
    page = blank_page(LEFT_PX + 4 * step, top + len(explanation.views) * step + 40)
    write(page, LEFT_PX, 8, f"{setup.plan.title}: frame {scene.frame}, t = {scene.time_s:.1f} s", 20, INK)
    for column, text in enumerate(COLUMNS):
        write(page, LEFT_PX + column * step, top - 24, text, TEXT_PX, INK)
    for row, (guard, view) in enumerate(zip(scene.guards, explanation.views, strict=True)):
        write(page, 6, top + row * step + TILE_PX // 2 - 20, "guard", 14, INK)
        write(page, 22, top + row * step + TILE_PX // 2, str(guard.number), 16, INK, bold=True)
        window = setup.window(guard)
        for column, grid in enumerate((view.a, view.b, view.c, view.d)):
            canvas = paint_grid(page, LEFT_PX + column * step, top + row * step, TILE_PX, window, grid)
            if column == 0:
                canvas.circle(guard.sensor, setup.usable_range_m, GUARD_RANGE)
                for box in view.kept:
                    canvas.box(box, DETECTION, 2)
                for item in explanation.removed:
                    if item.detection.robot == guard.number - 1:
                        paint_removed(canvas, item.detection.box, str(item.ally + 1))
            canvas.cross(guard.believed[:2], GUARD)
            canvas.box(window.shrunk(1.0 / canvas.scale), GUARD, 2)
    entries: list[legend.Entry] = [
        legend.outline(DETECTION, "box, kept"),
        (lambda canvas: canvas.dashed_box(legend.SWATCH, GUARD), "box, taken for the ally of that number"),
        (lambda canvas: canvas.cross((0.0, 0.0), GUARD), "where the guard believes to be"),
        legend.swatch(OUTSIDE, "outside the prior map"),
        legend.reach(setup),
    ]
    legend.write_beside(page, legend.beside(entries, LEFT_PX, page.shape[1], 14), page.shape[0] - 24, 0, 14)
    return page


def known_corners(grid: OccupancyGrid) -> Floats:
    """(2, 2) the lower left and the upper right corner of the known cells, or of a grid without any."""
    rows, columns = np.nonzero(grid.data >= 0)
    if not len(rows):
        return np.array(grid.extent).reshape(2, 2)
    cells = [(columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)]
    return np.array(grid.origin) + grid.resolution * np.array(cells)


def plot_area(view: Box, lines: int) -> tuple[slice, slice]:
    """The rows and columns of a page that show ``view`` below so many lines of title."""
    side_x, side_y = view.x_max - view.x_min, view.y_max - view.y_min
    longest = max(side_x, side_y)
    width, height = round(PLOT_PX * side_x / longest), round(PLOT_PX * side_y / longest)
    top = 14 + (TITLE_PX + 8) * lines
    return slice(top, top + max(height, 1)), slice(LEFT_PX, LEFT_PX + max(width, 1))


def _page(
    view: Box, title: Sequence[str], entries: Sequence[legend.Entry], paint: Callable[[Picture], None]
) -> Picture:
    """A title, what ``paint`` draws of ``view`` with axes in metres, and a legend on its right."""
    rows, columns = plot_area(view, len(title))
    legend_left = columns.stop + GAP_PX
    height = max(rows.stop + BOTTOM_PX, rows.start + ROW_PX * (len(entries) + 1))
    widest = max(text_mask(line, TITLE_PX).shape[1] for line in title) + 2 * GAP_PX
    page = blank_page(max(legend_left + LEGEND_PX, LEFT_PX + widest), height)
    for number, line in enumerate(title):
        write(page, LEFT_PX, 8 + (TITLE_PX + 8) * number, line, TITLE_PX, INK)
    picture = page[rows, columns]
    paint(picture)
    canvas = Canvas(picture, view)
    step_m = next((step for step in STEPS_M if step * canvas.scale >= TICK_GAP_PX), STEPS_M[-1])
    for k in range(int(np.ceil(view.x_min / step_m)), int(view.x_max // step_m) + 1):
        column = columns.start + round(float(canvas.pixels((k * step_m, 0.0))[0]))
        page[rows.stop : rows.stop + 5, column] = INK
        write(page, column, rows.stop + 6, f"{k * step_m:g}", 14, INK, before=0.5)
    for k in range(int(np.ceil(view.y_min / step_m)), int(view.y_max // step_m) + 1):
        row = rows.start + round(float(canvas.pixels((0.0, k * step_m))[1]))
        page[row, LEFT_PX - 5 : LEFT_PX] = INK
        write(page, LEFT_PX - 8, row - 9, f"{k * step_m:g}", 14, INK, before=1.0)
    write(page, (columns.start + columns.stop) // 2 - 20, rows.stop + 24, "x / m", 14, INK)
    write(page, 2, rows.start - 20, "y / m", 14, INK)
    legend.write_legend(page, entries, legend_left, rows.start + 12, ROW_PX, TEXT_PX)
    return page


def _path(canvas: Canvas) -> None:
    canvas.line([(-6.0, 0.0), (6.0, 0.0)], color_of(0), 2)
    canvas.circle((-6.0, 0.0), 4.0, color_of(0), 2)
    canvas.circle((6.0, 0.0), 4.0, color_of(0), -1)
