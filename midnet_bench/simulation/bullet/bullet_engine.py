"""``BulletEngine``: one trial's robots, walls and intruders in PyBullet."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos_sin
from midnet_bench.geometry import Command, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.body import add_floor, add_obstacle, add_solids, load_robot, move_obstacle
from midnet_bench.simulation.bullet.client import Client, bullet
from midnet_bench.simulation.engine import Beams

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_SETTLE_S = 1.0

BATCH = 100
"""Rays in one call. PyBullet answers with three tuples for each, and once 700 are new, Python's garbage
collector runs: with all rays in one call, casting takes a third longer. PyBullet's limit is 16383."""


class BulletEngine:
    """The :class:`~midnet_bench.simulation.engine.Engine` that PyBullet makes.

    The first step begins when the robots have settled on their wheels. Engines in one process do not touch
    each other.
    """

    def __init__(self, layout: Layout, robot: RobotModel, step_hz: int, solver_iterations: int) -> None:
        self._robot = robot
        self._step_hz = step_hz
        self.client = Client()
        self._ray_client = Client()
        """the solids alone: beside floor and robots, which no beam meets, a ray takes a fifth longer"""
        try:
            self._build(layout, solver_iterations)
        except BaseException:
            self.close()
            raise

    def _build(self, layout: Layout, solver_iterations: int) -> None:
        """Load everything, and let the robots settle on their wheels."""
        starts = layout.robots + layout.intruders
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self._step_hz,
            numSolverIterations=solver_iterations,
            deterministicOverlappingPairs=1,
        )
        self.client.setGravity(0.0, 0.0, -9.81)
        self._floor = add_floor(self.client)
        add_solids(self.client, layout.solids)
        add_solids(self._ray_client, layout.solids)
        self._bodies = [load_robot(self.client, self._robot, pose) for pose in starts]
        self._mass_x_m = self._bodies[0].mass_x_m if starts else 0.0
        # of the rims, left and right, m/s
        self._targets = [(0.0, 0.0)] * len(starts)
        self._speeds = [(0.0, 0.0)] * len(starts)
        for index in range(len(starts)):
            self._set_motors(index)
        self._present = list(range(len(starts)))
        """the robots that are still in the arena"""
        self._obstacles: list[int] = []
        self._poses: Floats | None = None
        """the poses of this tick, once they were read"""
        for _ in range(round(_SETTLE_S * self._step_hz)):
            self.client.stepSimulation()

    def close(self) -> None:
        """Give the clients back; more than once does no harm."""
        self.client.close()
        self._ray_client.close()

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity, within its limits; held until the next one."""
        self._targets[index] = self._robot.rim_speeds(command)

    def step(self) -> None:
        """Let 1 / ``step_hz`` seconds pass; each wheel's speed comes nearer to its target.

        The ramp is the Gazebo plugin's wheelAcceleration, applied at every physics step. The plugin skips
        the ramp of both wheels as soon as one of them is near its target; that jump is not copied.
        """
        for index, (target, speed) in enumerate(zip(self._targets, self._speeds, strict=True)):
            if target != speed:
                self._speeds[index] = (self._nearer(speed[0], target[0]), self._nearer(speed[1], target[1]))
                self._set_motors(index)
        self.client.stepSimulation()
        self._poses = None

    def _nearer(self, speed: float, target: float) -> float:
        missing, most = target - speed, self._robot.rim_acceleration_mps2 * (1.0 / self._step_hz)
        return target if abs(missing) <= most else speed + math.copysign(most, missing)

    def _set_motors(self, index: int) -> None:
        robot, (body, wheels, _) = self._robot, self._bodies[index]
        self.client.setJointMotorControlArray(
            body,
            wheels,
            bullet.VELOCITY_CONTROL,
            targetVelocities=[speed / robot.wheel_radius_m for speed in self._speeds[index]],
            forces=(robot.wheel_torque_nm, robot.wheel_torque_nm),
        )

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way, the same number at each call; beams pass them."""
        if not self._obstacles:
            self._obstacles = [add_obstacle(self.client, solid) for solid in solids]
        for body, solid in zip(self._obstacles, solids, strict=True):
            move_obstacle(self.client, body, solid)

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame, under the middle of its axle."""
        if self._poses is None:
            fetch = self.client.getBasePositionAndOrientation
            places = np.full((len(self._bodies), 7), np.nan)
            for index in self._present:
                at, turn = fetch(self._bodies[index].body)
                places[index] = at + turn
            self._poses = base_poses(places, self._mass_x_m)
        return self._poses

    def velocities(self, rows: Ints) -> Floats:
        """(n, 2) forward speed (m/s) and yaw rate (rad/s) of ``rows``."""
        velocities = np.full((len(self._bodies), 2), np.nan)
        yaws = self.poses()[:, 2].tolist()
        for index in rows.tolist():
            (x, y, _), (_, _, turn) = self.client.getBaseVelocity(self._bodies[index].body)
            # the solver made this velocity at the heading that the step began with
            heading = yaws[index] - turn / self._step_hz
            c, s = cos_sin(heading)
            velocities[index] = x * c + y * s, turn
        return velocities

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned, radians."""
        angles = np.full((len(self._bodies), 2), np.nan)
        for index in self._present:
            body, wheels, _ = self._bodies[index]
            left, right = self.client.getJointStates(body, wheels)
            angles[index] = left[0], right[0]
        return angles

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        shape = beams.directions.shape[:2]
        starts, ends = np.full((2, *shape, 3), self._robot.lidar_height_m)
        starts[..., :2] = beams.axes[:, None] + near_m * beams.directions
        ends[..., :2] = beams.axes[:, None] + far_m * beams.directions
        starts, ends = starts.reshape(-1, 3), ends.reshape(-1, 3)
        fractions = np.empty(len(starts))
        for first in range(0, len(starts), BATCH):
            batch = slice(first, first + BATCH)
            hits = self._ray_client.rayTestBatch(starts[batch], ends[batch])
            fractions[batch] = [hit[2] for hit in hits]
        ranges = np.where(fractions < 1.0, near_m + fractions * (far_m - near_m), np.inf)
        return ranges.reshape(shape)

    def remove(self, index: int) -> None:
        """Take a robot out for good."""
        self.client.removeBody(self._bodies[index].body)
        self._targets[index] = self._speeds[index]
        self._present.remove(index)
        self._poses = None

    def contacts(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each robot touches anything but the floor now."""
        touching = np.zeros(len(self._bodies), dtype=np.bool_)
        for index in self._present:
            points = self.client.getContactPoints(bodyA=self._bodies[index].body, linkIndexA=-1)
            touching[index] = any(point[2] != self._floor and point[8] <= 0.0 for point in points)
        return touching


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
