"""A map as a picture: what is known, the ways that robots took, and where walls truly are."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from midnet_bench.drawing.palette import EXPLORERS, INK, TRUTH, hexadecimal
from midnet_bench.drawing.plots import add_label, add_polygon, new_figure, show_grid, show_metres
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid

Floats = npt.NDArray[np.float64]

UNKNOWN, OCCUPIED = 0.8, 0.15
"""shades of grey; free is white"""
MARGIN_M = 0.3
MOST_CELLS = 4000
"""along a side of what is drawn; the picture has some 1000 pixels there"""
HEIGHT_IN = 7.6
SIDE_IN, TOP_IN, BOTTOM_IN = 0.75, 0.4, 0.8


def draw_map(grid: OccupancyGrid, ways: Sequence[Floats], title: str, walls: Sequence[Floats] = ()) -> Figure:
    """The known part of a map, and all true walls, with each robot's way on it, metres of the map frame.

    Args:
        grid: int8, 100 occupied, 0 free, -1 unknown.
        ways: of each robot, (k, 3) or (k, 2) poses in driving order.
        title: stands above.
        walls: outlines of the true walls, (n, 2) each, where they are known.
    """
    corners = np.array([*known_corners(grid), *(corner for outline in walls for corner in outline)])
    view = Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()).shrunk(-MARGIN_M)
    wide = (view.x_max - view.x_min) / (view.y_max - view.y_min)
    plot_in = HEIGHT_IN - TOP_IN - BOTTOM_IN
    width_in = max(7.5, plot_in * wide + 2 * SIDE_IN)
    figure = new_figure(width_in, HEIGHT_IN)
    axes = figure.add_axes(
        (SIDE_IN / width_in, BOTTOM_IN / HEIGHT_IN, 1 - 2 * SIDE_IN / width_in, plot_in / HEIGHT_IN)
    )
    axes.set_facecolor(str(UNKNOWN))
    show_grid(axes, coarsened(grid, MOST_CELLS), UNKNOWN, OCCUPIED)
    show_metres(axes, view)
    axes.set_title(title, fontsize=11, loc="left")
    axes.set_xlabel("x / m", fontsize=9)
    axes.set_ylabel("y / m", fontsize=9)
    for outline in walls:
        add_polygon(axes, outline, fill=False, edgecolor=hexadecimal(TRUTH), linewidth=0.6, zorder=2)
    for number, way in enumerate(ways, 1):
        _add_way(axes, way, number, len(ways))
    figure.legend(
        handles=_legend(len(ways), bool(walls)), loc="lower center", ncols=6, fontsize=8.5, frameon=False
    )
    return figure


def coarsened(grid: OccupancyGrid, most_cells: int) -> OccupancyGrid:
    """A map of the same place with at most so many cells along each side.

    A cell of it is occupied if one of those that it is made of is, else free if one is. The grid itself if it
    is small enough.
    """
    factor = -(-max(grid.width, grid.height) // most_cells)
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


def _add_way(axes: Axes, way: Floats, number: int, of: int) -> None:
    color = EXPLORERS[(number - 1) % len(EXPLORERS)]
    axes.plot(way[:, 0], way[:, 1], color=hexadecimal(color), linewidth=1.0, zorder=3)
    for pose, fill in ((way[0], "none"), (way[-1], "full")):
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
        end = (float(way[-1, 0]), float(way[-1, 1]))
        add_label(axes, end, str(number), color, xytext=(5, 5), fontsize=9, fontweight="bold")


def _legend(robots: int, has_truth: bool) -> list[Artist]:
    handles: list[Artist] = [
        Patch(facecolor=str(OCCUPIED), label="occupied"),
        Patch(facecolor="white", edgecolor="#999999", label="free"),
        Patch(facecolor=str(UNKNOWN), label="unknown"),
    ]
    if has_truth:
        handles.append(Patch(facecolor="none", edgecolor=hexadecimal(TRUTH), label="true walls"))
    color = hexadecimal(EXPLORERS[0] if robots == 1 else INK)
    handles += [
        Line2D([], [], color=color, marker="o", markevery=[0], fillstyle="none", label="start and way"),
        Line2D([], [], color=color, marker="o", linestyle="none", label="end"),
    ]
    return handles
