"""Detections against the truth: the paper's counts and ratios, beside them one-to-one matching and GOSPA.

The paper counts boxes for tp and intruders for fn (item 43), so two boxes on one intruder raise both of
its scores. The matching pairs each intruder with one box at most and counts the rest as duplicates.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from midnet_bench.geometry import Booleans, Box, Floats, Point, dense_outline, lengths

InRange = Literal["edge", "centre"]
TruePositives = Literal["every", "one_per_intruder", "surplus_false"]

CUTOFF_M = 1.0
"""A box farther than this from an intruder is no partner for it; a miss or a false box costs half of it."""


class TruthObject(NamedTuple):
    """An intruder as it really is at the frame's instant, map frame, metres."""

    name: str
    box: Box  # whatever reading of item 45 the caller takes
    center: Point  # (x, y)


Covers = Callable[[Floats], Booleans]
"""(n,) which of (n, 2) points, map frame, metres, lie in a sensor's field of view"""


class FrameCounts(NamedTuple):
    """Counts of one frame, or their sums over frames; ratios are taken of sums only."""

    tp: int
    """boxes that touch some intruder; or one for each intruder, ``matched``, where ``tp_boxes`` says so"""
    fp: int  # boxes that touch none; with ``surplus_false`` the ``duplicates`` too, so all boxes minus tp
    fn: int  # intruders in range that no box touches
    intruders_in_range: int  # intruders that a robot could have seen
    matched: int  # pairs of one intruder and one box; with ``duplicates`` all boxes that touch some intruder
    duplicates: int  # boxes left over on intruders that have theirs
    missed: int  # intruders in range without a box of their own; above fn where one box covers two
    error_sum_m: float  # metres from box centre to intruder centre, summed over the matched pairs
    gospa_m: float
    """metres: distances of partners, and half a metre for each miss and each false or further box"""


NOTHING = FrameCounts(0, 0, 0, 0, 0, 0, 0, 0.0, 0.0)


class FrameMatch(NamedTuple):
    """The pairs of detections and truths of a frame, by index, from which counts and explanations start."""

    touched: list[list[int]]  # for each detection, the truths that it covers some area of
    truth_of: list[int | None]  # for each detection, the truth it is paired with
    detection_of: list[int | None]  # for each truth, the detection it is paired with


def touches(box: Box, other: Box) -> bool:
    """Whether they have some area in common, as section V.A asks."""
    return box.intersection_area(other) > 0.0


def truths_in_range(
    truths: Sequence[TruthObject],
    sensors: Sequence[Point],
    range_m: float,
    rule: InRange = "edge",
    views: Sequence[Covers] = (),
) -> list[bool]:
    """For each truth, whether it is within ``range_m`` of at least one sensor (item 46).

    ``sensors``: (x, y) of each robot's, map frame, metres; ``rule``: by its nearest point, or its centre;
    ``views``: the sensors' fields of view, none if all of them see all round.
    """
    if views:
        return [
            any(_is_in_view(truth, *sensor, range_m, rule) for sensor in zip(sensors, views, strict=True))
            for truth in truths
        ]
    if rule == "centre":
        return [any(math.dist(truth.center, sensor) <= range_m for sensor in sensors) for truth in truths]
    return [any(truth.box.distance_to_point(x, y) <= range_m for x, y in sensors) for truth in truths]


def _is_in_view(truth: TruthObject, sensor: Point, covers: Covers, range_m: float, rule: InRange) -> bool:
    """Whether the truth's centre, or any point of its outline, is in range and field of view of a sensor."""
    points = np.array([truth.center])
    if rule == "edge":
        left, low, right, high = truth.box
        corners = np.array([(left, low), (right, low), (right, high), (left, high)])
        points = np.vstack((dense_outline(corners), points))
    return bool((covers(points) & (lengths(points - np.array(sensor)) <= range_m)).any())


def match_frame(detections: Sequence[Box], truths: Sequence[TruthObject]) -> FrameMatch:
    """The one-to-one matching of boxes and intruders: as many pairs as can be, then the greatest sum of IoU.

    Only a box and a truth with a common area greater than zero make a pair (item 44). Solved by
    scipy's ``linear_sum_assignment`` (a Hungarian-type method).
    """
    overlaps = [[box.iou(truth.box) for truth in truths] for box in detections]
    touched = [[truth for truth, overlap in enumerate(row) if overlap > 0.0] for row in overlaps]
    truth_of: list[int | None] = [None] * len(detections)
    detection_of: list[int | None] = [None] * len(truths)
    if any(touched):
        from scipy.optimize import linear_sum_assignment  # here: tables need none of it

        worth = np.array(overlaps)
        # a pair is worth more than all IoUs together, so the number of pairs comes first
        worth[worth > 0.0] += 1.0 + min(worth.shape)
        rows, columns = linear_sum_assignment(worth, maximize=True)
        for detection, truth in zip(rows.tolist(), columns.tolist(), strict=True):
            if worth[detection, truth] > 0.0:
                truth_of[detection] = truth
                detection_of[truth] = detection
    return FrameMatch(touched, truth_of, detection_of)


def count_frame(
    detections: Sequence[Box],
    truths: Sequence[TruthObject],
    in_range: Sequence[bool],
    tp_boxes: TruePositives = "every",
    match: FrameMatch | None = None,
) -> FrameCounts:
    """One frame's counts: section V.A's, and those of the one-to-one matching.

    Args:
        detections: MIDNet's boxes, map frame, metres.
        truths: the intruders, where they are at the frame's instant.
        in_range: for each truth, whether missing it counts. A box on an intruder that is out of range is a
            tp all the same (item 47).
        tp_boxes: whether every box on an intruder is a tp, or one box for each intruder, further ones
            being neither tp nor fp (``one_per_intruder``) or fp (``surplus_false``) (item 43).
        match: of these detections and truths, if the caller has it.
    """
    match = match or match_frame(detections, truths)
    touched = {truth for indices in match.touched for truth in indices}
    touching = sum(map(bool, match.touched))
    near = [index for index, counts in enumerate(in_range) if counts]
    errors_m = [
        math.dist(detections[detection].center, truths[truth].center)
        for detection, truth in enumerate(match.truth_of)
        if truth is not None
    ]
    surplus = touching - len(errors_m)
    is_every = tp_boxes == "every"
    return FrameCounts(
        tp=touching if is_every else len(errors_m),
        fp=len(detections) - touching + surplus * (tp_boxes == "surplus_false"),
        fn=sum(index not in touched for index in near),
        intruders_in_range=len(near),
        matched=len(errors_m),
        duplicates=surplus,
        missed=sum(match.detection_of[index] is None for index in near),
        error_sum_m=math.fsum(errors_m),
        gospa_m=gospa([box.center for box in detections], [truth.center for truth in truths], in_range),
    )


def gospa(boxes: Sequence[Point], intruders: Sequence[Point], in_range: Sequence[bool]) -> float:
    """GOSPA of one frame, metres; 0 where every intruder in range has its box and there is no other.

    Rahmathullah, Garcia-Fernandez and Svensson, "Generalized optimal sub-pattern assignment metric" (2017),
    with p = 1 and alpha = 2, so that it is a sum in metres: the distances of the pairs, and half the cut-off
    for each intruder and each box without a partner. It does not get better by leaving boxes unfused.

    Args:
        boxes: (x, y) of the centres of the detections, map frame, metres.
        intruders: (x, y) of the centres of the intruders.
        in_range: for each intruder, whether missing it counts. One out of range may have a partner, which
            costs their distance, and costs nothing without (item 47).
    """
    half_m = 0.5 * CUTOFF_M
    alone = half_m * (len(boxes) + sum(in_range))
    if not boxes or not intruders:
        return alone
    from scipy.optimize import linear_sum_assignment

    # what a pair costs beside both of them alone; worse than alone is no pair
    each = list(zip(intruders, in_range, strict=True))
    change = np.array(
        [[min(0.0, math.dist(box, place) - half_m * (1 + counts)) for place, counts in each] for box in boxes]
    )
    return math.fsum([alone, *change[linear_sum_assignment(change)].tolist()])


def total(counts: Iterable[FrameCounts]) -> FrameCounts:
    """The sums over frames, those of metres exact and rounded once; of no frames, zeros."""
    *numbers, errors_m, gospas_m = zip(NOTHING, *counts, strict=True)
    return FrameCounts._make([*map(sum, numbers), math.fsum(errors_m), math.fsum(gospas_m)])


class Ratios(NamedTuple):
    """The three scores of the paper's table, 0 to 1 or NaN."""

    precision: float  # Eq. 8; NaN when there was no box
    recall: float  # Eq. 9; NaN when there was nothing to find
    f1: float  # Eq. 10, the harmonic mean of both; NaN when either is, or when both are 0 (item 40)


def ratios(tp: float, fp: float, fn: float) -> Ratios:
    """Eqs. 8 to 10 of counts that are already summed over frames.

    For the one-to-one matching give ``matched``, ``fp + duplicates`` and ``missed``.
    """
    precision = tp / (tp + fp) if tp + fp > 0 else math.nan
    recall = tp / (tp + fn) if tp + fn > 0 else math.nan
    f1 = 2.0 * precision * recall / (precision + recall) if precision + recall > 0.0 else math.nan
    return Ratios(precision, recall, f1)


class Causes(NamedTuple):
    """Counts of one frame, or their sums over frames."""

    fn_hidden: int  # of fn: no beam of any guard meets the intruder within range at this instant
    fn_new: int  # of fn: the intruder was out of range one frame (0.2 s) before
    fp_left: int  # of fp: where an intruder was one frame before
    overlapping: int  # frames in which two of the fused boxes overlap
    reordered: int  # of the frames looked at so: those with other boxes if the robots come in opposite order
    looked_at: int  # frames in which MIDNet was also given the robots in opposite order
    fn_outside_window: int  # of fn: no part of the intruder lies in the local costmap of any guard
    fn_hidden_in_window: int  # of fn_hidden: those in the local costmap of some guard
    fn_new_in_window: int
    """of fn in the local costmap of some guard: out of range, or of every costmap, one frame before"""


NONE = Causes(*[0] * 9)


class CauseCounter:
    """Counts frame by frame; it remembers where the intruders were in the frame before."""

    def __init__(self) -> None:
        self._before: dict[str, tuple[Box, bool, bool]] = {}

    def count(
        self,
        detections: Sequence[Box],
        truths: Sequence[TruthObject],
        touched: Sequence[Sequence[int]],
        in_range: Sequence[bool],
        in_sight: Callable[[], Sequence[bool]],
        in_window: Sequence[bool],
        opposite: Sequence[Box] | None = None,
    ) -> Causes:
        """One frame.

        Args:
            detections: MIDNet's boxes, map frame, metres.
            truths: the intruders at the frame's instant, each under its own name.
            touched: for each detection the truths that it covers some area of, as ``FrameMatch`` has them.
            in_range: for each truth, whether missing it counts.
            in_sight: for each truth, whether a beam meets it; asked only if something was missed.
            in_window: for each truth, whether some part of it lies in some guard's local costmap.
            opposite: MIDNet's boxes if the robots come in opposite order; None in frames that skip this.
        """
        before = self._before
        self._before = {
            truth.name: (truth.box, near, near and inside)
            for truth, near, inside in zip(truths, in_range, in_window, strict=True)
        }
        found = {index for indices in touched for index in indices}
        missed = [index for index, counts in enumerate(in_range) if counts and index not in found]
        seen = in_sight() if missed else ()
        known = [(index, before[truths[index].name]) for index in missed if truths[index].name in before]
        false = [box for box, indices in zip(detections, touched, strict=True) if not indices]
        return Causes(
            fn_hidden=sum(not seen[index] for index in missed),
            fn_new=sum(not was_near for _, (_, was_near, _) in known),
            fp_left=sum(any(touches(box, place) for place, _, _ in before.values()) for box in false),
            overlapping=int(any(touches(*pair) for pair in itertools.combinations(detections, 2))),
            reordered=int(opposite is not None and sorted(opposite) != sorted(detections)),
            looked_at=int(opposite is not None),
            fn_outside_window=sum(not in_window[index] for index in missed),
            fn_hidden_in_window=sum(in_window[index] and not seen[index] for index in missed),
            fn_new_in_window=sum(in_window[index] and not was_inside for index, (*_, was_inside) in known),
        )


def total_causes(causes: Iterable[Causes]) -> Causes:
    """The sums over frames; of no frames, zeros."""
    return Causes(*map(sum, zip(NONE, *causes, strict=True)))
