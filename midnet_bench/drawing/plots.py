"""What the pictures that matplotlib draws have in common. Agg only: no window, no global state."""

import contextlib
import io
from collections.abc import Iterator

from matplotlib import rc_context, rcParamsDefault
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 150


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
