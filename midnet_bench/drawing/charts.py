"""What charts of numbers share: series that colour-blind readers tell apart, estimates with intervals."""

import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.drawing.plots import own_style
from midnet_bench.errors import InputError

DPI = 200
FONT_PT = 9
METADATA: Mapping[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""format of a figure -> what is left out of its file, or its bytes would differ"""
FORMATS = ("png", "svg")
"""written unless other formats are given"""


class Style(NamedTuple):
    """Colour, marker and dash each tell the series apart alone: for colour-blind readers and grey print."""

    color: str
    marker: str
    dash: str | tuple[int, tuple[float, ...]]


STYLES = (
    Style("#0072B2", "o", "-"),
    Style("#D55E00", "s", "--"),
    Style("#009E73", "^", "-."),
    Style("#CC79A7", "D", ":"),
    Style("#000000", "v", (0, (5, 1, 1, 1, 1, 1))),
)
"""Okabe and Ito's colours"""


def chart(width_in: float, height_in: float, w_pad: float = 0.12, h_pad: float = 0.08) -> Figure:
    """An empty figure on a canvas of its own, laid out by its contents."""
    figure = Figure(figsize=(width_in, height_in), layout=ConstrainedLayoutEngine(w_pad=w_pad, h_pad=h_pad))
    FigureCanvasAgg(figure)
    return figure


def add_estimates(
    axes: Axes, places: Sequence[float], estimates: Sequence[Estimate], style: Style, label: str | None
) -> None:
    """A line through estimates at places along x, each with its interval as a bar."""
    values, lows, highs = (np.array([e[part] for e in estimates]) for part in range(3))
    axes.errorbar(
        places,
        values,
        # where all trials are alike the value may lie outside its interval, by a rounding
        yerr=np.maximum(0.0, [values - lows, highs - values]),
        label=label,
        color=style.color,
        marker=style.marker,
        linestyle=style.dash,
        markersize=5,
        linewidth=1.3,
        elinewidth=0.8,
        capsize=2,
    )


def add_series(
    axes: Axes,
    series: Mapping[str, Mapping[int, Estimate]],
    dodge: float,
    x_label: str,
    styles: Sequence[Style] = STYLES,
) -> None:
    """A line for each series over whole numbers along x.

    Args:
        axes: to draw in.
        series: label -> x -> what is drawn there.
        dodge: between neighbouring series along x, so that intervals do not cover each other.
        x_label: of the axis.
        styles: of the series, in turn.
    """
    for place, ((label, points), style) in enumerate(zip(series.items(), cycle(styles))):
        shift = dodge * (place - (len(series) - 1) / 2)
        add_estimates(axes, [x + shift for x in points], list(points.values()), style, label)
    axes.set_xlabel(x_label)
    places = sorted({x for points in series.values() for x in points})
    if len(places) == 1:
        axes.set_xlim(places[0] - 1.0, places[0] + 1.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    light_grid(axes)


def light_grid(axes: Axes) -> None:
    """Faint horizontal lines behind the data, and no frame at the top and the right."""
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def drawn_data(name: str, figure: Figure) -> Table:
    """What a figure shows, as a table: a row for each point of each line, with its interval if it has one.

    ``at`` is the label of the nearest tick where points are set apart along x, else the place itself.
    """
    rows: list[Mapping[str, Cell]] = []
    for axes in figure.axes:
        panel = ", ".join(filter(None, (axes.get_title() or axes.get_title("left"), axes.get_ylabel())))
        bars = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
        drawn = [(one.lines[0], str(one.get_label()), one.lines[2]) for one in bars]
        labels = {line: str(line.get_label()) for line in axes.lines}
        drawn += [(line, text, ()) for line, text in labels.items() if not text.startswith("_") and not bars]
        ticks = dict(zip(axes.get_xticks(), (one.get_text() for one in axes.get_xticklabels()), strict=False))
        for line, label, intervals in drawn:
            ends = [np.asarray(segment) for one in intervals for segment in one.get_segments()]
            for number, (x, y) in enumerate(np.asarray(line.get_xydata()).tolist()):
                tick = min(ticks, key=lambda place: abs(place - x)) if bars and ticks else None
                row: dict[str, Cell] = {
                    "panel": panel,
                    "series": "" if label.startswith("_") else label,
                    "at": f"{x:g}" if tick is None else ticks[tick].replace("\n", " ") or f"{tick:g}",
                    "value": y,
                }
                # a point without an interval has an empty bar
                if number < len(ends) and ends[number].ndim == 2:
                    low, high = ends[number][:, 1].min(), ends[number][:, 1].max()
                    row |= {"low": float(low), "high": float(high)}
                rows.append(row)
    return Table(f"{name}_data", f"Data of {name}", rows)


def counted(estimates: Sequence[Estimate], method: str) -> str:
    """``mean of 20 trials; 95 % intervals: ...``: what the points of a figure are made of, for its foot."""
    counts = sorted({estimate.n for estimate in estimates})
    if counts == [1]:
        return "one trial each, without intervals"
    return f"mean of {' to '.join(map(str, sorted({counts[0], counts[-1]})))} trials; {method}"


def labelled(axes: Axes) -> tuple[list[Artist], list[str]]:
    """The handles and labels of a legend."""
    handles, labels = axes.get_legend_handles_labels()
    return handles, labels


@own_style()
def chart_files(figure: Figure, formats: Sequence[str] = FORMATS) -> dict[str, bytes]:
    """The figure's files by ending; the same figure gives the same bytes.

    Args:
        figure: to be written.
        formats: of ``METADATA``.

    Raises:
        InputError: there is no such format.
    """
    if unknown := [one for one in formats if one not in METADATA]:
        raise InputError(f"figure format '{unknown[0]}': use {', '.join(METADATA)}")
    files = {}
    # without a salt the ids in an SVG are random; type 42 keeps a PDF's text selectable
    with rc_context({"svg.hashsalt": "midnet-bench", "pdf.fonttype": 42}):
        for name in formats:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=name, dpi=DPI, metadata=METADATA[name])
            files[f".{name}"] = buffer.getvalue()
    return files
