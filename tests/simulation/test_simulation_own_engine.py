"""What the seam ``engine`` takes, and what it refuses of an engine from outside."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import OtherIntruders
from midnet_bench.arena.layout import OtherIntruder
from midnet_bench.geometry import Command, Pose2D
from midnet_bench.plugins import PluginError
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.engine import SIMULATORS, Beams
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import WorldSettings
from tests.simulation.scenes import OWN_ENGINE, FastWorld, run, scene, sensors

STARTS = [(-1.0, 0.5, 0.3), (1.0, -0.5, 3.0)]


def own(folder: Path, text: str = OWN_ENGINE, others: tuple[OtherIntruder, ...] = ()) -> World:
    (folder / "stub.py").write_text(text)
    engine = SIMULATORS.pinned(f"{folder}/stub.py:World")
    return World(replace(scene(STARTS), others=others), WorldSettings(engine=engine), BURGER)


def test_it_agrees_with_fast_in_the_open(tmp_path: Path) -> None:
    worlds = [own(tmp_path), FastWorld(scene(STARTS))]
    for world in worlds:
        world.drive(0, Command(0.5, 0.4))  # faster than a Burger can
        world.drive(1, Command(0.1, -1.0))
        run(world, 3.0)
    mine, fast = worlds
    np.testing.assert_allclose(mine.poses(), fast.poses(), atol=0.1)  # the motors' ramp
    np.testing.assert_allclose(mine.velocities(), fast.velocities(), atol=1e-9)
    np.testing.assert_allclose(mine.velocities()[0], [0.22, 0.4])
    np.testing.assert_allclose(mine.wheel_angles(), fast.wheel_angles(), atol=1.0)
    poses = fast.poses()
    angles = np.linspace(0.0, 6.0, 50)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    beams = Beams(poses[:, :2].copy(), np.stack([ways, ways]))
    np.testing.assert_allclose(mine.cast(beams, 0.12, 3.5), fast.cast(beams, 0.12, 3.5), atol=1e-9)


def driven(world: World) -> None:
    """Asks everything of a world once."""
    world.drive(0, Command(0.1, 0.0))
    run(world, 0.1)
    lidars = sensors(world)
    lidars.scan([0, 1], lidars.noise([np.random.default_rng(0)] * 2))
    world.wheel_angles()
    world.collisions()


def test_one_that_is_removed_is_not_asked_for_again(tmp_path: Path) -> None:
    world = own(tmp_path)
    world.step()
    world.remove(1)
    assert math.isnan(world.pose(1).x)
    world.step()
    for given in (world.poses(), world.velocities(), world.wheel_angles()):
        assert np.isnan(given[1]).all()
        assert np.isfinite(given[0]).all()
    assert world.active.tolist() == [True, False]
    with pytest.raises(ValueError, match="robot 1"):
        world.drive(1, Command(0.1, 0.0))


def test_one_that_can_is_told_of_what_stands_in_the_robots_way(tmp_path: Path) -> None:
    walled = OWN_ENGINE + "\n    def obstruct(self, solids):\n        self.states[0, 0] = solids[0].pose.x\n"
    box = OtherIntruder(OtherIntruders(kind="box"), Pose2D(0.7, 1.5, 0.0))
    xs = {text: own(tmp_path, text, (box,)) for text in (OWN_ENGINE, walled)}
    for world in xs.values():
        world.step()
    assert [world.pose(0).x for world in xs.values()] == [-1.0, 0.7]


def test_touching_counts_once_until_a_second_has_passed_without_it(tmp_path: Path) -> None:
    touching = "np.array([0.5 < self.wheels[0, 0] < 1.0 or self.wheels[0, 0] > 9.0, False])"
    world = own(tmp_path, OWN_ENGINE.replace("np.zeros(len(self.states), dtype=bool)", touching))
    world.drive(0, Command(0.1, 0.0))
    counts = []
    for _ in range(4):
        run(world, 1.0)
        counts.append(world.collisions().tolist())
    assert counts == [[1, 0], [1, 0], [2, 0], [2, 0]]


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("return self.states\n", "return self.states[:1]\n", r"poses: shape \(2, 3\) is needed"),
        ("return self.states\n", "return 'here'\n", "poses: an array of numbers is needed, not str"),
        ("return self.states\n", "return self.states * np.nan\n", "poses: .* not finite"),
        ("return self.wheels\n", "return self.wheels.T[:1]\n", r"wheel_angles: shape \(2, 2\)"),
        (".min(axis=1)", ".min()", r"cast: shape \(2, 360\)"),
        ("np.where(meets, along, np.inf)", "np.where(meets, -1.0, np.inf)", "cast: -1 is neither inf nor"),
        ("np.where(meets, along, np.inf)", "np.where(meets, np.nan, np.inf)", "cast: nan is neither"),
        ("dtype=bool)", "dtype=int) + 2", "contacts: True or False is needed"),
        ("self.commands[index] = command", "self.commands[index] = comand", "NameError: name 'comand'"),
        ("def wheel_angles", "def wheels_turned", "AttributeError: .*wheel_angles"),
        ("self.starts = ", "1 / 0 #", "ZeroDivisionError"),
    ],
)
def test_what_an_engine_gives_is_checked(tmp_path: Path, right: str, wrong: str, says: str) -> None:
    text = OWN_ENGINE.replace(right, wrong)
    assert text != OWN_ENGINE
    with pytest.raises(PluginError, match=says) as caught:
        driven(own(tmp_path, text))
    assert str(caught.value).startswith("engine stub.py:World#")
    assert len(str(caught.value)) < 300
