"""Layouts for the tests of the simulation, and a caster of beams that shares nothing with it."""

import math
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D, Solid
from midnet_bench.robots.burger import BURGER, LDS_01
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.sensors import LidarSensors
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import LidarSettings, WorldSettings

HOWTO = Path(__file__).parents[2] / "docs" / "howto"


def shown_on(page: str) -> str:
    """The file that a page under docs/howto shows."""
    return (HOWTO / page).read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]


OWN_ENGINE = shown_on("engine.md")
"""an engine of somebody else's, in pure numpy"""
OWN_ROBOT = shown_on("robot.md")


def world_on(
    engine: str, layout: Layout, settings: WorldSettings | None = None, robot: RobotModel = BURGER
) -> World:
    return World(layout, replace(settings or WorldSettings(), engine=engine), robot)


BulletWorld, FastWorld, MujocoWorld = (partial(world_on, name) for name in ("bullet", "fast", "mujoco"))
WORLDS = {"bullet": BulletWorld, "fast": FastWorld, "mujoco": MujocoWorld}
"""the engines by name"""
NEEDS_MUJOCO = pytest.mark.skipif(
    find_spec("mujoco") is None, reason="the extra midnet-bench[mujoco] is not installed"
)
ENGINES = ("bullet", "fast", pytest.param("mujoco", marks=NEEDS_MUJOCO))
"""their names, for tests of each"""


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


def beam_lengths(pose, solids: tuple[Solid, ...], discs) -> np.ndarray:
    """What a perfect LDS-01 on a robot at ``pose`` would measure, one beam and one shape at a time.

    ``discs`` are (x, y, radius). inf beyond 3.5 m, 0 below 0.12 m.
    """
    lds = LDS_01
    axis = Pose2D(*pose).compose(lds.mount)
    lengths = []
    for number in range(lds.beams):
        angle = pose[2] + math.radians(number)
        found = [_to_solid(axis.x, axis.y, angle, solid) for solid in solids]
        found += [_to_circle(axis.x - x, axis.y - y, angle, radius) for x, y, radius in discs]
        length = min(found, default=math.inf)
        lengths.append(0.0 if length < 0.12 else length if length < 3.5 else math.inf)
    return np.array(lengths)


def _to_solid(x: float, y: float, angle: float, solid: Solid) -> float:
    local = solid.pose.inverse().compose(Pose2D(x, y, angle))
    if solid.kind == "cylinder":
        return _to_circle(local.x, local.y, local.yaw, solid.length_m / 2.0)
    return _to_rectangle(local, solid.length_m / 2.0, solid.width_m / 2.0)


def _to_circle(x: float, y: float, angle: float, radius: float) -> float:
    along = -(x * math.cos(angle) + y * math.sin(angle))
    aside = abs(x * math.sin(angle) - y * math.cos(angle))
    if along < 0.0 or aside >= radius:
        return math.inf
    return along - math.sqrt(radius**2 - aside**2)


def _to_rectangle(ray: Pose2D, half_length: float, half_width: float) -> float:
    enter, leave = 0.0, math.inf
    slabs = ((ray.x, math.cos(ray.yaw), half_length), (ray.y, math.sin(ray.yaw), half_width))
    for start, speed, half in slabs:
        if abs(speed) < 1e-12:
            if abs(start) > half:
                return math.inf
            continue
        one, other = sorted(((-half - start) / speed, (half - start) / speed))
        enter, leave = max(enter, one), min(leave, other)
    return enter if enter < leave else math.inf
