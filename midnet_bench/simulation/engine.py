"""``Engine``: what moves the robots and casts their beams; and the extension point for engines of one's own.

An engine knows bodies, motors, and rays against what never moves. ``World`` lies above it and is the same
for all of them: people, counts of collisions, checks. So are the ``sensors``: what beams meet of other robots
and their noise, wheel encoders, gyroscopes.
"""

from typing import NamedTuple, Protocol

from midnet_bench.geometry import Booleans, Command, Floats
from midnet_bench.plugins import ExtensionPoint

SIMULATORS = ExtensionPoint(
    option="engine",
    entry_points="midnet_bench.simulators",
    method="step",
    own={"bullet": None, "fast": None, "mujoco": "midnet_bench.simulation.mujoco_engine:MujocoEngine"},
    needs={"mujoco": "mujoco"},
)
SOLVER_ITERATIONS = 50  # over a step's contacts, at most; pybullet, numSolverIterations


class Beams(NamedTuple):
    """The beams of m sensors in the map frame, all in the scan plane."""

    axes: Floats  # (m, 2) where they meet, metres
    directions: Floats  # (m, beams, 2) unit vectors


class Engine(Protocol):
    """Bodies, wheels, and beams against what never moves: the physics of one trial.

    Made as ``Class(layout, robot, step_hz)``, and of what options the class has beside. All robots are of
    the kind ``robot``: first the security robots, then the mobile intruders, at rest where ``layout`` has
    them. Two that are made alike and driven alike must agree bit for bit, in any process. Rows of robots that
    were removed may hold anything. Metres, radians, seconds; map frame.

    An engine may also have these. ``obstruct(solids)``, called before each step of an arena with people or
    things that move: robots run into these solids from now on, in place of those before; beams pass them.
    ``velocities(rows)``: (n, 2) forward speed and yaw rate, of which only ``rows`` are read; without it they
    are taken from the poses. ``close()``: gives back what it holds; more than once does no harm.
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

    def contacts(self) -> Booleans:
        """(n,) whether each robot touches anything but the floor now."""

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) from the axis to the first of ``layout.solids`` between both distances, else inf.

        The robots' own discs are met by the caller, for all engines alike.
        """
