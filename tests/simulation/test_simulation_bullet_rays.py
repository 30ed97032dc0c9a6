"""Which piece of a beam PyBullet is asked about, held to its answers about whole beams."""

import math

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.arena.solids import Solid
from midnet_bench.geometry import Pose2D
from midnet_bench.simulation.bullet.world import World, pieces
from midnet_bench.simulation.integrity import surfaces
from midnet_bench.simulation.lidar import beam_directions
from midnet_bench.simulation.simulator import Beams
from tests.simulation.scenes import scene

ANGLES_RAD = np.radians(np.arange(360))
HEIGHT_M = 0.182


def beams_at(poses: np.ndarray) -> Beams:
    return Beams(*beam_directions(poses, 0.0, np.cos(ANGLES_RAD), np.sin(ANGLES_RAD)))


def whole_beams(world: World, beams: Beams, near_m: float, far_m: float) -> np.ndarray:
    starts, ends = (
        np.concatenate(
            [
                beams.axes[:, None] + reach_m * beams.directions,
                np.full((*beams.directions.shape[:2], 1), HEIGHT_M),
            ],
            axis=2,
        ).reshape(-1, 3)
        for reach_m in (near_m, far_m)
    )
    met = world._rays.fractions(starts, ends)
    return np.where(met < 1.0, near_m + met * (far_m - near_m), np.inf).reshape(beams.directions.shape[:2])


def assert_same(pieces: np.ndarray, whole: np.ndarray) -> None:
    assert np.array_equal(np.isinf(pieces), np.isinf(whole))
    met = np.isfinite(whole)
    np.testing.assert_allclose(pieces[met], whole[met], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("arena", "seed"), [("map1", 1), ("map2", 2)])
@pytest.mark.parametrize(("near_m", "far_m"), [(0.12, 3.5), (0.0, 0.12), (0.5, 8.0)])
def test_a_piece_of_a_beam_meets_what_the_whole_beam_meets(
    arena: str, seed: int, near_m: float, far_m: float
) -> None:
    layout = place(load_arena(arena), seed, 1)
    rng = np.random.default_rng(seed)
    half_x, half_y = (side / 2.0 for side in layout.arena.enclosure_m)
    # also behind and inside of walls, on the lines along their faces, and exactly between two sectors
    poses = rng.uniform((-half_x, -half_y, -4.0), (half_x, half_y, 4.0), size=(300, 3))
    poses[::3] = np.round(poses[::3] / 0.025) * 0.025
    poses[::6, 2] = 0.0
    with World(layout) as world:
        beams = beams_at(poses)
        assert_same(world.cast(beams, near_m, far_m), whole_beams(world, beams, near_m, far_m))


def test_a_wall_seen_end_on_is_met_at_its_end() -> None:
    wall = Solid("box", Pose2D(1.5, 0.0, 0.0), 1.0, 0.1, 0.5)
    poses = np.array(
        [(x, y, yaw) for x in (0.0, 0.9) for y in (0.05, -0.05, 0.0) for yaw in (0.0, 1e-9, -1e-9)]
    )
    with World(scene([(0.0, 1.0, 0.0)], stationary=[wall])) as world:
        beams = beams_at(poses)
        ranges = world.cast(beams, 0.0, 3.5)
        assert_same(ranges, whole_beams(world, beams, 0.0, 3.5))
    assert ranges[-3:, 0] == pytest.approx(0.1, abs=1e-3)


def test_few_beams_are_cast_far() -> None:
    layout = place(load_arena("map2"), 1, 1)
    poses = np.array([(pose.x, pose.y, pose.yaw) for pose in layout.robots + layout.intruders])
    _, _, spans, places = pieces(*beams_at(poses), surfaces(layout), 0.12, 3.5, HEIGHT_M)
    assert len(places) < 0.9 * len(poses) * 360
    assert (spans[:, 1] - spans[:, 0]).mean() < 0.5
    assert math.isclose(spans[:, 1].max(), 3.5)
