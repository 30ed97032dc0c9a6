"""Layouts and beams for the tests of the simulation."""

import math
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.sensors import LidarSensors
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import LidarSettings, WorldSettings

HOWTO = Path(__file__).parents[2] / "docs" / "howto"


def shown_on(page: str) -> str:
    """The file that a page under docs/howto shows."""
    return (HOWTO / page).read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]


OWN_ENGINE = shown_on("engine.md")  # an engine of somebody else's, in pure numpy
OWN_ROBOT = shown_on("robot.md")


def world_on(
    engine: str, layout: Layout, settings: WorldSettings | None = None, robot: RobotModel = BURGER
) -> World:
    return World(layout, replace(settings or WorldSettings(), engine=engine), robot)


BulletWorld, FastWorld, MujocoWorld = (partial(world_on, name) for name in ("bullet", "fast", "mujoco"))
WORLDS = {"bullet": BulletWorld, "fast": FastWorld, "mujoco": MujocoWorld}  # the engines by name
NEEDS_MUJOCO = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="the extra midnet-bench[mujoco] is not installed"
)
ENGINES = ("bullet", "fast", pytest.param("mujoco", marks=NEEDS_MUJOCO))  # their names, for tests of each


def scene(robots, intruders=(), stationary=(), arena: Arena | None = None, seed: int = 1) -> Layout:
    """A layout with everybody exactly where the test wants them; Map 1 without intruders by default."""
    return Layout(
        arena or load_arena("empty"),
        seed,
        tuple(stationary),
        tuple(Pose2D(*pose) for pose in robots),
        tuple(Pose2D(*pose) for pose in intruders),
    )


def small_arena(side_m: float) -> Arena:
    """A square room within the empty Map 1."""
    half = side_m / 2.0
    walls = (((-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)),)
    return load_arena("empty").model_copy(update={"walls": walls})


def sensors(world: World, profile: str = "urdf", noise: str = "none") -> LidarSensors:
    """The robots' LiDARs, without noise by default."""
    return LidarSensors(world, LidarSettings(robot_profile=profile, noise=noise))


def run(world: World, seconds: float) -> None:
    for _ in range(round(seconds * world.step_hz)):
        world.step()


def fans(rng: np.random.Generator, layout: Layout, sensors: int) -> Beams:
    """Full turns of 360 beams, anywhere in the arena, also in walls and right before them."""
    half_x, half_y = (side / 2.0 for side in layout.arena.enclosure_m)
    axes = rng.uniform((-half_x, -half_y), (half_x, half_y), size=(sensors, 2))
    angles = rng.uniform(-math.pi, math.pi, (sensors, 1)) + np.radians(np.arange(360))
    return Beams(axes, np.stack((np.cos(angles), np.sin(angles)), axis=2))


def differing(one: np.ndarray, other: np.ndarray, by_m: float) -> np.ndarray:
    """(k, 2) sensor and beam of those ranges that differ."""
    with np.errstate(invalid="ignore"):
        return np.argwhere(~((np.abs(one - other) <= by_m) | (one == other)))


def beam_lengths(pose, layout: Layout, discs) -> np.ndarray:
    """What a perfect LDS-01 on a robot at ``pose`` would measure: walls by ``fast``, discs in closed form.

    ``discs`` are (x, y, radius). inf beyond 3.5 m, 0 below 0.12 m.
    """
    x, y, _ = Pose2D(*pose).compose(LDS_01.mount)
    angles = pose[2] + np.radians(np.arange(LDS_01.beams))
    ways = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    with FastWorld(layout) as world:
        lengths = world.cast(Beams(np.array([(x, y)]), ways[None]), 0.0, 3.5)[0]
    for disc_x, disc_y, radius in discs:
        to_disc = np.array([disc_x - x, disc_y - y])
        along, aside = ways @ to_disc, np.abs(ways @ (to_disc[1], -to_disc[0]))
        is_met = (along >= 0.0) & (aside < radius)
        entered = along - np.sqrt(np.where(is_met, radius**2 - aside**2, 0.0))
        lengths = np.minimum(lengths, np.where(is_met, entered, np.inf))
    return np.where(lengths < 0.12, 0.0, np.where(lengths < 3.5, lengths, np.inf))
