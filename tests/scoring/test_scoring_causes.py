"""Causes of errors as the paper words them, by hand."""

from collections.abc import Callable

import pytest

from midnet_bench.geometry import Box
from midnet_bench.scoring.frame_counts import (
    NONE,
    CauseCounter,
    Causes,
    TruthObject,
    match_frame,
    total_causes,
)

HERE, THERE, FAR = Box(0.0, 0.0, 1.0, 1.0), Box(2.0, 0.0, 3.0, 1.0), Box(8.0, 0.0, 9.0, 1.0)


def intruder(box: Box, name: str = "intruder 1") -> TruthObject:
    return TruthObject(name, box, box.center)


def counted(
    counter: CauseCounter,
    detections: list[Box],
    truths: list[TruthObject],
    in_range: list[bool],
    in_sight: Callable[[], list[bool]],
    opposite: list[Box] | None = None,
    in_window: list[bool] | None = None,
) -> Causes:
    """As a trial asks for it; unless given, local costmaps reach all that is in range."""
    touched = match_frame(detections, truths).touched
    reached = in_range if in_window is None else in_window
    return counter.count(detections, truths, touched, in_range, in_sight, reached, opposite)


def never() -> list[bool]:
    raise AssertionError("nothing was missed")


def test_a_hidden_intruder_and_one_that_just_came_near() -> None:
    counter = CauseCounter()
    truths = [intruder(HERE), intruder(THERE, "intruder 2")]
    first = counted(counter, [HERE], truths, [True, False], never)
    second = counted(counter, [], truths, [True, True], lambda: [False, True])

    assert first == NONE
    assert second == NONE._replace(fn_hidden=1, fn_new=1, fn_hidden_in_window=1, fn_new_in_window=1)


def test_an_intruder_that_was_in_range_before_is_not_new() -> None:
    counter = CauseCounter()
    truths = [intruder(HERE), intruder(THERE, "intruder 2"), intruder(FAR, "intruder 3")]
    counted(counter, [HERE, THERE], truths, [True, True, False], never)
    assert counted(counter, [], truths, [True] * 3, lambda: [True] * 3).fn_new == 1


def test_misses_outside_the_local_costmaps_are_counted_apart_from_those_inside() -> None:
    counter = CauseCounter()
    truths = [intruder(HERE), intruder(THERE, "intruder 2"), intruder(FAR, "intruder 3")]
    near, all_seen = [True] * 3, lambda: [True] * 3
    first = counted(counter, [], truths, near, lambda: [False, False, True], in_window=[True, False, False])
    second = counted(counter, [], truths, near, all_seen, in_window=[True, True, False])
    third = counted(counter, [THERE], truths, near, all_seen, in_window=[True, True, False])
    assert first == NONE._replace(fn_hidden=2, fn_outside_window=2, fn_hidden_in_window=1)
    # the second one came into a costmap just now, the first was there before
    assert second == NONE._replace(fn_outside_window=1, fn_new_in_window=1)
    assert third == NONE._replace(fn_outside_window=1)


def test_nobody_is_new_in_the_first_frame() -> None:
    assert counted(CauseCounter(), [], [intruder(HERE)], [True], lambda: [True]) == NONE


def test_an_intruder_out_of_range_is_not_missed() -> None:
    assert counted(CauseCounter(), [], [intruder(HERE)], [False], never) == NONE


def test_a_box_where_an_intruder_was_is_left_over_from_it_and_another_is_not() -> None:
    counter = CauseCounter()
    counted(counter, [], [intruder(HERE)], [False], never)
    causes = counted(counter, [HERE, FAR], [intruder(THERE)], [False], never)

    assert causes.fp_left == 1
    # a frame later it is older than the delay of a scan
    assert counted(counter, [HERE], [intruder(THERE)], [False], never).fp_left == 0


def test_a_box_on_an_intruder_is_no_false_one_wherever_it_was() -> None:
    counter = CauseCounter()
    counted(counter, [], [intruder(HERE)], [False], never)
    assert counted(counter, [Box(0.5, 0.0, 2.5, 1.0)], [intruder(THERE)], [True], never).fp_left == 0


@pytest.mark.parametrize(("other", "overlaps"), [(Box(0.9, 0.0, 2.0, 1.0), 1), (Box(1.0, 0.0, 2.0, 1.0), 0)])
def test_boxes_that_share_an_edge_do_not_overlap(other: Box, overlaps: int) -> None:
    causes = counted(CauseCounter(), [HERE, other], [intruder(HERE)], [True], never)
    assert causes.overlapping == overlaps


def test_the_order_of_boxes_is_no_difference_and_another_box_is_one() -> None:
    def reordered(opposite: list[Box] | None) -> tuple[int, int]:
        causes = counted(CauseCounter(), [HERE, FAR], [intruder(HERE)], [True], never, opposite)
        return causes.reordered, causes.looked_at

    assert reordered(None) == (0, 0)
    assert reordered([FAR, HERE]) == (0, 1)
    assert reordered([HERE]) == (1, 1)
    assert reordered([HERE, THERE]) == (1, 1)


def test_sums_over_frames() -> None:
    assert total_causes([]) == NONE
    assert total_causes([Causes(*range(1, 10))] * 2) == Causes(*range(2, 20, 2))
