import math
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.geometry import Box, LidarGeometry, Pose2D, mean_point

COORDINATE = st.floats(-50.0, 50.0)
ANGLE = st.floats(-3.1, 3.1)


@st.composite
def cell_boxes(draw: st.DrawFn) -> Box:
    """Boxes of whole cells on a 12 x 12 grid."""
    x, y = draw(st.integers(0, 10)), draw(st.integers(0, 10))
    return Box(x, y, draw(st.integers(x + 1, 12)), draw(st.integers(y + 1, 12)))


@given(x=COORDINATE, y=COORDINATE, yaw=ANGLE, dx=COORDINATE, dy=COORDINATE, turn=ANGLE)
def test_a_pose_relative_to_another_leads_from_that_one_to_it(
    x: float, y: float, yaw: float, dx: float, dy: float, turn: float
) -> None:
    first, second = Pose2D(x, y, yaw), Pose2D(x + dx, y + dy, turn)
    step = second.relative_to(first)
    reached = first.compose(step)
    assert reached.distance_to(second) < 1e-9
    assert math.remainder(reached.yaw - second.yaw, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert -math.pi <= step.yaw <= math.pi


@given(x=COORDINATE, y=COORDINATE, yaw=ANGLE, px=COORDINATE, py=COORDINATE)
def test_points_are_transformed_as_poses_are_composed(
    x: float, y: float, yaw: float, px: float, py: float
) -> None:
    pose = Pose2D(x, y, yaw)
    points = pose.transform(np.array([[px, py], [0.0, 0.0]]))
    composed = pose.compose(Pose2D(px, py, 0.0))
    assert points == pytest.approx(np.array([composed[:2], (x, y)]), abs=1e-12)
    assert pose.inverse().transform(points) == pytest.approx(np.array([[px, py], [0.0, 0.0]]), abs=1e-12)


@given(cell_boxes(), cell_boxes())
def test_iou_is_the_share_of_common_cells(a: Box, b: Box) -> None:
    raster = np.zeros((2, 12, 12), bool)
    for layer, box in zip(raster, (a, b), strict=True):
        layer[int(box.y_min) : int(box.y_max), int(box.x_min) : int(box.x_max)] = True
    expected = np.count_nonzero(raster.all(axis=0)) / np.count_nonzero(raster.any(axis=0))
    assert a.iou(b) == pytest.approx(expected)
    assert a.iou(b) == b.iou(a)
    assert a.iou(a) == 1.0


def test_boxes_that_only_touch_or_have_no_area_do_not_overlap() -> None:
    box = Box(0.0, 0.0, 1.0, 1.0)
    assert box.iou(Box(1.0, 0.0, 2.0, 1.0)) == 0.0
    assert box.iou(Box(1.0, 1.0, 2.0, 2.0)) == 0.0
    assert box.iou(Box(0.5, 0.2, 0.5, 0.8)) == 0.0
    assert Box(0.5, 0.5, 0.5, 0.5).iou(Box(0.5, 0.5, 0.5, 0.5)) == 0.0


@given(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=40), st.randoms())
def test_a_mean_point_is_the_same_to_the_bit_in_any_order(
    points: list[tuple[float, float]], random: Random
) -> None:
    shuffled = random.sample(points, len(points))
    middle = mean_point(np.array(points))
    assert mean_point(np.array(shuffled)).tobytes() == middle.tobytes()
    assert middle == pytest.approx(np.mean(points, axis=0))


@pytest.mark.parametrize(
    ("beams", "increment_deg", "is_full"),
    [(360, 1.0, True), (361, 1.0, True), (455, 360.0 / 455, True), (300, 1.0, False), (1081, 0.25, False)],
)
def test_a_full_turn_is_told_by_the_gap_behind_the_last_beam(
    beams: int, increment_deg: float, is_full: bool
) -> None:
    for sign in (1.0, -1.0):
        lidar = LidarGeometry(
            beams, 0.3, sign * math.radians(increment_deg), 0.1, 10.0, Pose2D(0.0, 0.0, 0.0)
        )
        assert lidar.is_full_turn == is_full
        everywhere = np.random.default_rng(1).uniform(-5.0, 5.0, (100, 2))
        assert lidar.covers(Pose2D(0.0, 0.0, 1.0), everywhere).all() == is_full


@pytest.mark.parametrize("increment_deg", [1.0, -1.0])
def test_a_field_of_view_ends_half_a_beam_beyond_its_beams(increment_deg: float) -> None:
    first_deg = -120.0 if increment_deg > 0 else 120.0
    lidar = LidarGeometry(
        241, math.radians(first_deg), math.radians(increment_deg), 0.1, 10.0, Pose2D(0.0, 0.0, 0.0)
    )
    sensor = Pose2D(2.0, -1.0, 2.5)
    for off_deg, seen in ((0.0, True), (120.4, True), (-120.4, True), (120.6, False), (-120.6, False)):
        way = 2.5 + math.radians(off_deg)
        point = (2.0 + 3.0 * math.cos(way), -1.0 + 3.0 * math.sin(way))
        assert lidar.covers(sensor, np.array([point])).tolist() == [seen], off_deg
