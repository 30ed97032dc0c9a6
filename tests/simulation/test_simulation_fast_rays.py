"""Beams through both engines; where they differ, exact arithmetic says who is right."""

import math
from fractions import Fraction

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.geometry import Pose2D, Solid
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.fleet import surfaces
from tests.simulation.scenes import BulletWorld, FastWorld, differing, fans, scene

SAME_M = 1e-9
"""What counts as a difference, and how far ``fast`` may be from the exact distance: it rounds."""
WRONG_M = 1e-6
"""PyBullet computes in single precision near a side's ends; from here on it is wrong."""


def exact_m(sides: np.ndarray, axis, direction, near_m: float, far_m: float) -> float:
    """The first side that a beam meets, its numbers taken as they are; inf if it meets none."""
    to_side, along = sides[:, :2] - axis, sides[:, 2:] - sides[:, :2]
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = direction[0] * along[:, 1] - direction[1] * along[:, 0]
        roughly = (to_side[:, 0] * direction[1] - to_side[:, 1] * direction[0]) / turns
    sides = sides[~(np.abs(roughly - 0.5) > 0.51)]  # the rest it misses by a hundredth of their length
    x, y, dx, dy = (Fraction(float(value)) for value in (*axis, *direction))
    nearest = math.inf
    for side in sides:
        ax, ay, bx, by = (Fraction(float(value)) for value in side)
        area = dx * (by - ay) - dy * (bx - ax)
        if area == 0:
            continue
        distance = ((ax - x) * (by - ay) - (ay - y) * (bx - ax)) / area
        share = ((ax - x) * dy - (ay - y) * dx) / area
        if 0 <= share <= 1 and Fraction(near_m) <= distance < Fraction(far_m):
            nearest = min(nearest, distance)
    return float(nearest)


def test_where_the_engines_differ_fast_is_right() -> None:
    beams_cast = disputes = wrong = 0
    for name, seed in (("map1", 11), ("map1", 12), ("map1", 13), ("map2", 14), ("map2", 15), ("empty", 16)):
        layout = place(load_arena(name), seed, 1)
        sides = surfaces(layout)
        beams = fans(np.random.default_rng(seed), layout, 48)
        with BulletWorld(layout) as bullet, FastWorld(layout) as fast:
            ranges, other = fast.cast(beams, 0.12, 3.5), bullet.cast(beams, 0.12, 3.5)
        beams_cast += ranges.size
        for i, k in differing(ranges, other, SAME_M):
            exact = exact_m(sides, beams.axes[i], beams.directions[i, k], 0.12, 3.5)
            assert ranges[i, k] == pytest.approx(exact, abs=SAME_M, rel=0.0), (name, seed, i, k)
            disputes += 1
            wrong += len(differing(other[i, k], np.array(exact), WRONG_M))
    assert beams_cast > 100_000
    assert disputes < 0.01 * beams_cast, "the engines agree on nearly all beams"
    assert wrong > 0, "the judge finds PyBullet wrong beside some walls' ends"


def test_beams_in_any_directions_and_at_any_range_are_exact() -> None:
    """Against all sides in exact arithmetic: full turns, and beams that form none; near and far limits."""
    layout = place(load_arena("map1"), 3, 1)
    sides = surfaces(layout)
    rng = np.random.default_rng(3)
    turns = fans(rng, layout, 2)
    axes, angles = turns.axes, rng.uniform(-4.0, 4.0, (2, 240))
    apart = Beams(axes, np.stack((np.cos(angles), np.sin(angles)), axis=2))
    backwards = Beams(axes, np.ascontiguousarray(turns.directions[:, ::-1]))
    with FastWorld(layout) as fast:
        for beams in (turns, apart, backwards):
            for near_m, far_m in ((0.0, 0.5), (0.12, 3.5), (2.0, 20.0)):
                ranges = fast.cast(beams, near_m, far_m)
                for i, k in np.ndindex(ranges.shape):
                    if k % 24 == 0:
                        exact = exact_m(sides, beams.axes[i], beams.directions[i, k], near_m, far_m)
                        assert ranges[i, k] == pytest.approx(exact, abs=SAME_M, rel=0.0)


def test_a_sensor_on_a_wall_and_one_inside_see_what_is_before_them() -> None:
    block = Solid("box", Pose2D(1.0, 0.0, 0.0), 1.0, 1.0, 0.5)
    layout = scene([(0.0, 0.0, 0.0)], stationary=[block])
    angles = np.radians(np.arange(360))
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    with FastWorld(layout) as fast:
        on, inside = fast.cast(
            Beams(np.array([(0.5, 0.1), (1.2, 0.0)]), np.stack([directions] * 2)), 0.12, 3.5
        )
    assert on[180] == pytest.approx(0.5 + 2.925)
    assert on[0] == pytest.approx(1.0), "its far side: the near one is nearer than the beam begins"
    np.testing.assert_allclose(inside[[0, 90, 180, 270]], (0.3, 0.5, 0.7, 0.5))


def test_no_sensors_and_no_beams_give_empty_ranges() -> None:
    with FastWorld(scene([(0.0, 0.0, 0.0)])) as fast:
        assert fast.cast(Beams(np.empty((0, 2)), np.empty((0, 360, 2))), 0.12, 3.5).shape == (0, 360)
        assert fast.cast(Beams(np.zeros((3, 2)), np.empty((3, 0, 2))), 0.12, 3.5).shape == (3, 0)
