"""``World``: one trial's robots, walls and intruders in compiled loops of our own."""

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.arena.solids import Solid
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.fast import motion
from midnet_bench.simulation.fast.contacts import body_of, room_for
from midnet_bench.simulation.fast.motion import drive_of
from midnet_bench.simulation.fast.outlines import outlines_of, side_grid
from midnet_bench.simulation.fast.rays import cast_on_outlines
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams, require_active

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_CONTACT_HZ = 10
_EPISODE_GAP_S = 1.0


class World:
    """The :class:`~midnet_bench.simulation.simulator.Simulator` without PyBullet; a context manager.

    Bodies are planar and have no wheels; ``motion`` says how they move. At tick 0 all stand where the layout
    has them.
    """

    def __init__(
        self, layout: Layout, settings: WorldSettings | None = None, robot: RobotModel = BURGER
    ) -> None:
        self.layout = layout
        self.robot = robot
        self.settings = settings or WorldSettings()
        self.step_hz = self.settings.step_hz
        self.tick = 0
        starts = layout.robots + layout.intruders
        drive = drive_of(robot, self.step_hz, self.settings.solver_iterations)
        body = body_of(robot)
        self._outlines = outlines_of(layout.solids)
        ground = side_grid(self._outlines, body.reach_m + 2.0 * drive.most_m)
        self._parts = motion.taken_apart(drive, body, ground, room_for(len(starts), body))
        self._states = np.zeros((len(starts), motion.COLUMNS))
        self._states[:, motion.POSE] = starts
        self._present = np.ones(len(starts), dtype=np.bool_)
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_touch = np.full(len(starts), -(10**9), dtype=np.int64)
        self._pose_array: Floats | None = None
        self._obstacles = np.zeros((0, 6))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Nothing to give back."""

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""
        return self._present.copy()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one. Clamped to the robot's limits."""
        require_active(self._present, index)
        left, right = self.robot.rim_speeds(command)
        self._states[index, motion.ASKED_LEFT] = left
        self._states[index, motion.ASKED_RIGHT] = right

    def step(self) -> None:
        """Let one tick of 1 / ``step_hz`` seconds pass."""
        motion.step_world(self._states, self._present, self._obstacles, *self._parts)
        self.tick += 1
        self._pose_array = None
        if self.tick % (self.step_hz // _CONTACT_HZ) == 0:
            motion.count_collisions(
                self._states,
                self._present,
                self._collisions,
                self._last_touch,
                self.tick,
                int(_EPISODE_GAP_S * self.step_hz),
                self._obstacles,
                *self._parts,
            )

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way from now on, in place of those before; beams pass them."""
        rows = [(*one.pose, one.length_m, one.width_m, one.kind == "cylinder") for one in solids]
        self._obstacles = np.array(rows, dtype=np.float64).reshape(-1, 6)

    def pose(self, index: int) -> Pose2D:
        """A robot's true base_footprint (under the axle), map frame; NaN once it is removed."""
        return Pose2D(*self._states[index, motion.POSE].tolist())

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        if self._pose_array is None:
            self._pose_array = self._states[:, motion.POSE].copy()
            self._pose_array.flags.writeable = False
        return self._pose_array

    def velocities(self, rows: Ints | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot; NaN for one that is removed."""
        return self._states[:, motion.VELOCITY].copy()

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians; NaN for a robot that is removed."""
        return self._states[:, motion.ANGLES].copy()

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        still = self._outlines
        ranges = cast_on_outlines(
            beams.axes, beams.directions, still.corners, still.first, still.circles, near_m, far_m
        )
        return np.asarray(ranges)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        require_active(self._present, index)
        self._present[index] = False
        for part in (motion.POSE, motion.VELOCITY, motion.ANGLES):
            self._states[index, part] = np.nan
        self._pose_array = None

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far, looked at ten times a second.

        Touching counts once until a second has passed without it.
        """
        return self._collisions.copy()
