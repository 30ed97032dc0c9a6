"""PyBullet's beams against plain arithmetic on the solids' sides."""

import math

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.geometry import Command, Pose2D, Solid
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.fleet import surfaces
from tests.simulation.scenes import BulletWorld, differing, fans, run, scene

SAME_M = 1e-12
BESIDE_M = 1e-3
"""PyBullet's mesh may be met, or missed, so near to the end of a side."""


def nearest_side_m(sides: np.ndarray, beams: Beams, near_m: float, far_m: float, longer_m: float):
    """(m, beams) metres to the first of (k, 4) sides, each made longer at both ends; inf if there is none."""
    starts, along = sides[:, :2], sides[:, 2:] - sides[:, :2]
    slack = longer_m / np.hypot(*along.T)
    ranges = np.full(beams.directions.shape[:2], np.inf)
    for i, (axis, directions) in enumerate(zip(*beams, strict=True)):
        to_side, (dx, dy) = starts - axis, directions.T[..., None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = dx * along[:, 1] - dy * along[:, 0]
            distances = (to_side[:, 0] * along[:, 1] - to_side[:, 1] * along[:, 0]) / turn
            shares = (to_side[:, 0] * dy - to_side[:, 1] * dx) / turn
            met = (-slack <= shares) & (shares <= 1.0 + slack) & (near_m <= distances) & (distances < far_m)
        ranges[i] = np.where(met, distances, np.inf).min(axis=1)
    return ranges


@pytest.mark.parametrize(("arena", "seed"), [("map1", 1), ("map2", 2)])
@pytest.mark.parametrize(("near_m", "far_m"), [(0.12, 3.5), (0.0, 0.12), (0.5, 8.0)])
def test_beams_meet_the_nearest_side(arena: str, seed: int, near_m: float, far_m: float) -> None:
    layout = place(load_arena(arena), seed, 1)
    sides, beams = surfaces(layout), fans(np.random.default_rng(seed), layout, 100)
    with BulletWorld(layout) as world:
        ranges = world.cast(beams, near_m, far_m)
    longer, shorter = (nearest_side_m(sides, beams, near_m, far_m, by_m) for by_m in (BESIDE_M, -BESIDE_M))
    clear = longer == shorter
    assert clear.mean() > 0.99
    assert np.isfinite(ranges[clear]).any()
    assert not len(differing(ranges[clear], longer[clear], SAME_M))


def test_floor_robots_and_obstacles_are_not_met() -> None:
    layout = scene([(0.5 * i, 0.0, 0.0) for i in range(-3, 4)], [(0.0, 0.6, 0.0), (0.0, -0.6, 0.0)])
    person = Solid("cylinder", Pose2D(-0.2, 0.3, 0.0), 0.3, 0.3, 1.7)
    beams = fans(np.random.default_rng(1), layout, 7)
    beams = beams._replace(axes=np.array([(x, y) for x, y, _ in layout.robots]))
    with BulletWorld(layout) as world:
        before = world.cast(beams, 0.0, 3.5)
        world.engine.obstruct([person])
        for robot in range(9):
            world.drive(robot, Command(0.2, 0.5))
        run(world, 1.0)
        assert np.array_equal(world.cast(beams, 0.0, 3.5), before)
    sides = nearest_side_m(surfaces(layout), beams, 0.0, 3.5, 0.0)
    assert math.isinf(before.max())
    assert not len(differing(before, sides, SAME_M))
