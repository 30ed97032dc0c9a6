"""What a false box is made of: whose returns, how old, and put off by which error."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from midnet_bench.geometry import Box, lengths
from midnet_bench.grid import cell_centers, cell_middles
from midnet_bench.scoring.error_causes import UNEXPLAINED
from midnet_bench.scoring.errors import (
    WALL,
    Cause,
    GuardView,
    Ints,
    Marks,
    cells_left,
    guard_of,
    source_name,
    touches,
)
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.scoring.loss_funnel import beside, sizes_of_errors, without_each_error


class Views(Protocol):
    """The views of one frame, by guard; a list is one, and so is what makes them on demand."""

    def __getitem__(self, guard: int, /) -> GuardView:
        """That guard's."""

    def __iter__(self) -> Iterator[GuardView]:
        """All, in the team's order."""


_BESIDE = {
    "delay": "stale",
    "crop": "misplaced_by_crop",
    "pose": "misplaced_by_pose",
    "noise": "misplaced_by_noise",
    "cut": "rim",
}
"""a box of an intruder that does not touch it, by what :func:`beside` says"""


def made_of(detection: Box, finder: int, truths: Sequence[TruthObject], views: Views) -> Cause:
    """What a box is that has no intruder to itself.

    Args:
        detection: of the team, map frame, metres.
        finder: the index of the guard that it is said to come from.
        truths: the intruders as they are now.
        views: of every guard, in the team's order.
    """
    on = [truth.name for truth in truths if touches(detection, truth.box)]
    if on:
        return Cause("fragment", finder, on[0])
    # as it was found; or, where a fusion made a new one, those that it was made of
    same = [(views[finder], box) for box in views[finder].found if box == detection]
    parts = same or [(view, box) for view in views for box in view.found if touches(box, detection)]
    if views[finder].d is None:  # of what it was made is not known
        parts = [(views[finder], detection)]
    made = [(view, *_marks_of(box, view)) for view, box in parts]
    if not any(votes.any() for _, _, votes in made):
        return Cause(UNEXPLAINED, finder)
    view, marks, votes = max(made, key=lambda part: int(part[2].sum()))
    source = max(np.unique(marks.source).tolist(), key=lambda each: int(votes[marks.source == each].sum()))
    own = marks.where((marks.source == source) & (votes > 0))
    is_deflated = source >= 0 and touches(detection.shrunk(-view.deflated_m), truths[source].box)
    name, offset_m = ("deflated", view.deflated_m) if is_deflated else _what(source, own, truths, view)
    return Cause(name, view.guard, source_name(source, truths), float(own.age_s.min()), offset_m)


def _marks_of(box: Box, view: GuardView) -> tuple[Marks, Ints]:
    """The marks that a guard's box can be of, and how many of its cells are nearest to each."""
    marks = view.marks()
    if not len(marks.source):
        return marks, np.zeros(0, dtype=np.int64)
    places = marks.believed + view.shift_m
    box = box.shrunk(-view.deflated_m)
    wide = box.shrunk(-view.reach_m)
    x, y = places[:, 0], places[:, 1]
    near = (x >= wide.x_min) & (x <= wide.x_max) & (y >= wide.y_min) & (y <= wide.y_max)
    marks, places = marks.where(near), places[near]
    votes = np.zeros(len(places), dtype=np.int64)
    if not len(places):
        return marks, votes
    if view.d is None:
        return marks, votes + 1
    cells = cell_centers(view.d, view.d.data > 0)
    x, y = cells[:, 0], cells[:, 1]
    cells = cells[(x > box.x_min) & (x < box.x_max) & (y > box.y_min) & (y < box.y_max)]
    middles = cell_middles(view.d, places)
    distances_m = lengths(cells[:, None] - middles[None])
    nearest = distances_m.argmin(axis=1)
    within = distances_m[np.arange(len(cells)), nearest] <= view.reach_m + 1e-6
    np.add.at(votes, nearest[within], 1)
    return marks, votes


def _what(source: int, own: Marks, truths: Sequence[TruthObject], view: GuardView) -> tuple[str, float]:
    """The cause of a box that is mostly of one source, by its marks ``own``; and the error, metres."""
    if source == WALL:
        return _of_wall(own, view)
    if guard_of(source) is not None:
        return ("ally_left" if own.is_newest.any() else "ally_trail"), 0.0
    if source < 0:
        return UNEXPLAINED, 0.0
    truth = truths[source]
    has_left = all(truth.box.distance_to_point(*point) > view.reach_m for point in own.true.tolist())
    if has_left and not own.is_newest.any():
        return "intruder_trail", float(lengths(own.true - truth.center).min())
    if view.prior is None:
        return UNEXPLAINED, 0.0
    name, offset_m = beside(source, truths, own, view)
    return _BESIDE[name], offset_m


def _of_wall(own: Marks, view: GuardView) -> tuple[str, float]:
    """Which error put a wall's returns where the prior map does not cover them; and how far, metres."""
    places = without_each_error(own, view)
    enough = [name for name, at in places.items() if not len(cells_left(at, view))]
    if not enough and not len(cells_left(own.true, view)):
        enough = list(places)  # no error alone, but all of them
    if view.prior is None or not enough:
        return ("wall_by_map" if view.prior is not None else UNEXPLAINED), 0.0
    lengths_m = sizes_of_errors(own, view)
    name = max(enough, key=lengths_m.__getitem__)
    return f"wall_by_{name}", lengths_m[name]
