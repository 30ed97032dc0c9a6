"""Why the team's errors came about: the stage at which a miss was lost, and what a false box is made of.

Nothing here needs a simulator or a detector: scans, true places and boxes are the evidence.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.geometry import Booleans, Box, Floats, Indices, Point, lengths
from midnet_bench.grid import OccupancyGrid, cell_centers, cell_middles, cells_of, values_at
from midnet_bench.midnet.detection import OCCUPIED
from midnet_bench.scoring.error_causes import MISS_CAUSES, UNEXPLAINED
from midnet_bench.scoring.frame_counts import TruthObject, touches

WALL, NOTHING = -1, -2  # what a return came from that is no truth: a wall, or nothing that is known
_FIRST_ALLY = -10


def ally(guard: int) -> int:
    """The source of returns from a guard, by its index in the team."""
    return _FIRST_ALLY - guard


def source_name(source: int, truths: Sequence[TruthObject]) -> str:
    """In words: ``guard 2``, an intruder's name, ``a wall``; empty for nothing that is known."""
    if source <= _FIRST_ALLY:
        return f"guard {_FIRST_ALLY - source + 1}"
    return truths[source].name if source >= 0 else "a wall" if source == WALL else ""


class Marks(NamedTuple):
    """m returns of one guard, each in four places: which part of its error came from pose and range."""

    source: Indices  # (m,) the index of a truth, :func:`ally`, ``WALL`` or ``NOTHING``
    age_s: Floats  # (m,)
    is_newest: Booleans  # (m,) whether it is of the guard's last scan
    believed: Floats  # (m, 2) where the guard put it, map frame, metres
    at_true_pose: Floats  # (m, 2) where it had put it, had it known its pose
    at_true_range: Floats  # (m, 2) where it had put it without the noise of its range
    true: Floats  # (m, 2) what was met

    def where(self, chosen: Booleans | Indices) -> "Marks":
        """Those of an (m,) mask, or of these indices."""
        return Marks._make(column[chosen] for column in self)


class SightLines(NamedTuple):
    """What the n beams of one LiDAR would meet at the frame's instant."""

    directions: Floats  # (n, 2) unit vectors, map frame
    ranges_m: Floats  # (n,) inf for nothing
    sources: Indices  # (n,) as of :class:`Marks`


class GuardView(NamedTuple):
    """One guard at the frame's instant: where it truly is, what it marked, and what became of that."""

    guard: int  # index in the team
    sensor: Point  # (x, y) of its LiDAR as it truly is, map frame, metres
    lines: Callable[[], SightLines]
    returns: Callable[[int], tuple[Marks, Booleans]]
    """source -> the returns of its last scan that came from there, and which are within the obstacle range"""
    marks: Callable[[], Marks]  # the marked cells of its costmap; misses need none of them
    shift_m: Point  # by which the crop moves its cells on the prior map
    window: Box  # its costmap, map frame, metres
    reach_m: float  # how far from a mark a cell has the cost that counts
    a: OccupancyGrid | None  # A of Eq. 1, cropped, 0 where occupied; None if the detector has no such grid
    d: OccupancyGrid | None  # D of Eq. 6, 255 where an intruder is
    prior: OccupancyGrid | None  # B in full, the prior map's binary grid, 0 where occupied
    disc: Indices  # (k, 2) columns and rows from a mark's cell to the cells that have the cost that counts
    found: Sequence[Box]  # the boxes that it found
    deflated_m: float  # what was taken off each side of them as soon as they were found
    taken: Sequence[int | None]  # for each of them the index of the ally that it was removed for
    centers_at_scan: Callable[[], Floats]
    """(truths, 2) where the truths were at its last scan; (0, 2) before the first"""


class Cause(NamedTuple):
    """Why one error came about."""

    name: str  # of ``error_causes``
    guard: int | None = None  # index of the guard that it came about at; None if at none
    by: str = ""  # what else had a part: the robot before it, or the one that left the trail
    age_s: float = 0.0  # of the newest return that has a part
    offset_m: float = 0.0
    """by which error of place: of the pose, the crop, the range, or how far an intruder moved"""


def moved(box: Box, by: Point) -> Box:
    """The box elsewhere."""
    x, y = by
    return Box(box.x_min + x, box.y_min + y, box.x_max + x, box.y_max + y)


_BY_ERROR = {
    "delay": ("delay", "stale"),
    "crop": ("crop_shift", "misplaced_by_crop"),
    "pose": ("pose_error", "misplaced_by_pose"),
    "noise": ("range_noise", "misplaced_by_noise"),
    "cut": ("under_prior", "rim"),
}
"""what :func:`_displacement` says -> the cause of a miss, and that of a box beside its intruder"""
_OFF_GRID = 1  # a value that no binary grid has


def miss_cause(
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
    return list(MISS_CAUSES).index("pose_error" if is_box else cause.name)


def _lost_by(truth: int, truths: Sequence[TruthObject], view: GuardView) -> Cause:
    """The stage at which one guard lost it, if the team has no box on it."""
    returns, in_reach = view.returns(truth)
    if not len(in_reach):
        return _unseen(truth, truths, view)
    if not in_reach.any():
        return Cause("beyond_range", view.guard)
    returns = returns.where(in_reach)
    age_s = float(returns.age_s.min())

    def lost(name: str, by: str = "", offset_m: float = 0.0) -> Cause:
        return Cause(name, view.guard, by, age_s, offset_m)

    places = returns.believed + view.shift_m
    places = places[_inside(view.window, places)]
    if not len(places):
        return lost("outside_window")
    if view.a is None or view.d is None:
        boxes = [k for k, box in enumerate(view.found) if _inside(box.shrunk(-view.reach_m), places).any()]
        if not boxes:
            return lost("not_detected")
    else:
        on_grid = values_at(view.a.data, view.a, places, _OFF_GRID)
        if (on_grid == _OFF_GRID).all():
            return lost("outside_prior")
        if not (on_grid == OCCUPIED).any():
            return lost("below_threshold")
        left = _cells_about(view.d, places, view.reach_m)
        if not len(left):
            return lost("under_prior")
        boxes = [k for k, box in enumerate(view.found) if _inside(box.shrunk(-view.deflated_m), left).any()]
        if not boxes:
            return lost("too_small")
    on_it = [k for k in boxes if touches(view.found[k], truths[truth].box)]
    if not on_it:
        if any(touches(view.found[k].shrunk(-view.deflated_m), truths[truth].box) for k in boxes):
            return lost("deflated", offset_m=view.deflated_m)
        error, offset_m = _displacement(truth, truths, returns, view)
        return lost(_BY_ERROR[error][0], offset_m=offset_m)
    allies = [view.taken[k] for k in on_it]
    if None not in allies:
        return lost("taken_for_ally", f"guard {(allies[0] or 0) + 1}")
    return lost("dropped_by_fusion")


def _displacement(
    truth: int, truths: Sequence[TruthObject], returns: Marks, view: GuardView
) -> tuple[str, float]:
    """Which error of place put what is made of an intruder's returns beside it, and how large it is, metres.

    The cells of the returns are made anew without each error: ``delay`` (the intruder has moved since the
    scan), ``crop``, ``pose`` and ``noise``. It is the largest of those without which a cell lies on the
    intruder. If none is enough alone, it is the largest of them, if a cell does without any. If even then
    none does, it is ``cut``: the prior map covers what else there is of it.
    """
    gone = np.array(truths[truth].center) - view.centers_at_scan()[truth]
    half, box = 0.0 if view.prior is None else view.prior.resolution / 2.0, truths[truth].box

    def is_on_it(places: Floats) -> bool:
        x, y = _cells_left(places, view).T
        across = (x + half > box.x_min) & (x - half < box.x_max)
        return bool((across & (y + half > box.y_min) & (y - half < box.y_max)).any())

    errors = {
        "delay": (float(lengths(gone)), returns.believed + view.shift_m + gone),
        **_errors_of_place(returns, view),
    }
    enough = [name for name, (_, places) in errors.items() if is_on_it(places)]
    if not enough and not is_on_it(returns.true + gone):
        return "cut", 0.0
    name = max(enough or errors, key=lambda error: errors[error][0])
    return name, errors[name][0]


def _errors_of_place(marks: Marks, view: GuardView) -> dict[str, tuple[float, Floats]]:
    """By how much each error puts marks off, metres, and (m, 2) where they lay without it, metres."""
    by_pose, by_noise = (
        math.fsum(lengths(marks.believed - places).tolist()) / len(marks.believed)
        for places in (marks.at_true_pose, marks.at_true_range)
    )
    return {
        "crop": (float(lengths(np.array(view.shift_m))), marks.believed),
        "pose": (by_pose, marks.at_true_pose + view.shift_m),
        "noise": (by_noise, marks.at_true_range + view.shift_m),
    }


def _cells_left(places: Floats, view: GuardView) -> Floats:
    """(n, 2) centres of the cells that marks at (m, 2) places give once the prior map is subtracted, metres.

    Cells beyond the prior map are not there, as in section IV.B.1. Nothing where there is no prior map.
    """
    prior = view.prior
    if prior is None or not len(places):
        return np.empty((0, 2))
    cells = np.unique((cells_of(prior, places)[:, None] + view.disc[None]).reshape(-1, 2), axis=0)
    cells = cells[((cells >= 0) & (cells < (prior.width, prior.height))).all(axis=1)]
    cells = cells[prior.data[cells[:, 1], cells[:, 0]] != OCCUPIED]
    return np.asarray(prior.origin + (cells + 0.5) * prior.resolution)


def _cells_about(d: OccupancyGrid, places: Floats, reach_m: float) -> Floats:
    """(n, 2) the centres of the cells of D that some of the places reach, map frame, metres."""
    cells = cell_centers(d, d.data > 0)
    # a mark is the middle of its cell, wherever in it the beam ended
    near = lengths(cells[:, None] - cell_middles(d, places)[None]) <= reach_m + 1e-6
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
    crossing = np.isfinite(entry_m)
    before = crossing & (ranges_m < entry_m)
    if not before.any():
        return Cause("between_beams", view.guard)
    in_front, counts = np.unique(sources[before], return_counts=True)
    source = int(in_front[counts.argmax()])
    ends = np.array(view.sensor) + entry_m[crossing, None] * directions[crossing]
    if source == WALL:
        name = "occluded_by_wall"
    elif source <= _FIRST_ALLY:
        name = "occluded_by_guard"
    else:
        name = "occluded" if _inside(view.window, ends).any() else "occluded_outside_window"
    return Cause(name, view.guard, source_name(source, truths))


def _entry_m(sensor: Point, directions: Floats, box: Box) -> Floats:
    """(n,) metres along each beam to the box; inf for beams that pass it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        low = (np.array(box[:2]) - sensor) / directions
        high = (np.array(box[2:]) - sensor) / directions
    enter = np.minimum(low, high).max(axis=1)
    leave = np.maximum(low, high).min(axis=1)
    return np.asarray(np.where((leave >= enter) & (leave > 0.0), np.maximum(enter, 0.0), np.inf))


def false_box_cause(
    detection: Box, finder: int, truths: Sequence[TruthObject], views: Sequence[GuardView]
) -> Cause:
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
    name, offset_m = ("deflated", view.deflated_m) if is_deflated else _made_of(source, own, truths, view)
    return Cause(name, view.guard, source_name(source, truths), float(own.age_s.min()), offset_m)


def _marks_of(box: Box, view: GuardView) -> tuple[Marks, Indices]:
    """The marks that a guard's box can be of, and how many of its cells are nearest to each."""
    box = box.shrunk(-view.deflated_m)
    wide = box.shrunk(-view.reach_m)
    marks = view.marks()
    x, y = (marks.believed + view.shift_m).T
    marks = marks.where((x >= wide.x_min) & (x <= wide.x_max) & (y >= wide.y_min) & (y <= wide.y_max))
    votes = np.zeros(len(marks.source), dtype=np.int64)
    if not len(votes):
        return marks, votes
    if view.d is None:
        return marks, votes + 1
    cells = cell_centers(view.d, view.d.data > 0)
    x, y = cells.T
    cells = cells[(x > box.x_min) & (x < box.x_max) & (y > box.y_min) & (y < box.y_max)]
    distances_m = lengths(cells[:, None] - cell_middles(view.d, marks.believed + view.shift_m)[None])
    within = distances_m.min(axis=1) <= view.reach_m + 1e-6
    np.add.at(votes, distances_m.argmin(axis=1)[within], 1)
    return marks, votes


def _made_of(source: int, own: Marks, truths: Sequence[TruthObject], view: GuardView) -> tuple[str, float]:
    """The cause of a box that is mostly of one source, by its marks ``own``; and the error, metres."""
    if source <= _FIRST_ALLY:
        return ("ally_left" if own.is_newest.any() else "ally_trail"), 0.0
    if source >= 0 and not own.is_newest.any():
        truth = truths[source]
        if all(truth.box.distance_to_point(*point) > view.reach_m for point in own.true.tolist()):
            return "intruder_trail", float(lengths(own.true - truth.center).min())
    if view.prior is None or source == NOTHING:
        return UNEXPLAINED, 0.0
    if source >= 0:
        error, offset_m = _displacement(source, truths, own, view)
        return _BY_ERROR[error][1], offset_m
    # which error put a wall's returns where the prior map does not cover them
    errors = _errors_of_place(own, view)
    enough = [name for name, (_, places) in errors.items() if not len(_cells_left(places, view))]
    if not enough and len(_cells_left(own.true, view)):
        return "wall_by_map", 0.0
    name = max(enough or errors, key=lambda error: errors[error][0])  # no error alone, but all of them
    return f"wall_by_{name}", errors[name][0]
