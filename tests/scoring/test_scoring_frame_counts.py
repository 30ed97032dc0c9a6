"""Counts of frames by hand and by definition: section V.A's, one-to-one matching, GOSPA, the causes."""

import itertools
import math
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from random import Random

import pytest
import scipy.optimize  # noqa: F401 - the first match imports it, which hypothesis takes for slow
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box, LidarGeometry, Point, Pose2D
from midnet_bench.scoring.frame_counts import (
    NONE,
    NOTHING,
    CauseCounter,
    Causes,
    FrameCounts,
    TruthObject,
    count_frame,
    gospa,
    match_frame,
    ratios,
    total,
    total_causes,
    truths_in_range,
)


def intruder(box: Box, name: str = "intruder 1") -> TruthObject:
    return TruthObject(name, box, box.center)


ONE = intruder(Box(0.0, 0.0, 1.0, 1.0))
TWO = intruder(Box(1.5, 0.0, 2.5, 1.0))
NEAR, FURTHER, FALSE, OVER_BOTH = (
    Box(0.0, 0.0, 0.9, 1.0),
    Box(0.8, 0.0, 1.2, 1.0),
    Box(5.0, 5.0, 6.0, 6.0),
    Box(0.0, 0.0, 2.5, 1.0),
)


@pytest.mark.parametrize(
    ("boxes", "truths", "in_range", "expected"),
    [
        ([], [], [], {}),
        ([ONE.box], [], [], {"fp": 1, "gospa_m": 0.5}),
        ([], [ONE], [True], {"fn": 1, "intruders_in_range": 1, "missed": 1, "gospa_m": 0.5}),
        # out of range: its absence is no miss, and a box on it is true
        ([], [ONE], [False], {}),
        ([ONE.box], [ONE], [False], {"tp": 1, "matched": 1}),
        # a hit, a false box and a miss
        (
            [Box(0.5, 0.5, 1.2, 1.0), FALSE],
            [ONE, TWO],
            [True, True],
            {
                **{"tp": 1, "fp": 1, "fn": 1, "intruders_in_range": 2, "matched": 1, "missed": 1},
                "error_sum_m": math.hypot(0.35, 0.25),
                "gospa_m": math.hypot(0.35, 0.25) + 0.5 + 0.5,
            },
        ),
        # of two boxes on one intruder the one with the greater IoU is paired
        *(
            (
                boxes,
                [ONE],
                [True],
                {
                    **{"tp": 2, "intruders_in_range": 1, "matched": 1, "duplicates": 1},
                    **{"error_sum_m": 0.05, "gospa_m": 0.55},
                },
            )
            for boxes in ([NEAR, FURTHER], [FURTHER, NEAR])
        ),
        # one box over two intruders finds both for the paper and one for the matching
        (
            [OVER_BOTH],
            [ONE, TWO],
            [True, True],
            {
                **{"tp": 1, "intruders_in_range": 2, "matched": 1, "missed": 1},
                **{"error_sum_m": 0.75, "gospa_m": 1.25},
            },
        ),
        # a shared edge is no touch, and neither is a box without area
        (
            [Box(1.0, 0.0, 1.5, 1.0), Box(0.5, 0.2, 0.5, 0.8)],
            [ONE, TWO],
            [True, True],
            {"fp": 2, "fn": 2, "intruders_in_range": 2, "missed": 2, "gospa_m": 0.75},
        ),
    ],
)
def test_counts_by_hand(
    boxes: list[Box], truths: list[TruthObject], in_range: list[bool], expected: dict[str, float]
) -> None:
    counts = count_frame(boxes, truths, in_range)._asdict()
    assert counts == pytest.approx({**NOTHING._asdict(), **expected})


def test_second_boxes_count_as_asked() -> None:
    boxes, truths = [NEAR, FURTHER, FALSE], [ONE, TWO]
    every = count_frame(boxes, truths, [True, True])
    assert (every.tp, every.fp, every.fn) == (2, 1, 1)
    once = count_frame(boxes, truths, [True, True], "one_per_intruder", match_frame(boxes, truths))
    assert once == every._replace(tp=1)
    assert count_frame(boxes, truths, [True, True], "surplus_false") == every._replace(tp=1, fp=2)
    # a box over two intruders is one true positive, and neither of them is missed
    counts = count_frame([OVER_BOTH], truths, [True, True], "surplus_false")
    assert (counts.tp, counts.fp, counts.fn) == (1, 0, 0)


def test_as_many_pairs_as_can_be_come_before_the_best_overlap() -> None:
    both, only_one = Box(0.0, 0.0, 1.6, 1.0), Box(0.9, 0.9, 1.2, 1.2)
    assert match_frame([both, only_one], [ONE, TWO]) == ([[0, 1], [0]], [1, 0], [1, 0])


def test_range_is_measured_to_the_nearest_point_or_to_the_centre() -> None:
    # the sensor is 2.5 m left of the box and 3 m left of its centre
    left = [(-2.5, 0.5)]
    assert truths_in_range([ONE], left, 2.5) == [True]
    assert truths_in_range([ONE], left, 2.49) == [False]
    assert truths_in_range([ONE], left, 2.5, "centre") == [False]
    assert truths_in_range([ONE], left, 3.0, "centre") == [True]
    # inside the box; beyond a corner; one of several sensors is enough
    assert truths_in_range([ONE], [(0.5, 0.5)], 0.1) == [True]
    assert truths_in_range([ONE], [(4.0, 5.0)], 4.99) == [False]
    assert truths_in_range([ONE], [(4.0, 5.0)], 5.0) == [True]
    assert truths_in_range([ONE, TWO], [(-9.0, 0.0), (3.0, 0.5)], 1.0) == [False, True]
    assert truths_in_range([ONE], [], 2.5) == [False]


@st.composite
def cell_boxes(draw: st.DrawFn) -> Box:
    x1, y1 = draw(st.integers(0, 7)), draw(st.integers(0, 3))
    return Box(x1, y1, x1 + draw(st.integers(1, 4)), y1 + draw(st.integers(1, 4)))


FRAMES = st.tuples(
    st.lists(cell_boxes(), max_size=4),
    st.lists(st.tuples(cell_boxes(), st.booleans()), max_size=4),
)
Frame = tuple[list[Box], list[tuple[Box, bool]]]


def scores_of(
    detections: list[Box], truths: list[TruthObject], truth_of: Sequence[int | None]
) -> list[float]:
    """The IoU of each pair, worked out here."""
    pairs = [
        (box, truths[truth].box) for box, truth in zip(detections, truth_of, strict=True) if truth is not None
    ]
    both = [(one.intersection_area(other), one.area + other.area) for one, other in pairs]
    return [common / (areas - common) for common, areas in both]


@given(FRAMES)
def test_matching_is_the_best_of_all_that_there_are(frame: Frame) -> None:
    detections, truths = frame[0], [intruder(box) for box, _ in frame[1]]
    best = (0, 0.0)
    # every way to give each detection a truth of its own, or none
    slots = [*range(len(truths)), *([None] * len(detections))]
    for assignment in set(itertools.permutations(slots, len(detections))):
        scores = scores_of(detections, truths, assignment)
        if all(score > 0.0 for score in scores):
            best = max(best, (len(scores), round(sum(scores), 9)))
    match = match_frame(detections, truths)
    scores = scores_of(detections, truths, match.truth_of)
    assert all(score > 0.0 for score in scores)
    assert (len(scores), round(sum(scores), 9)) == best
    pairs = {(box, truth) for truth, box in enumerate(match.detection_of) if box is not None}
    assert pairs == {(box, truth) for box, truth in enumerate(match.truth_of) if truth is not None}


@given(FRAMES)
def test_counts_are_what_their_names_say(frame: Frame) -> None:
    detections, truths = frame[0], [intruder(box) for box, _ in frame[1]]
    in_range = [counts for _, counts in frame[1]]
    counts = count_frame(detections, truths, in_range)
    touching = [any(box.intersection_area(truth.box) > 0.0 for truth in truths) for box in detections]
    unseen = [all(box.intersection_area(truth.box) == 0.0 for box in detections) for truth in truths]
    assert counts.tp == sum(touching)
    assert counts.tp + counts.fp == len(detections)
    assert counts.fn == sum(1 for gone, counts_ in zip(unseen, in_range, strict=True) if gone and counts_)
    assert counts.intruders_in_range == sum(in_range)
    assert counts.matched + counts.duplicates == counts.tp
    surplus = count_frame(detections, truths, in_range, "surplus_false")
    assert (surplus.tp, surplus.tp + surplus.fp, surplus.fn) == (counts.matched, len(detections), counts.fn)
    assert counts.matched <= min(len(detections), len(truths))
    assert counts.fn <= counts.missed <= counts.intruders_in_range
    assert counts.error_sum_m >= 0.0
    # an unpaired box on an intruder is a duplicate only if all intruders that it touches have their box
    match = match_frame(detections, truths)
    for indices, paired in zip(match.touched, match.truth_of, strict=True):
        if paired is None:
            assert all(match.detection_of[truth] is not None for truth in indices)


METRES = st.floats(0, 9)
COUNTED = st.tuples(*[st.integers(0, 9)] * 7, METRES, METRES).map(FrameCounts._make)


@pytest.mark.slow
@given(st.lists(COUNTED, max_size=40), st.randoms())
def test_sums_over_frames_are_exact_so_their_order_is_nothing(
    counts: list[FrameCounts], random: Random
) -> None:
    summed = total(counts)
    assert repr(total(random.sample(counts, len(counts)))) == repr(summed)
    for name, value in summed._asdict().items():
        exact = sum(Fraction(getattr(one, name)) for one in counts)
        assert (value, type(value)) == (type(value)(exact), type(getattr(NOTHING, name)))


def test_errors_of_one_frame_add_up_exactly() -> None:
    # one by one they add up to 4.000000000000002
    boxes = [Box.square(1.5 * k + 0.4, 0.0, 1.0) for k in range(10)]
    truths = [intruder(Box.square(1.5 * k, 0.0, 1.0)) for k in range(10)]
    errors_m = [math.dist(box.center, truth.center) for box, truth in zip(boxes, truths, strict=True)]
    counts = count_frame(boxes, truths, [True] * 10)
    assert counts.error_sum_m == counts.gospa_m == math.fsum(errors_m) == 4.000000000000003


@pytest.mark.parametrize(
    ("boxes", "intruders", "in_range", "expected"),
    [
        ([], [], [], 0.0),
        ([(0.0, 0.0)], [(0.0, 0.3)], [True], 0.3),
        ([], [(0.0, 0.0)], [True], 0.5),
        ([(0.0, 0.0)], [], [], 0.5),
        # too far to be a pair; a further box on an intruder
        ([(0.0, 0.0)], [(5.0, 0.0)], [True], 1.0),
        ([(0.0, 0.0), (0.2, 0.0)], [(0.0, 0.0)], [True], 0.5),
        # out of range: it may be missed and found; then a box nearer to false than to it
        ([], [(0.0, 0.0)], [False], 0.0),
        ([(0.0, 0.1)], [(0.0, 0.0)], [False], 0.1),
        ([(0.0, 0.6)], [(0.0, 0.0)], [False], 0.5),
    ],
)
def test_gospa_by_hand(
    boxes: list[Point], intruders: list[Point], in_range: list[bool], expected: float
) -> None:
    assert gospa(boxes, intruders, in_range) == pytest.approx(expected)


COORDINATES = st.integers(0, 12).map(lambda quarters: quarters / 4)
PLACES = st.lists(st.tuples(COORDINATES, COORDINATES), max_size=4)


@given(PLACES, PLACES, PLACES)
def test_gospa_is_its_definition_and_a_metric(a: list[Point], b: list[Point], c: list[Point]) -> None:
    def distance(one: list[Point], other: list[Point]) -> float:
        return gospa(one, other, [True] * len(other))

    # the least over all assignments of the smaller set, distances cut off at 1 m
    few, many = sorted((a, b), key=len)
    least = min(
        sum(min(math.dist(one, other), 1.0) for one, other in zip(few, chosen, strict=True))
        for chosen in itertools.permutations(many, len(few))
    )
    assert distance(a, b) == pytest.approx(least + 0.5 * (len(many) - len(few)))
    assert distance(a, a) == 0.0
    assert distance(a, b) == pytest.approx(distance(b, a))
    assert distance(a, c) <= distance(a, b) + distance(b, c) + 1e-9


@pytest.mark.parametrize(
    ("tp", "fp", "fn", "printed"),
    [
        (6967, 176, 1889, ("0.975", "0.787", "0.871")),
        (14953, 1047, 619, ("0.935", "0.960", "0.947")),
        # something to find, nothing found, no box; only false boxes, where Eq. 10 divides by 0
        (0, 0, 5, ("nan", "0.000", "nan")),
        (0, 3, 5, ("0.000", "0.000", "nan")),
        (0, 0, 0, ("nan", "nan", "nan")),
    ],
)
def test_the_papers_table(tp: int, fp: int, fn: int, printed: tuple[str, str, str]) -> None:
    assert tuple(f"{ratio:.3f}" for ratio in ratios(tp, fp, fn)) == printed


MANY = st.integers(0, 10**6)


@given(MANY, MANY, MANY)
def test_ratios_lie_within_0_and_1_and_f1_is_the_harmonic_mean(tp: int, fp: int, fn: int) -> None:
    p, r, f = ratios(tp, fp, fn)
    for ratio in (p, r, f):
        assert math.isnan(ratio) or 0.0 <= ratio <= 1.0
    if tp > 0:
        assert min(p, r) * (1 - 1e-12) <= f <= max(p, r) * (1 + 1e-12)
        assert f == pytest.approx(2 * tp / (2 * tp + fp + fn))
    else:
        assert math.isnan(f)


HERE, THERE, FAR = Box(0.0, 0.0, 1.0, 1.0), Box(2.0, 0.0, 3.0, 1.0), Box(8.0, 0.0, 9.0, 1.0)
THREE = [intruder(HERE), intruder(THERE, "intruder 2"), intruder(FAR, "intruder 3")]


def counted(
    counter: CauseCounter,
    detections: list[Box],
    truths: list[TruthObject],
    in_range: list[bool],
    in_sight: list[bool] | None = None,
    opposite: list[Box] | None = None,
    in_window: list[bool] | None = None,
) -> Causes:
    """As a trial asks for it; unless given, nothing is missed and costmaps reach all that is in range."""
    touched = match_frame(detections, truths).touched
    reached = in_range if in_window is None else in_window

    def sight() -> list[bool]:
        assert in_sight is not None, "nothing was missed"
        return in_sight

    return counter.count(detections, truths, touched, in_range, sight, reached, opposite)


def test_hidden_intruders_and_those_that_just_came_near() -> None:
    counter = CauseCounter()
    assert counted(counter, [HERE], THREE[:2], [True, False]) == NONE
    second = counted(counter, [], THREE[:2], [True, True], [False, True])
    assert second == NONE._replace(fn_hidden=1, fn_new=1, fn_hidden_in_window=1, fn_new_in_window=1)
    counter = CauseCounter()
    counted(counter, [HERE, THERE], THREE, [True, True, False])
    assert counted(counter, [], THREE, [True] * 3, [True] * 3).fn_new == 1
    # in the first frame no intruder is new; one out of range is not missed
    assert counted(CauseCounter(), [], THREE[:1], [True], [True]) == NONE
    assert counted(CauseCounter(), [], THREE[:1], [False]) == NONE


def test_misses_outside_the_local_costmaps_are_counted_apart_from_those_inside() -> None:
    counter, near = CauseCounter(), [True] * 3
    first = counted(counter, [], THREE, near, [False, False, True], in_window=[True, False, False])
    second = counted(counter, [], THREE, near, near, in_window=[True, True, False])
    third = counted(counter, [THERE], THREE, near, near, in_window=[True, True, False])
    assert first == NONE._replace(fn_hidden=2, fn_outside_window=2, fn_hidden_in_window=1)
    # the second one came into a costmap just now, the first was there before
    assert second == NONE._replace(fn_outside_window=1, fn_new_in_window=1)
    assert third == NONE._replace(fn_outside_window=1)


def test_a_false_box_where_an_intruder_was_is_left_over_from_it_and_another_is_not() -> None:
    counter = CauseCounter()
    counted(counter, [], THREE[:1], [False])
    assert counted(counter, [HERE, FAR], [intruder(THERE)], [False]).fp_left == 1
    # a frame later it is older than the delay of a scan
    assert counted(counter, [HERE], [intruder(THERE)], [False]).fp_left == 0
    # a box on an intruder is none, wherever it was
    counted(counter, [], THREE[:1], [False])
    assert counted(counter, [Box(0.5, 0.0, 2.5, 1.0)], [intruder(THERE)], [True]).fp_left == 0


@pytest.mark.parametrize(
    ("boxes", "opposite", "expected"),
    [
        ([HERE, Box(0.9, 0.0, 2.0, 1.0)], None, {"overlapping": 1}),
        ([HERE, Box(1.0, 0.0, 2.0, 1.0)], None, {}),
        ([HERE, FAR], [FAR, HERE], {"looked_at": 1}),
        ([HERE, FAR], [HERE], {"looked_at": 1, "reordered": 1}),
        ([HERE, FAR], [HERE, THERE], {"looked_at": 1, "reordered": 1}),
    ],
)
def test_boxes_that_overlap_and_boxes_that_the_order_of_robots_decides(
    boxes: list[Box], opposite: list[Box] | None, expected: dict[str, int]
) -> None:
    causes = counted(CauseCounter(), boxes, THREE[:1], [True], opposite=opposite)
    assert causes == NONE._replace(**expected)


def test_sums_of_causes() -> None:
    assert total_causes([]) == NONE
    assert total_causes([Causes(*range(1, 10))] * 2) == Causes(*range(2, 20, 2))


AHEAD = LidarGeometry(181, -math.pi / 2.0, math.pi / 180.0, 0.1, 10.0, Pose2D(0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("box", "centre", "edge"),
    [
        (Box(1.0, -0.5, 2.0, 0.5), True, True),  # ahead
        (Box(-2.0, -0.5, -1.0, 0.5), False, False),  # behind
        (Box(-2.0, 1.0, 0.5, 2.0), False, True),  # beside, its front in view
        (Box(2.4, -0.1, 3.0, 0.1), False, True),  # its nearer side in range
        (Box(2.6, -0.1, 3.0, 0.1), False, False),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_what_lies_outside_a_field_of_view_is_not_in_range(
    box: Box, centre: bool, edge: bool, yaw: float
) -> None:
    """Of a half circle that looks along x; turned with the sensor, boxes by their outlines' extent."""
    truth, sensor = intruder(box), Pose2D(0.0, 0.0, 0.0)
    if yaw:
        x, y = Pose2D(0.0, 0.0, yaw).compose(Pose2D(*truth.center, 0.0))[:2]
        truth, sensor = intruder(Box.square(x, y, 1e-6)), Pose2D(0.0, 0.0, yaw)
        edge = centre
    for rule, expected in (("centre", centre), ("edge", edge)):
        answer = truths_in_range([truth], [sensor[:2]], 2.5, rule, [partial(AHEAD.covers, sensor)])  # type: ignore[arg-type]
        assert answer == [expected], rule


def test_one_sensor_that_has_it_in_view_is_enough() -> None:
    behind = intruder(Box(-2.0, -0.5, -1.0, 0.5))
    sensors = [Pose2D(0.0, 0.0, 0.0), Pose2D(0.0, 0.0, math.pi)]
    views = [partial(AHEAD.covers, sensor) for sensor in sensors]
    places = [sensor[:2] for sensor in sensors]
    assert truths_in_range([behind], places, 2.5, "centre", views) == [True]
    assert truths_in_range([behind], places[:1], 2.5, "centre", views[:1]) == [False]
