"""What MIDNet looks at: each robot's grids with its boxes, and the fused detections on the prior map."""

from collections.abc import Sequence

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, INTRUDER, hexadecimal
from midnet_bench.drawing.plots import (
    add_box,
    add_label,
    add_polygon,
    new_figure,
    show_greys,
    show_grid,
    show_metres,
)
from midnet_bench.drawing.scene import RobotMark, Scene, title_of, view_of
from midnet_bench.experiments.guarded.arena import GuardedArena
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import RemovedAlly
from midnet_bench.midnet.pipeline import Explanation, RobotView

COLUMNS = (
    "A: local grid (Eq. 1)",
    "B: prior map, cropped",
    "C: occupied in both (Eq. 5)",
    "D: occupied in A only (Eq. 6)",
)
OUTSIDE = "#cccccc"
ALLY_DASH = (0, (3, 2))


def draw_grids(trial: GuardedArena, scene: Scene, explanation: Explanation) -> Figure:
    """Grids A to D of each guard, a row per guard, in the paper's colours: 0 black, 255 white.

    On A, the boxes around the blobs of D: those that were kept, and those that were taken for an ally. A
    row shows the whole window of the guard's costmap; where it leaves the prior map there is no grid.
    """
    rows = len(explanation.views)
    height_in = 0.95 + 2.75 * rows
    figure = new_figure(11.0, height_in)
    axes = figure.subplots(rows, len(COLUMNS), squeeze=False)
    figure.subplots_adjust(
        left=0.06, right=0.99, top=1.0 - 0.62 / height_in, bottom=0.6 / height_in, wspace=0.14, hspace=0.14
    )
    half_m = trial.parameters.local_size_m / 2.0
    for guard, view, row in zip(scene.guards, explanation.views, axes, strict=True):
        for grid, one in zip((view.a, view.b, view.c, view.d), row, strict=True):
            _show(one, grid, Box.square(guard.believed.x, guard.believed.y, 2.0 * half_m))
        removed = [item for item in explanation.removed if item.sighting.robot == guard.number - 1]
        _add_boxes(row[0], view, removed)
        row[0].set_ylabel(f"guard {guard.number}", fontsize=10, fontweight="bold")
        for one in row[1:]:
            one.tick_params(labelleft=False)  # one window, one scale a row
        for one in row:
            one.plot(guard.believed.x, guard.believed.y, marker="+", color=hexadecimal(GUARD), markersize=8)
    for text, one in zip(COLUMNS, axes[0], strict=True):
        one.set_title(text, fontsize=9.5)
    figure.suptitle(
        f"{title_of(trial)}: frame {scene.frame_number}, t = {scene.time_s:.1f} s. Metres, map frame.",
        x=0.06,
        y=1.0 - 0.12 / height_in,
        ha="left",
        va="top",
        fontsize=11,
    )
    handles: list[Artist] = [
        Patch(facecolor="none", edgecolor=hexadecimal(DETECTION), linewidth=1.6, label="box, kept"),
        Patch(facecolor="none", edgecolor=hexadecimal(GUARD), linestyle=ALLY_DASH, linewidth=1.6),
        Line2D([], [], color=hexadecimal(GUARD), marker="+", markersize=8, linestyle="none"),
        Patch(facecolor=OUTSIDE, label="outside the prior map"),
    ]
    handles[1].set_label("box, removed as the ally of that number")
    handles[2].set_label("the guard, as it believes")
    figure.legend(handles=handles, loc="lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def draw_detections(trial: GuardedArena, scene: Scene) -> Figure:
    """The fused detections on the prior map before inflation, with the true outlines thin underneath."""
    figure = new_figure(9.6, 7.3)
    axes = figure.add_axes((0.065, 0.075, 0.68, 0.87))
    show_metres(axes, view_of(trial, 0.4))
    axes.set_title(
        f"{title_of(trial)}: detections of frame {scene.frame_number}, t = {scene.time_s:.1f} s",
        fontsize=11,
        loc="left",
    )
    axes.set_xlabel("x / m", fontsize=9)
    axes.set_ylabel("y / m", fontsize=9)
    show_grid(axes, trial.prior_map)
    for solid in trial.layout.stationary:
        add_polygon(axes, solid.outline(), fill=False, edgecolor=hexadecimal(INTRUDER), linewidth=0.8)
    for robot in scene.robots:
        _add_outline(axes, robot)
    for found in scene.detections:
        color = FALSE_DETECTION if found.is_false else DETECTION
        style = {"linestyle": (0, (4, 1.5)), "linewidth": 2.0} if found.is_false else {"linewidth": 1.6}
        add_box(axes, found.box, color, zorder=5, **style)
        add_label(axes, (found.box.x_min, found.box.y_max), str(found.robot), color, fontweight="bold")
    figure.legend(
        handles=_legend_of_detections(scene),
        loc="upper left",
        bbox_to_anchor=(0.755, 0.95),
        fontsize=8.5,
        frameon=False,
        labelspacing=0.9,
    )
    return figure


def _show(axes: Axes, grid: OccupancyGrid, window: Box) -> None:
    axes.set_facecolor(OUTSIDE)
    if grid.data.size:
        show_greys(axes, grid, 255.0)
    show_metres(axes, window)


def _add_boxes(axes: Axes, view: RobotView, removed: Sequence[RemovedAlly]) -> None:
    for box in view.kept:
        add_box(axes, box, DETECTION, linewidth=1.3)
    for item in removed:
        box = item.sighting.box
        add_box(axes, box, GUARD, linewidth=1.3, linestyle=ALLY_DASH)
        add_label(axes, (box.x_max, box.y_max), str(item.ally + 1), GUARD, xytext=(1, 0), fontweight="bold")


def _add_outline(axes: Axes, robot: RobotMark) -> None:
    color = GUARD if robot.is_guard else INTRUDER
    add_polygon(axes, robot.outline, fill=False, edgecolor=hexadecimal(color), linewidth=0.8)
    if robot.is_guard:
        add_label(axes, robot.pose[:2], str(robot.number), color, fontsize=7, xytext=(5, -9))


def _legend_of_detections(scene: Scene) -> list[Artist]:
    handles: list[Artist] = [
        Patch(facecolor="#404040", label="wall on the prior map"),
        Patch(
            facecolor="none",
            edgecolor=hexadecimal(DETECTION),
            linewidth=1.6,
            label="detection, with the\nnumber of its guard",
        ),
    ]
    if any(found.is_false for found in scene.detections):
        handles.append(
            Patch(
                facecolor="none",
                edgecolor=hexadecimal(FALSE_DETECTION),
                linewidth=2.0,
                linestyle=(0, (4, 1.5)),
                label="detection that touches\nno intruder",
            )
        )
    handles.append(
        Patch(
            facecolor="none", edgecolor=hexadecimal(INTRUDER), linewidth=0.8, label="intruder, true outline"
        )
    )
    handles.append(
        Patch(facecolor="none", edgecolor=hexadecimal(GUARD), linewidth=0.8, label="guard, true outline")
    )
    return handles
