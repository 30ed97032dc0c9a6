"""``World``: the robots, walls, people and things of one trial, around any engine."""

from typing import Any, Self

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.elementary import directions
from midnet_bench.geometry import Booleans, Command, Floats, Indices, Pose2D
from midnet_bench.plugins import PluginError
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.crowd import Crowd
from midnet_bench.simulation.engine import SIMULATORS, Beams, Engine
from midnet_bench.simulation.world_settings import WorldSettings

CONTACT_HZ = 10  # how often contacts are looked at
EPISODE_GAP_S = 1.0  # Touching counts once until so long has passed without it.


class World:
    """One trial's robots: security robots (index 0 up) and, after them, mobile intruders, as in the layout.

    Time is ``tick`` / ``step_hz`` and starts at 0 with all robots at rest. Two worlds made alike and driven
    alike agree bit for bit, in any process. Poses are those of the base frame, in the map frame. What an
    engine from outside gives is checked where it comes in; PluginError names the engine and what was wrong.
    Robots run into people if the engine has ``obstruct``, and pass through them otherwise. A context manager.
    """

    def __init__(
        self, layout: Layout, settings: WorldSettings | None = None, robot: RobotModel = BURGER
    ) -> None:
        """Only the chosen engine is imported.

        Raises:
            PyBulletMissingError: the engine is ``bullet`` and PyBullet is not installed.
            PluginError: the engine cannot be made.
        """
        settings = settings or WorldSettings()
        self.layout = layout
        self.robot = robot
        self.step_hz = settings.step_hz
        self.tick = 0
        self.crowd = Crowd(layout, 1.0 / self.step_hz)
        """people and things that move by themselves"""
        self.engine = _engine(layout, settings, robot)
        self._name = settings.engine
        self._is_checked = not SIMULATORS.is_made_here(settings.engine)
        self._has_velocities = hasattr(self.engine, "velocities")
        count = len(layout.robots + layout.intruders)
        self._active = np.ones(count, dtype=np.bool_)
        self._gone: list[int] = []  # those that were removed
        self._collisions = np.zeros(count, dtype=np.int64)
        self._last_touch = np.full(count, -(10**9), dtype=np.int64)
        self._poses: Floats | None = None
        """of this tick, once they were read"""
        self._before = np.array(layout.robots + layout.intruders).reshape(-1, 3)
        """of the tick before, for engines without ``velocities``"""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Give back what the engine holds; more than once does no harm."""
        if hasattr(self.engine, "close"):
            self._call("close")

    @property
    def active(self) -> Booleans:
        """(n,) whether each robot is still in the arena."""
        return self._active.copy()

    def step(self) -> None:
        """Let one tick pass: first for people, with the places of the robots, then for the robots."""
        if self.crowd.members:
            robots = self.poses()[self._active]
            robots[:, 2] = self.robot.body_reach_m
            self.crowd.step(robots)
            if hasattr(self.engine, "obstruct"):
                self._call("obstruct", self.crowd.solids())
        if not self._has_velocities:
            self._before = self.poses()
        self._call("step")
        self.tick += 1
        self._poses = None
        if self.tick % (self.step_hz // CONTACT_HZ) == 0:
            self._count_collisions()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one, clamped to the robot's limits."""
        self._require_active(index)
        self._call("drive", index, self.robot.clamped(command))

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        self._require_active(index)
        self._call("remove", index)
        self._active[index] = False
        self._gone.append(index)
        self._poses = None

    def pose(self, index: int) -> Pose2D:
        """A robot's true pose; NaN once it is removed."""
        return Pose2D(*self.poses()[index].tolist())

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot; read-only, fresh per tick."""
        if self._poses is None:
            self._poses = self._of_robots("poses", 3, self._active)
            self._poses.flags.writeable = False
        return self._poses

    def velocities(self, rows: Indices | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot; NaN for one that is removed.

        With ``rows``, only theirs are wanted: the others' may be NaN.
        """
        if self._has_velocities:
            there = np.flatnonzero(self._active) if rows is None else rows[self._active[rows]]
            return self._of_robots("velocities", 2, there, there)
        moved = self.poses() - self._before
        turned = (moved[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        ahead = directions(self._before[:, 2] + turned / 2.0)
        return np.column_stack(((moved[:, :2] * ahead).sum(axis=1), turned)) * self.step_hz

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians; NaN for a robot that is removed."""
        return self._of_robots("wheel_angles", 2, self._active)

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres to the first thing that is no robot, people included; inf if there is none.

        From the axis; of what never moves, only what lies between ``near_m`` and ``far_m`` counts.
        """
        ranges = self._array("cast", beams.directions.shape[:2], beams, near_m, far_m)
        if self._is_checked:
            is_right = (ranges >= near_m) & ((ranges <= far_m) | (ranges == np.inf))
            if not is_right.all():
                wrong = ranges[~is_right][0]
                raise self._wrong("cast", f"{wrong:g} is neither inf nor between {near_m:g} and {far_m:g} m")
        if self.crowd.members:
            self.crowd.shorten(ranges, beams, far_m)
        return ranges

    def collisions(self) -> Indices:
        """(n,) how often each robot has run into something so far, looked at ten times a second."""
        return self._collisions.copy()

    def _count_collisions(self) -> None:
        contacts = self._array("contacts", self._active.shape)
        if self._is_checked and not ((contacts == 0.0) | (contacts == 1.0)).all():
            raise self._wrong("contacts", "True or False is needed of each robot")
        is_touching = (contacts == 1.0) & self._active
        if not is_touching.any():
            return
        self._collisions += is_touching & (self.tick - self._last_touch > EPISODE_GAP_S * self.step_hz)
        self._last_touch[is_touching] = self.tick

    def _require_active(self, index: int) -> None:
        if not 0 <= index < len(self._active) or not self._active[index]:
            count = len(self._active)
            raise ValueError(f"robot {index} is not in this world (it has {count}, or it was removed)")

    def _of_robots(self, method: str, columns: int, rows: npt.NDArray[Any], *arguments: Any) -> Floats:
        """What a method gives of each robot, checked for active ``rows``; NaN for those that were removed."""
        found = self._array(method, (len(self._active), columns), *arguments)
        if self._gone:
            found[self._gone] = np.nan
        if self._is_checked and not np.isfinite(found[rows]).all():
            raise self._wrong(method, "a number of a robot that is there is not finite")
        return found

    def _array(self, method: str, shape: tuple[int, ...], *arguments: Any) -> Floats:
        """A copy of the numbers that a method gives."""
        given = self._call(method, *arguments)
        if not self._is_checked:
            return np.array(given, dtype=np.float64)
        try:
            found = np.array(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(method, f"an array of numbers is needed, not {type(given).__name__}") from error
        if found.shape != shape:
            raise self._wrong(method, f"shape {shape} is needed (got {found.shape})")
        return found

    def _call(self, method: str, *arguments: Any) -> Any:
        if not self._is_checked:
            return getattr(self.engine, method)(*arguments)
        try:
            return getattr(self.engine, method)(*arguments)
        except Exception:
            with SIMULATORS.calling(self._name):
                raise

    def _wrong(self, method: str, fault: str) -> PluginError:
        return PluginError(f"engine {self._name}: {method}: {fault}")


def _engine(layout: Layout, settings: WorldSettings, robot: RobotModel) -> Engine:
    if settings.engine == "fast":
        from midnet_bench.simulation.fast.fast_engine import FastEngine

        return FastEngine(layout, robot, settings.step_hz)
    if settings.engine == "bullet":
        from midnet_bench.simulation.bullet_engine import BulletEngine

        return BulletEngine(layout, robot, settings.step_hz)
    return SIMULATORS.make(settings.engine, layout, robot, settings.step_hz)
