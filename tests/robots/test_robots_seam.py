"""The seam ``robot``: what it takes, what a RobotModel may be, and what of a trial goes by it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.geometry import Command, Pose2D
from midnet_bench.navigation.navigation_settings import radii
from midnet_bench.robots.model import ROBOTS, Disc, RobotModel
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01, WAFFLE
from tests.simulation.scenes import ENGINES, OWN_ROBOT, WORLDS, run, scene


def test_the_waffle_s_measures_agree_with_each_other() -> None:
    assert WAFFLE.body_reach_m == pytest.approx(math.hypot(0.197, 0.133))
    inscribed_m, circumscribed_m = radii(WAFFLE.footprint)
    assert inscribed_m < WAFFLE.radius_m < circumscribed_m == pytest.approx(WAFFLE.footprint_reach_m)
    middle_x = (max(x for x, _ in WAFFLE.body) + min(x for x, _ in WAFFLE.body)) / 2.0
    assert WAFFLE.lidar.mount.x == pytest.approx(middle_x)
    assert max(y for _, y in WAFFLE.body) == pytest.approx(0.144 + 0.018 / 2.0)  # a wheel's outer face


def test_names_and_numbers_in_brackets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(OWN_ROBOT)
    monkeypatch.chdir(tmp_path)
    assert ROBOTS.make("burger") == BURGER
    assert ROBOTS.make("waffle") == WAFFLE
    slow = ROBOTS.make(ROBOTS.pinned("burger(max_linear_mps=0.1)"))
    assert (slow.max_linear_mps, slow.wheel_radius_m) == (0.1, BURGER.wheel_radius_m)
    assert slow.urdf is None  # which has the old wheels
    pinned = ROBOTS.pinned("mine.py:ROBOT(max_angular_radps=1)")
    assert pinned.startswith("mine.py:ROBOT(max_angular_radps=1)#")
    (tmp_path / "mine.py").unlink()
    assert ROBOTS.make(pinned).max_angular_radps == 1.0


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("wafle", "robot: unknown name 'wafle'; did you mean 'waffle'?"),
        ("mine.py:LIDAR", "expected a RobotModel"),
        ("mine.py:ROBBOT", "no 'ROBBOT' in mine.py; did you mean 'ROBOT'?"),
        ("burger(max_speed=1)", "no option 'max_speed'"),
        ("burger(max_linear_mps=fast)", "max_linear_mps: a number is needed"),
        (
            "burger(wheel_radius_m=0)",
            "robot 'TurtleBot3 Burger': wheel_radius_m: 0 is no finite number above 0",
        ),
    ],
)
def test_a_robot_that_is_not_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, value: str, says: str
) -> None:
    (tmp_path / "mine.py").write_text(OWN_ROBOT)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        DetectionParameters.of(robot=value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mass_kg": math.nan}, "mass_kg: nan"),
        ({"body": ((0.0, 0.0), (0.1, 0.0))}, "body: three corners"),
        ({"footprint": ((0.1, 0.1), (0.2, 0.1), (0.2, 0.2))}, "footprint: its corners must go once around"),
        ({"footprint": ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))}, "footprint: the body reaches"),
        ({"seen": Disc(0.0, 0.0)}, "seen: a disc of 0.0 m"),
        ({"seen": Disc(3.0, 0.0)}, "seen: a disc of 3.0 m"),
        ({"lidar": replace(LDS_01, beams=720)}, "lidar: its beams must spread"),
        ({"lidar_height_m": 0.4}, "lidar_height_m: what stands in an arena may end at"),
        ({"lidar": replace(LDS_01, range_min_m=4.0)}, "lidar: range_min_m must be below"),
        ({"lidar": replace(LDS_01, mount=Pose2D(0.0, 0.05, 0.0))}, "lidar: it must be mounted"),
    ],
)
def test_measures_that_cannot_be_are_named(changes: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=f"robot 'TurtleBot3 Waffle': {says}"):
        replace(WAFFLE, **changes)


def test_a_trial_s_settings_go_by_its_robot_unless_they_are_given() -> None:
    burger, waffle = DetectionParameters.of(), DetectionParameters.of(robot="waffle", dwa_max_vel_x_mps=0.22)
    assert burger.flat_values()["robot"] == "burger"
    assert waffle.flat_values()["robot"] == "waffle"
    assert waffle.navigator.bare_footprint == WAFFLE.footprint
    assert waffle.costmap.inscribed_radius_m == WAFFLE.radius_m
    limits = waffle.guard_navigator.dwa.limits
    assert (limits.max_vel_x_mps, limits.min_vel_trans_mps) == (0.22, 0.13)
    assert limits.max_vel_theta_radps == WAFFLE.max_angular_radps
    assert waffle.intruder_speed_mps == WAFFLE.max_linear_mps
    again = DetectionParameters.from_flat(waffle.flat_values())
    assert again == waffle
    assert DetectionParameters.parse(waffle.flat_values(), "again") == waffle
    assert MappingParameters.of(robot="waffle").navigator.bare_footprint == WAFFLE.footprint
    with pytest.raises(InputError, match=r"intruder_speed_mps: 0.25 is out of range; a TurtleBot3 Burger"):
        DetectionParameters.of(intruder_speed_mps=0.25)


def test_an_arena_too_narrow_for_the_robots_says_so() -> None:
    arena = load_arena("map1")
    assert place(arena, 1, 2, reach_m=WAFFLE.body_reach_m) == place(arena, 1, 2)
    with pytest.raises(
        InputError, match=r"robots.spacing_m: 0.6 m is too little .* 0.50 m .* 1.00 m is needed"
    ):
        place(arena, 1, 2, reach_m=0.5)
    with pytest.raises(InputError, match=r"mobile_intruders.clearance_m"):
        place(arena, 1, 1, reach_m=0.5)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("robot", [WAFFLE, replace(BURGER, urdf=None)], ids=["waffle", "burger without urdf"])
def test_a_robot_that_is_only_measures_drives_as_it_is_told(engine: str, robot: RobotModel) -> None:
    with WORLDS[engine](scene([(-1.0, -1.0, 0.3)]), robot=robot) as world:
        np.testing.assert_allclose(world.pose(0), (-1.0, -1.0, 0.3), atol=2e-3)
        world.drive(0, Command(0.9, 0.0))
        run(world, 3.0)
        speed, turn = world.velocities()[0]
        assert speed == pytest.approx(robot.max_linear_mps, abs=0.004)
        assert abs(turn) < 0.01
        world.drive(0, Command(0.0, 1.0))
        run(world, 2.0)
        assert world.velocities()[0, 1] == pytest.approx(1.0, abs=0.02)
        assert abs(world.velocities()[0, 0]) < 0.01
        left, right = world.wheel_angles()[0]
        turned = world.pose(0).yaw - 0.3
        expected = turned * robot.wheel_separation_m / robot.wheel_radius_m
        assert right - left == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_waffle_stops_at_a_wall_where_its_body_ends(engine: str) -> None:
    wall_x = load_arena("empty").enclosure_m[0] / 2.0 - load_arena("empty").wall_thickness_m / 2.0
    with WORLDS[engine](scene([(wall_x - 0.5, 0.0, 0.0)]), robot=WAFFLE) as world:
        world.drive(0, Command(0.26, 0.0))
        run(world, 4.0)
        assert wall_x - world.pose(0).x == pytest.approx(max(x for x, _ in WAFFLE.body), abs=0.02)
        assert world.collisions()[0] == 1
