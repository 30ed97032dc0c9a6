"""``FastEngine``: one trial's robots, walls and intruders in compiled loops of our own."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Command, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.fast import motion
from midnet_bench.simulation.fast.outlines import cast_on_outlines, outlines_of

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class FastEngine:
    """The :class:`~midnet_bench.simulation.engine.Engine` without PyBullet.

    Bodies are planar and have no wheels; ``motion`` says how they move.
    """

    def __init__(self, layout: Layout, robot: RobotModel, step_hz: int, solver_iterations: int) -> None:
        self._robot = robot
        starts = layout.robots + layout.intruders
        self._outlines = outlines_of(layout.solids)
        self._parts = motion.parts_of(robot, self._outlines, len(starts), step_hz, solver_iterations)
        self._states = np.zeros((len(starts), motion.COLUMNS))
        self._states[:, motion.POSE] = starts
        self._present = np.ones(len(starts), dtype=np.bool_)
        self._obstacles = np.zeros((0, 6))

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity, within its limits; held until the next one."""
        self._states[index, motion.ASKED] = self._robot.rim_speeds(command)

    def step(self) -> None:
        """Let 1 / ``step_hz`` seconds pass."""
        motion.step_world(self._states, self._present, self._obstacles, self._parts)

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way from now on, in place of those before; beams pass them."""
        rows = [(*one.pose, one.length_m, one.width_m, one.kind == "cylinder") for one in solids]
        self._obstacles = np.array(rows, dtype=np.float64).reshape(-1, 6)

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame, under the middle of its axle."""
        return self._states[:, motion.POSE]

    def velocities(self, rows: Ints) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot."""
        return self._states[:, motion.VELOCITY]

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians."""
        return self._states[:, motion.ANGLES]

    def contacts(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot touches anything now."""
        touching = motion.touching(self._states, self._present, self._obstacles, self._parts)
        return np.asarray(touching)

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        still = self._outlines
        ranges = cast_on_outlines(
            beams.axes, beams.directions, still.corners, still.first, still.circles, near_m, far_m
        )
        return np.asarray(ranges)

    def remove(self, index: int) -> None:
        """Take a robot out for good."""
        self._present[index] = False
