"""What beams meet, against a caster of our own, and the noise on top."""

import math

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.elementary import standard_normals
from midnet_bench.geometry import Command, Pose2D, Solid
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import LDS_01
from midnet_bench.simulation import sensors as lidar
from midnet_bench.simulation.bullet_engine import BATCH
from midnet_bench.simulation.sensors import NOTHING, SOLID, TOO_NEAR_M, NoiseBlocks
from tests.simulation.scenes import BulletWorld, FastWorld, beam_lengths, run, scene, sensors

ANY = NoiseBlocks([stream(1, "unused")] * 10, LDS_01.beams)
LIMITS_M = (LDS_01.range_min_m, LDS_01.range_max_m)


def discs_seen(poses, by: int, radius: float = 0.055, offset: float = -0.017):
    return [
        (x + offset * math.cos(yaw), y + offset * math.sin(yaw), radius)
        for index, (x, y, yaw) in enumerate(poses)
        if index != by
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("map1", 1), ("map2", 2)])
def test_ranges_are_those_of_walls_and_discs(name: str, seed: int) -> None:
    """To 3 mm, but for the few beams that pass within 2 mm of a corner or graze a 64-sided cylinder."""
    layout = place(load_arena(name), seed, 5, 5)
    with BulletWorld(layout) as world:
        rng = stream(seed, "test")
        for index in range(10):
            world.drive(index, Command(rng.uniform(0.0, 0.22), rng.uniform(-1.0, 1.0)))
        run(world, 4.0)
        ranges = sensors(world).scan(range(10), ANY)
        poses = world.poses()
    expected = np.array([beam_lengths(poses[i], layout, discs_seen(poses, by=i)) for i in range(len(poses))])
    both = np.isfinite(ranges) & np.isfinite(expected)
    errors = np.abs(ranges[both] - expected[both])
    assert both.sum() > 1000
    assert np.count_nonzero(np.isfinite(ranges) != np.isfinite(expected)) <= 4
    assert np.count_nonzero(errors > 0.003) <= 0.002 * errors.size
    assert np.median(errors) < 1e-6


@pytest.mark.parametrize(("profile", "radius", "offset"), [("urdf", 0.055, -0.017), ("disc", 0.105, 0.0)])
def test_a_burger_shows_others_its_lds_or_all_of_itself(profile: str, radius: float, offset: float) -> None:
    layout = scene([(0.0, 0.0, 0.0)], [(0.8, 0.3, 2.0)])
    with BulletWorld(layout) as world:
        lidars = sensors(world, profile)
        ranges, bodies = lidars.scan([0], ANY), lidars.newest.bodies
        axis = Pose2D(*world.poses()[0]).compose(LDS_01.mount)
        ((x, y, _),) = discs_seen(world.poses(), by=0, radius=radius, offset=offset)
        met = np.flatnonzero(bodies[0] == 1)
        angles = axis.yaw + np.radians(met)
        points = np.column_stack(
            (axis.x + ranges[0, met] * np.cos(angles), axis.y + ranges[0, met] * np.sin(angles))
        )
        np.testing.assert_allclose(np.hypot(*(points - (x, y)).T), radius, atol=1e-9)
        width = 2.0 * math.degrees(math.asin(radius / math.hypot(x - axis.x, y - axis.y)))
        assert abs(len(met) - width) <= 1.0
        box = lidars.outline(1)
        np.testing.assert_allclose(box, (x - radius, y - radius, x + radius, y + radius))


def test_bodies_tell_robots_from_what_stands() -> None:
    block = Solid("box", Pose2D(-1.0, 0.0, 0.0), 0.5, 0.5, 0.5)
    with BulletWorld(
        scene([(0.0, 0.0, 0.0)], [(0.0, 1.0, 0.0)], stationary=[block], arena=load_arena("map2"))
    ) as world:
        lidars = sensors(world)
        ranges, bodies = lidars.scan([0, 1], ANY), lidars.newest.bodies
    assert bodies[0, 90] == 1
    assert bodies[1, 270] == 0
    assert bodies[0, 180] == SOLID
    assert ranges[0, 180] == pytest.approx(0.718, abs=0.002)
    assert np.array_equal(bodies == NOTHING, np.isinf(ranges))
    assert NOTHING in bodies


def test_the_nearer_of_two_robots_hides_the_other() -> None:
    with BulletWorld(scene([(0.0, 0.0, 0.0), (0.7, 0.0, 0.0)], [(1.5, 0.0, 0.0)])) as world:
        bodies = sensors(world).true_scan(np.array([0])).bodies
    assert 2 not in bodies
    assert np.count_nonzero(bodies == 1) == 9


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2])
def test_a_wall_at_the_bumper_is_too_near_and_nothing_is_seen_through_it(yaw: float) -> None:
    start = (2.8 * math.cos(yaw), 2.8 * math.sin(yaw), yaw)
    with BulletWorld(scene([start])) as world:
        world.drive(0, Command(0.1, 0.0))
        run(world, 4.0)
        ranges = sensors(world).scan([0], ANY)[0]
        expected = beam_lengths(world.poses()[0], world.layout, [])
    assert np.count_nonzero(ranges == TOO_NEAR_M) > 60
    assert np.array_equal(ranges == TOO_NEAR_M, expected == 0.0)
    np.testing.assert_allclose(ranges, expected, atol=1e-4)


def test_a_robot_at_the_bumper_is_too_near() -> None:
    with BulletWorld(scene([(0.0, 0.0, 0.0)], [(0.08, 0.0, math.pi)])) as world:
        lidars = sensors(world)
        ranges, bodies = lidars.scan([0], ANY), lidars.newest.bodies
    assert ranges[0, 0] == TOO_NEAR_M
    assert bodies[0, 0] == 1
    assert ranges[0, 180] > 2.5


def test_a_scan_does_not_depend_on_who_scans_with_it() -> None:
    layout = place(load_arena("map1"), 2, 5)
    with BulletWorld(layout) as world:
        lidars = sensors(world, noise="gazebo")

        def noise() -> NoiseBlocks:
            return lidars.noise([stream(1, "noise", i) for i in range(10)])

        together = lidars.scan(range(10), noise())
        alone = [lidars.scan([i], noise())[0] for i in range(10)]
        reversed_order = lidars.scan([9, 4], noise())
    assert np.array_equal(together, alone)
    assert np.array_equal(reversed_order, together[[9, 4]])


def test_more_rays_than_one_batch_holds_are_split() -> None:
    with BulletWorld(scene([(0.0, 0.0, 0.0)])) as world:
        one = sensors(world).scan([0], ANY)
        many = sensors(world).scan([0] * 50, ANY)
    assert BATCH < 50 * 360
    assert np.array_equal(many, np.repeat(one, 50, axis=0))
    with BulletWorld(scene([(0.0, 0.0, 0.0)])) as world:
        assert sensors(world).scan([], ANY).shape == (0, 360)


def noisy_scans(noise: str, scans: int = 300) -> tuple[np.ndarray, np.ndarray]:
    layout = place(load_arena("map2"), 3, 1, 0)
    with FastWorld(layout) as world:
        truth = sensors(world).scan([0], ANY)[0]
        lidars = sensors(world, noise=noise)
        blocks = lidars.noise([stream(3, "lidar", 0)])
        return truth, np.array([lidars.scan([0], blocks)[0] for _ in range(scans)])


def reported(ranges: np.ndarray, noise: str) -> np.ndarray:
    normals = standard_normals(stream(1, "a"), ranges.shape)
    return lidar.reported(ranges, normals, np.ones(1), lidar.ERRORS[noise][:3], LIMITS_M)


def test_blocks_of_noise_hold_what_would_be_drawn_reading_by_reading() -> None:
    """Sensors in any order, also one twice in a call, and past the end of a block."""
    blocks = NoiseBlocks([stream(1, "noise", i) for i in range(3)], 5)
    alone = [stream(1, "noise", i) for i in range(3)]
    for rows in [[0, 1, 2], [2], [1, 1, 0], [], *[[2, 0]] * (2 * NoiseBlocks.READINGS)]:
        expected = np.array([standard_normals(alone[row], (5,)) for row in rows]).reshape(-1, 5)
        np.testing.assert_array_equal(blocks.draw(np.array(rows, dtype=np.int64)), expected)


def test_what_is_reported_is_what_arrays_give() -> None:
    """The same in NumPy, to the last bit: far and near ranges, nothing met, too near, beyond the limits."""
    rng = np.random.default_rng(1)
    ranges = np.concatenate(([np.inf, 0.0, 0.119, 0.12, 3.5], rng.uniform(0.05, 3.5, 355)))[None]
    ranges = np.concatenate((ranges, rng.permuted(ranges)))
    scales, normals = np.array([0.97, 1.04]), rng.normal(size=ranges.shape)
    for sigma_m, share, near_m, _ in lidar.ERRORS.values():
        scaled = np.where(np.isinf(ranges), 0.0, ranges) * scales[:, None]
        noisy = np.clip(scaled + np.where(scaled < near_m, sigma_m, share * scaled) * normals, *LIMITS_M)
        expected = np.where(ranges < LIMITS_M[0], TOO_NEAR_M, np.where(np.isinf(ranges), np.inf, noisy))
        given = lidar.reported(ranges, normals, scales, (sigma_m, share, near_m), LIMITS_M)
        np.testing.assert_array_equal(given, expected)


def test_noise_is_drawn_scan_by_scan() -> None:
    truth, scans = noisy_scans("gazebo", 2)
    rng = stream(3, "lidar", 0)
    for scan in scans:
        expected = np.clip(truth + 0.010 * standard_normals(rng, (360,)), *LIMITS_M)
        expected[np.isinf(truth)] = np.inf
        np.testing.assert_array_equal(scan, expected)


def test_gazebo_noise_is_normal_with_one_centimetre_at_every_range() -> None:
    truth, scans = noisy_scans("gazebo")
    seen = (truth > 0.2) & (truth < 3.4)
    errors = scans[:, seen] - truth[seen]
    assert abs(errors.mean()) < 4 * 0.01 / math.sqrt(errors.size)
    np.testing.assert_allclose(errors.std(axis=0), 0.010, rtol=0.2)
    assert errors.std() == pytest.approx(0.010, rel=0.01)
    assert np.abs(np.corrcoef(errors[:, :20].T) - np.eye(20)).max() < 0.3, "beams are independent"
    assert np.isinf(scans[:, np.isinf(truth)]).all(), "what meets nothing stays without a return"
    assert scans[np.isfinite(scans)].max() <= 3.5


def test_datasheet_noise_grows_with_range_and_has_a_scale_of_its_own() -> None:
    truth, scans = noisy_scans("datasheet")
    seen = (truth > 0.6) & (truth < 3.2)
    scale = (scans[:, seen].mean(axis=0) / truth[seen]).mean()
    expected = lidar.draw_scale(stream(3, "lidar scale", "robot", 0))
    assert scale == pytest.approx(expected, abs=1e-3)
    assert 0.0 < abs(scale - 1.0) <= 0.05
    relative = scans[:, seen].std(axis=0) / (truth[seen] * scale)
    np.testing.assert_allclose(relative, 0.035 / 3.0, rtol=0.25)
    assert relative.mean() == pytest.approx(0.035 / 3.0, rel=0.02)


def test_sensors_scales_are_spread_as_the_maker_says() -> None:
    scales = np.array([lidar.draw_scale(stream(1, "scale", i)) for i in range(2000)])
    assert scales.std() == pytest.approx(0.05 / 3.0, rel=0.05)
    assert np.abs(scales - 1.0).max() <= 0.05 + 1e-9


def test_close_by_noise_is_a_third_of_a_centimetre_and_ranges_are_clamped() -> None:
    noisy = reported(np.full((1, 20000), 0.3), "datasheet")
    assert noisy.std() == pytest.approx(0.010 / 3.0, rel=0.03)
    noisy = reported(np.array([[0.1201] * 500 + [3.499] * 500]), "gazebo")
    assert (noisy.min(), noisy.max()) == (0.12, 3.5)
