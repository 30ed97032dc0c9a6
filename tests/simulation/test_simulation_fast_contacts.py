"""Bodies of the engine ``fast``: closed forms, nothing gets into anything, what is wedged comes free."""

import math
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import Layout, place
from midnet_bench.geometry import Command, Pose2D, Solid
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.fast.contacts import hull_of
from midnet_bench.simulation.fast.outlines import outlines_of, side_grid
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import WorldSettings
from tests.simulation.overlap import deepest_m
from tests.simulation.scenes import ENGINES, NEEDS_MUJOCO, WORLDS, FastWorld, run, scene, small_arena


def charge(
    layout: Layout, seed: int, seconds: float, step_hz: int = 30, engine: str = "fast"
) -> tuple[World, float]:
    """A world whose robots drove about blindly, and the deepest that one stood in anything."""
    rng = np.random.default_rng(seed)
    deepest = 0.0
    world = WORLDS[engine](layout, WorldSettings(step_hz=step_hz))
    for tick in range(round(seconds * step_hz)):
        if tick % step_hz == 0:
            for index in range(len(world.active)):
                world.drive(index, Command(rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0)))
        world.step()
        if tick % 3 == 0:
            deepest = max(deepest, deepest_m(layout, world.poses()))
    return world, deepest


@pytest.mark.parametrize("step_hz", [30, 60, 240])
@pytest.mark.parametrize(
    ("linear", "angular"), [(0.22, 0.0), (-0.1, 0.0), (0.0, 2.84), (0.2, 0.5), (0.1, -2.5)]
)
def test_speeds_are_those_asked_for_and_paths_are_arcs(linear: float, angular: float, step_hz: int) -> None:
    """Closed form: a ramp of 1 m/s2 on each rim, then a circle; the midpoint rule errs by (w dt)^2 / 24."""
    seconds = 4.0
    with FastWorld(scene([(0.3, -0.2, 0.5)]), WorldSettings(engine="fast", step_hz=step_hz)) as world:
        world.drive(0, Command(linear, angular))
        run(world, 1.0)
        x, y, yaw = world.poses()[0]
        angles = world.wheel_angles()[0]
        run(world, seconds)
        after, turned = world.poses()[0], (world.wheel_angles()[0] - angles) * BURGER.wheel_radius_m
        velocity = world.velocities()[0]
    np.testing.assert_allclose(velocity, (linear, angular), rtol=0.0, atol=1e-12)
    half = angular * BURGER.wheel_separation_m / 2.0
    np.testing.assert_allclose(turned, np.array([linear - half, linear + half]) * seconds, atol=1e-9)
    end = yaw + angular * seconds
    assert math.remainder(after[2] - end, math.tau) == pytest.approx(0.0, abs=1e-9)
    if angular:
        radius = linear / angular
        expected = (
            x + radius * (math.sin(end) - math.sin(yaw)),
            y - radius * (math.cos(end) - math.cos(yaw)),
        )
        error = abs(radius) * 2.0 * (angular / step_hz) ** 2 / 24.0
    else:
        expected, error = (x + linear * seconds * math.cos(yaw), y + linear * seconds * math.sin(yaw)), 0.0
    np.testing.assert_allclose(after[:2], expected, rtol=0.0, atol=error + 1e-9)


def test_the_hull_has_the_contours_extremes_and_its_radius_of_gyration_is_the_descriptions() -> None:
    hull = hull_of(BURGER.body)
    assert {tuple(corner) for corner in hull[:, :2].tolist()} == {
        (x, side * y)
        for x, y in ((0.038, 0.07), (0.03, 0.089), (-0.03, 0.089), (-0.102, 0.07))
        for side in (1, -1)
    }
    mass, moment, inertia = 0.0, np.zeros(3), 0.0
    root = ElementTree.parse(BURGER.urdf).getroot()
    places = {
        joint.find("child").get("link"): numbers(joint.find("origin")) for joint in root.findall("joint")
    }
    for link in root.findall("link"):
        one = link.find("inertial")
        kilograms = float(one.find("mass").get("value"))
        place = places.get(link.get("name"), np.zeros(3)) + numbers(one.find("origin"))
        mass, moment = mass + kilograms, moment + kilograms * place
        inertia += float(one.find("inertia").get("izz")) + kilograms * (place[0] ** 2 + place[1] ** 2)
    about_the_middle = inertia - (moment[0] ** 2 + moment[1] ** 2) / mass
    assert math.sqrt(about_the_middle / mass) == pytest.approx(BURGER.gyration_radius_m, rel=0.01)


def numbers(origin) -> np.ndarray:
    return np.zeros(3) if origin is None else np.array(origin.get("xyz").split(), dtype=float)


TEAMS = st.tuples(
    st.sampled_from(["map1", "map2", "empty"]),
    st.integers(0, 10_000),
    st.integers(1, 5),
    st.integers(0, 5),
    st.sampled_from([30, 60]),
)
"""arena, seed, security robots, intruders, steps per second"""


def deepest_of(team: tuple[str, int, int, int, int], seconds: float) -> float:
    name, seed, robots, intruders, step_hz = team
    return charge(place(load_arena(name), seed, robots, intruders), seed, seconds, step_hz)[1]


def test_nobody_gets_a_millimetre_into_a_wall_or_another() -> None:
    assert deepest_of(("map1", 7, 5, 5, 30), seconds=8.0) < 1e-3


@pytest.mark.slow
@settings(max_examples=6, derandomize=True)
@given(TEAMS)
def test_nobody_in_any_team_gets_a_millimetre_into_a_wall_or_another(
    team: tuple[str, int, int, int, int],
) -> None:
    assert deepest_of(team, seconds=12.0) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("engine", "side_m", "rows", "seed", "most_m"),
    [
        ("fast", 1.0, 3, 2, 1e-3),
        ("fast", 0.8, 2, 1, 1e-3),
        pytest.param("mujoco", 1.0, 3, 2, 8e-3, marks=NEEDS_MUJOCO),
    ],
)
def test_not_even_in_a_jam_and_a_jam_keeps_moving(
    engine: str, side_m: float, rows: int, seed: int, most_m: float
) -> None:
    """Nine robots on a square metre. In PyBullet each comes about as far, and 8 to 19 mm into the others."""
    places = np.linspace(-side_m / 2.0 + 0.2, side_m / 2.0 - 0.2, rows)
    rng = np.random.default_rng(seed)
    starts = [(x, y, rng.uniform(-3.0, 3.0)) for x in places for y in places]
    layout = scene(starts, arena=small_arena(side_m))
    world, deepest = charge(layout, seed, 10.0, engine=engine)
    assert deepest < most_m
    moved = np.hypot(*(world.poses()[:, :2] - np.array(starts)[:, :2]).T)
    assert np.count_nonzero(moved > 0.02) >= 0.6 * len(starts)
    assert (world.collisions() > 0).all()
    assert np.abs(world.poses()[:, :2]).max() < side_m / 2.0


@pytest.mark.slow
@pytest.mark.parametrize("size_m", [(0.12, 0.12), (0.3, 0.1)])
def test_what_moves_by_itself_pushes_nobody_into_a_wall_or_another(size_m: tuple[float, float]) -> None:
    """It goes round at 0.7 m/s among six robots on 1.4 square metres, where not all can make room for it."""
    kind = "cylinder" if size_m[0] == size_m[1] else "box"
    starts = [(x, y, 3.0 * x + y) for x in (-0.4, 0.0, 0.4) for y in (-0.3, 0.3)]
    layout = scene(starts, arena=small_arena(1.2))
    rng, deepest, squeezed = np.random.default_rng(3), 0.0, 0.0
    with FastWorld(layout) as world:
        for tick in range(250):
            turn = tick / 15.0
            at = Pose2D(0.35 * math.cos(turn), 0.35 * math.sin(turn), turn)
            solid = Solid(kind, at, *size_m, 0.5)
            world.engine.obstruct([solid])
            if tick % 30 == 0:
                for index in range(len(starts)):
                    world.drive(index, Command(rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0)))
            world.step()
            if tick % 3:
                continue
            deepest = max(deepest, deepest_m(layout, world.poses()))
            bodies = [Pose2D(*pose).transform(np.array(BURGER.body)) for pose in world.poses().tolist()]
            squeezed = max(squeezed, *(-solid.distance_to(body).min() for body in bodies))
    assert deepest < 1e-3
    assert squeezed > 0.03


@pytest.mark.parametrize("kind", ["cylinder", "box"])
def test_a_slow_thing_moves_a_robot_out_of_its_way(kind: str) -> None:
    """The robot's front stays at its own; PyBullet has it up to 40 mm deeper inside."""
    ends = {}
    for engine in ("fast", "bullet"):
        with WORLDS[engine](scene([(0.0, 0.0, 0.0)])) as world:
            for tick in range(360):
                solid = Solid(kind, Pose2D(0.5 - 0.1 * tick / 30.0, 0.0, 0.0), 0.2, 0.2, 0.5)
                world.engine.obstruct([solid])
                world.step()
            ends[engine] = world.poses()[0]
    front = solid.pose.x - 0.1
    assert ends["fast"][0] + 0.038 == pytest.approx(front, abs=1e-3)
    assert ends["bullet"][0] == pytest.approx(ends["fast"][0], abs=0.05)
    assert ends["fast"][1:] == pytest.approx((0.0, 0.0), abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("offset_m", [0.0, 0.02])
def test_a_wedged_pair_comes_free(engine: str, offset_m: float) -> None:
    """Two that push each other in a dead end where none can turn, until both back off."""
    gate = (((-0.6, -0.2), (2.0, -0.2)), ((-0.6, 0.2), (2.0, 0.2)), ((2.0, -0.2), (2.0, 0.2)))
    arena = load_arena("empty").model_copy(update={"walls": gate})
    with WORLDS[engine](scene([(-0.2, 0.0, 0.0), (0.2, offset_m, math.pi)], arena=arena)) as world:
        distances = []
        for speed_mps, seconds in ((0.2, 8.0), (-0.2, 4.0)):
            for index in (0, 1):
                world.drive(index, Command(speed_mps, 0.0))
            run(world, seconds)
            (ax, ay, _), (bx, by, _) = world.poses()
            distances.append(math.hypot(bx - ax, by - ay))
    assert distances[0] < 0.085
    assert distances[1] > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [30, 45, 60, 80])
def test_whoever_meets_a_wall_askew_turns_and_slides_as_in_pybullet(degrees: float) -> None:
    """It ends square to the wall, within 15 mm of where PyBullet has it at 60 steps a second."""
    ends = {}
    for name in ("bullet", "fast", *(["mujoco"] if find_spec("mujoco") else [])):
        start = (2.3, -2.0, math.radians(90 - degrees))
        with WORLDS[name](scene([start]), WorldSettings(step_hz=60)) as world:
            world.drive(0, Command(0.2, 0.0))
            run(world, 12.0)
            ends[name] = world.poses()[0]
    for name, end in ends.items():
        np.testing.assert_allclose(end[:2], ends["bullet"][:2], rtol=0.0, atol=0.015, err_msg=name)
        assert end[2] == pytest.approx(ends["bullet"][2], abs=0.01), name


def test_wheels_turn_on_and_odometry_tells_that_the_body_does_not() -> None:
    with FastWorld(scene([(2.5, 0.0, 0.0)])) as world:
        world.drive(0, Command(0.2, 0.0))
        run(world, 5.0)
        before = world.wheel_angles()[0]
        run(world, 1.0)
        turned = (world.wheel_angles()[0] - before) * BURGER.wheel_radius_m
        assert world.velocities()[0] == pytest.approx((0.0, 0.0), abs=1e-4)
        assert world.poses()[0, 0] == pytest.approx(2.925 - 0.038, abs=2e-4)
    np.testing.assert_allclose(turned, 0.2, atol=1e-9)


def test_what_slides_along_a_wall_does_not_catch_where_the_next_one_begins() -> None:
    """A wall in four pieces, another that ends in it and a block across it: as smooth as a single piece."""
    arena = load_arena("empty")
    y = -1.0 + arena.wall_thickness_m / 2.0 + 0.089 + 1e-4
    block = Solid("box", Pose2D(0.7, -1.0, 0.0), 0.3, arena.wall_thickness_m, 0.5)
    ends = []
    for line, more, blocks in (
        (((-2.5, -1.0), (2.5, -1.0)), (), ()),
        (tuple((x, -1.0) for x in (-2.5, -1.0, 0.0, 1.0, 2.5)), (((0.5, -1.0), (0.5, -2.0)),), (block,)),
    ):
        walled = arena.model_copy(update={"walls": (line, *more)})
        with FastWorld(scene([(-2.2, y, 0.0)], stationary=blocks, arena=walled)) as world:
            world.drive(0, Command(0.2, -0.01))
            run(world, 20.0)
            ends.append(world.poses()[0])
    assert ends[0][0] > 1.0, "it slides"
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.0, atol=0.01)


def test_sides_inside_other_solids_are_left_out_and_corners_there_are_none() -> None:
    arena = load_arena("empty")
    walls = (((-1.0, 0.0), (1.0, 0.0)), ((0.0, 0.0), (0.0, 1.0)))
    layout = scene([(0.0, -0.5, 0.0)], arena=arena.model_copy(update={"walls": walls}))
    half = arena.wall_thickness_m / 2.0
    sides, *_ = side_grid(outlines_of(layout.solids), 0.2)
    lengths = sides[:, 4]
    # the bar keeps its ends and its face below, is cut above, and the stem keeps what stands out of it
    expected = [2 * half, 2 * half, 2 + 2 * half, 1.0, 1.0, 2 * half, 1.0, 1.0, 2 * half]
    assert sorted(lengths.round(6)) == pytest.approx(sorted(expected))
    corners = sides[(sides[:, 5:] != 0.0).any(axis=1), :2]
    free = {(-1 - half, -half), (1 + half, -half), (1 + half, half), (-1 - half, half), (half, 1 + half)}
    assert {tuple(corner) for corner in corners.round(6).tolist()} == {
        (round(x, 6), round(y, 6)) for x, y in free | {(-half, 1 + half)}
    }
