"""The Burger's measures agree with its description, and the margins that are drawn from them with both."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from midnet_bench.agents.patrol import DRIVABLE_M
from midnet_bench.arena.layout import ROBOT_CLEARANCE_M
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.midnet.pipeline import MIDNetSettings
from midnet_bench.navigation.navigation_settings import LocalPlannerLimits
from midnet_bench.robots.turtlebot3 import BURGER


def numbers(text: str | None) -> list[float]:
    return [float(word) for word in (text or "").split()]


def test_the_body_is_that_of_the_description() -> None:
    assert BURGER.urdf is not None
    root = ET.parse(BURGER.urdf).getroot()
    base = root.find("link[@name='base_link']")
    assert base is not None
    corners = set()
    for shape in base.findall("collision"):
        origin, box = shape.find("origin"), shape.find("geometry/box")
        assert origin is not None
        assert box is not None
        (x, y, _), (length, width, _) = numbers(origin.get("xyz")), numbers(box.get("size"))
        corners |= {(x + a * length / 2, y + b * width / 2) for a in (-1, 1) for b in (-1, 1)}
    body = {(round(x, 6), round(y, 6)) for x, y in BURGER.body}
    assert {(round(x, 6), round(y, 6)) for x, y in corners} <= body
    assert max(math.hypot(*corner) for corner in corners) == pytest.approx(BURGER.body_reach_m)
    wheels = [root.find(f"joint[@name='wheel_{side}_joint']/origin") for side in ("left", "right")]
    left, right = (numbers(wheel.get("xyz")) for wheel in wheels if wheel is not None)
    assert left[1] - right[1] == pytest.approx(BURGER.wheel_separation_m)
    sphere = root.find("link[@name='wheel_left']/collision/geometry/sphere")
    assert sphere is not None
    assert float(sphere.get("radius", "nan")) == BURGER.wheel_radius_m


def test_the_body_lies_within_the_footprint_that_it_plans_with() -> None:
    corners = np.array(BURGER.footprint)
    assert (np.array(BURGER.body) >= corners.min(axis=0)).all()
    assert (np.array(BURGER.body) <= corners.max(axis=0)).all()
    assert BURGER.body_reach_m == pytest.approx(0.1237, abs=1e-4)
    assert BURGER.footprint_reach_m == pytest.approx(0.1421, abs=1e-4)


def test_a_robot_that_keeps_a_margin_touches_nothing_however_it_turns() -> None:
    assert BURGER.footprint_reach_m < DRIVABLE_M
    assert BURGER.body_reach_m < ROBOT_CLEARANCE_M


def test_defaults_that_are_said_in_other_rooms_are_this_robots() -> None:
    limits = LocalPlannerLimits()
    assert limits.max_vel_x_mps == -limits.min_vel_x_mps == limits.max_vel_trans_mps
    assert limits.max_vel_x_mps == DetectionParameters().intruder_speed_mps <= BURGER.max_linear_mps
    assert (
        MIDNetSettings().ally_diameter_m
        == BURGER.diameter_m
        == pytest.approx(math.hypot(0.138, 0.178), abs=5e-4)
    )
    assert BURGER.disc("disc").radius_m == BURGER.radius_m
