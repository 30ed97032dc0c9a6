"""``World``: one trial's robots, walls and intruders in PyBullet."""

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.arena.solids import Solid
from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos_sin
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.body import Drive, load_robot
from midnet_bench.simulation.bullet.engine import bullet, give_back, take_client
from midnet_bench.simulation.bullet.stage import add_floor, add_obstacle, add_solids, move_obstacle
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams, require_active

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_SETTLE_S = 1.0
_CONTACT_HZ = 10
_EPISODE_GAP_S = 1.0

BATCH = 100
"""Rays in one call. PyBullet answers with three tuples for each, and once 700 are new, Python's garbage
collector runs: with all rays in one call, casting takes a third longer. PyBullet's limit is 16383."""


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
        self._client = take_client()
        self._ray_client = take_client()
        """the solids alone: beside floor and robots, which no beam meets, a ray takes a fifth longer"""
        try:
            self._build()
        except BaseException:
            self.close()
            raise

    def _build(self) -> None:
        """Load everything, and let the robots settle on their wheels."""
        layout, robot = self.layout, self.robot
        starts = layout.robots + layout.intruders
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self.step_hz,
            numSolverIterations=self.settings.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self._floor = add_floor(self._client)
        add_solids(self._client, layout.solids)
        add_solids(self._ray_client, layout.solids)
        self._robots = [load_robot(self._client, robot, pose) for pose in starts]
        self._mass_x_m = self._robots[0].mass_x_m if starts else 0.0
        self._drive = Drive(robot, self._robots, self._client, 1.0 / self.step_hz)
        self._active = np.ones(len(starts), dtype=np.bool_)
        self._present = list(range(len(starts)))
        """the robots that are still in the arena"""
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_contact = np.full(len(starts), -(10**9), dtype=np.int64)
        self._obstacles: list[int] = []
        self._poses: Floats | None = None
        """the poses of this tick, once they were read"""
        for _ in range(round(_SETTLE_S * self.step_hz)):
            bullet.stepSimulation(physicsClientId=self._client)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the clients back; more than once does no harm."""
        if self._client >= 0:
            give_back(self._client)
            give_back(self._ray_client)
            self._client = self._ray_client = -1

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot is still in the arena."""
        return self._active.copy()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity; held until the next one. Clamped to the robot's limits."""
        require_active(self._active, index)
        self._drive.command(index, command)

    def step(self) -> None:
        """Let one tick of 1 / ``step_hz`` seconds pass."""
        self._drive.step()
        bullet.stepSimulation(physicsClientId=self._client)
        self.tick += 1
        self._poses = None
        if self.tick % (self.step_hz // _CONTACT_HZ) == 0:
            self._count_collisions()

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way, the same number at each call; beams pass them."""
        if not self._obstacles:
            self._obstacles = [add_obstacle(self._client, solid) for solid in solids]
        for body, solid in zip(self._obstacles, solids, strict=True):
            move_obstacle(self._client, body, solid)

    def pose(self, index: int) -> Pose2D:
        """A robot's true base_footprint (under the axle), map frame; NaN once it is removed."""
        return Pose2D(*self.poses()[index].tolist())

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of what ``pose`` gives for every robot."""
        if self._poses is None:
            fetch, client = bullet.getBasePositionAndOrientation, self._client
            places = np.full((len(self._robots), 7), np.nan)
            for index in self._present:
                at, turn = fetch(self._robots[index].body, client)
                places[index] = at + turn
            self._poses = base_poses(places, self._mass_x_m)
            self._poses.flags.writeable = False
        return self._poses

    def velocities(self, rows: Ints | None = None) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of ``rows``, or of all; NaN for one removed."""
        velocities = np.full((len(self._robots), 2), np.nan)
        yaws = self.poses()[:, 2].tolist()
        for index in self._present if rows is None else rows.tolist():
            (x, y, _), (_, _, turn) = bullet.getBaseVelocity(self._robots[index].body, self._client)
            # the solver made this velocity at the heading that the step began with
            heading = yaws[index] - turn / self.step_hz
            c, s = cos_sin(heading)
            velocities[index] = x * c + y * s, turn
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
        shape = beams.directions.shape[:2]
        starts, ends = np.full((2, *shape, 3), self.robot.lidar_height_m)
        starts[..., :2] = beams.axes[:, None] + near_m * beams.directions
        ends[..., :2] = beams.axes[:, None] + far_m * beams.directions
        starts, ends = starts.reshape(-1, 3), ends.reshape(-1, 3)
        fractions = np.empty(len(starts))
        for first in range(0, len(starts), BATCH):
            batch = slice(first, first + BATCH)
            hits = bullet.rayTestBatch(starts[batch], ends[batch], physicsClientId=self._ray_client)
            fractions[batch] = [hit[2] for hit in hits]
        ranges = np.where(fractions < 1.0, near_m + fractions * (far_m - near_m), np.inf)
        return ranges.reshape(shape)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        require_active(self._active, index)
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


@njit
def base_poses(places: Floats, mass_x_m: float) -> Floats:
    """(n, 3) x, y, yaw of base frames from (n, 7) positions and quaternions (x, y, z, w) of their masses.

    ``mass_x_m``: how far the mass lies before the base frame's origin.
    """
    poses = np.empty((len(places), 3))
    for i in range(len(places)):
        x, y, z, w = places[i, 3], places[i, 4], places[i, 5], places[i, 6]
        yaw = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        c, s = cos_sin(yaw)
        poses[i, 0] = places[i, 0] - mass_x_m * c
        poses[i, 1] = places[i, 1] - mass_x_m * s
        poses[i, 2] = yaw
    return poses
