"""One frame in pictures: a guard's grids A to D, and the tree in which all guards' boxes are fused."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from midnet_bench.drawing.palette import DETECTION, EXPLORERS, GUARD, RGB, hexadecimal
from midnet_bench.drawing.plots import new_figure, own_style
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import divide_and_conquer, fuse_detections
from midnet_bench.midnet.pipeline import Explanation, Observation

LETTERS = "abcdefghijklmnopqrstuvwxyz"

Span = tuple[int, int]
"""the first and the last guard of a part of the team, from 0"""


class Node(NamedTuple):
    """A call of Algorithm 3."""

    left: list[int]
    """indices of the boxes that are left"""
    halves: tuple[Span, ...]
    """that it fuses; none for a single guard"""
    lost: list[tuple[int, int]]
    """(box, the box that stays in its place)"""


class Tree(NamedTuple):
    """Algorithm 3 over a team's boxes."""

    boxes: list[Box]
    """without those of allies, guard after guard"""
    names: list[str]
    """of each box, such as 2b: the second box of guard 2"""
    nodes: Mapping[Span, Node]

    @property
    def root(self) -> Node:
        """The last call, over the whole team."""
        return self.nodes[max(self.nodes, key=lambda span: span[1] - span[0])]


def tree_of(explanation: Explanation, threshold: float) -> Tree:
    """The calls of Algorithm 3 for one frame; ``threshold``: the least IoU of boxes that are fused."""
    kept = [view.kept for view in explanation.views]
    boxes = [box for own in kept for box in own]
    lists = np.split(np.arange(len(boxes)), np.cumsum([*map(len, kept)])[:-1])
    names = [f"{robot + 1}{name}" for robot, own in enumerate(kept) for name in _letters(len(own))]
    rows = np.array(boxes).reshape(-1, 4)
    nodes: dict[Span, Node] = {}

    def left_of(first: int, last: int) -> list[int]:
        return [int(k) for k in divide_and_conquer(lists, first, last, rows, threshold)]

    def winner_of(i: int, j: int) -> int | None:
        """Algorithm 4 of two lists of one box: the one that is left, None if both are."""
        one, other = (np.array([k], dtype=np.int64) for k in (i, j))
        left = fuse_detections(one, other, rows, threshold)
        return int(left[0]) if len(left) == 1 else None

    def call(first: int, last: int) -> None:
        if first == last:
            nodes[first, last] = Node(left_of(first, last), (), [])
            return
        middle = (first + last) // 2
        halves = (first, middle), (middle + 1, last)
        for half in halves:
            call(*half)
        one, other = (nodes[half].left for half in halves)
        lost = []
        for i in other:
            matches = ((j, winner) for j in one if (winner := winner_of(i, j)) is not None)
            j, winner = next(matches, (i, i))
            lost += [] if winner == j == i else [(j if winner == i else i, winner)]
        nodes[first, last] = Node(left_of(first, last), halves, lost)

    call(0, len(kept) - 1)
    return Tree(boxes, names, nodes)


def _letters(count: int) -> list[str]:
    """a, b, ... z, aa, ab ..."""
    return [*LETTERS, *(one + two for one in LETTERS for two in LETTERS)][:count]


def _show_metres(axes: Axes, view: Box, title: str | None = None) -> None:
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


def _show_grid(axes: Axes, grid: OccupancyGrid, unknown: float = 0.8, occupied: float = 0.25) -> None:
    """An int8 map (100 occupied, 0 free, -1 unknown) in its place, metres; shades of grey, free is white."""
    shades = np.select([grid.data < 0, grid.data >= 100], [unknown, occupied], 1.0)
    _show_greys(axes, grid.with_data(shades), 1.0)


def _show_greys(axes: Axes, grid: OccupancyGrid, white: float) -> None:
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


def _add_box(axes: Axes, box: Box, color: RGB, **style: Any) -> None:
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


def _add_label(axes: Axes, at: tuple[float, float], text: str, color: RGB, **style: Any) -> None:
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
        _show_greys(one, grid, white)
        _show_metres(one, window)
        one.set_title(title, fontsize=10)
        one.plot(seen.pose.x, seen.pose.y, marker="+", color=hexadecimal(GUARD), markersize=8)
    for box in view.kept:
        _add_box(axes[-1], box, DETECTION, linewidth=1.5)
    for taken in explanation.removed:
        if taken.detection.robot == guard:
            box = taken.detection.box
            _add_box(axes[-1], box, GUARD, linewidth=1.5, linestyle="--")
            _add_label(axes[-1], (box.x_max, box.y_max), f"guard {taken.ally + 1}", GUARD)
    figure.tight_layout()
    return figure


@own_style()
def draw_fusion(prior: OccupancyGrid, tree: Tree) -> Figure:
    """All guards' boxes on the map, and the lists that Algorithm 3 makes of them, level by level."""
    team = max(last for _, last in tree.nodes) + 1
    figure = new_figure(11.0, 5.4 if team <= 5 else 7.0)
    plan, axes = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    plan.set_anchor("N")
    axes.set_anchor("N")
    _show_grid(plan, prior)
    view = Box(*np.array(prior.extent).tolist())
    _show_metres(plan, view, "Boxes on the prior map; thick: left after fusion")
    for k, (box, name) in enumerate(zip(tree.boxes, tree.names, strict=True)):
        is_left = k in tree.root.left
        color = EXPLORERS[(int(name.rstrip(LETTERS)) - 1) % len(EXPLORERS)]
        _add_box(plan, box, color, linewidth=2.2 if is_left else 0.8)
        corner, at = ((box[2], box[3]), (2.0, 2.0)) if is_left else ((box[0], box[1]), (-9.0, -8.0))
        _add_label(plan, corner, name, color, xytext=at)
    _draw_tree(axes, tree, team)
    figure.tight_layout()
    return figure


def _draw_tree(axes: Axes, tree: Tree, team: int) -> None:
    level: dict[Span, int] = {}
    for span, node in tree.nodes.items():  # halves come before what they are halves of
        level[span] = 1 + max((level[half] for half in node.halves), default=-1)
    for (first, last), node in tree.nodes.items():
        x, y = (first + last) / 2.0, level[first, last]
        for half in node.halves:
            axes.plot([sum(half) / 2.0, x], [level[half] + 0.2, y - 0.25], color="#999999", zorder=1)
        text = f"guard {first + 1}" if first == last else f"guards {first + 1} to {last + 1}"
        for start in range(0, len(node.left), 4):
            text += "\n" + " ".join(tree.names[k] for k in node.left[start : start + 4])
        if node.lost:
            text += "\nfused: " + ", ".join(f"{tree.names[k]} into {tree.names[j]}" for k, j in node.lost)
        box = {"facecolor": "white", "edgecolor": hexadecimal(GUARD), "boxstyle": "round,pad=0.35"}
        size = 8.5 if team <= 5 else 6.5
        axes.text(x, y, text, ha="center", va="center", fontsize=size, zorder=2, bbox=box)
    axes.set(xlim=(-0.6, team - 0.4), ylim=(-0.4, max(level.values()) + 0.5))
    axes.set_title("The tree of Algorithm 3, from the bottom up", fontsize=11, loc="left")
    axes.axis("off")
