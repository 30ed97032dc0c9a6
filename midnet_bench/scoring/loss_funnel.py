"""The loss funnel: the stage between an intruder and the team's boxes at which it was lost."""

import math
from collections.abc import Sequence

import numpy as np

from midnet_bench.geometry import Box, lengths
from midnet_bench.grid import OccupancyGrid, cell_centers, cell_middles, values_at
from midnet_bench.midnet.binary_map import OCCUPIED
from midnet_bench.scoring.error_causes import MISS_CAUSES, UNEXPLAINED
from midnet_bench.scoring.errors import (
    WALL,
    Booleans,
    Cause,
    Floats,
    GuardView,
    Marks,
    cells_left,
    guard_of,
    source_name,
    touch,
    touches,
)
from midnet_bench.scoring.frame_counts import TruthObject

_STAGE = {name: stage for stage, name in enumerate(MISS_CAUSES)}
_BESIDE = {
    "delay": "delay",
    "crop": "crop_shift",
    "pose": "pose_error",
    "noise": "range_noise",
    "cut": "under_prior",
}
"""a miss, by what :func:`beside` says of its boxes"""
_OFF_GRID = 1
"""a value that no binary grid has"""


def lost_at(
    truth: int, truths: Sequence[TruthObject], detections: Sequence[Box], views: Sequence[GuardView]
) -> Cause:
    """Why an intruder has no box of its own: the stage that it reached with the guard that got it farthest.

    Args:
        truth: the index of the intruder, which is in range of some guard.
        truths: all intruders as they are now.
        detections: the team's boxes, map frame, metres.
        views: of each guard that has the intruder in range.
    """
    if any(touches(box, truths[truth].box) for box in detections):
        return Cause("merged")
    causes = [_lost_by(truth, truths, view) for view in views]
    return max(causes, key=_stage, default=Cause(UNEXPLAINED))


def _stage(cause: Cause) -> int:
    """How far a guard got it. A late box had passed every stage that a box beside it passes."""
    is_box = cause.name == "delay" and cause.offset_m > 0.0
    return _STAGE["pose_error" if is_box else cause.name]


def _lost_by(truth: int, truths: Sequence[TruthObject], view: GuardView) -> Cause:
    """The stage at which one guard lost it, if the team has no box on it."""
    returns, in_reach = view.returns(truth)
    if not len(in_reach):
        return _unseen(truth, truths, view)
    if not in_reach.any():
        return Cause("beyond_range", view.guard)
    if not in_reach.all():
        returns = returns.where(in_reach)
    age_s = float(returns.age_s.min())
    places = returns.believed + view.shift_m
    places = places[_inside(view.window, places)]
    if not len(places):
        return Cause("outside_window", view.guard, age_s=age_s)
    if view.a is None or view.d is None:
        boxes = [k for k, box in enumerate(view.found) if _inside(box.shrunk(-view.reach_m), places).any()]
        if not boxes:
            return Cause("not_detected", view.guard, age_s=age_s)
    else:
        on_grid = values_at(view.a.data, view.a, places, _OFF_GRID)
        if (on_grid == _OFF_GRID).all():
            return Cause("outside_prior", view.guard, age_s=age_s)
        if not (on_grid == OCCUPIED).any():
            return Cause("below_threshold", view.guard, age_s=age_s)
        left = cells_about(view.d, places, view.reach_m)
        if not len(left):
            return Cause("under_prior", view.guard, age_s=age_s)
        whole = [box.shrunk(-view.deflated_m) for box in view.found]
        boxes = [k for k, box in enumerate(whole) if _inside(box, left).any()]
        if not boxes:
            return Cause("too_small", view.guard, age_s=age_s)
    on_it = [k for k in boxes if touches(view.found[k], truths[truth].box)]
    if not on_it and any(touches(view.found[k].shrunk(-view.deflated_m), truths[truth].box) for k in boxes):
        return Cause("deflated", view.guard, age_s=age_s, offset_m=view.deflated_m)
    if not on_it:
        name, offset_m = beside(truth, truths, returns, view)
        return Cause(_BESIDE[name], view.guard, age_s=age_s, offset_m=offset_m)
    allies = [view.taken[k] for k in on_it]
    if all(taken is not None for taken in allies):
        return Cause("taken_for_ally", view.guard, f"guard {(allies[0] or 0) + 1}", age_s)
    return Cause("dropped_by_fusion", view.guard, age_s=age_s)


def beside(truth: int, truths: Sequence[TruthObject], returns: Marks, view: GuardView) -> tuple[str, float]:
    """Which error of place put what is made of an intruder's returns beside it, and how large it is, metres.

    The cells of the returns are made anew without each error: ``delay`` (the intruder has moved since the
    scan), ``crop``, ``pose`` and ``noise``. It is the largest of those without which a cell lies on the
    intruder. If none is enough alone, it is the largest of them, if a cell does without any. If even then
    none does, it is ``cut``: the prior map covers what else there is of it.

    Args:
        truth: the index of the intruder.
        truths: as they are now.
        returns: of it, of whose cells none lies on it.
        view: of the guard.
    """
    gone = np.array(truths[truth].center) - view.centers_at_scan()[truth]
    places = {
        "delay": returns.believed + view.shift_m + gone,
        **without_each_error(returns, view),
        "all": returns.true + gone,
    }
    resolution = 0.0 if view.prior is None else view.prior.resolution
    touching = [
        name for name, at in places.items() if touch(cells_left(at, view), resolution, truths[truth].box)
    ]
    if not touching:
        return "cut", 0.0
    lengths_m = {"delay": float(lengths(gone)), **sizes_of_errors(returns, view)}
    name = max([name for name in touching if name != "all"] or lengths_m, key=lengths_m.__getitem__)
    return name, lengths_m[name]


def without_each_error(marks: Marks, view: GuardView) -> dict[str, Floats]:
    """(m, 2) where marks lay on the prior map without one error of place: ``crop``, ``pose``, ``noise``."""
    return {
        "crop": marks.believed,
        "pose": marks.at_true_pose + view.shift_m,
        "noise": marks.at_true_range + view.shift_m,
    }


def sizes_of_errors(marks: Marks, view: GuardView) -> dict[str, float]:
    """By how much the same errors put marks off, metres; means over the marks."""
    return {
        "crop": float(lengths(np.array(view.shift_m))),
        "pose": _mean(lengths(marks.believed - marks.at_true_pose)),
        "noise": _mean(lengths(marks.believed - marks.at_true_range)),
    }


def _mean(lengths_m: Floats) -> float:
    return math.fsum(lengths_m.tolist()) / len(lengths_m)


def cells_about(d: OccupancyGrid, places: Floats, reach_m: float) -> Floats:
    """(n, 2) the centres of the cells of D that some of the places reach, map frame, metres."""
    cells = cell_centers(d, d.data > 0)
    if not len(cells):
        return cells
    # a mark is the middle of its cell, wherever in it the beam ended
    middles = cell_middles(d, places)
    near = lengths(cells[:, None] - middles[None]) <= reach_m + 1e-6
    return cells[near.any(axis=1)]


def _inside(box: Box, points: Floats) -> Booleans:
    x, y = points[:, 0], points[:, 1]
    return np.asarray((x >= box.x_min) & (x < box.x_max) & (y >= box.y_min) & (y < box.y_max))


def _unseen(truth: int, truths: Sequence[TruthObject], view: GuardView) -> Cause:
    """Why no beam of the last scan came back from it, by what the beams would meet now."""
    directions, ranges_m, sources = view.lines()
    met = sources == truth
    if met.any():
        ends = np.array(view.sensor) + ranges_m[met, None] * directions[met]
        # a scan of this instant had lost it one stage later
        return Cause("delay" if _inside(view.window, ends).any() else "outside_window", view.guard)
    entry_m = _entry_m(view.sensor, directions, truths[truth].box)
    before = ranges_m < entry_m
    crossing = np.isfinite(entry_m)
    if not (crossing & before).any():
        return Cause("between_beams", view.guard)
    who, counts = np.unique(sources[crossing & before], return_counts=True)
    source = int(who[counts.argmax()])
    ends = np.array(view.sensor) + entry_m[crossing, None] * directions[crossing]
    if source == WALL:
        name = "occluded_by_wall"
    elif guard_of(source) is not None:
        name = "occluded_by_guard"
    else:
        name = "occluded" if _inside(view.window, ends).any() else "occluded_outside_window"
    return Cause(name, view.guard, source_name(source, truths))


def _entry_m(sensor: tuple[float, float], directions: Floats, box: Box) -> Floats:
    """(n,) metres along each beam to the box; inf for beams that pass it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (np.array(box[:2]) - sensor) / directions
        high = (np.array(box[2:]) - sensor) / directions
    enter = np.minimum(low, high).max(axis=1)
    leave = np.maximum(low, high).min(axis=1)
    return np.asarray(np.where((leave >= enter) & (leave > 0.0), np.maximum(enter, 0.0), np.inf))
