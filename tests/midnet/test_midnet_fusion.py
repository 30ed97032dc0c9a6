"""Algorithms 3 and 4, and what the paper claims of them that does not hold (item 35)."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box
from tests.midnet.teams import Detection, conquer, fuse, of

T = 0.1


def boxes_in(detections: list[Detection]) -> list[Box]:
    return [detection.box for detection in detections]


def fuse_all(*lists: list[Box], threshold: float = T) -> list[Detection]:
    return conquer([of(r, *boxes) for r, boxes in enumerate(lists)], 0, len(lists) - 1, threshold)


SMALL = Box(0, 0, 4, 4)
LARGE = Box(0, 0, 5, 4)
ELSEWHERE = Box(20, 0, 24, 4)


@pytest.mark.parametrize(
    ("s1", "s2", "fused"),
    [
        ([LARGE], [ELSEWHERE, SMALL], [(0, ELSEWHERE), (1, LARGE)]),  # takes the place of the smaller
        ([SMALL], [LARGE], [(0, LARGE)]),
        ([SMALL], [SMALL], [(0, SMALL)]),
        ([ELSEWHERE], [SMALL], [(0, SMALL), (1, ELSEWHERE)]),  # no partner
    ],
)
def test_algorithm_4_by_hand(s1: list[Box], s2: list[Box], fused: list[tuple[int, Box]]) -> None:
    assert fuse(of(1, *s1), of(0, *s2), T) == [Detection(box, robot) for robot, box in fused]


def test_iou_of_exactly_t_fuses_and_less_does_not() -> None:
    tenth = Box(0, 0, 4, 4), Box(0, 0, 2, 0.8)  # 1.6 of 16
    assert tenth[0].iou(tenth[1]) == pytest.approx(T)
    assert len(fuse_all([tenth[0]], [tenth[1]])) == 1
    assert len(fuse_all([tenth[0]], [Box(0, 0, 2, 0.79)])) == 2


@given(st.integers(-200, 200), st.integers(-200, 200))
def test_equal_cells_tie_wherever_they_lie_on_the_map(column: int, row: int) -> None:
    def box(*cells: int) -> Box:
        moved = np.add(cells, (column, row, column, row))
        return Box(*np.add((-4.03, 1.0, -4.03, 1.0), 0.05 * moved).tolist())

    # 16 cells each, so j stays; 2 of 20 cells in common, exactly t
    assert fuse_all([box(0, 0, 4, 4)], [box(1, 0, 5, 4)]) == of(0, box(0, 0, 4, 4))
    assert len(fuse_all([box(0, 0, 3, 4)], [box(2, 2, 4, 7)])) == 1


def test_five_robots_with_boxes_of_their_own_come_out_in_index_order() -> None:
    own = [Box(10 * robot, 0, 10 * robot + 4, 4) for robot in range(5)]
    assert fuse_all(*([box] for box in own)) == [Detection(box, robot) for robot, box in enumerate(own)]


def test_recursion_takes_a_range_of_robots() -> None:
    lists = [of(robot, Box(10 * robot, 0, 10 * robot + 4, 4)) for robot in range(5)]
    assert conquer(lists, 1, 3, T) == lists[1] + lists[2] + lists[3]


def test_a_single_robot_keeps_its_overlapping_boxes() -> None:
    # item 34: the base case returns the list as it is
    assert boxes_in(fuse_all([SMALL, LARGE])) == [SMALL, LARGE]


#   A      .AAAA......
#   B      ...BBBBBB..     overlaps A and C by more than t, and is the largest
#   C      .......CCCC
A, B, C = Box(0, 0, 4, 4), Box(2, 0, 8, 4), Box(6, 0, 10, 4)


def test_result_depends_on_the_order_of_the_robots_and_can_hold_boxes_that_overlap() -> None:
    # B meets A, then C meets B: one box. But if A and C are joined first, B takes A's place and stops
    # looking at its first match, and C stays beside it.
    assert boxes_in(fuse_all([A], [B], [C])) == [B]
    assert boxes_in(fuse_all([A], [C], [B])) == [B, C]
    assert B.iou(C) == pytest.approx(0.25)


def test_fusing_a_list_with_itself_can_change_it() -> None:
    # LARGE finds its match in SMALL, which comes first, and takes its place: now it is there twice
    own = of(0, SMALL, LARGE)
    assert boxes_in(fuse(own, own, T)) == [LARGE, LARGE]


def test_a_box_can_be_pushed_out_by_one_that_it_does_not_even_overlap() -> None:
    #   j      ....jjjj....
    #   i1     111111......    takes j's place
    #   i2     ......222222    is compared with j, which is gone, and pushes out i1
    j, i1, i2 = Box(4, 0, 8, 4), Box(0, 0, 6, 4), Box(6, 0, 12, 4)
    assert fuse(of(1, i1, i2), of(0, j), T) == of(1, i2)
    assert i1.iou(i2) == 0.0


def test_removing_a_box_can_leave_more_detections() -> None:
    # so an ally that is taken out can add a fused detection, though it never adds to a robot's list
    bridge, left, right = Box(0, 0, 12, 4), Box(0, 0, 4, 4), Box(8, 0, 12, 4)
    assert boxes_in(fuse_all([bridge], [left, right])) == [bridge]
    assert boxes_in(fuse_all([], [left, right])) == [left, right]


Cells = tuple[int, int, int, int]


@st.composite
def cell_boxes(draw: st.DrawFn) -> Cells:
    x1, y1 = draw(st.integers(0, 9)), draw(st.integers(0, 9))
    return x1, y1, x1 + draw(st.integers(1, 6)), y1 + draw(st.integers(1, 6))


LISTS = st.lists(st.lists(cell_boxes(), max_size=4, unique=True), min_size=1, max_size=5)


def in_metres(cells: Cells) -> Box:
    return Box(*(-3.97 + 0.05 * edge for edge in cells))


def as_the_paper_writes_it(s1: list[Cells], s2: list[Cells], t: Fraction) -> list[Cells]:
    """Algorithm 4 word for word, on whole cells and fractions."""

    def area(box: Cells) -> int:
        return (box[2] - box[0]) * (box[3] - box[1])

    def overlap(a: Cells, b: Cells) -> Fraction:
        width = max(0, min(a[2], b[2]) - max(a[0], b[0]))
        height = max(0, min(a[3], b[3]) - max(a[1], b[1]))
        return Fraction(width * height, area(a) + area(b) - width * height)

    s = list(s2)
    for i in s1:
        ip = False
        for j in s2:
            if overlap(i, j) >= t:
                if area(i) > area(j):
                    s[s2.index(j)] = i
                ip = True
                break
        if not ip:
            s.append(i)
    return s


@given(
    st.lists(cell_boxes(), max_size=6, unique=True),
    st.lists(cell_boxes(), max_size=6, unique=True),
    st.sampled_from([Fraction(1, 10), Fraction(1, 5), Fraction(1, 2), Fraction(1)]),
)
def test_fusion_in_metres_is_algorithm_4_in_cells(s1: list[Cells], s2: list[Cells], t: Fraction) -> None:
    fusion = fuse(of(1, *map(in_metres, s1)), of(0, *map(in_metres, s2)), float(t))
    assert boxes_in(fusion) == [in_metres(box) for box in as_the_paper_writes_it(s1, s2, t)]


def tree_of_the_paper(lists: list[list[Cells]], left: int, right: int) -> list[Cells]:
    """Algorithm 3 on whole cells: for five robots, ((1 2) 3) (4 5)."""
    if left == right:
        return lists[left]
    middle = (left + right) // 2
    first, second = tree_of_the_paper(lists, left, middle), tree_of_the_paper(lists, middle + 1, right)
    return as_the_paper_writes_it(second, first, Fraction(1, 10))


@pytest.mark.slow
@given(LISTS)
def test_robots_are_fused_in_the_order_of_algorithm_3(lists: list[list[Cells]]) -> None:
    found = [[in_metres(cells) for cells in own] for own in lists]
    fused = fuse_all(*found)
    assert boxes_in(fused) == [in_metres(cells) for cells in tree_of_the_paper(lists, 0, len(lists) - 1)]
    assert all(detection.box in found[detection.robot] for detection in fused)
