"""``Simulator``: what the fleet and the experiments ask of an engine: ``bullet/`` or ``fast/``.

An engine knows bodies, motors and rays against what stands still. The models of sensors lie above it and are
shared by all engines: what beams meet of other robots and their noise (``lidar``), wheel encoders
(``odometry``), the inertial sensor (``imu``).
"""

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.model import RobotModel

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


class Beams(NamedTuple):
    """The beams of m sensors in the map frame, all in the scan plane."""

    axes: Floats
    """(m, 2) where they meet, metres"""
    directions: Floats
    """(m, beams, 2) unit vectors"""


def require_active(active: npt.NDArray[np.bool_], index: int) -> None:
    """Raises ValueError unless robot ``index`` is one of the (n,) ``active`` ones of a world."""
    if not 0 <= index < len(active) or not active[index]:
        raise ValueError(f"robot {index} is not in this world (it has {len(active)}, or it was removed)")


class Simulator(Protocol):
    """One trial's robots: security robots (index 0 up) and, after them, mobile intruders, as in the layout.

    Time is ``tick`` / ``step_hz`` and starts at 0 with all robots at rest. Two simulators made alike and
    driven alike must agree bit for bit, in any process. Poses are those of the base frame, in the map frame.
    """

    @property
    def layout(self) -> Layout:
        """Where everything was at the start."""

    @property
    def robot(self) -> RobotModel:
        """What all robots are."""

    @property
    def step_hz(self) -> int:
        """Ticks per second."""

    @property
    def tick(self) -> int:
        """Ticks since the start."""

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""

    def step(self) -> None:
        """Let one tick pass."""

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one, clamped to the robot's limits."""

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good."""

    def pose(self, index: int) -> Pose2D:
        """A robot's true pose; NaN once it is removed."""

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot; read-only, fresh per tick."""

    def velocities(self, rows: Ints | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot; NaN for one that is removed.

        With ``rows``, only theirs are wanted: the others' may be NaN.
        """

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians; NaN for a robot that is removed."""

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first thing that stands still; inf if there is none.

        Robots do not count, and only what lies between ``near_m`` and ``far_m`` does.
        """

    def collisions(self) -> npt.NDArray[np.int64]:
        """(n,) how often each robot has run into something so far."""

    def close(self) -> None:
        """Give back what the engine holds; more than once does no harm."""
