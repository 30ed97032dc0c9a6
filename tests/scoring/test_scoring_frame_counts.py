import itertools
import math
from fractions import Fraction
from random import Random

import pytest
import scipy.optimize  # noqa: F401 - the first match imports it, which hypothesis takes for slow
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box
from midnet_bench.scoring.frame_counts import (
    NOTHING,
    FrameCounts,
    TruthObject,
    count_frame,
    match_frame,
    total,
    truths_in_range,
)


def intruder(box: Box, name: str = "intruder") -> TruthObject:
    return TruthObject(name, box, box.center)


ONE = intruder(Box(0.0, 0.0, 1.0, 1.0))
TWO = intruder(Box(1.5, 0.0, 2.5, 1.0))


def test_hit_a_false_box_and_a_miss() -> None:
    detections = [Box(0.5, 0.5, 1.2, 1.0), Box(5.0, 5.0, 6.0, 6.0)]
    counts = count_frame(detections, [ONE, TWO], [True, True])
    assert counts == FrameCounts(
        tp=1,
        fp=1,
        fn=1,
        intruders_in_range=2,
        matched=1,
        duplicates=0,
        missed=1,
        error_sum_m=pytest.approx(math.hypot(0.35, 0.25)),
        gospa_m=pytest.approx(math.hypot(0.35, 0.25) + 0.5 + 0.5),
    )


def test_two_boxes_on_one_intruder_are_two_tp_and_one_duplicate() -> None:
    near, far = Box(0.0, 0.0, 0.9, 1.0), Box(0.8, 0.0, 1.2, 1.0)
    for detections in ([near, far], [far, near]):
        counts = count_frame(detections, [ONE], [True])
        assert (counts.tp, counts.fp, counts.fn) == (2, 0, 0)
        assert (counts.matched, counts.duplicates, counts.missed) == (1, 1, 0)
        # the box with the greater IoU is the one that is paired
        assert counts.error_sum_m == pytest.approx(0.05)


def test_one_box_for_each_intruder_leaves_further_boxes_uncounted() -> None:
    boxes = [Box(0.0, 0.0, 0.9, 1.0), Box(0.8, 0.0, 1.2, 1.0), Box(5.0, 5.0, 6.0, 6.0)]
    every = count_frame(boxes, [ONE, TWO], [True, True])
    once = count_frame(boxes, [ONE, TWO], [True, True], "one_per_intruder", match_frame(boxes, [ONE, TWO]))
    assert (every.tp, every.fp, every.fn) == (2, 1, 1)
    assert once == every._replace(tp=1)


def test_a_second_box_on_an_intruder_can_be_a_false_positive_and_its_miss_stays_none() -> None:
    boxes = [Box(0.0, 0.0, 0.9, 1.0), Box(0.8, 0.0, 1.2, 1.0), Box(5.0, 5.0, 6.0, 6.0)]
    every = count_frame(boxes, [ONE, TWO], [True, True])
    surplus = count_frame(boxes, [ONE, TWO], [True, True], "surplus_false")
    assert surplus == every._replace(tp=1, fp=2)
    # a box over two intruders is one true positive, and neither of them is missed
    over_both = [Box(0.0, 0.0, 2.5, 1.0)]
    counts = count_frame(over_both, [ONE, TWO], [True, True], "surplus_false")
    assert (counts.tp, counts.fp, counts.fn) == (1, 0, 0)


def test_one_box_over_two_intruders_finds_both_for_the_paper_and_one_for_the_matching() -> None:
    counts = count_frame([Box(0.0, 0.0, 2.5, 1.0)], [ONE, TWO], [True, True])
    assert (counts.tp, counts.fn) == (1, 0)
    assert (counts.matched, counts.missed) == (1, 1)


def test_as_many_pairs_as_can_be_come_before_the_best_overlap() -> None:
    both, only_one = Box(0.0, 0.0, 1.6, 1.0), Box(0.9, 0.9, 1.2, 1.2)
    match = match_frame([both, only_one], [ONE, TWO])
    assert match.touched == [[0, 1], [0]]
    assert match.truth_of == [1, 0]
    assert match.detection_of == [1, 0]


def test_shared_edge_is_no_touch_and_neither_is_a_box_without_area() -> None:
    detections = [Box(1.0, 0.0, 1.5, 1.0), Box(0.5, 0.2, 0.5, 0.8)]
    counts = count_frame(detections, [ONE, TWO], [True, True])
    assert (counts.tp, counts.fp, counts.fn, counts.missed) == (0, 2, 2, 2)


def test_box_on_an_intruder_out_of_range_is_a_true_positive_and_its_absence_no_miss() -> None:
    assert count_frame([ONE.box], [ONE], [False]).tp == 1
    assert count_frame([], [ONE], [False]) == NOTHING


def test_frames_with_nothing_in_them() -> None:
    assert count_frame([], [], []) == NOTHING
    assert count_frame([ONE.box], [], []) == NOTHING._replace(fp=1, gospa_m=0.5)
    assert count_frame([], [ONE], [True]) == NOTHING._replace(
        fn=1, intruders_in_range=1, missed=1, gospa_m=0.5
    )
    assert total([]) == NOTHING


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


def overlap(a: Box, b: Box) -> float:
    both = a.intersection_area(b)
    return both / (a.area + b.area - both)


@given(FRAMES)
def test_matching_is_the_best_of_all_that_there_are(frame: tuple[list[Box], list[tuple[Box, bool]]]) -> None:
    detections, truths = frame[0], [intruder(box) for box, _ in frame[1]]
    best = (0, 0.0)
    # every way to give each detection a truth of its own, or none
    slots = [*range(len(truths)), *([None] * len(detections))]
    for assignment in set(itertools.permutations(slots, len(detections))):
        scores = [
            overlap(box, truths[truth].box)
            for box, truth in zip(detections, assignment, strict=True)
            if truth is not None
        ]
        if all(score > 0.0 for score in scores):
            best = max(best, (len(scores), round(sum(scores), 9)))

    match = match_frame(detections, truths)
    scores = [
        overlap(box, truths[truth].box)
        for box, truth in zip(detections, match.truth_of, strict=True)
        if truth is not None
    ]
    assert all(score > 0.0 for score in scores)
    assert (len(scores), round(sum(scores), 9)) == best
    for truth, detection in enumerate(match.detection_of):
        if detection is not None:
            assert match.truth_of[detection] == truth
    assert sum(one is not None for one in match.detection_of) == len(scores)


@given(FRAMES)
def test_counts_are_what_their_names_say(frame: tuple[list[Box], list[tuple[Box, bool]]]) -> None:
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


@given(
    st.lists(
        st.tuples(*[st.integers(0, 9)] * 7, st.floats(0, 9), st.floats(0, 9)).map(
            lambda row: FrameCounts(*row)
        ),
        max_size=5,
    )
)
def test_total_sums_each_count(frames: list[FrameCounts]) -> None:
    summed = total(frames)
    for name in FrameCounts._fields:
        assert getattr(summed, name) == pytest.approx(sum(getattr(frame, name) for frame in frames))


METRES = st.floats(0.0, 20.0)


@given(st.lists(st.tuples(st.integers(0, 9), METRES, METRES), max_size=40), st.randoms())
def test_sums_over_frames_are_exact_so_their_order_is_nothing(
    frames: list[tuple[int, float, float]], random: Random
) -> None:
    counts = [NOTHING._replace(tp=tp, error_sum_m=error_m, gospa_m=m) for tp, error_m, m in frames]
    summed = total(counts)
    assert repr(total(random.sample(counts, len(counts)))) == repr(summed)
    assert Fraction(summed.error_sum_m) == Fraction(float(sum(Fraction(one.error_sum_m) for one in counts)))
    assert [type(number) for number in summed] == [type(number) for number in NOTHING]


def test_errors_of_one_frame_add_up_exactly() -> None:
    # one by one they add up to 4.000000000000002
    boxes = [Box.square(1.5 * k + 0.4, 0.0, 1.0) for k in range(10)]
    truths = [intruder(Box.square(1.5 * k, 0.0, 1.0)) for k in range(10)]
    errors_m = [math.dist(box.center, truth.center) for box, truth in zip(boxes, truths, strict=True)]
    counts = count_frame(boxes, truths, [True] * 10)
    assert counts.error_sum_m == counts.gospa_m == math.fsum(errors_m) == 4.000000000000003
