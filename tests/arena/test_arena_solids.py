import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.elementary import atan2
from midnet_bench.geometry import Pose2D, Solid, gap_m

places = st.floats(-5.0, 5.0)
angles = st.floats(-math.pi, math.pi)
sides = st.floats(0.1, 2.0)


def box(x: float, y: float, yaw: float, length: float, width: float) -> Solid:
    return Solid("box", Pose2D(x, y, yaw), length, width, 1.0)


def cylinder(x: float, y: float, diameter: float) -> Solid:
    return Solid("cylinder", Pose2D(x, y, 0.0), diameter, diameter, 1.0)


def test_a_wall_segment_is_longer_by_its_thickness() -> None:
    wall = Solid.segment((1.0, -2.0), (1.0, 2.0), 0.2, 1.0)
    np.testing.assert_allclose(wall.bounding_box(), (0.9, -2.1, 1.1, 2.1), atol=1e-12)


@given(places, places, angles, sides, sides)
def test_a_box_is_at_zero_distance_on_its_outline_and_negative_inside(x, y, yaw, length, width) -> None:
    solid = box(x, y, yaw, length, width)
    corners = solid.outline
    middles = (corners + np.roll(corners, -1, axis=0)) / 2.0
    np.testing.assert_allclose(solid.distance_to(np.vstack((corners, middles))), 0.0, atol=1e-9)
    np.testing.assert_allclose(solid.distance_to(np.array([(x, y)])), -min(length, width) / 2.0, atol=1e-9)


@given(places, places, angles, sides, sides, places, places)
def test_distance_to_a_box_is_that_to_the_nearest_of_many_points_on_it(x, y, yaw, length, width, px, py):
    solid = box(x, y, yaw, length, width)
    corners = solid.outline
    t = np.linspace(0.0, 1.0, 2001)[:, None]
    rim = np.vstack([a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    brute = np.hypot(rim[:, 0] - px, rim[:, 1] - py).min()
    assert abs(solid.distance_to(np.array([(px, py)]))[0]) == pytest.approx(brute, abs=2e-3)


def test_outlines_turn_to_the_left_and_a_cylinder_keeps_its_radius_on_average() -> None:
    for solid in (box(1.0, 2.0, 0.7, 0.5, 0.3), cylinder(-1.0, 3.0, 1.0)):
        corners = solid.outline
        x, y = corners.T
        area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0
        assert area == pytest.approx(0.15 if solid.kind == "box" else math.pi * 0.25, rel=2e-3)
    spread = cylinder(-1.0, 3.0, 1.0).distance_to(cylinder(-1.0, 3.0, 1.0).outline)
    assert 0.0 < spread.max() < 7e-4


def test_bounding_boxes() -> None:
    np.testing.assert_allclose(box(0, 0, math.pi / 2, 2.0, 1.0).bounding_box(), (-0.5, -1.0, 0.5, 1.0))
    np.testing.assert_allclose(cylinder(1.0, 2.0, 1.0).bounding_box(), (0.5, 1.5, 1.5, 2.5))


def test_gaps_between_solids_known_by_hand() -> None:
    one = box(0.0, 0.0, 0.0, 1.0, 1.0)
    assert gap_m(one, (box(2.0, 0.0, 0.0, 1.0, 1.0),)) == pytest.approx(1.0, abs=1e-9)
    diamond = box(2.0, 0.0, math.pi / 4, 1.0, 1.0)
    assert gap_m(diamond, (one,)) == pytest.approx(1.5 - math.sqrt(0.5), abs=1e-9)
    assert gap_m(one, (diamond,)) == pytest.approx(1.5 - math.sqrt(0.5), abs=1e-3)
    assert gap_m(one, (cylinder(0.0, 2.0, 1.0),)) == pytest.approx(1.0, abs=1e-3)
    assert gap_m(box(0, 0, 0, 2.0, 0.2), (box(0, 0, math.pi / 2, 2.0, 0.2),)) < 0.0, "a cross overlaps"
    assert gap_m(one, ()) == math.inf


@pytest.mark.parametrize(
    ("dx", "dy"), [(2.0, 0.0), (2.0, -0.0), (-2.0, 0.0), (-2.0, -0.0), (0.0, 3.0), (0.0, -3.0), (-0.0, 3.0)]
)
def test_a_wall_along_an_axis_has_the_direction_that_any_other_is_given(dx: float, dy: float) -> None:
    yaw = Solid.segment((0.0, 0.0), (dx, dy), 0.15, 1.0).pose.yaw
    expected = atan2(dy - 0.0, dx - 0.0)
    assert (yaw, math.copysign(1.0, yaw)) == (expected, math.copysign(1.0, expected))
