"""Pictures of one instant: an arena, the grids of MIDNet, its detections, and how section IV got at them."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from midnet_bench.drawing.painter import (
    MARGIN_M,
    SWATCH,
    Canvas,
    DetectionPanel,
    Entry,
    Labels,
    Picture,
    WorldPanel,
    blank_page,
    detection_legend,
    grid_legend,
    outline,
    paint_scale,
    reach_entry,
    scan_legend,
    sign_legend,
    swatch,
    text_mask,
    tiles,
    world_legend,
    write,
    write_legend,
)
from midnet_bench.drawing.palette import (
    DETECTION,
    EXPLORERS,
    FAINT_INK,
    FALSE_DETECTION,
    GUARD,
    GUARD_RANGE,
    INK,
    INTRUDER,
    WHITE,
    WOOD,
    WOOD_EDGE,
)
from midnet_bench.drawing.scene import Scene, Setup
from midnet_bench.geometry import Box, Point
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import Call, divide_and_conquer
from midnet_bench.midnet.pipeline import Explanation, Observation

PLOT_PX, LABEL_PX, TEXT_PX, TITLE_PX, ROW_PX = 940, 15, 15, 20, 26
LEFT_PX, BOTTOM_PX, GAP_PX, LEGEND_PX = 52, 46, 18, 335
STEPS_M, TICK_GAP_PX = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0), 70.0
"""between two numbers of an axis; they are no nearer"""
OUTSIDE, GREYS = (204, 204, 204), np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
"""where there is no grid, and the shades of one"""
TILE_PX, TILE_GAP_PX = 300, 16
STEP_PX, PLAN_PX, HEAD_PX = 400, 640, 26
"""sides of a grid and of the plan, and height of a title, in the pictures of steps"""
NODE_PX, NODE_TEXT_PX, NODE_ROW_PX = 130, 13, 18
COLUMNS = (
    "A: local grid (Eq. 1), boxes from D",
    "B: prior map, cropped",
    "C: occupied in both (Eq. 5)",
    "D: occupied in A only (Eq. 6)",
)
LETTERS = "abcdefghijklmnopqrstuvwxyz"
Item = TypeVar("Item")
Span = tuple[int, int]  # the first and the last guard of a part of the team, from 0


def draw_arena(setup: Setup, scene: Scene, faults: Mapping[int, Point] | None = None) -> Picture:
    """Walls, intruders, guards with their local costmap and LiDAR range, paths, goals and detections.

    ``faults``: what is wrong with the arena by its number, where it is, metres, map frame.
    """
    view = setup.plan.view(MARGIN_M)
    walls = swatch(WOOD, "wall", WOOD_EDGE)
    entries = [walls, *world_legend(setup, [scene]), *detection_legend([scene])]
    if faults:
        entries.append((lambda canvas: canvas.cross((0.0, 0.0), FALSE_DETECTION), "fault, by its number"))

    def paint(picture: Picture) -> None:
        height, width = picture.shape[:2]
        WorldPanel(setup, width, height, LABEL_PX).paint(picture, scene)
        canvas = Canvas(picture, view, LABEL_PX)
        for number, at in (faults or {}).items():
            canvas.cross(at, FALSE_DETECTION)
            canvas.label(at, str(number), FALSE_DETECTION, 11, -11)

    return plot_page(view, [f"{setup.plan.title}, t = {scene.time_s:.1f} s"], entries, paint)


def draw_detections(setup: Setup, scene: Scene) -> Picture:
    """The fused detections on the prior map and the guards' grids, with the true outlines thin underneath."""
    entries = [
        *detection_legend([scene], numbered=True),
        *sign_legend([scene]),
        *([outline(INTRUDER, "true outline of an intruder")] if scene.truths else []),
        *([outline(GUARD, "true outline of a guard"), reach_entry(setup)] if scene.guards else []),
        *scan_legend(setup),
        *grid_legend(),
    ]
    title = f"{setup.plan.title}: detections of frame {scene.frame}, t = {scene.time_s:.1f} s"
    panel = DetectionPanel(setup, LABEL_PX, shows_outlines=True)
    return plot_page(panel.view, [title, scene.counter], entries, lambda picture: panel.paint(picture, scene))


def draw_grids(setup: Setup, scene: Scene, explanation: Explanation) -> Picture:
    """Grids A to D of each guard, a row per guard, in the paper's colours: 0 black, 255 white.

    On A, the boxes around the blobs of D: those that were kept, and those that were taken for an ally. A
    row shows the whole window of the guard's costmap; where it leaves the prior map there is no grid.
    """
    step, top = TILE_PX + TILE_GAP_PX, 70
    page = blank_page(LEFT_PX + 4 * step, top + len(explanation.views) * step + 40)
    write(page, LEFT_PX, 8, f"{setup.plan.title}: frame {scene.frame}, t = {scene.time_s:.1f} s", 20)
    for column, text in enumerate(COLUMNS):
        write(page, LEFT_PX + column * step, top - 24, text, TEXT_PX)
    places = tiles(4 * len(explanation.views), 4, step, step, LEFT_PX, top)
    for robot, (guard, view) in enumerate(zip(scene.guards, explanation.views, strict=True)):
        middle = top + robot * step + TILE_PX // 2
        write(page, 6, middle - 20, "guard", 14)
        write(page, 22, middle, str(guard.number), 16, bold=True)
        window = setup.window(guard)
        for grid in (view.a, view.b, view.c, view.d):
            canvas = _paint_grid(page, *next(places), TILE_PX, window, grid)
            if grid is view.a:
                canvas.circle(guard.sensor, setup.usable_range_m, GUARD_RANGE)
                _paint_boxes(canvas, explanation, robot, "")
            canvas.cross(guard.believed[:2], GUARD)
            canvas.box(window.shrunk(1.0 / canvas.scale), GUARD, 2)
    entries: list[Entry] = [
        outline(DETECTION, "box, kept"),
        (lambda canvas: canvas.dashed_box(SWATCH, GUARD), "box, taken for the ally of that number"),
        (lambda canvas: canvas.cross((0.0, 0.0), GUARD), "where the guard believes to be"),
        swatch(OUTSIDE, "outside the prior map"),
        reach_entry(setup),
    ]
    write_legend(page, entries, LEFT_PX, page.shape[0] - 24, 0, 14, right=page.shape[1])
    return page


def draw_views(seen: Observation, explanation: Explanation, guard: int) -> Picture:
    """One guard's costmap, its grids A to D and its boxes."""
    view, costs = explanation.views[guard], seen.costmap.data
    window = Box(*seen.costmap.extent).shrunk(-seen.costmap.resolution)
    greys = np.rint(2.55 * (100 - np.where(costs < 0, 50, costs))).astype(np.uint8)
    panels = {
        "costmap: 0 white, 100 black": seen.costmap.with_data(greys),
        "A: local grid (Eq. 1)": view.a,
        "B: prior map, cropped (Algorithm 1)": view.b,
        "C: occupied in both (Eq. 5)": view.c,
        "D: occupied in A only (Eq. 6)": view.d,
        "boxes of D; dashed: an ally": view.a,
    }
    across, down = STEP_PX + GAP_PX, STEP_PX + HEAD_PX + GAP_PX
    page = blank_page(3 * across + GAP_PX, 2 * down + GAP_PX)
    for number, (left, top) in enumerate(tiles(len(panels), 3, across, down, GAP_PX, GAP_PX)):
        title, grid = [*panels.items()][number]
        write(page, left, top, title, 16)
        canvas = _paint_grid(page, left, top + HEAD_PX, STEP_PX, window, grid)
        canvas.cross(seen.pose[:2], GUARD)
        if number == 0:
            paint_scale(canvas, window)
    _paint_boxes(canvas, explanation, guard, "guard ")
    return page


class Tree(NamedTuple):
    """Algorithm 3 over a team's boxes."""

    boxes: list[Box]  # without those of allies, guard after guard
    names: list[str]  # of each box, such as 2b: the second box of guard 2
    nodes: Mapping[Span, Call]  # halves before what they are halves of

    @property
    def levels(self) -> dict[Span, int]:
        """Of each call, how many lie below it at most."""
        level: dict[Span, int] = {}
        for span in self.nodes:
            level[span] = 1 + max((level[half] for half in halves_of(span)), default=-1)
        return level

    @property
    def root(self) -> Call:
        """The last call, over the whole team."""
        return [*self.nodes.values()][-1]


def halves_of(span: Span) -> tuple[Span, ...]:
    """What a call of Algorithm 3 fuses; nothing for a single guard."""
    first, last = span
    middle = (first + last) // 2
    return ((first, middle), (middle + 1, last)) if first < last else ()


def tree_of(explanation: Explanation, threshold: float) -> Tree:
    """The calls of Algorithm 3 for one frame; ``threshold``: the least IoU of boxes that are fused."""
    kept = [view.kept for view in explanation.views]
    boxes = [box for own in kept for box in own]
    lists = np.split(np.arange(len(boxes)), np.cumsum([*map(len, kept)])[:-1])
    letters = [*LETTERS, *(one + two for one in LETTERS for two in LETTERS)]
    names = [f"{robot}{letter}" for robot, own in enumerate(kept, 1) for letter in letters[: len(own)]]
    nodes: dict[Span, Call] = {}
    divide_and_conquer(lists, 0, len(lists) - 1, np.array(boxes).reshape(-1, 4), threshold, nodes)
    return Tree(boxes, names, nodes)


def draw_fusion(prior: OccupancyGrid, tree: Tree) -> Picture:
    """All guards' boxes on the map, and the lists that Algorithm 3 makes of them, level by level."""
    team, levels = max(last for _, last in tree.nodes) + 1, 1 + max(tree.levels.values())
    left, width, height = PLAN_PX + 2 * GAP_PX, max(PLAN_PX, NODE_PX * team), max(PLAN_PX, NODE_PX * levels)
    page = blank_page(left + width + GAP_PX, HEAD_PX + 2 * GAP_PX + height)
    write(page, GAP_PX, GAP_PX, "Boxes on the prior map; thick: left after fusion", 16)
    write(page, left, GAP_PX, "The tree of Algorithm 3, from the bottom up", 16)
    greys = np.select([prior.data < 0, prior.data >= 100], [205, 40], 255).astype(np.uint8)
    view, top = Box(*prior.extent), GAP_PX + HEAD_PX
    plan = _paint_grid(page, GAP_PX, top, PLAN_PX, view, prior.with_data(greys))
    paint_scale(plan, view)
    labels = Labels(plan)
    for k, (box, name) in enumerate(zip(tree.boxes, tree.names, strict=True)):
        color = EXPLORERS[(int(name.rstrip(LETTERS)) - 1) % len(EXPLORERS)]
        plan.box(box, color, 3 if k in tree.root.left else 1)
        labels.put((box.x_max, box.y_max), name, color, 10.0)
    _paint_tree(page[top : top + height, left:], tree, team)
    return page


def _paint_tree(picture: Picture, tree: Tree, team: int) -> None:
    """Each call in a frame, guards from left to right, the halves below what they are halves of."""
    height, width = picture.shape[:2]
    canvas = Canvas(picture, Box(0.0, -float(height), float(width), 0.0))
    levels, step_px = tree.levels, height / (1 + max(tree.levels.values()))
    at = {
        span: (width / team * ((span[0] + span[1]) / 2.0 + 0.5), step_px * (levels[span] + 0.5) - height)
        for span in tree.nodes
    }
    for span in tree.nodes:
        for half in halves_of(span):
            canvas.line([at[half], at[span]], FAINT_INK)
    for (first, last), call in tree.nodes.items():
        lines = [f"guard {first + 1}" if first == last else f"guards {first + 1} to {last + 1}"]
        lines += [" ".join(tree.names[k] for k in four) for four in _by(4, call.left)]
        lines += [
            "fused: " * (not number) + ", ".join(f"{tree.names[k]} into {tree.names[j]}" for k, j in two)
            for number, two in enumerate(_by(2, call.lost))
        ]
        widths = [text_mask(line, NODE_TEXT_PX).shape[1] for line in lines]
        (x, y), half_x, half_y = (
            at[first, last],
            max(widths) / 2.0 + 6.0,
            NODE_ROW_PX * len(lines) / 2.0 + 4.0,
        )
        canvas.box(Box(x - half_x, y - half_y, x + half_x, y + half_y), GUARD, fill=WHITE)
        for number, (line, wide) in enumerate(zip(lines, widths, strict=True)):
            row = round(4.0 - y - half_y) + NODE_ROW_PX * number
            write(picture, round(x - wide / 2.0), row, line, NODE_TEXT_PX)


def _by(count: int, items: Sequence[Item]) -> list[Sequence[Item]]:
    return [items[first : first + count] for first in range(0, len(items), count)]


def _paint_grid(page: Picture, left: int, top: int, side_px: int, view: Box, grid: OccupancyGrid) -> Canvas:
    """A grid of greys (uint8) in a square of a page; the canvas of that square, which shows ``view``."""
    tile = page[top : top + side_px, left : left + side_px]
    tile[:] = OUTSIDE
    canvas = Canvas(tile, view, LABEL_PX)
    canvas.cells(grid, GREYS)
    return canvas


def _paint_boxes(canvas: Canvas, explanation: Explanation, guard: int, before: str) -> None:
    """A guard's boxes: those that were kept; those that were taken for an ally, and which."""
    for box in explanation.views[guard].kept:
        canvas.box(box, DETECTION, 2)
    for (box, robot), ally, _ in explanation.removed:
        if robot == guard:
            canvas.dashed_box(box, GUARD)
            canvas.label((box.x_max, box.y_max), f"{before}{ally + 1}", GUARD, 7, -5)


def plot_area(view: Box, lines: int) -> tuple[slice, slice]:
    """The rows and columns of a page that show ``view`` below so many lines of title."""
    side_x, side_y = view.x_max - view.x_min, view.y_max - view.y_min
    longest = max(side_x, side_y)
    width, height = round(PLOT_PX * side_x / longest), round(PLOT_PX * side_y / longest)
    top = 14 + (TITLE_PX + 8) * lines
    return slice(top, top + max(height, 1)), slice(LEFT_PX, LEFT_PX + max(width, 1))


def plot_page(
    view: Box, title: Sequence[str], entries: Sequence[Entry], paint: Callable[[Picture], None]
) -> Picture:
    """A title, what ``paint`` draws of ``view`` with axes in metres, and a legend on its right."""
    rows, columns = plot_area(view, len(title))
    legend_left = columns.stop + GAP_PX
    height = max(rows.stop + BOTTOM_PX, rows.start + ROW_PX * (len(entries) + 1))
    widest = max(text_mask(line, TITLE_PX).shape[1] for line in title) + 2 * GAP_PX
    page = blank_page(max(legend_left + LEGEND_PX, LEFT_PX + widest), height)
    for number, line in enumerate(title):
        write(page, LEFT_PX, 8 + (TITLE_PX + 8) * number, line, TITLE_PX)
    picture = page[rows, columns]
    paint(picture)
    canvas = Canvas(picture, view)
    step_m = next((step for step in STEPS_M if step * canvas.scale >= TICK_GAP_PX), STEPS_M[-1])
    for k in range(int(np.ceil(view.x_min / step_m)), int(view.x_max // step_m) + 1):
        column = columns.start + round(float(canvas.pixels((k * step_m, 0.0))[0]))
        page[rows.stop : rows.stop + 5, column] = INK
        write(page, column, rows.stop + 6, f"{k * step_m:g}", 14, before=0.5)
    for k in range(int(np.ceil(view.y_min / step_m)), int(view.y_max // step_m) + 1):
        row = rows.start + round(float(canvas.pixels((0.0, k * step_m))[1]))
        page[row, LEFT_PX - 5 : LEFT_PX] = INK
        write(page, LEFT_PX - 8, row - 9, f"{k * step_m:g}", 14, before=1.0)
    write(page, (columns.start + columns.stop) // 2 - 20, rows.stop + 24, "x / m", 14)
    write(page, 2, rows.start - 20, "y / m", 14)
    write_legend(page, entries, legend_left, rows.start + 12, ROW_PX, TEXT_PX)
    return page
