"""Fusions by hand, and what must hold of each for any boxes."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.detectors.fusions import (
    CentreDistance,
    ConnectedComponents,
    Fusion,
    KalmanTracks,
    NoFusion,
    NonMaximumSuppression,
    WeightedBoxes,
    ious,
)
from midnet_bench.geometry import Box

Boxes = npt.NDArray[np.float64]
BLIND_TO_ORDER = [NoFusion, NonMaximumSuppression, ConnectedComponents, WeightedBoxes]
ALL = [*BLIND_TO_ORDER, CentreDistance, KalmanTracks]


def boxes(*rows: Sequence[float]) -> Boxes:
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def row(cells: tuple[int, int, int, int]) -> tuple[float, ...]:
    x, y, width, height = cells
    return tuple(side * 0.05 for side in (x, y, x + width, y + height))


cells = st.tuples(st.integers(0, 20), st.integers(0, 20), st.integers(1, 10), st.integers(1, 10)).map(row)
teams = st.lists(st.lists(cells, max_size=5).map(lambda own: boxes(*own)), min_size=1, max_size=5)

CHAIN = [boxes((0, 0, 2, 1)), boxes((1, 0, 3, 1)), boxes((2, 0, 4, 1))]
"""each overlaps the next by a third, the first and the last share an edge"""


@pytest.mark.parametrize(("gap_m", "boxes"), [(0.0, 3), (0.29, 3), (0.31, 2), (0.6, 1)])
def test_components_join_boxes_with_a_gap_between_them_where_that_is_wanted(gap_m: float, boxes: int) -> None:
    legs = [np.array([[0.0, 0.0, 0.1, 0.1], [0.4, 0.0, 0.5, 0.1], [0.5, 0.6, 0.6, 0.7]])]
    fused = ConnectedComponents(gap_m=gap_m).fuse(legs, 0.0)
    assert len(fused) == boxes
    if boxes == 2:
        np.testing.assert_array_equal(fused[0], [0.0, 0.0, 0.5, 0.1])


def test_a_chain_is_told_apart_by_what_each_fusion_is() -> None:
    assert len(NoFusion().fuse(CHAIN, 0.0)) == 3
    np.testing.assert_array_equal(ConnectedComponents().fuse(CHAIN, 0.0), [[0, 0, 4, 1]])
    # of three of one size the lowest corner comes first and takes out its neighbour alone
    np.testing.assert_array_equal(NonMaximumSuppression().fuse(CHAIN, 0.0), [[0, 0, 2, 1], [2, 0, 4, 1]])
    # the mean of the first two overlaps the third by a seventh
    np.testing.assert_array_equal(WeightedBoxes(iou=0.14).fuse(CHAIN, 0.0), [[1, 0, 3, 1]])
    np.testing.assert_array_equal(WeightedBoxes(iou=0.15).fuse(CHAIN, 0.0), [[0.5, 0, 2.5, 1], [2, 0, 4, 1]])
    np.testing.assert_array_equal(ConnectedComponents(iou=0.5).fuse(CHAIN, 0.0), NoFusion().fuse(CHAIN, 0.0))


def test_suppression_keeps_the_larger_box() -> None:
    found = [boxes((0, 0, 1, 1)), boxes((0, 0, 1.5, 1.5)), boxes((5, 5, 6, 6))]
    np.testing.assert_array_equal(
        NonMaximumSuppression(iou=0.3).fuse(found, 0.0), [[0, 0, 1.5, 1.5], [5, 5, 6, 6]]
    )


def test_centres_within_reach_become_their_mean_and_most_pairs_come_first() -> None:
    # the second robot's left box is nearer to the first's right one, but then one box would be left alone
    found = [boxes((0, 0, 1, 1), (0.4, 0, 1.4, 1)), boxes((0.3, 0, 1.3, 1), (0.7, 0, 1.7, 1))]
    fused = CentreDistance(gap_m=0.35).fuse(found, 0.0)
    np.testing.assert_allclose(fused, [[0.15, 0, 1.15, 1], [0.55, 0, 1.55, 1]])
    third = CentreDistance(gap_m=0.35).fuse([*found, boxes((0.15, 0, 1.15, 1))], 0.0)
    np.testing.assert_allclose(third, fused)


def test_a_track_is_told_from_its_third_box_on_and_for_half_a_second_after_its_last() -> None:
    fusion, told = KalmanTracks(), []
    for frame in range(10):
        found = [boxes((frame * 0.04, 0, frame * 0.04 + 1, 1))] if frame < 5 else [boxes()]
        told.append(len(fusion.fuse(found, 0.2 * frame)))
    assert told == [0, 0, 1, 1, 1, 1, 1, 0, 0, 0]


def test_overlaps_of_all_pairs_are_those_of_each_pair() -> None:
    rng = np.random.default_rng(3)
    corners = rng.uniform(0, 2, (12, 2))
    some = np.hstack((corners, corners + rng.uniform(0.1, 1, (12, 2))))
    plain = [Box(*one) for one in some.tolist()]
    wanted = [[one.iou(other) for other in plain] for one in plain]
    np.testing.assert_allclose(ious(some[:, None], some), wanted, atol=1e-12)


@pytest.mark.parametrize("make", ALL)
def test_nobody_and_nothing_give_no_boxes(make: Callable[[], Fusion]) -> None:
    for found in ([], [boxes()], [boxes(), boxes()]):
        assert np.shape(make().fuse(found, 0.2)) == (0, 4)


@pytest.mark.slow
@pytest.mark.parametrize("make", BLIND_TO_ORDER)
@given(teams, st.randoms(use_true_random=False))
def test_the_order_of_robots_and_of_their_boxes_does_not_matter(make, team, random) -> None:
    fused = make().fuse(team, 0.0)
    mixed = [own[random.sample(range(len(own)), len(own))] for own in random.sample(team, len(team))]
    np.testing.assert_array_equal(make().fuse(mixed, 0.0), fused)


@given(teams)
def test_components_are_disjoint_groups_that_hold_every_box(team) -> None:
    fused = ConnectedComponents(iou=1e-9).fuse(team, 0.0)
    for box in np.concatenate(team):
        holds = (fused[:, :2] <= box[:2]).all(axis=1) & (fused[:, 2:] >= box[2:]).all(axis=1)
        assert holds.any()
    if not any(len(own) for own in team):
        assert not len(fused)
