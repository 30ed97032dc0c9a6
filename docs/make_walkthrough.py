"""Makes the pictures of ``docs/walkthrough.md``: ``python docs/make_walkthrough.py``."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

import midnet_bench as mb
from midnet_bench.drawing.palette import DETECTION, EXPLORERS, GUARD, RGB, hexadecimal
from midnet_bench.drawing.plots import new_figure, own_style, png_of_figure
from midnet_bench.experiments.guarded.arena import ObservedFrame
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import divide_and_conquer, fuse_detections, overlaps
from midnet_bench.midnet.pipeline import Explanation, Observation

IMAGES = Path(__file__).with_name("images")
SEED, FRAME, GUARD_SHOWN = 1, 226, 3
"""the frame has few boxes, and a fusion at each level of the tree"""
NODES = {(0, 0): 0, (1, 1): 1, (2, 2): 2, (3, 3): 3, (4, 4): 4, (0, 1): 0.5, (0, 2): 1.25, (3, 4): 3.5}
"""the lists of Algorithm 3, first and last robot from 0, and where each stands"""
HALVES = {(0, 1): ((0, 0), (1, 1)), (0, 2): ((0, 1), (2, 2)), (3, 4): ((3, 3), (4, 4))}
LEVELS = {(0, 1): 1, (0, 2): 2, (3, 4): 2, (0, 4): 3}


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
        path_effects=[withStroke(linewidth=2.0, foreground="white")],
        zorder=9,
        annotation_clip=True,
    )


@own_style()
def draw_views(seen: Observation, explanation: Explanation, guard: int) -> Figure:
    """One guard's costmap, its grids A to D and its boxes."""
    view, resolution = explanation.views[guard], seen.costmap.resolution
    x_min, y_min, x_max, y_max = seen.costmap.extent
    window = Box(x_min - resolution, y_min - resolution, x_max + resolution, y_max + resolution)
    costs = seen.costmap.with_data(100 - np.where(seen.costmap.data < 0, 50, seen.costmap.data))
    figure = new_figure(9.0, 6.3)
    axes = figure.subplots(2, 3).ravel()
    panels: list[tuple[str, OccupancyGrid, float]] = [
        ("costmap: 0 white, 100 black", costs, 100.0),
        ("A: local grid (Eq. 1)", view.a, 255.0),
        ("B: prior map, cropped (Algorithm 1)", view.b, 255.0),
        ("C: occupied in both (Eq. 5)", view.c, 255.0),
        ("D: occupied in A only (Eq. 6)", view.d, 255.0),
        ("boxes of D; dashed: an ally", view.a, 255.0),
    ]
    for one, (title, grid, white) in zip(axes, panels, strict=True):
        one.set_facecolor("#cccccc")
        show_greys(one, grid, white)
        show_metres(one, window)
        one.set_title(title, fontsize=10)
        one.plot(seen.pose.x, seen.pose.y, marker="+", color=hexadecimal(GUARD), markersize=8)
    for box in view.kept:
        add_box(axes[-1], box, DETECTION, linewidth=1.5)
    for taken in explanation.removed:
        if taken.detection.robot == guard:
            box = taken.detection.box
            add_box(axes[-1], box, GUARD, linewidth=1.5, linestyle="--")
            add_label(axes[-1], (box.x_max, box.y_max), f"guard {taken.ally + 1}", GUARD)
    figure.tight_layout()
    return figure


@own_style()
def draw_fusion(prior: OccupancyGrid, explanation: Explanation, threshold: float) -> Figure:
    """All guards' boxes on the map, and the lists that Algorithm 3 makes of them, level by level."""
    kept = [view.kept for view in explanation.views]
    boxes = np.array([box for own in kept for box in own]).reshape(-1, 4)
    starts = np.cumsum([0, *map(len, kept)])
    names = [f"{robot + 1}{'abcdefghijk'[k]}" for robot, own in enumerate(kept) for k in range(len(own))]
    seen = overlaps(boxes)

    def fused(first: int, last: int) -> list[int]:
        lists = divide_and_conquer(np.arange(len(boxes)), starts, first, last, seen, threshold)
        return [int(k) for k in lists]

    def into(i: int, j: int) -> int:
        """Algorithm 4 of two lists of one box: which is left, -1 if both are."""
        one, other = (np.array([k], dtype=np.int64) for k in (i, j))
        left: npt.NDArray[np.int64] = fuse_detections(one, other, seen, threshold)
        return int(left[0]) if len(left) == 1 else -1

    figure = new_figure(11.0, 5.4)
    plan, tree = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    plan.set_anchor("N")
    tree.set_anchor("N")
    show_grid(plan, prior)
    show_metres(
        plan, Box(*np.array(prior.extent).tolist()), "Boxes on the prior map; thick: left after fusion"
    )
    left = fused(0, len(kept) - 1)
    for k, name in enumerate(names):
        color = EXPLORERS[int(name[0]) - 1]
        add_box(plan, Box(*boxes[k].tolist()), color, linewidth=2.2 if k in left else 0.8)
        corner, at = ((2, 3), (2.0, 2.0)) if k in left else ((0, 1), (-9.0, -8.0))
        add_label(plan, (boxes[k, corner[0]], boxes[k, corner[1]]), name, color, xytext=at)
    _draw_tree(tree, fused, into, names)
    figure.tight_layout()
    return figure


def _draw_tree(
    axes: Axes, fused: Callable[[int, int], list[int]], into: Callable[[int, int], int], names: list[str]
) -> None:
    places, halves = {**NODES, (0, 4): 2.3}, {**HALVES, (0, 4): ((0, 2), (3, 4))}
    for (first, last), x in places.items():
        y = LEVELS.get((first, last), 0)
        own, text = (
            fused(first, last),
            f"guard {first + 1}" if first == last else f"guards {first + 1} to {last + 1}",
        )
        lost: list[str] = []
        for half in halves.get((first, last), ()):
            axes.plot([places[half], x], [LEVELS.get(half, 0) + 0.2, y - 0.25], color="#999999", zorder=1)
        if first < last:
            left, right = (fused(*half) for half in halves[first, last])
            for i in right:
                matches = ((j, into(i, j)) for j in left)
                j, winner = next((match for match in matches if match[1] >= 0), (i, i))
                lost += [] if winner == j == i else [f"{names[j if winner == i else i]} into {names[winner]}"]
        for start in range(0, len(own), 4):
            text += "\n" + " ".join(names[k] for k in own[start : start + 4])
        if lost:
            text += f"\nfused: {', '.join(lost)}"
        axes.text(
            x, y, text, ha="center", va="center", fontsize=8.5, zorder=2,
            bbox={"facecolor": "white", "edgecolor": hexadecimal(GUARD), "boxstyle": "round,pad=0.35"},
        )  # fmt: skip
    axes.set(xlim=(-0.6, 4.6), ylim=(-0.4, 3.5))
    axes.set_title("The tree of Algorithm 3, from the bottom up", fontsize=11, loc="left")
    axes.axis("off")


def shown_frame() -> tuple[OccupancyGrid, ObservedFrame]:
    """The prior map, and the frame that the page shows."""
    with mb.simulate(seed=SEED, robots=5, frames=FRAME, engine="fast", explain=True) as frames:
        *_, frame = frames
    return frames.trial.prior_map, frame


def main() -> None:
    """Write both pictures."""
    prior, frame = shown_frame()
    found = frame.midnet.explanation
    assert found is not None
    guard = GUARD_SHOWN - 1
    pictures = {
        "walk-grids.png": draw_views(frame.observations[guard], found, guard),
        "walk-fusion.png": draw_fusion(prior, found, mb.MIDNetSettings().iou_fuse),
    }
    for name, figure in pictures.items():
        (IMAGES / name).write_bytes(png_of_figure(figure))
        print(IMAGES / name)


if __name__ == "__main__":
    main()
