"""``BulletEngine``: one trial's robots, walls and intruders in PyBullet, which nothing else here imports."""

import contextlib
import math
import os
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from inspect import isbuiltin
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos_sin
from midnet_bench.errors import InputError
from midnet_bench.geometry import Command, Floats, Indices, Pose2D, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import SOLVER_ITERATIONS, Beams


class PyBulletMissingError(InputError, ImportError):
    """PyBullet is not installed; an ImportError too, so that programs may look for it as for any package."""


@contextlib.contextmanager
def _stderr_to_nowhere() -> Iterator[None]:
    """Close file descriptor 2 to what C prints, unless it is closed already."""
    try:
        stderr = os.dup(2)
    except OSError:
        yield
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)


# The library prints its build time from C, past sys.stderr, in every process that loads it: in the middle of
# a progress bar. Only the first import has anything to silence.
try:
    with _stderr_to_nowhere():
        import pybullet as bullet
except ImportError as error:
    raise PyBulletMissingError(
        "PyBullet is not installed: the engine 'bullet' needs it, and its ready-made wheels end at "
        "CPython 3.11; take 'fast': --engine fast, or engine=\"fast\" in Python"
    ) from error

_SETTLE_S = 1.0
BATCH = 100
"""Rays in one call. PyBullet answers with three tuples for each, and once 700 are new, Python's garbage
collector runs: with all rays in one call, casting takes a third longer. PyBullet's limit is 16383."""

# Collision groups: what a shape is, and (as its mask) with which groups it collides. PyBullet lets two shapes
# collide when either one's mask names the other's group, so every mask here is answered by the other side's.
# A ray acts as group 1, and sees nothing but what stands still: robots are discs in the scan plane, which
# simulation/sensors.py intersects exactly.
RAY, ROBOT, STATIC, FLOOR, ROLLER = 1, 2, 4, 8, 16

WHEEL_FRICTION, CASTER_FRICTION = 1.0, 0.1  # those of the Burger's description
_CASTER_M = 0.005  # radius of the ball
_CASTER_INSIDE_M = 0.02  # from the body's end to the ball's middle, as a TurtleBot3 has it
_MASS_SHARE = 0.125
"""of the way from the axle to the caster, where the body's mass lies: on the axle it tips when it brakes"""
_WHEEL_MASS, _CASTER_MASS = 0.03, 0.005  # shares of the robot's mass
_BELOW_FLOOR_M = 0.05


class Client(SimpleNamespace):
    """An empty world of PyBullet's, with its functions: ``client.stepSimulation()``."""

    def __init__(self) -> None:
        self._number = int(bullet.connect(bullet.DIRECT))
        functions = {name: one for name, one in vars(bullet).items() if isbuiltin(one)}
        super().__init__(
            **{name: partial(one, physicsClientId=self._number) for name, one in functions.items()}
        )

    def close(self) -> None:
        """Give back what it holds; twice does no harm."""
        if self._number >= 0:
            self.disconnect()
            self._number = -1


class BulletEngine:
    """The :class:`~midnet_bench.simulation.engine.Engine` that PyBullet makes.

    The first step begins when the robots have settled on their wheels. Engines in one process do not touch
    each other.
    """

    def __init__(self, layout: Layout, robot: RobotModel, step_hz: int) -> None:
        self._robot = robot
        self._step_hz = step_hz
        self.client = Client()
        self._ray_client = Client()
        """the solids alone: beside floor and robots, which no beam meets, a ray takes a fifth longer"""
        try:
            self._build(layout)
        except BaseException:
            self.close()
            raise

    def _build(self, layout: Layout) -> None:
        """Load everything, and let the robots settle on their wheels."""
        starts = layout.robots + layout.intruders
        self.client.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self._step_hz,
            numSolverIterations=SOLVER_ITERATIONS,
            deterministicOverlappingPairs=1,
        )
        self.client.setGravity(0.0, 0.0, -9.81)
        floor = self.client.createCollisionShape(bullet.GEOM_PLANE)
        self._floor = add_static(self.client, floor, FLOOR, ROBOT | ROLLER)
        add_solids(self.client, layout.solids)
        add_solids(self._ray_client, layout.solids)
        self._bodies = [load_robot(self.client, self._robot, pose) for pose in starts]
        self._mass_x_m = self._bodies[0].mass_x_m if starts else 0.0
        self._targets, self._speeds = np.zeros((2, len(starts), 2))  # of the rims, left and right, m/s
        for index in range(len(starts)):
            self._set_motors(index)
        self._present = list(range(len(starts)))  # the robots that are still in the arena
        self._obstacles: list[int] = []
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
        missing = self._targets - self._speeds
        most = self._robot.rim_acceleration_mps2 * (1.0 / self._step_hz)
        nearer = self._speeds + np.copysign(most, missing)
        self._speeds = np.where(np.abs(missing) <= most, self._targets, nearer)
        for index in np.flatnonzero(missing.any(axis=1)).tolist():
            self._set_motors(index)
        self.client.stepSimulation()

    def _set_motors(self, index: int) -> None:
        robot, (body, wheels, _) = self._robot, self._bodies[index]
        self.client.setJointMotorControlArray(
            body,
            wheels,
            bullet.VELOCITY_CONTROL,
            targetVelocities=(self._speeds[index] / robot.wheel_radius_m).tolist(),
            forces=(robot.wheel_torque_nm, robot.wheel_torque_nm),
        )

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way, the same number at each call; beams pass them."""
        if not self._obstacles:
            self._obstacles = [add_obstacle(self.client, solid) for solid in solids]
        for body, solid in zip(self._obstacles, solids, strict=True):
            at = [solid.pose.x, solid.pose.y, solid.height_m / 2.0]
            self.client.resetBasePositionAndOrientation(body, at, turned(solid.pose.yaw))

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame, under the middle of its axle."""
        places = np.full((len(self._bodies), 7), np.nan)
        for index in self._present:
            at, turn = self.client.getBasePositionAndOrientation(self._bodies[index].body)
            places[index] = at + turn
        return np.asarray(base_poses(places, self._mass_x_m))

    def velocities(self, rows: Indices) -> Floats:
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


class Body(NamedTuple):
    """One robot in a PyBullet client."""

    body: int
    wheels: tuple[int, int]  # joints, left and right
    mass_x_m: float
    """of the point that PyBullet calls the body's position, its base's centre of mass, in the base frame"""


def turned(yaw_rad: float) -> tuple[float, ...]:
    """The quaternion x, y, z, w of a turn."""
    quaternion: tuple[float, ...] = bullet.getQuaternionFromEuler([0.0, 0.0, yaw_rad])
    return quaternion


def load_robot(client: Client, robot: RobotModel, pose: Pose2D) -> Body:
    """A robot with its base frame at ``pose``, by its description, or of its measures without one.

    Wheels and caster touch the floor only.
    """
    if robot.urdf is None:
        return _build_robot(client, robot, pose)
    body = client.loadURDF(
        str(robot.urdf),
        [pose.x, pose.y, robot.base_link_height_m],
        turned(pose.yaw),
        flags=bullet.URDF_USE_INERTIA_FROM_FILE,
    )
    joints = range(client.getNumJoints(body))
    links = {client.getJointInfo(body, joint)[12].decode(): joint for joint in joints}
    return _on_wheels(client, body, (links["wheel_left"], links["wheel_right"]), links["caster"])


def _on_wheels(client: Client, body: int, wheels: tuple[int, int], caster: int) -> Body:
    """A loaded body of which only those links touch the floor."""
    rollers = (*wheels, caster)
    for link in range(-1, client.getNumJoints(body)):
        group, mask = (ROLLER, FLOOR) if link in rollers else (ROBOT, ROBOT | STATIC | FLOOR)
        client.setCollisionFilterGroupMask(body, link, group, mask)
        client.changeDynamics(body, link, contactProcessingThreshold=0.0)
    return Body(body, wheels, client.getDynamicsInfo(body, -1)[3][0])


def _build_robot(client: Client, robot: RobotModel, pose: Pose2D) -> Body:
    """A body of a robot's measures: its hull from above, two wheels and a ball under the longer end."""
    front, back = max(x for x, _ in robot.body), min(x for x, _ in robot.body)
    caster_x = back + _CASTER_INSIDE_M if -back >= front else front - _CASTER_INSIDE_M
    mass_x, axle_z = _MASS_SHARE * caster_x, robot.wheel_radius_m
    low, high = 0.25 * axle_z, max(robot.lidar_height_m, axle_z)
    hull = [(x - mass_x, y, z - axle_z) for x, y in robot.body for z in (low, high)]

    shape = client.createCollisionShape
    wheel = shape(bullet.GEOM_SPHERE, radius=robot.wheel_radius_m)
    ball = shape(bullet.GEOM_SPHERE, radius=_CASTER_M)
    side = robot.wheel_separation_m / 2.0
    masses = [share * robot.mass_kg for share in (_WHEEL_MASS, _WHEEL_MASS, _CASTER_MASS)]
    level = [(0.0, 0.0, 0.0, 1.0)] * 3
    start = pose.compose(Pose2D(mass_x, 0.0, 0.0))
    body = client.createMultiBody(
        baseMass=robot.mass_kg - math.fsum(masses),
        baseCollisionShapeIndex=shape(bullet.GEOM_MESH, vertices=hull),
        basePosition=(start.x, start.y, axle_z),
        baseOrientation=turned(pose.yaw),
        linkMasses=masses,
        linkCollisionShapeIndices=[wheel, wheel, ball],
        linkVisualShapeIndices=[-1] * 3,
        linkPositions=[
            (-mass_x, side, 0.0),
            (-mass_x, -side, 0.0),
            (caster_x - mass_x, 0.0, _CASTER_M - axle_z),
        ],
        linkOrientations=level,
        linkInertialFramePositions=[(0.0, 0.0, 0.0)] * 3,
        linkInertialFrameOrientations=level,
        linkParentIndices=[0] * 3,
        linkJointTypes=[bullet.JOINT_REVOLUTE, bullet.JOINT_REVOLUTE, bullet.JOINT_FIXED],
        linkJointAxis=[(0.0, 1.0, 0.0)] * 3,
    )
    inertia = robot.mass_kg * robot.gyration_radius_m * robot.gyration_radius_m
    client.changeDynamics(body, -1, localInertiaDiagonal=[inertia] * 3, linearDamping=0.0, angularDamping=0.0)
    for link, friction in enumerate((WHEEL_FRICTION, WHEEL_FRICTION, CASTER_FRICTION)):
        client.changeDynamics(body, link, lateralFriction=friction)
    return _on_wheels(client, body, (0, 1), 2)._replace(mass_x_m=mass_x)


def add_static(client: Client, shape: int, group: int, mask: int) -> int:
    """The body id of something that nothing moves."""
    body = client.createMultiBody(0.0, shape)
    client.setCollisionFilterGroupMask(body, -1, group, mask)
    client.changeDynamics(body, -1, lateralFriction=1.0, contactProcessingThreshold=0.0)
    return int(body)


def add_solids(client: Client, solids: tuple[Solid, ...]) -> int:
    """The body id of one triangle mesh of all ``solids``, which beams see and robots run into.

    Sides only: nothing reaches a top. The mesh is passed inline, because PyBullet remembers files by name.
    """
    vertices: list[list[float]] = []
    triangles: list[int] = []
    for solid in solids:
        outline = solid.outline
        count, first = len(outline), len(vertices)
        for height in (-_BELOW_FLOOR_M, solid.height_m):
            vertices += np.column_stack((outline, np.full(count, height))).tolist()
        for corner in range(count):
            low, low_next = first + corner, first + (corner + 1) % count
            triangles += [low, low_next, low_next + count, low, low_next + count, low + count]
    shape = client.createCollisionShape(
        bullet.GEOM_MESH, vertices=vertices, indices=triangles, flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH
    )
    return add_static(client, shape, STATIC, RAY | ROBOT)


def add_obstacle(client: Client, solid: Solid) -> int:
    """The body id of something that robots run into and beams do not see."""
    half_m = [solid.length_m / 2.0, solid.width_m / 2.0, solid.height_m / 2.0]
    if solid.kind == "cylinder":
        shape = client.createCollisionShape(bullet.GEOM_CYLINDER, radius=half_m[0], height=solid.height_m)
    else:
        shape = client.createCollisionShape(bullet.GEOM_BOX, halfExtents=half_m)
    return add_static(client, shape, ROBOT, ROBOT)
