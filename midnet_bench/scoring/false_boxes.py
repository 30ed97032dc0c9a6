"""What a false box is made of: whose returns, how old, and put off by which error."""

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np

from midnet_bench.geometry import Box, lengths
from midnet_bench.grid import OccupancyGrid, cell_centers, cell_middles, values_at
from midnet_bench.scoring.error_causes import UNEXPLAINED
from midnet_bench.scoring.errors import (
    WALL,
    Booleans,
    Cause,
    Floats,
    GuardView,
    Ints,
    Marks,
    box_at_scan,
    guard_of,
    source_name,
    touches,
)
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.scoring.loss_funnel import beside


class Views(Protocol):
    """The views of one frame, by guard; a list is one, and so is what makes them when they are asked for."""

    def __getitem__(self, guard: int, /) -> GuardView:
        """That guard's."""

    def __iter__(self) -> Iterator[GuardView]:
        """All, in the team's order."""


_NAMES = {"delay": "stale", "pose_error": "misplaced", "under_prior": "rim"}
"""what a box is of which :func:`beside` tells why it misses its intruder"""


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
    made = [(view, *_marks_of(box, view)) for view, box in parts]
    if not any(votes.any() for _, _, votes in made):
        return Cause(UNEXPLAINED, finder)
    view, marks, votes = max(made, key=lambda part: int(part[2].sum()))
    source = max(np.unique(marks.source).tolist(), key=lambda each: int(votes[marks.source == each].sum()))
    own = marks.where((marks.source == source) & (votes > 0))
    name, offset_m = _what(detection, source, own, truths, view)
    return Cause(name, view.guard, source_name(source, truths), float(own.age_s.min()), offset_m)


def _marks_of(box: Box, view: GuardView) -> tuple[Marks, Ints]:
    """The marks that a guard's box can be of, and how many of its cells are nearest to each."""
    if not len(view.marks.source):
        return view.marks, np.zeros(0, dtype=np.int64)
    places = view.marks.believed + view.shift_m
    wide = box.shrunk(-view.reach_m)
    x, y = places[:, 0], places[:, 1]
    near = (x >= wide.x_min) & (x <= wide.x_max) & (y >= wide.y_min) & (y <= wide.y_max)
    marks, places = view.marks.where(near), places[near]
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


def _what(
    detection: Box, source: int, own: Marks, truths: Sequence[TruthObject], view: GuardView
) -> tuple[str, float]:
    """The cause of a box that is mostly of one source, by its marks ``own``; and the error, metres."""
    if source == WALL:
        return _wall(own, view)
    if guard_of(source) is not None:
        return ("ally_left" if own.is_newest.any() else "ally_trail"), 0.0
    if source < 0:
        return UNEXPLAINED, 0.0
    truth = truths[source]
    has_left = all(truth.box.distance_to_point(*point) > view.reach_m for point in own.true.tolist())
    if has_left and not own.is_newest.any():
        return "intruder_trail", float(lengths(own.true - truth.center).min())
    offset = (own.true - own.believed - view.shift_m).mean(axis=0)
    at_scan = box_at_scan(source, truths, view)
    name = _NAMES[beside([detection], at_scan, offset)]
    gone_m = float(lengths(np.array(at_scan.center) - truth.center))
    return name, gone_m if name == "stale" else float(lengths(offset))


def _wall(own: Marks, view: GuardView) -> tuple[str, float]:
    """Which error put a wall's returns where the prior map does not cover them; and how far, metres."""
    if view.covered is None:
        return UNEXPLAINED, 0.0
    offsets_m = {
        "wall_by_crop": float(lengths(np.array(view.shift_m))),
        "wall_by_pose": float(lengths(own.believed - own.at_true_pose).mean()),
        "wall_by_noise": float(lengths(own.believed - own.at_true_range).mean()),
    }
    without = {
        "wall_by_crop": own.believed,
        "wall_by_pose": own.at_true_pose + view.shift_m,
        "wall_by_noise": own.at_true_range + view.shift_m,
    }
    enough = [name for name, places in without.items() if _covered(view.covered, places).all()]
    if not enough and _covered(view.covered, own.true).mean() > 0.5:
        enough = list(without)  # no error alone, but all of them
    if not enough:
        return "wall_by_map", 0.0
    name = max(enough, key=offsets_m.__getitem__)
    return name, offsets_m[name]


def _covered(covered: OccupancyGrid, places: Floats) -> Booleans:
    """For each place whether the prior map takes away all that a mark there gives; beyond the map all is."""
    return values_at(covered.data, covered, places, 1) > 0
