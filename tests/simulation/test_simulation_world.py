"""Burgers in each engine: how they drive, stop, bump and leave."""

import hashlib
import math

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.geometry import STOP, Command
from midnet_bench.rng import stream
from midnet_bench.simulation import world as worlds
from tests.simulation.scenes import ENGINES, WORLDS, run, scene, sensors

BASE_FRONT_M = 0.038
WALL_FACE_M = 2.925


@pytest.fixture(params=ENGINES)
def engine(request) -> str:
    return request.param


@pytest.fixture
def World(engine: str) -> type:
    return WORLDS[engine]


@pytest.mark.parametrize(
    ("linear", "angular"), [(0.2, 0.0), (0.0, 0.5), (0.0, 2.84), (0.2, 0.5), (0.1, -2.5), (-0.1, 1.0)]
)
def test_a_burger_drives_and_turns_at_the_speed_asked_for(World: type, linear: float, angular: float) -> None:
    with World(scene([(0.0, 0.0, 0.3)])) as world:
        world.drive(0, Command(linear, angular))
        run(world, 1.0)
        yaws, velocities, xy = [world.poses()[0, 2]], [], [world.poses()[0, :2]]
        for _ in range(5 * world.step_hz):
            world.step()
            yaws.append(world.poses()[0, 2])
            xy.append(world.poses()[0, :2])
            velocities.append(world.velocities()[0])
    assert np.diff(np.unwrap(yaws)).sum() == pytest.approx(angular * 5.0, rel=0.02, abs=0.002)
    assert np.hypot(*np.diff(xy, axis=0).T).sum() == pytest.approx(abs(linear) * 5.0, rel=0.02, abs=0.01)
    np.testing.assert_allclose(np.mean(velocities, axis=0), (linear, angular), rtol=0.02, atol=2e-3)


def test_commands_are_clamped_and_ramped(World: type) -> None:
    with World(scene([(-2.0, 0.0, 0.0)])) as world:
        world.drive(0, Command(5.0, 0.0))
        speeds = []
        for _ in range(world.step_hz):
            world.step()
            speeds.append(world.velocities()[0, 0])
        gains = np.diff([0.0, *speeds]) * world.step_hz
        assert max(speeds) == pytest.approx(0.22, rel=0.01)
        assert gains.max() < 1.1, "1 m/s2, as the Gazebo plugin ramps"
        assert speeds[world.step_hz // 5 - 1] < 0.205 < speeds[world.step_hz // 3 - 1]
        world.drive(0, Command(0.0, -9.0))
        run(world, 1.0)
        assert world.velocities()[0, 1] == pytest.approx(-2.84, rel=0.01)
        world.drive(0, STOP)
        run(world, 1.0)
        np.testing.assert_allclose(world.velocities()[0], 0.0, atol=1e-3)


def reach_m(world: worlds.World) -> float:
    """How far the corners of the first robot's base are from the middle of the room, along an axis."""
    corners = np.array([(BASE_FRONT_M, 0.07), (BASE_FRONT_M, -0.07), (-0.102, 0.07), (-0.102, -0.07)])
    return float(np.abs(world.pose(0).transform(corners)).max())


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, 0.6])
def test_a_burger_stops_at_a_wall(World: type, yaw: float) -> None:
    with World(scene([(2.0 * math.cos(yaw), 2.0 * math.sin(yaw), yaw)])) as world:
        world.drive(0, Command(0.22, 0.0))
        run(world, 7.0)
        assert reach_m(world) == pytest.approx(WALL_FACE_M, abs=0.005)
        assert world.collisions().tolist() == [1]


def test_two_burgers_head_on_stop_each_other_and_both_count_it(World: type) -> None:
    with World(scene([(-0.4, 0.0, 0.0)], [(0.4, 0.0, math.pi)])) as world:
        world.drive(0, Command(0.2, 0.0))
        world.drive(1, Command(0.2, 0.0))
        run(world, 6.0)
        first, second = world.poses()
        assert math.dist(first[:2], second[:2]) > 2 * BASE_FRONT_M - 0.008
        assert world.collisions().tolist() == [1, 1]
        # Backing off for longer than a second and coming again is another collision.
        world.drive(0, Command(-0.2, 0.0))
        world.drive(1, STOP)
        run(world, 2.0)
        world.drive(0, Command(0.2, 0.0))
        run(world, 4.0)
        assert world.collisions()[0] == 2


@pytest.mark.parametrize(("gap", "passes"), [(0.20, True), (0.16, False)])
def test_a_burger_is_as_wide_as_its_wheels(World: type, gap: float, passes: bool) -> None:
    """Its base is 0.14 m wide, but over its wheels it measures 0.178 m."""
    arena = load_arena("empty")
    end = (gap + arena.wall_thickness_m) / 2.0
    gate = (((0.5, end), (0.5, 2.0)), ((0.5, -2.0), (0.5, -end)))
    with World(scene([(0.0, 0.0, 0.0)], arena=arena.model_copy(update={"walls": gate}))) as world:
        world.drive(0, Command(0.2, 0.0))
        run(world, 6.0)
        assert bool(world.poses()[0, 0] > 1.0) is passes


def moving(world: worlds.World, seconds: float, digest):
    count = len(world.active)
    steer = stream(world.layout.seed, "test steering")
    lidars = sensors(world, noise="gazebo")
    noise = lidars.noise([stream(world.layout.seed, "test lidar", i) for i in range(count)])
    for tick in range(round(seconds * world.step_hz)):
        if tick % (world.step_hz // 2) == 0:
            for index in np.flatnonzero(world.active):
                world.drive(int(index), Command(steer.uniform(0.0, 0.22), steer.uniform(-2.0, 2.0)))
        world.step()
        if tick % (world.step_hz // 5) == 0:
            present = np.flatnonzero(world.active).tolist()
            digest.update(lidars.scan(present, noise).tobytes())
        present = np.flatnonzero(world.active).tolist()
        moves = np.hstack((world.velocities(), world.wheel_angles()))[present]
        digest.update(world.poses().tobytes() + moves.tobytes())
        yield


def digest_of(engine: str, seed: int) -> str:
    """Of everything that a world says while its robots drive about."""
    digest = hashlib.sha256()
    with WORLDS[engine](place(load_arena("map1"), seed, 3, 3)) as world:
        for _ in moving(world, 2.0, digest):
            pass
    return digest.hexdigest()


def test_worlds_stepped_in_turns_say_what_each_says_alone_and_another_seed_gives_others(
    engine: str, World: type
) -> None:
    alone = [digest_of(engine, 1), digest_of(engine, 2)]
    digests = [hashlib.sha256(), hashlib.sha256()]
    with World(place(load_arena("map1"), 1, 3, 3)) as one, World(place(load_arena("map1"), 2, 3, 3)) as two:
        for _ in zip(moving(one, 2.0, digests[0]), moving(two, 2.0, digests[1]), strict=True):
            pass
    assert [digest.hexdigest() for digest in digests] == alone
    assert alone[0] != alone[1]


def test_a_caught_intruder_leaves_and_the_rest_goes_on_the_same_way_each_time(World: type) -> None:
    digests = []
    for _ in range(2):
        digest = hashlib.sha256()
        with World(place(load_arena("map1"), 4, 2, 3)) as world:
            for tick, _ in enumerate(moving(world, 1.5, digest)):
                if tick == world.step_hz:
                    world.remove(3)
            assert world.active.tolist() == [True, True, True, False, True]
            assert np.isnan(world.poses()[3]).all()
            assert np.isfinite(world.poses()[[0, 1, 2, 4]]).all()
            with pytest.raises(ValueError, match="robot 3 is not in this world"):
                world.drive(3, STOP)
            assert np.isnan(world.velocities()[3]).all()
            assert np.isnan(world.wheel_angles()[3]).all()
            lidars = sensors(world)
            with pytest.raises(ValueError, match="robot 3 is not in this world"):
                lidars.scan([0, 3], lidars.noise([stream(1, "a")] * 5))
        digests.append(digest.hexdigest())
    assert digests[0] == digests[1]


def test_a_removed_robot_is_neither_seen_nor_bumped_into(World: type) -> None:
    with World(scene([(0.0, 0.0, 0.0)], [(0.6, 0.0, 0.0)])) as world:
        lidars = sensors(world)
        noise = lidars.noise([stream(1, "a")] * 2)
        assert lidars.scan([0], noise)[0, 0] < 1.0
        world.remove(1)
        assert lidars.scan([0], noise)[0, 0] == pytest.approx(WALL_FACE_M + 0.032, abs=0.003)
        world.drive(0, Command(0.22, 0.0))
        run(world, 6.0)
        assert world.poses()[0, 0] > 1.2
        assert world.collisions()[0] == 0


def test_robots_stand_still_where_they_were_put_until_told_otherwise(World: type) -> None:
    layout = place(load_arena("map1"), 5, 5)
    with World(layout) as world:
        run(world, 3.0)
        starts = np.array([tuple(pose) for pose in layout.robots + layout.intruders])
        np.testing.assert_allclose(world.poses()[:, :2], starts[:, :2], atol=1e-3)
        np.testing.assert_allclose(np.sin(world.poses()[:, 2] - starts[:, 2]), 0.0, atol=1e-3)
        assert world.collisions().sum() == 0
        assert world.tick == 3 * world.step_hz


def test_truth_comes_read_only_and_fresh(World: type) -> None:
    with World(scene([(0.0, 0.0, 0.0)])) as world:
        poses = world.poses()
        assert world.poses() is poses
        with pytest.raises(ValueError, match="read-only"):
            poses[0, 0] = 1.0
        world.drive(0, Command(0.2, 0.0))
        run(world, 1.0)
        assert poses[0, 0] == pytest.approx(0.0, abs=1e-3)
        assert world.poses()[0, 0] > 0.1
        world.close()  # and once more at the end, which does no harm


@pytest.mark.slow
def test_at_its_own_rate_a_burger_moves_as_precisely_as_the_docs_say() -> None:
    """Speed, turn rate and steadiness after braking and turning, and how far a body enters a wall."""
    straight, turning = [(0.22, 0.0), (0.0, 0.8), (0.22, 0.0), (-0.2, 0.0)], [(0.1, -1.5), (0.0, 2.7)]
    commands = [*straight, *turning, (0.22, 2.7), (0.1, 0.0)]
    with WORLDS["bullet"](scene([(-1.0, -1.0, 0.0)])) as world:
        assert world.step_hz == 30
        for linear, angular in commands:
            world.drive(0, Command(linear, angular))
            run(world, 1.0)
            moves, places = [], [world.poses()[0]]
            for _ in range(2 * world.step_hz):
                world.step()
                moves.append(world.velocities()[0])
                places.append(world.poses()[0])
            way = np.diff(np.array(places), axis=0)
            assert abs(np.hypot(way[:, 0], way[:, 1]).sum() / 2.0 - abs(linear)) < 0.0025
            assert abs(np.unwrap(np.array(places)[:, 2])[[0, -1]] @ (-0.5, 0.5) - angular) < 0.003
            assert np.std(moves, axis=0) == pytest.approx((0.0, 0.0), abs=0.003), "it does not rock"


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_a_burger_enters_a_wall_by_little_as_it_hits_it(yaw: float) -> None:
    with WORLDS["bullet"](scene([(2.3 * math.cos(yaw), 2.3 * math.sin(yaw), yaw)])) as world:
        world.drive(0, Command(0.22, 0.0))
        reaches = []
        for _ in range(8 * world.step_hz):
            world.step()
            reaches.append(reach_m(world) - WALL_FACE_M)
    assert max(reaches) < 0.012, "a step of 7 mm, and the nose dips"
    assert max(reaches[-world.step_hz :]) < 0.005
