"""What the pictures that matplotlib draws have in common. Agg only: no window, no global state."""

import contextlib
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import rc_context, rcParamsDefault
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from matplotlib.patheffects import withStroke

from midnet_bench.drawing.palette import RGB, hexadecimal
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid

DPI = 150
_HALO = [withStroke(linewidth=2.0, foreground="white")]


@contextlib.contextmanager
def own_style() -> Iterator[None]:
    """Matplotlib draws by its defaults, whatever a ``matplotlibrc`` says; also a decorator."""
    with rc_context({key: value for key, value in rcParamsDefault.items() if not key.startswith("backend")}):
        yield


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure on a canvas of its own."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI)
    FigureCanvasAgg(figure)
    return figure


@own_style()
def png_of_figure(figure: Figure) -> bytes:
    """The figure as a PNG file, the same bytes for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def show_metres(axes: Axes, view: Box, title: str | None = None) -> None:
    """Make the axes show ``view`` in metres of the map frame, y up, both directions to one scale.

    With a ``title``, the axes get labels too.
    """
    axes.set_xlim(view.x_min, view.x_max)
    axes.set_ylim(view.y_min, view.y_max)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=8)
    if title is not None:
        axes.set_title(title, fontsize=11, loc="left")
        axes.set_xlabel("x / m", fontsize=9)
        axes.set_ylabel("y / m", fontsize=9)


def show_grid(axes: Axes, grid: OccupancyGrid, unknown: float = 0.8, occupied: float = 0.25) -> None:
    """An int8 map (100 occupied, 0 free, -1 unknown) in its place, metres; shades of grey, free is white."""
    shades = np.select([grid.data < 0, grid.data >= 100], [unknown, occupied], 1.0)
    show_greys(axes, grid.with_data(shades), 1.0)


def show_greys(axes: Axes, grid: OccupancyGrid, white: float) -> None:
    """A grid's (rows, columns) values in their place, metres: 0 is black, ``white`` is white."""
    x_min, y_min, x_max, y_max = grid.extent
    axes.imshow(
        grid.data,
        cmap="gray",
        vmin=0.0,
        vmax=white,
        origin="lower",
        extent=(x_min, x_max, y_min, y_max),
        interpolation="none",
        zorder=0,
    )


def add_polygon(axes: Axes, corners: npt.NDArray[np.float64], **style: Any) -> None:
    """A closed polygon through (n, 2) corners, metres; ``style`` is that of matplotlib's Patch."""
    axes.add_patch(Polygon(corners, closed=True, **style))


def add_box(axes: Axes, box: Box, color: RGB, **style: Any) -> None:
    """The outline of a box; ``style`` is that of matplotlib's Patch."""
    side_x, side_y = box.x_max - box.x_min, box.y_max - box.y_min
    axes.add_patch(
        Rectangle(
            (box.x_min, box.y_min),
            side_x,
            side_y,
            **{"fill": False, "edgecolor": hexadecimal(color), **style},
        )
    )


def add_label(axes: Axes, at: tuple[float, float], text: str, color: RGB, **style: Any) -> None:
    """Small text with a white halo, its lower left corner a little up and right of (x, y), metres."""
    axes.annotate(
        text,
        at,
        **{"xytext": (2.0, 2.0), "textcoords": "offset points", "fontsize": 8, **style},
        color=hexadecimal(color),
        path_effects=_HALO,
        zorder=9,
        annotation_clip=True,
    )
