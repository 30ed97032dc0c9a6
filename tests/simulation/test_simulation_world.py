"""Burgers in PyBullet: how they drive, stop, bump and leave."""

import hashlib
import math
import subprocess
import sys

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.messages import STOP, Command
from midnet_bench.rng import stream
from midnet_bench.simulation.bullet.world import World
from tests.simulation.scenes import run, scene, sensors

BASE_FRONT_M = 0.038
WALL_FACE_M = 2.925


def test_a_burger_drives_straight_at_the_speed_asked_for() -> None:
    with World(scene([(-2.0, 0.0, 0.0)])) as world:
        world.drive(0, Command(0.2, 0.0))
        run(world, 1.0)
        before = world.poses()[0]
        run(world, 5.0)
        after = world.poses()[0]
    assert after[0] - before[0] == pytest.approx(1.0, rel=0.01)
    assert abs(after[1] - before[1]) < 0.002
    assert abs(after[2]) < 0.002


@pytest.mark.parametrize(
    ("linear", "angular"), [(0.0, 0.5), (0.0, 2.84), (0.2, 0.5), (0.1, -2.5), (-0.1, 1.0)]
)
def test_a_burger_turns_at_the_rate_asked_for(linear: float, angular: float) -> None:
    with World(scene([(0.0, 0.0, 0.3)])) as world:
        world.drive(0, Command(linear, angular))
        run(world, 1.0)
        yaws, velocities, xy = [world.poses()[0, 2]], [], [world.poses()[0, :2]]
        for _ in range(300):
            world.step()
            yaws.append(world.poses()[0, 2])
            xy.append(world.poses()[0, :2])
            velocities.append(world.odometry(0)[1:])
    assert np.diff(np.unwrap(yaws)).sum() == pytest.approx(angular * 5.0, rel=0.02)
    assert np.hypot(*np.diff(xy, axis=0).T).sum() == pytest.approx(abs(linear) * 5.0, rel=0.02, abs=0.01)
    np.testing.assert_allclose(np.mean(velocities, axis=0), (linear, angular), rtol=0.02, atol=2e-3)


def test_commands_are_clamped_and_ramped() -> None:
    with World(scene([(-2.0, 0.0, 0.0)])) as world:
        world.drive(0, Command(5.0, 0.0))
        speeds = []
        for _ in range(60):
            world.step()
            speeds.append(world.odometry(0)[1])
        gains = np.diff([0.0, *speeds]) * 60.0
        assert max(speeds) == pytest.approx(0.22, rel=0.01)
        assert gains.max() < 1.1, "1 m/s2, as the Gazebo plugin ramps"
        assert speeds[11] < 0.205 < speeds[16]
        world.drive(0, Command(0.0, -9.0))
        run(world, 1.0)
        assert world.odometry(0)[2] == pytest.approx(-2.84, rel=0.01)
        world.drive(0, STOP)
        run(world, 1.0)
        np.testing.assert_allclose(world.odometry(0)[1:], 0.0, atol=1e-3)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, 0.6])
def test_a_burger_stops_at_a_wall(yaw: float) -> None:
    with World(scene([(2.0 * math.cos(yaw), 2.0 * math.sin(yaw), yaw)])) as world:
        world.drive(0, Command(0.22, 0.0))
        run(world, 15.0)
        x, y, heading = world.poses()[0]
        corners = [(BASE_FRONT_M, 0.07), (BASE_FRONT_M, -0.07), (-0.102, 0.07), (-0.102, -0.07)]
        c, s = math.cos(heading), math.sin(heading)
        reach = max(max(abs(x + c * a - s * b), abs(y + s * a + c * b)) for a, b in corners)
        assert WALL_FACE_M - 0.005 < reach < WALL_FACE_M + 0.005
        assert world.collisions().tolist() == [1]


def test_two_burgers_head_on_stop_each_other_and_both_count_it() -> None:
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
def test_a_burger_is_as_wide_as_its_wheels(gap: float, passes: bool) -> None:
    """Its base is 0.14 m wide, but over its wheels it measures 0.178 m."""
    arena = load_arena("empty")
    end = (gap + arena.wall_thickness_m) / 2.0
    gate = (((0.5, end), (0.5, 2.0)), ((0.5, -2.0), (0.5, -end)))
    with World(scene([(0.0, 0.0, 0.0)], arena=arena.model_copy(update={"walls": gate}))) as world:
        world.drive(0, Command(0.2, 0.0))
        run(world, 6.0)
        assert bool(world.poses()[0, 0] > 1.0) is passes


def drive_about(world: World, seconds: float) -> str:
    """A digest of everything that a world says while its robots drive about."""
    digest = hashlib.sha256()
    for _ in moving(world, seconds, digest):
        pass
    return digest.hexdigest()


def moving(world: World, seconds: float, digest):
    count = len(world.active)
    rngs = [stream(world.layout.seed, "test lidar", i) for i in range(count)]
    steer = stream(world.layout.seed, "test steering")
    lidars = sensors(world, noise="gazebo")
    for tick in range(round(seconds * 60)):
        if tick % 30 == 0:
            for index in np.flatnonzero(world.active):
                world.drive(int(index), Command(steer.uniform(0.0, 0.22), steer.uniform(-2.0, 2.0)))
        world.step()
        if tick % 12 == 0:
            present = np.flatnonzero(world.active).tolist()
            digest.update(lidars.scan(present, [rngs[i] for i in present]).tobytes())
        present = np.flatnonzero(world.active).tolist()
        moves = [(*world.odometry(i)[1:], *world.wheel_angles(i)) for i in present]
        digest.update(world.poses().tobytes() + np.array(moves).tobytes())
        yield


def digest_of(seed: int) -> str:
    with World(place(load_arena("map1"), seed, 3, 3)) as world:
        return drive_about(world, 5.0)


def test_a_seed_gives_the_same_bytes_again_and_another_seed_others() -> None:
    first = digest_of(1)
    assert digest_of(2) != first
    assert digest_of(1) == first, "after another world in the same process"


@pytest.mark.slow
def test_worlds_stepped_in_turns_do_not_touch_each_other() -> None:
    alone = [digest_of(1), digest_of(2)]
    digests = [hashlib.sha256(), hashlib.sha256()]
    with (
        World(place(load_arena("map1"), 1, 3, 3)) as one,
        World(place(load_arena("map1"), 2, 3, 3)) as two,
    ):
        for _ in zip(moving(one, 5.0, digests[0]), moving(two, 5.0, digests[1]), strict=True):
            pass
    assert [digest.hexdigest() for digest in digests] == alone


@pytest.mark.slow
def test_another_process_gives_the_same_bytes() -> None:
    here = digest_of(3)
    code = "import sys; sys.path.insert(0, sys.argv[1]); import test_simulation_world as t; "
    code += "print(t.digest_of(3))"
    folder = __file__.rpartition("/")[0]
    there = subprocess.run(
        [sys.executable, "-c", code, folder], capture_output=True, text=True, check=True, timeout=60
    )
    assert there.stdout.strip() == here
    assert there.stderr == "", "the physics library's greeting is kept off the terminal"


def test_a_caught_intruder_leaves_and_the_rest_goes_on_the_same_way_each_time() -> None:
    digests = []
    for _ in range(2):
        digest = hashlib.sha256()
        with World(place(load_arena("map1"), 4, 2, 3)) as world:
            for tick, _ in enumerate(moving(world, 6.0, digest)):
                if tick == 180:
                    world.remove(3)
            assert world.active.tolist() == [True, True, True, False, True]
            assert np.isnan(world.poses()[3]).all()
            assert np.isfinite(world.poses()[[0, 1, 2, 4]]).all()
            with pytest.raises(ValueError, match="robot 3 is not in this world"):
                world.drive(3, STOP)
            with pytest.raises(ValueError, match="robot 3 is not in this world"):
                world.odometry(3)[1:]
            with pytest.raises(ValueError, match="robot 3 is not in this world"):
                sensors(world).scan([0, 3], [stream(1, "a"), stream(1, "b")])
        digests.append(digest.hexdigest())
    assert digests[0] == digests[1]


def test_a_removed_robot_is_neither_seen_nor_bumped_into() -> None:
    with World(scene([(0.0, 0.0, 0.0)], [(0.6, 0.0, 0.0)])) as world:
        lidars = sensors(world)
        assert lidars.scan([0], [stream(1, "a")])[0, 0] < 1.0
        world.remove(1)
        assert lidars.scan([0], [stream(1, "a")])[0, 0] == pytest.approx(WALL_FACE_M + 0.032, abs=0.003)
        world.drive(0, Command(0.22, 0.0))
        run(world, 6.0)
        assert world.poses()[0, 0] > 1.2
        assert world.collisions()[0] == 0


def test_robots_stand_still_where_they_were_put_until_told_otherwise() -> None:
    layout = place(load_arena("map1"), 5, 5)
    with World(layout) as world:
        run(world, 10.0)
        starts = np.array([tuple(pose) for pose in layout.robots + layout.intruders])
        np.testing.assert_allclose(world.poses()[:, :2], starts[:, :2], atol=1e-3)
        np.testing.assert_allclose(np.sin(world.poses()[:, 2] - starts[:, 2]), 0.0, atol=1e-3)
        assert world.collisions().sum() == 0
        assert world.tick == 600


def test_truth_comes_read_only_and_fresh() -> None:
    with World(scene([(0.0, 0.0, 0.0)])) as world:
        poses = world.poses()
        assert world.poses() is poses
        with pytest.raises(ValueError, match="read-only"):
            poses[0, 0] = 1.0
        world.drive(0, Command(0.2, 0.0))
        run(world, 1.0)
        assert poses[0, 0] == pytest.approx(0.0, abs=1e-3)
        assert world.poses()[0, 0] > 0.1


def test_the_outline_is_the_disc_in_the_scan_plane() -> None:
    yaw = 1.0
    with World(scene([(0.5, -0.5, yaw)])) as world:
        box = sensors(world).outline(0)
        assert box.center == pytest.approx(
            (0.5 - 0.017 * math.cos(yaw), -0.5 - 0.017 * math.sin(yaw)), abs=1e-3
        )
        assert box.x_max - box.x_min == pytest.approx(0.11)


def test_closing_twice_does_no_harm() -> None:
    world = World(scene([(0.0, 0.0, 0.0)]))
    world.close()
    world.close()
