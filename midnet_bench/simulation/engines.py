"""What makes a :class:`~midnet_bench.simulation.simulator.Simulator`, by the option ``engine``."""

from midnet_bench.arena.layout import Layout
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.own_engine import OwnEngine
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Simulator


def make_world(layout: Layout, settings: WorldSettings, robot: RobotModel) -> Simulator:
    """The world of one trial; only the chosen engine is imported.

    Raises:
        PyBulletMissingError: the engine is ``bullet`` and PyBullet is not installed.
        PluginError: the engine is another's, and cannot be made.
    """
    if settings.engine == "fast":
        from midnet_bench.simulation.fast.world import World as FastWorld

        return FastWorld(layout, settings, robot)
    if settings.engine == "bullet":
        from midnet_bench.simulation.bullet.world import World as BulletWorld

        return BulletWorld(layout, settings, robot)
    return OwnEngine(layout, settings, robot)
