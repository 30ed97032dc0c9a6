"""``World``: one trial's robots, walls and intruders in a PyBullet client of their own."""

import math
from operator import itemgetter
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command, Odometry
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.body import Drive, load_robot
from midnet_bench.simulation.bullet.engine import bullet
from midnet_bench.simulation.bullet.stage import add_floor, add_solids
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_FRACTION = itemgetter(2)
"""of a ray's result, as PyBullet gives it"""
MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""

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
        self._client = bullet.connect(bullet.DIRECT)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self.step_hz,
            numSolverIterations=self.settings.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self._floor = add_floor(self._client)
        add_solids(self._client, layout.solids)
        self._robots = [load_robot(self._client, robot, pose) for pose in starts]
        self._drive = Drive(robot, self._robots, self._client, 1.0 / self.step_hz)
        self._active = np.ones(len(starts), dtype=np.bool_)
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_contact = np.full(len(starts), -(10**9), dtype=np.int64)
        self._poses: list[Pose2D | None] = [None] * len(starts)
        self._pose_array: Floats | None = None
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
            bullet.disconnect(physicsClientId=self._client)
            self._client = -1

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
        self._forget_poses()
        if self.tick % (self.step_hz // _CONTACT_HZ) == 0:
            self._count_collisions()

    def pose(self, index: int) -> Pose2D:
        """A robot's true base_footprint (under the axle), map frame; NaN once it is removed."""
        pose = self._poses[index]
        if pose is None:
            pose = self._poses[index] = self._fetch_pose(index)
        return pose

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        if self._pose_array is None:
            poses = np.array([self.pose(index) for index in range(len(self._robots))])
            poses.flags.writeable = False
            self._pose_array = poses
        return self._pose_array

    def odometry(self, index: int) -> Odometry:
        """A robot's true pose, forward speed (m/s) and yaw rate (rad/s), map frame."""
        self._require(index)
        (x, y, _), (_, _, turn) = bullet.getBaseVelocity(self._robots[index].body, self._client)
        pose = self.pose(index)
        return Odometry(pose, x * math.cos(pose.yaw) + y * math.sin(pose.yaw), turn)

    def wheel_angles(self, index: int) -> Floats:
        """(2,) how far a robot's left and right wheel have turned, radians."""
        self._require(index)
        body, wheels = self._robots[index]
        states = bullet.getJointStates(body, wheels, physicsClientId=self._client)
        return np.array([state[0] for state in states])

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        return cast_on_solids(self._client, beams, near_m, far_m, self.robot.lidar_height_m)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        self._require(index)
        bullet.removeBody(self._robots[index].body, physicsClientId=self._client)
        self._drive.forget(index)
        self._active[index] = False
        self._forget_poses()

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

    def _forget_poses(self) -> None:
        self._poses = [None] * len(self._robots)
        self._pose_array = None

    def _fetch_pose(self, index: int) -> Pose2D:
        if not self._active[index]:
            return Pose2D(math.nan, math.nan, math.nan)
        at, (x, y, z, w) = bullet.getBasePositionAndOrientation(self._robots[index].body, self._client)
        return Pose2D(at[0], at[1], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def _count_collisions(self) -> None:
        gap = _EPISODE_GAP_S * self.step_hz
        for index in self._active.nonzero()[0].tolist():
            contacts = bullet.getContactPoints(
                bodyA=self._robots[index].body, linkIndexA=-1, physicsClientId=self._client
            )
            if any(contact[2] != self._floor and contact[8] <= 0.0 for contact in contacts):
                if self.tick - self._last_contact[index] > gap:
                    self._collisions[index] += 1
                self._last_contact[index] = self.tick


@njit(cache=True)
def ray_ends(
    axes: Floats, directions: Floats, near_m: float, far_m: float, height_m: float
) -> tuple[Floats, Floats]:
    """Two of (m * beams, 3): the points ``near_m`` and ``far_m`` along every beam, at a height."""
    sensors, beams = directions.shape[:2]
    starts, ends = np.empty((sensors * beams, 3)), np.empty((sensors * beams, 3))
    for i in range(sensors):
        for k in range(beams):
            start, end = starts[i * beams + k], ends[i * beams + k]
            for axis in range(2):
                start[axis] = axes[i, axis] + near_m * directions[i, k, axis]
                end[axis] = axes[i, axis] + far_m * directions[i, k, axis]
            start[2] = end[2] = height_m
    return starts, ends


@njit(cache=True)
def distances(met: Floats, near_m: float, far_m: float) -> Floats:
    """(n,) metres, of what is met at a share ``met`` of the way from near to far; inf where that is 1."""
    found = np.empty_like(met)
    for i in range(len(met)):
        found[i] = near_m + met[i] * (far_m - near_m) if met[i] < 1.0 else np.inf
    return found


def cast_on_solids(client: int, beams: Beams, near_m: float, far_m: float, height_m: float) -> Floats:
    """(m, beams) distance from the axis to the first solid between near and far; inf if there is none."""
    starts, ends = ray_ends(*beams, near_m, far_m, height_m)
    met = np.empty(len(starts))
    for first in range(0, len(starts), MAX_BATCH):
        batch = slice(first, first + MAX_BATCH)
        met[batch] = ray_fractions(client, starts[batch], ends[batch])
    return np.asarray(distances(met, near_m, far_m).reshape(beams.directions.shape[:2]))


def ray_fractions(client: int, starts: Floats, ends: Floats) -> Floats:
    """(n,) how far along each ray the first solid is, 1 if there is none; (n, 3) starts and ends, metres.

    PyBullet answers with a tuple of tuples; most of what that costs is making them and giving them back.
    """
    hits = bullet.rayTestBatch(starts, ends, numThreads=1, physicsClientId=client)
    fractions = np.fromiter(map(_FRACTION, hits), np.float64, len(hits))
    del hits
    return fractions
