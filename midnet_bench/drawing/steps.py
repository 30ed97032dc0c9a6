"""One frame in pictures: a guard's grids A to D, and the tree in which all guards' boxes are fused."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from midnet_bench.drawing.canvas import (
    Canvas,
    Labels,
    Picture,
    blank_page,
    paint_grid,
    paint_removed,
    paint_scale,
    text_mask,
    write,
)
from midnet_bench.drawing.palette import DETECTION, EXPLORERS, FAINT_INK, GUARD, INK, WHITE
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.fusion import divide_and_conquer, fuse_detections
from midnet_bench.midnet.pipeline import Explanation, Observation

TILE_PX, GAP_PX, TITLE_PX, TEXT_PX = 400, 18, 26, 16
PLAN_PX, NODE_PX, LEVEL_PX, NODE_TEXT_PX, ROW_PX = 640, 130, 130, 13, 18
LETTERS = "abcdefghijklmnopqrstuvwxyz"

Item = TypeVar("Item")
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
    def levels(self) -> dict[Span, int]:
        """Of each call, how many lie below it at most."""
        level: dict[Span, int] = {}
        for span, node in self.nodes.items():  # halves come before what they are halves of
            level[span] = 1 + max((level[half] for half in node.halves), default=-1)
        return level

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


def draw_views(seen: Observation, explanation: Explanation, guard: int) -> Picture:
    """One guard's costmap, its grids A to D and its boxes."""
    view, costs = explanation.views[guard], seen.costmap.data
    window = Box(*seen.costmap.extent).shrunk(-seen.costmap.resolution)
    greys = np.rint(2.55 * (100 - np.where(costs < 0, 50, costs))).astype(np.uint8)
    panels: list[tuple[str, OccupancyGrid]] = [
        ("costmap: 0 white, 100 black", seen.costmap.with_data(greys)),
        ("A: local grid (Eq. 1)", view.a),
        ("B: prior map, cropped (Algorithm 1)", view.b),
        ("C: occupied in both (Eq. 5)", view.c),
        ("D: occupied in A only (Eq. 6)", view.d),
        ("boxes of D; dashed: an ally", view.a),
    ]
    across, down = TILE_PX + GAP_PX, TILE_PX + TITLE_PX + GAP_PX
    page = blank_page(3 * across + GAP_PX, 2 * down + GAP_PX)
    for place, (title, grid) in enumerate(panels):
        left, top = GAP_PX + place % 3 * across, GAP_PX + place // 3 * down
        write(page, left, top, title, TEXT_PX, INK)
        canvas = paint_grid(page, left, top + TITLE_PX, TILE_PX, window, grid)
        canvas.cross(seen.pose[:2], GUARD)
        if not place:
            paint_scale(canvas, window)
    for box in view.kept:
        canvas.box(box, DETECTION, 2)
    for taken in explanation.removed:
        if taken.detection.robot == guard:
            paint_removed(canvas, taken.detection.box, f"guard {taken.ally + 1}")
    return page


def draw_fusion(prior: OccupancyGrid, tree: Tree) -> Picture:
    """All guards' boxes on the map, and the lists that Algorithm 3 makes of them, level by level."""
    team, levels = max(last for _, last in tree.nodes) + 1, 1 + max(tree.levels.values())
    left, width, height = PLAN_PX + 2 * GAP_PX, max(PLAN_PX, NODE_PX * team), max(PLAN_PX, LEVEL_PX * levels)
    page = blank_page(left + width + GAP_PX, TITLE_PX + 2 * GAP_PX + height)
    write(page, GAP_PX, GAP_PX, "Boxes on the prior map; thick: left after fusion", TEXT_PX, INK)
    write(page, left, GAP_PX, "The tree of Algorithm 3, from the bottom up", TEXT_PX, INK)
    greys = np.select([prior.data < 0, prior.data >= 100], [205, 40], 255).astype(np.uint8)
    view, top = Box(*prior.extent), GAP_PX + TITLE_PX
    plan = paint_grid(page, GAP_PX, top, PLAN_PX, view, prior.with_data(greys))
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
    for span, node in tree.nodes.items():
        for half in node.halves:
            canvas.line([at[half], at[span]], FAINT_INK)
    for (first, last), node in tree.nodes.items():
        lines = [f"guard {first + 1}" if first == last else f"guards {first + 1} to {last + 1}"]
        lines += [" ".join(tree.names[k] for k in four) for four in _by(4, node.left)]
        lines += [
            "fused: " * (not number) + ", ".join(f"{tree.names[k]} into {tree.names[j]}" for k, j in two)
            for number, two in enumerate(_by(2, node.lost))
        ]
        widths = [text_mask(line, NODE_TEXT_PX).shape[1] for line in lines]
        (x, y), half_x, half_y = at[first, last], max(widths) / 2.0 + 6.0, ROW_PX * len(lines) / 2.0 + 4.0
        canvas.box(Box(x - half_x, y - half_y, x + half_x, y + half_y), GUARD, fill=WHITE)
        for number, (line, wide) in enumerate(zip(lines, widths, strict=True)):
            row = round(4.0 - y - half_y) + ROW_PX * number
            write(picture, round(x - wide / 2.0), row, line, NODE_TEXT_PX, INK)


def _by(count: int, items: Sequence[Item]) -> list[Sequence[Item]]:
    return [items[first : first + count] for first in range(0, len(items), count)]
