"""``World``: one trial's robots, walls and intruders in a PyBullet client of their own."""

import math
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.body import Drive, load_robot
from midnet_bench.simulation.bullet.engine import bullet, give_back, take_client
from midnet_bench.simulation.bullet.rays import Rays
from midnet_bench.simulation.bullet.stage import add_floor, add_solids
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_SETTLE_S = 1.0
_CONTACT_HZ = 10
_EPISODE_GAP_S = 1.0


class World:
    """The :class:`~midnet_bench.simulation.simulator.Simulator` that PyBullet makes; a context manager.

    Tick 0 is when the robots have settled on their wheels. Worlds in one process do not touch each other.
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
        self._client = take_client()
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self.step_hz,
            numSolverIterations=self.settings.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self._floor = add_floor(self._client)
        add_solids(self._client, layout.solids)
        self._rays = Rays(layout, robot.lidar_height_m)
        self._robots = [load_robot(self._client, robot, pose) for pose in starts]
        self._drive = Drive(robot, self._robots, self._client, 1.0 / self.step_hz)
        self._active = np.ones(len(starts), dtype=np.bool_)
        self._present = list(range(len(starts)))
        """the robots that are still in the arena"""
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_contact = np.full(len(starts), -(10**9), dtype=np.int64)
        self._poses: Floats | None = None
        """what ``poses`` gives at this tick, once it was asked for"""
        for _ in range(round(_SETTLE_S * self.step_hz)):
            bullet.stepSimulation(physicsClientId=self._client)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the client back; more than once does no harm."""
        if self._client >= 0:
            give_back(self._client)
            self._client = -1
        self._rays.close()

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""
        return self._active.copy()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one. Clamped to the robot's limits."""
        self._require(index)
        self._drive.command(index, command)

    def step(self) -> None:
        """Let one tick of 1 / ``step_hz`` seconds pass."""
        self._drive.step()
        bullet.stepSimulation(physicsClientId=self._client)
        self.tick += 1
        self._poses = None
        if self.tick % (self.step_hz // _CONTACT_HZ) == 0:
            self._count_collisions()

    def pose(self, index: int) -> Pose2D:
        """A robot's true base_footprint (under the axle), map frame; NaN once it is removed."""
        return Pose2D(*self.poses()[index].tolist())

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        if self._poses is None:
            self._poses = np.array([self._fetch_pose(index) for index in range(len(self._robots))])
            self._poses.flags.writeable = False
        return self._poses

    def velocities(self) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of every robot; NaN for one that is removed."""
        velocities = np.full((len(self._robots), 2), np.nan)
        yaws = self.poses()[:, 2].tolist()
        for index in self._present:
            (x, y, _), (_, _, turn) = bullet.getBaseVelocity(self._robots[index].body, self._client)
            # the solver made this velocity at the heading that the step began with
            heading = yaws[index] - turn / self.step_hz
            velocities[index] = x * math.cos(heading) + y * math.sin(heading), turn
        return velocities

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians; NaN for a robot that is removed."""
        angles = np.full((len(self._robots), 2), np.nan)
        for index in self._present:
            body, wheels, _ = self._robots[index]
            left, right = bullet.getJointStates(body, wheels, physicsClientId=self._client)
            angles[index] = left[0], right[0]
        return angles

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        return self._rays.cast(beams, near_m, far_m)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        self._require(index)
        bullet.removeBody(self._robots[index].body, physicsClientId=self._client)
        self._drive.forget(index)
        self._active[index] = False
        self._present.remove(index)
        self._poses = None

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far, looked at ten times a second.

        Touching counts once until a second has passed without it.
        """
        return self._collisions.copy()

    def _require(self, index: int) -> None:
        if not 0 <= index < len(self._robots) or not self._active[index]:
            raise ValueError(
                f"robot {index} is not in this world (it has {len(self._robots)}, or it was removed)"
            )

    def _fetch_pose(self, index: int) -> tuple[float, float, float]:
        if not self._active[index]:
            return math.nan, math.nan, math.nan
        body, _, mass_x_m = self._robots[index]
        at, (x, y, z, w) = bullet.getBasePositionAndOrientation(body, self._client)
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return at[0] - mass_x_m * math.cos(yaw), at[1] - mass_x_m * math.sin(yaw), yaw

    def _count_collisions(self) -> None:
        gap = _EPISODE_GAP_S * self.step_hz
        for index in self._present:
            contacts = bullet.getContactPoints(
                bodyA=self._robots[index].body, linkIndexA=-1, physicsClientId=self._client
            )
            if any(contact[2] != self._floor and contact[8] <= 0.0 for contact in contacts):
                if self.tick - self._last_contact[index] > gap:
                    self._collisions[index] += 1
                self._last_contact[index] = self.tick
