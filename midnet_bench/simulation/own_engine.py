"""``Engine``: what stands behind the seam ``engine``; and ``OwnEngine``, the world that it makes, checked."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.arena.solids import Solid
from midnet_bench.elementary import directions
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.model import RobotModel
from midnet_bench.seams import PluginError
from midnet_bench.simulation.seams import SIMULATORS
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams, require_active

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Engine(Protocol):
    """Bodies, wheels, and beams against what stands still: one trial's world.

    Made as ``Class(layout, robot, step_hz)``, and of what options the class has beside. All robots are of
    the kind ``robot``: first the security robots, then the mobile intruders, at rest where ``layout`` has
    them. Two that are made alike and driven alike must agree bit for bit, in any process. Rows of robots that
    were removed may hold anything. Metres, radians, seconds; map frame.
    """

    def step(self) -> None:
        """Let 1 / ``step_hz`` seconds pass."""

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity, within its limits; held until the next one."""

    def remove(self, index: int) -> None:
        """Take a robot out for good: nothing can touch it any more."""

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame, under the middle of its axle."""

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned: what odometry counts."""

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far."""

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) from the axis to the first of ``layout.solids`` between both distances, else inf.

        The robots' own discs are met by the caller, for all engines alike.
        """

    # An engine may also have ``obstruct(solids)``, called before each step of an arena with people or things
    # that move: robots run into these solids from now on, in place of those before. Beams pass them.


class OwnEngine:
    """The :class:`~midnet_bench.simulation.simulator.Simulator` around an :class:`Engine` from outside.

    Whatever the engine gives is checked where it comes in; PluginError names the engine and what was wrong.
    """

    def __init__(self, layout: Layout, settings: WorldSettings, robot: RobotModel) -> None:
        self.layout = layout
        self.robot = robot
        self.step_hz = settings.step_hz
        self.tick = 0
        self._name = settings.engine
        self._engine: Engine = SIMULATORS.make(settings.engine, layout, robot, settings.step_hz)
        self._active = np.ones(len(layout.robots + layout.intruders), dtype=np.bool_)
        self._poses = self._read_poses()
        self._velocities = np.zeros((len(self._active), 2))

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""
        return self._active.copy()

    def step(self) -> None:
        """Let one tick pass."""
        self._asked("step")
        self.tick += 1
        before, self._poses = self._poses, self._read_poses()
        moved = self._poses - before
        turned = (moved[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        there = self._active
        ahead = directions(before[there, 2] + turned[there] / 2.0)
        self._velocities = np.full_like(self._velocities, np.nan)
        self._velocities[there, 0] = (moved[there, :2] * ahead).sum(axis=1) * self.step_hz
        self._velocities[there, 1] = turned[there] * self.step_hz

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one, clamped to the robot's limits."""
        require_active(self._active, index)
        self._asked("drive", index, self.robot.clamped(command))

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good."""
        require_active(self._active, index)
        self._active[index] = False
        self._asked("remove", index)
        self._poses = self._poses.copy()
        self._poses[index] = self._velocities[index] = np.nan
        self._poses.flags.writeable = False

    @property
    def obstruct(self) -> Callable[[Sequence[Solid]], None] | None:
        """Lets ``solids`` stand in the robots' way from now on; None where the engine cannot."""
        return partial(self._asked, "obstruct") if hasattr(self._engine, "obstruct") else None

    def pose(self, index: int) -> Pose2D:
        """A robot's true pose; NaN once it is removed."""
        return Pose2D(*self._poses[index].tolist())

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        return self._poses

    def velocities(self, rows: Ints | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) over the last tick; NaN for one removed."""
        return self._velocities.copy()

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians; NaN for a robot that is removed."""
        return self._of_robots("wheel_angles", 2)

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        found = self._array("cast", beams.directions.shape[:2], beams, near_m, far_m)
        is_wrong = ~((found >= near_m) & (found <= far_m) | (found == np.inf))
        if is_wrong.any():
            raise self._wrong(
                "cast", f"{found[is_wrong][0]:g} is neither inf nor between {near_m:g} and {far_m:g} m"
            )
        return found

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far."""
        found = self._array("collisions", self._active.shape)
        if not (found >= 0.0).all() or (found != np.floor(found)).any():
            raise self._wrong("collisions", "counts are whole numbers from 0 on")
        return found.astype(np.int64)

    def close(self) -> None:
        """Nothing to give back."""

    def _read_poses(self) -> Floats:
        poses = self._of_robots("poses", 3)
        poses.flags.writeable = False
        return poses

    def _of_robots(self, method: str, columns: int) -> Floats:
        """What a method gives of each robot; NaN for those that were removed."""
        found = self._array(method, (len(self._active), columns))
        if not np.isfinite(found[self._active]).all():
            raise self._wrong(method, "a number of a robot that is there is not finite")
        found[~self._active] = np.nan
        return found

    def _array(self, method: str, shape: tuple[int, ...], *arguments: Any) -> Floats:
        """A copy of the numbers that a method gives."""
        given = self._asked(method, *arguments)
        try:
            found = np.array(given, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise self._wrong(method, f"an array of numbers is needed, not {type(given).__name__}") from error
        if found.shape != shape:
            raise self._wrong(method, f"shape {shape} is needed (got {found.shape})")
        return found

    def _asked(self, method: str, *arguments: Any) -> Any:
        with SIMULATORS.calling(self._name):
            return getattr(self._engine, method)(*arguments)

    def _wrong(self, method: str, what: str) -> PluginError:
        return PluginError(f"engine {self._name}: {method}: {what}")
