"""Pictures for print, by matplotlib: an arena, the grids of MIDNet, its detections, a map."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerTuple
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch
from matplotlib.path import Path

from midnet_bench.drawing.palette import (
    DETECTION,
    EXPLORERS,
    FALSE_DETECTION,
    FLOOR,
    GROUND,
    GUARD,
    GUARD_RANGE,
    INK,
    INTRUDER,
    INTRUDER_FAINT,
    MISSED,
    OUT_OF_RANGE,
    RGB,
    TRUTH,
    WOOD,
    WOOD_EDGE,
    hexadecimal,
)
from midnet_bench.drawing.plots import (
    DPI,
    add_box,
    add_label,
    add_polygon,
    new_figure,
    own_style,
    show_greys,
    show_grid,
    show_metres,
)
from midnet_bench.drawing.scene import Floats, FloorPlan, Point, Robot, Scene, Setup, Truth
from midnet_bench.drawing.signs import (
    CORNERS,
    DUPLICATE,
    FALSE_POSITIVE,
    MISS,
    NO_ERROR,
    RING,
    TRUE_POSITIVE,
    place_of,
)
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Explanation, RemovedAlly, RobotView

MARGIN_M = 0.4
"""around an arena"""
OTHER_RING_M = 0.25
"""about a person or a thing, to be found by"""
AT_GOAL_M = 0.35
HATCH = "////"
DASHED, ALLY_DASH = (0, (2, 1.5)), (0, (3, 2))
SIGN_PT = 7.0
"""half a side of a sign about an intruder is no shorter"""
Mark = Artist | tuple[Artist, ...]
"""an entry of a legend, of one piece or of several over each other"""

COLUMNS = (
    "A: local grid (Eq. 1), boxes from D",
    "B: prior map, cropped",
    "C: occupied in both (Eq. 5)",
    "D: occupied in A only (Eq. 6)",
)
OUTSIDE = "#cccccc"

UNKNOWN, OCCUPIED = 0.8, 0.15
"""shades of grey of a map; free is white"""
MAP_MARGIN_M = 0.3
MAX_CELLS = 4000
"""along a side of what is drawn; the picture has some 1000 pixels there"""
HEIGHT_IN = 7.6
SIDE_IN, TOP_IN, BOTTOM_IN = 0.75, 0.4, 0.8


@own_style()
def draw_arena(setup: Setup, scene: Scene, faults: Mapping[int, Point] | None = None) -> Figure:
    """Walls, stationary and mobile intruders, guards with the range of their LiDARs, paths and goals.

    ``faults``: what is wrong with the arena by its number, where it is, metres, map frame.
    """
    plan = setup.plan
    legend = _arena_legend(setup)
    if scene.others:
        legend.append(
            (Patch(facecolor=hexadecimal(INTRUDER)), "legs of a person, or a thing\nthat moves (P)")
        )
    if faults:
        cross = Line2D([], [], color=hexadecimal(FALSE_DETECTION), marker="X", markersize=9)
        cross.set(linestyle="none")
        legend.append((cross, "fault, by its number"))
    title = f"{plan.title}, t = {scene.time_s:.1f} s"
    figure, axes = _plan_with_legend(plan, title, *map(list, zip(*legend, strict=True)))
    axes.set_facecolor(hexadecimal(GROUND))
    add_box(axes, plan.enclosure, FLOOR, fill=True, facecolor=hexadecimal(FLOOR), zorder=0)
    _add_reach(axes, setup, scene)
    _add_floor_plan(axes, plan)
    for robot in scene.robots:
        _add_path(axes, robot, plan)
    for robot in scene.robots:
        _add_robot(axes, robot, scene)
    for number, outlines in enumerate(scene.others, 1):
        for outline in outlines:
            add_polygon(axes, outline, facecolor=hexadecimal(INTRUDER), edgecolor="none", zorder=5)
        middle = np.concatenate(outlines).mean(axis=0).tolist()
        axes.add_patch(Circle(middle, OTHER_RING_M, color=hexadecimal(INTRUDER), alpha=0.15, zorder=4))
        add_label(axes, (middle[0], middle[1]), f"P{number}", INTRUDER, fontweight="bold", xytext=(9, 9))
    for number, at in (faults or {}).items():
        axes.plot(*at, marker="X", markersize=9, color=hexadecimal(FALSE_DETECTION), zorder=7)
        add_label(axes, at, str(number), FALSE_DETECTION, fontweight="bold", xytext=(6, 6))
    return figure


@own_style()
def draw_grids(setup: Setup, scene: Scene, explanation: Explanation) -> Figure:
    """Grids A to D of each guard, a row per guard, in the paper's colours: 0 black, 255 white.

    On A, the boxes around the blobs of D: those that were kept, and those that were taken for an ally. A
    row shows the whole window of the guard's costmap; where it leaves the prior map there is no grid.
    """
    rows = len(explanation.views)
    height_in = 1.15 + 2.75 * rows
    figure = new_figure(11.0, height_in)
    axes = figure.subplots(rows, len(COLUMNS), squeeze=False)
    figure.subplots_adjust(
        left=0.08, right=0.99, top=1.0 - 0.62 / height_in, bottom=0.8 / height_in, wspace=0.14, hspace=0.14
    )
    for guard, view, row in zip(scene.guards, explanation.views, axes, strict=True):
        for grid, one in zip((view.a, view.b, view.c, view.d), row, strict=True):
            _show_binary(one, grid, Box.square(guard.believed.x, guard.believed.y, setup.local_size_m))
        removed = [item for item in explanation.removed if item.detection.robot == guard.number - 1]
        _add_boxes(row[0], view, removed)
        row[0].set_ylabel("y / m", fontsize=8)
        row[0].text(
            -0.32,
            0.5,
            f"guard {guard.number}",
            transform=row[0].transAxes,
            rotation=90,
            ha="center",
            va="center",
            fontsize=10,
            fontweight="bold",
        )
        for one in row[1:]:
            one.tick_params(labelleft=False)  # one window, one scale a row
        at, range_m = guard.sensor, setup.usable_range_m
        row[0].add_patch(Circle(at, range_m, fill=False, color=hexadecimal(GUARD_RANGE), linewidth=0.9))
        for one in row:
            one.spines[:].set(color=hexadecimal(GUARD), linewidth=1.4)  # the local costmap's edge
            one.plot(guard.believed.x, guard.believed.y, marker="+", color=hexadecimal(GUARD), markersize=8)
    for text, one in zip(COLUMNS, axes[0], strict=True):
        one.set_title(text, fontsize=9.5)
    for one in axes[-1]:
        one.set_xlabel("x / m", fontsize=8)
    figure.suptitle(
        f"{setup.plan.title}: frame {scene.frame}, t = {scene.time_s:.1f} s, map frame",
        x=0.08,
        y=1.0 - 0.12 / height_in,
        ha="left",
        va="top",
        fontsize=11,
    )
    removed_box = _empty_patch("box, removed as the\nally of that number", GUARD, linestyle=ALLY_DASH)
    cross = Line2D([], [], color=hexadecimal(GUARD), marker="+", markersize=8, linestyle="none")
    cross.set_label("the guard's believed\nposition")
    is_within = setup.local_size_m < math.sqrt(2.0) * setup.usable_range_m
    edge = (
        f"local costmap, {setup.local_size_m:g} m; the LiDAR\nrange, {setup.usable_range_m:g} m, ends outside"
    )
    labels = ["box, kept", removed_box.get_label(), cross.get_label(), "outside the prior map"]
    labels.append(edge if is_within else setup.reach)
    handles = [_empty_patch("", DETECTION), removed_box, cross, Patch(facecolor=OUTSIDE), _reach_mark()]
    figure.legend(
        handles=handles,
        labels=labels,
        handler_map={tuple: HandlerTuple(ndivide=1, pad=0.0)},
        loc="lower center",
        ncols=5,
        fontsize=9,
        frameon=False,
    )
    return figure


@own_style()
def draw_detections(setup: Setup, scene: Scene) -> Figure:
    """The fused detections on the prior map before inflation, with the true outlines thin underneath.

    Both kinds of error stand out: a detection that touches no intruder, and an intruder in range that no
    detection touches. One that is out of range has a quieter sign.
    """
    title = f"{setup.plan.title}: detections of frame {scene.frame}, t = {scene.time_s:.1f} s"
    title = f"{title}\n{scene.counter}"
    figure, axes = _plan_with_legend(setup.plan, title, *_detections_legend(setup, scene))
    show_grid(axes, setup.prior_map)
    _add_reach(axes, setup, scene)
    for truth in scene.truths:
        for outline in truth.outlines:
            add_polygon(axes, outline, fill=False, edgecolor=hexadecimal(INTRUDER), linewidth=0.8)
        _add_sign(axes, truth, setup.plan.view(MARGIN_M))
    for robot in scene.guards:
        add_polygon(axes, robot.outline, fill=False, edgecolor=hexadecimal(GUARD), linewidth=0.8)
        add_label(axes, robot.pose[:2], str(robot.number), GUARD, fontsize=7, xytext=(5, -9))
    for found in scene.detections:
        color = FALSE_DETECTION if found.is_false else DETECTION
        add_box(
            axes, found.box, color, zorder=5, linewidth=1.6, linestyle=DASHED if found.is_further else "-"
        )
        if found.is_false:
            x1, y1, x2, y2 = found.box
            for ends in ((y1, y2), (y2, y1)):
                axes.plot((x1, x2), ends, color=hexadecimal(color), linewidth=0.8, zorder=5)
        add_label(axes, (found.box.x_min, found.box.y_max), str(found.guard), color, fontweight="bold")
    return figure


@own_style()
def draw_map(
    grid: OccupancyGrid, paths: Sequence[Floats], title: str, walls: Sequence[Floats] = ()
) -> Figure:
    """The known part of a map, and all true walls, with each robot's path on it, metres of the map frame.

    Args:
        grid: int8, 100 occupied, 0 free, -1 unknown.
        paths: of each robot, (k, 3) or (k, 2) poses in driving order.
        title: stands above.
        walls: outlines of the true walls, (n, 2) each, where they are known.
    """
    corners = np.array([*known_corners(grid), *(corner for outline in walls for corner in outline)])
    view = Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()).shrunk(-MAP_MARGIN_M)
    aspect = (view.x_max - view.x_min) / (view.y_max - view.y_min)
    plot_in = HEIGHT_IN - TOP_IN - BOTTOM_IN
    width_in = max(7.5, plot_in * aspect + 2 * SIDE_IN)
    figure = new_figure(width_in, HEIGHT_IN)
    axes = figure.add_axes(
        (SIDE_IN / width_in, BOTTOM_IN / HEIGHT_IN, 1 - 2 * SIDE_IN / width_in, plot_in / HEIGHT_IN)
    )
    axes.set_facecolor(str(UNKNOWN))
    show_grid(axes, coarsened(grid, MAX_CELLS), UNKNOWN, OCCUPIED)
    show_metres(axes, view, title)
    for outline in walls:
        add_polygon(axes, outline, fill=False, edgecolor=hexadecimal(TRUTH), linewidth=0.6, zorder=2)
    for number, path in enumerate(paths, 1):
        _add_driven(axes, path, number, len(paths))
    handles = _map_legend(len(paths), bool(walls))
    figure.legend(handles=handles, loc="lower center", ncols=6, fontsize=8.5, frameon=False)
    return figure


def coarsened(grid: OccupancyGrid, max_cells: int) -> OccupancyGrid:
    """A map of the same place with at most ``max_cells`` cells along each side.

    A cell of it is occupied if one of those that it is made of is, else free if one is. The grid itself if it
    is small enough.
    """
    factor = -(-max(grid.width, grid.height) // max_cells)
    if factor <= 1:
        return grid
    starts = [np.arange(0, size, factor) for size in grid.data.shape]
    # 100 occupied, 0 free, -1 unknown: the largest says the most
    rows = np.maximum.reduceat(grid.data, starts[0], axis=0)
    return OccupancyGrid(np.maximum.reduceat(rows, starts[1], axis=1), factor * grid.resolution, grid.origin)


def known_corners(grid: OccupancyGrid) -> tuple[tuple[float, float], tuple[float, float]]:
    """(x, y) of the lower left and the upper right corner of the known cells, or of a grid without any."""
    rows, columns = np.nonzero(grid.data >= 0)
    if not len(rows):
        x_min, y_min, x_max, y_max = grid.extent
        return (x_min, y_min), (x_max, y_max)
    x, y = grid.origin
    return (
        (x + grid.resolution * float(columns.min()), y + grid.resolution * float(rows.min())),
        (x + grid.resolution * float(columns.max() + 1), y + grid.resolution * float(rows.max() + 1)),
    )


def _plan_with_legend(
    plan: FloorPlan, title: str, handles: Sequence[Any], labels: Sequence[str]
) -> tuple[Figure, Axes]:
    """A figure as high as the arena needs, its axes in metres, and a legend on their right.

    ``handles`` are artists or tuples of them that are drawn over each other.
    """
    view = plan.view(MARGIN_M)
    top_in = 0.4 + 0.2 * title.count("\n")
    left_in, bottom_in, legend_in, side_in = 0.72, 0.55, 2.45, 6.5
    aspect = (view.x_max - view.x_min) / (view.y_max - view.y_min)
    wide_in, high_in = (side_in, side_in / aspect) if aspect >= 1.0 else (side_in * aspect, side_in)
    # room for the legend beside a very wide arena
    figure_wide_in, figure_high_in = left_in + wide_in + legend_in, max(top_in + high_in + bottom_in, 3.2)
    figure = new_figure(figure_wide_in, figure_high_in)
    axes = figure.add_axes(
        (
            left_in / figure_wide_in,
            1.0 - (top_in + high_in) / figure_high_in,
            wide_in / figure_wide_in,
            high_in / figure_high_in,
        )
    )
    show_metres(axes, view, title)
    figure.legend(
        handles=handles,
        labels=labels,
        handler_map={tuple: HandlerTuple(ndivide=1, pad=0.0)},
        loc="upper left",
        bbox_to_anchor=((left_in + wide_in + 0.15) / figure_wide_in, 1.0 - top_in / figure_high_in),
        borderaxespad=0.0,
        fontsize=8.5,
        frameon=False,
        labelspacing=0.9,
    )
    return figure, axes


def _add_floor_plan(axes: Axes, plan: FloorPlan) -> None:
    # edges first, so that pieces of wall that share an end look like one
    for wall in plan.walls:
        add_polygon(axes, wall, fill=False, edgecolor=hexadecimal(WOOD_EDGE), linewidth=2, zorder=2)
    for wall in plan.walls:
        add_polygon(axes, wall, facecolor=hexadecimal(WOOD), edgecolor="none", zorder=2.1)
    for number, outline in enumerate(plan.stationary, 1):
        add_polygon(
            axes,
            outline,
            facecolor=hexadecimal(INTRUDER_FAINT),
            edgecolor=hexadecimal(INTRUDER),
            hatch=HATCH,
            linewidth=1.2,
            zorder=3,
        )
        x, y = outline.mean(axis=0).tolist()
        add_label(axes, (x, y), f"S{number}", INTRUDER, ha="center", va="center", xytext=(0, 0))


def _add_path(axes: Axes, robot: Robot, plan: FloorPlan) -> None:
    if robot.goal is None:
        return
    color = GUARD if robot.is_guard else INTRUDER
    marker = "x" if robot.is_guard else "D"
    # robots do not know of stationary intruders: a goal under one is hidden, or it would look like a part
    if not plan.hides(robot.goal):
        is_near = math.dist(robot.goal, robot.pose[:2]) < AT_GOAL_M
        axes.plot(
            *robot.goal, marker=marker, color=hexadecimal(color), markersize=5, fillstyle="none", zorder=4
        )
        if not is_near:  # a robot at its goal has its number there already
            add_label(axes, robot.goal, str(robot.number), color, fontsize=7, xytext=(4, -7))
    if robot.plan is not None:
        axes.plot(*robot.plan.T, color=hexadecimal(color), linewidth=0.9, linestyle=":", zorder=2.5)


def _add_robot(axes: Axes, robot: Robot, scene: Scene) -> None:
    color = GUARD if robot.is_guard else INTRUDER
    x, y, _ = robot.pose
    # a disc of fixed size under it, to be found by where a Burger to scale is a few dots
    axes.scatter([x], [y], s=40, color=hexadecimal(color), alpha=0.35, linewidths=0, zorder=4)
    add_polygon(axes, robot.outline, facecolor=hexadecimal(color), edgecolor="white", linewidth=0.4, zorder=5)
    axes.plot(*zip((x, y), robot.front, strict=True), color="white", linewidth=1.2, zorder=6)
    right, up = _away_from_others(robot, scene)
    add_label(
        axes,
        (x, y),
        str(robot.number),
        color,
        fontweight="bold",
        fontsize=9,
        xytext=(11 * right, 11 * up),
        ha="center",
        va="center",
    )


def _away_from_others(robot: Robot, scene: Scene) -> tuple[float, float]:
    """A unit vector to where a label does not lie on the next robot."""
    x, y, _ = robot.pose
    others = [other.pose for other in scene.robots if other is not robot]
    nearest = min(others, key=robot.pose.distance_to, default=None)
    if nearest is None or robot.pose.distance_to(nearest) > 0.6:
        return math.sqrt(0.5), math.sqrt(0.5)
    gap = robot.pose.distance_to(nearest)
    return (x - nearest.x) / gap, (y - nearest.y) / gap


def _arena_legend(setup: Setup) -> list[tuple[Mark, str]]:
    """What the colours and marks of this very picture mean."""
    guard, intruder = hexadecimal(GUARD), hexadecimal(INTRUDER)
    handles: list[tuple[Mark, str]] = [
        (Patch(facecolor=hexadecimal(WOOD), edgecolor=hexadecimal(WOOD_EDGE)), "wall"),
        (Patch(facecolor=guard), "guard (the white notch is\nits front)"),
        (_reach_mark(), setup.reach),
        (Line2D([], [], color=guard, marker="x", linestyle=":"), "a guard's path and goal"),
    ]
    if setup.shows_scans:
        handles.append((_returns_mark(), "LiDAR returns"))
    if setup.mobile_intruders:
        path = Line2D([], [], color=intruder, marker="D", fillstyle="none", linestyle=":")
        handles += [(Patch(facecolor=intruder), "mobile intruder"), (path, "an intruder's path and goal")]
    if setup.plan.stationary:
        stationary = Patch(facecolor=hexadecimal(INTRUDER_FAINT), edgecolor=intruder, hatch=HATCH)
        handles.append((stationary, "stationary intruder"))
    return handles


def _add_reach(axes: Axes, setup: Setup, scene: Scene) -> None:
    """Each guard's local costmap and the usable range of its LiDAR; its scans if the setup shows them."""
    pale = hexadecimal(GUARD_RANGE)
    view = setup.plan.view(MARGIN_M)
    for robot in scene.guards:
        axes.add_patch(
            Circle(robot.sensor, setup.usable_range_m, fill=False, color=pale, linewidth=0.8, zorder=1)
        )
        window = setup.window(robot)
        add_box(axes, window, GUARD, linewidth=0.7, zorder=1.5)
        if len(scene.guards) > 1:  # whose it is, at the corner that is in the picture
            at = (max(window.x_min, view.x_min), min(window.y_max, view.y_max))
            add_label(axes, at, f"{robot.number}", GUARD, fontsize=6, xytext=(2, -7), alpha=0.8)
    if setup.shows_scans:
        for points in scene.scans:
            axes.scatter(
                points[:, 0], points[:, 1], s=1.5, color=hexadecimal(GUARD), linewidths=0, zorder=3.6
            )


def _reach_mark() -> Mark:
    square = Line2D([], [], color=hexadecimal(GUARD), marker="s", markersize=11, fillstyle="none")
    circle = Line2D([], [], color=hexadecimal(GUARD_RANGE), marker="o", markersize=8, fillstyle="none")
    for one in (square, circle):
        one.set(linestyle="none", markeredgewidth=0.9)
    return square, circle


def _returns_mark() -> Line2D:
    return Line2D([], [], color=hexadecimal(GUARD), marker=".", markersize=3, linestyle=":")


def _show_binary(axes: Axes, grid: OccupancyGrid, window: Box) -> None:
    axes.set_facecolor(OUTSIDE)
    if grid.data.size:
        show_greys(axes, grid, 255.0)
    show_metres(axes, window)


def _add_boxes(axes: Axes, view: RobotView, removed: Sequence[RemovedAlly]) -> None:
    for box in view.kept:
        add_box(axes, box, DETECTION, linewidth=1.3)
    for item in removed:
        box = item.detection.box
        add_box(axes, box, GUARD, linewidth=1.3, linestyle=ALLY_DASH)
        add_label(axes, (box.x_max, box.y_max), str(item.ally + 1), GUARD, xytext=(1, 0), fontweight="bold")


def _add_sign(axes: Axes, truth: Truth, view: Box) -> None:
    """What is to be said about an intruder without a detection."""
    per_point = (view.x_max - view.x_min) / (72.0 / DPI * axes.get_window_extent().width)
    middle, half = place_of(truth, 3.0 * per_point, SIGN_PT * per_point)
    if truth.is_out_of_range:
        for stroke in RING:
            x, y = (stroke * max(half) + middle).T
            axes.plot(x, y, color=hexadecimal(OUT_OF_RANGE), linewidth=0.8, zorder=6)
    if truth.is_missed:
        for stroke in CORNERS:
            x, y = (stroke * half + middle).T
            axes.plot(x, y, color=hexadecimal(MISSED), linewidth=2.0, zorder=6)
        for one in _badge():
            one.set_data([middle[0] - half[0]], [middle[1] + half[1]])
            axes.add_line(one)


def _badge() -> tuple[Line2D, Line2D]:
    """A disc and the exclamation mark on it, at no place yet."""
    disc = Line2D([], [], linestyle="none", marker="o", markersize=7.5, zorder=7)
    disc.set(markerfacecolor=hexadecimal(MISSED), markeredgecolor="white", markeredgewidth=0.7)
    mark = Line2D([], [], linestyle="none", marker="$!$", markersize=4.8, zorder=8)
    mark.set(markerfacecolor="white", markeredgecolor="white", markeredgewidth=0.3)
    return disc, mark


def _strokes(strokes: Sequence[Floats], color: RGB, size_pt: float, width_pt: float) -> Line2D:
    """A sign as the marker of a legend."""
    path = Path.make_compound_path(*map(Path, strokes))
    handle = Line2D([], [], linestyle="none", marker=path, markersize=size_pt, fillstyle="none")
    handle.set(markeredgecolor=hexadecimal(color), markeredgewidth=width_pt)
    return handle


def _detections_legend(setup: Setup, scene: Scene) -> tuple[list[Mark], list[str]]:
    """What is in this very picture, and what it means."""
    boxes, truths = scene.detections, scene.truths
    crossed = Line2D([], [], color=hexadecimal(FALSE_DETECTION), linestyle="none", marker="x", markersize=8)
    false = (_empty_patch("", FALSE_DETECTION), crossed)
    missed = (_strokes(CORNERS, MISSED, 14.0, 1.8), *_badge())
    entries: list[tuple[Mark, str, bool]] = [
        (Patch(facecolor="#404040"), "wall on the prior map", True),
        (
            _empty_patch("", DETECTION),
            f"{TRUE_POSITIVE}, with the\nnumber of its guard",
            any(not (found.is_false or found.is_further) for found in boxes),
        ),
        (
            _empty_patch("", DETECTION, linestyle=DASHED),
            DUPLICATE,
            any(found.is_further for found in boxes),
        ),
        (false, FALSE_POSITIVE, any(found.is_false for found in boxes)),
        (_empty_patch("", INTRUDER, linewidth=0.8), "intruder, true outline", bool(truths)),
        (missed, MISS, any(truth.is_missed for truth in truths)),
        (
            _strokes(RING, OUT_OF_RANGE, 13.0, 0.8),
            NO_ERROR,
            any(truth.is_out_of_range for truth in truths),
        ),
        (_empty_patch("", GUARD, linewidth=0.8), "guard, true outline", bool(scene.guards)),
        (_reach_mark(), setup.reach, bool(scene.guards)),
        (_returns_mark(), "LiDAR returns", setup.shows_scans),
    ]
    shown = [(mark, text) for mark, text, is_there in entries if is_there]
    return [mark for mark, _ in shown], [text for _, text in shown]


def _empty_patch(
    label: str,
    color: tuple[int, int, int],
    linewidth: float = 1.6,
    linestyle: tuple[float, Sequence[float]] | None = None,
) -> Patch:
    return Patch(
        facecolor="none",
        edgecolor=hexadecimal(color),
        linewidth=linewidth,
        linestyle=linestyle,
        label=label,
    )


def _add_driven(axes: Axes, path: Floats, number: int, of: int) -> None:
    color = EXPLORERS[(number - 1) % len(EXPLORERS)]
    axes.plot(path[:, 0], path[:, 1], color=hexadecimal(color), linewidth=1.0, zorder=3)
    for pose, fill in ((path[0], "none"), (path[-1], "full")):
        axes.plot(
            pose[0],
            pose[1],
            marker="o",
            markersize=6,
            fillstyle=fill,
            color=hexadecimal(color),
            zorder=4,
        )
    if of > 1:
        end = (float(path[-1, 0]), float(path[-1, 1]))
        add_label(axes, end, str(number), color, xytext=(5, 5), fontsize=9, fontweight="bold")


def _map_legend(robots: int, has_truth: bool) -> list[Artist]:
    handles: list[Artist] = [
        Patch(facecolor=str(OCCUPIED), label="occupied"),
        Patch(facecolor="white", edgecolor="#999999", label="free"),
        Patch(facecolor=str(UNKNOWN), label="unknown"),
    ]
    if has_truth:
        handles.append(Patch(facecolor="none", edgecolor=hexadecimal(TRUTH), label="true walls"))
    color = hexadecimal(EXPLORERS[0] if robots == 1 else INK)
    handles += [
        Line2D([], [], color=color, marker="o", markevery=[0], fillstyle="none", label="start and path"),
        Line2D([], [], color=color, marker="o", linestyle="none", label="end"),
    ]
    return handles
