"""What PyBullet holds: robots' bodies, the floor, and all walls and stationary intruders as one mesh."""

import math
from typing import NamedTuple

import numpy as np

from midnet_bench.geometry import Pose2D, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.client import Client, bullet

# Collision groups: what a shape is, and (as its mask) with which groups it collides. PyBullet lets two shapes
# collide when either one's mask names the other's group, so every mask here is answered by the other side's.
# A ray acts as group 1, and sees nothing but what stands still: robots are discs in the scan plane, which
# simulation/sensors.py intersects exactly.
RAY, ROBOT, STATIC, FLOOR, ROLLER = 1, 2, 4, 8, 16


class Body(NamedTuple):
    """One robot in a PyBullet client."""

    body: int
    wheels: tuple[int, int]  # joints, left and right
    mass_x_m: float
    """of the point that PyBullet calls the body's position, its base's centre of mass, in the base frame"""


def load_robot(client: Client, robot: RobotModel, pose: Pose2D) -> Body:
    """A robot with its base frame at ``pose``. Wheels and caster touch the floor only."""
    if robot.urdf is None:
        return _build_robot(client, robot, pose)
    body = client.loadURDF(
        str(robot.urdf),
        [pose.x, pose.y, robot.base_link_height_m],
        bullet.getQuaternionFromEuler([0.0, 0.0, pose.yaw]),
        flags=bullet.URDF_USE_INERTIA_FROM_FILE,
    )
    links = {"base_link": -1}
    for joint in range(client.getNumJoints(body)):
        links[client.getJointInfo(body, joint)[12].decode()] = joint
    wheels = (links["wheel_left"], links["wheel_right"])
    return _on_wheels(client, body, wheels, links["caster"])


def _on_wheels(client: Client, body: int, wheels: tuple[int, int], caster: int) -> Body:
    """A loaded body of which only those links touch the floor."""
    rollers = (*wheels, caster)
    for link in range(-1, client.getNumJoints(body)):
        group, mask = (ROLLER, FLOOR) if link in rollers else (ROBOT, ROBOT | STATIC | FLOOR)
        client.setCollisionFilterGroupMask(body, link, group, mask)
        client.changeDynamics(body, link, contactProcessingThreshold=0.0)
    mass_x_m = client.getDynamicsInfo(body, -1)[3][0]
    return Body(body, wheels, mass_x_m)


WHEEL_FRICTION, CASTER_FRICTION = 1.0, 0.1  # those of the Burger's description
_CASTER_M = 0.005  # radius of the ball
_CASTER_INSIDE_M = 0.02  # from the body's end to the ball's middle, as a TurtleBot3 has it
_MASS_SHARE = 0.125
"""of the way from the axle to the caster, where the body's mass lies: on the axle it tips when it brakes"""
_WHEEL_MASS, _CASTER_MASS = 0.03, 0.005  # shares of the robot's mass


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
    middles = [(-mass_x, side, 0.0), (-mass_x, -side, 0.0), (caster_x - mass_x, 0.0, _CASTER_M - axle_z)]
    masses = [share * robot.mass_kg for share in (_WHEEL_MASS, _WHEEL_MASS, _CASTER_MASS)]
    level = [(0.0, 0.0, 0.0, 1.0)] * 3
    start = pose.compose(Pose2D(mass_x, 0.0, 0.0))
    body = client.createMultiBody(
        baseMass=robot.mass_kg - math.fsum(masses),
        baseCollisionShapeIndex=shape(bullet.GEOM_MESH, vertices=hull),
        basePosition=(start.x, start.y, axle_z),
        baseOrientation=bullet.getQuaternionFromEuler([0.0, 0.0, pose.yaw]),
        linkMasses=masses,
        linkCollisionShapeIndices=[wheel, wheel, ball],
        linkVisualShapeIndices=[-1] * 3,
        linkPositions=middles,
        linkOrientations=level,
        linkInertialFramePositions=[(0.0, 0.0, 0.0)] * 3,
        linkInertialFrameOrientations=level,
        linkParentIndices=[0] * 3,
        linkJointTypes=[bullet.JOINT_REVOLUTE, bullet.JOINT_REVOLUTE, bullet.JOINT_FIXED],
        linkJointAxis=[(0.0, 1.0, 0.0)] * 3,
    )
    inertia = robot.mass_kg * robot.gyration_radius_m * robot.gyration_radius_m
    client.changeDynamics(body, -1, localInertiaDiagonal=[inertia] * 3, linearDamping=0.0, angularDamping=0.0)
    for link, friction in ((0, WHEEL_FRICTION), (1, WHEEL_FRICTION), (2, CASTER_FRICTION)):
        client.changeDynamics(body, link, lateralFriction=friction)
    return _on_wheels(client, body, (0, 1), 2)._replace(mass_x_m=mass_x)


_BELOW_FLOOR_M = 0.05


def add_floor(client: Client) -> int:
    """The body id of an endless floor that robots stand on and beams do not see."""
    shape = client.createCollisionShape(bullet.GEOM_PLANE)
    return _add_static(client, shape, FLOOR, ROBOT | ROLLER)


def add_solids(client: Client, solids: tuple[Solid, ...]) -> int:
    """The body id of one triangle mesh of all ``solids``, which beams see and robots run into.

    Sides only: nothing reaches a top. The mesh is passed inline, because PyBullet remembers files by name.
    """
    vertices: list[list[float]] = []
    triangles: list[int] = []
    for solid in solids:
        outline = solid.outline()
        count, first = len(outline), len(vertices)
        for height in (-_BELOW_FLOOR_M, solid.height_m):
            vertices += np.column_stack((outline, np.full(count, height))).tolist()
        for corner in range(count):
            low, low_next = first + corner, first + (corner + 1) % count
            triangles += [low, low_next, low_next + count, low, low_next + count, low + count]
    shape = client.createCollisionShape(
        bullet.GEOM_MESH, vertices=vertices, indices=triangles, flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH
    )
    return _add_static(client, shape, STATIC, RAY | ROBOT)


def add_obstacle(client: Client, solid: Solid) -> int:
    """The body id of something that robots run into and beams do not see; :func:`move_obstacle` moves it."""
    if solid.kind == "cylinder":
        shape = client.createCollisionShape(
            bullet.GEOM_CYLINDER, radius=solid.length_m / 2.0, height=solid.height_m
        )
    else:
        half = [solid.length_m / 2.0, solid.width_m / 2.0, solid.height_m / 2.0]
        shape = client.createCollisionShape(bullet.GEOM_BOX, halfExtents=half)
    body = _add_static(client, shape, ROBOT, ROBOT)
    move_obstacle(client, body, solid)
    return body


def move_obstacle(client: Client, body: int, solid: Solid) -> None:
    """Put an obstacle where ``solid`` is now."""
    turn = bullet.getQuaternionFromEuler([0.0, 0.0, solid.pose.yaw])
    at = [solid.pose.x, solid.pose.y, solid.height_m / 2.0]
    client.resetBasePositionAndOrientation(body, at, turn)


def _add_static(client: Client, shape: int, group: int, mask: int) -> int:
    body = client.createMultiBody(0.0, shape)
    client.setCollisionFilterGroupMask(body, -1, group, mask)
    client.changeDynamics(body, -1, lateralFriction=1.0, contactProcessingThreshold=0.0)
    return int(body)
