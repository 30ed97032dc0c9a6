"""A robot's body in PyBullet, and its drive."""

import math
from typing import NamedTuple

from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.client import bullet

# Collision groups: what a shape is, and (as its mask) with which groups it collides. PyBullet lets two shapes
# collide when either one's mask names the other's group, so every mask here is answered by the other side's.
# A ray acts as group 1, and sees nothing but what stands still: robots are discs in the scan plane, which
# simulation/lidar.py intersects exactly.
RAY, ROBOT, STATIC, FLOOR, ROLLER = 1, 2, 4, 8, 16


class Body(NamedTuple):
    """One robot in a PyBullet client."""

    body: int
    wheels: tuple[int, int]
    """joints, left and right"""
    mass_x_m: float
    """of the point that PyBullet calls the body's position, its base's centre of mass, in the base frame"""


def load_robot(client: int, robot: RobotModel, pose: Pose2D) -> Body:
    """A robot with its base frame at ``pose``. Wheels and caster touch the floor only."""
    if robot.urdf is None:
        return _build_robot(client, robot, pose)
    body = bullet.loadURDF(
        str(robot.urdf),
        [pose.x, pose.y, robot.base_link_height_m],
        bullet.getQuaternionFromEuler([0.0, 0.0, pose.yaw]),
        flags=bullet.URDF_USE_INERTIA_FROM_FILE,
        physicsClientId=client,
    )
    links = {"base_link": -1}
    for joint in range(bullet.getNumJoints(body, physicsClientId=client)):
        links[bullet.getJointInfo(body, joint, physicsClientId=client)[12].decode()] = joint
    wheels = (links["wheel_left"], links["wheel_right"])
    return _on_wheels(client, body, wheels, links["caster"])


def _on_wheels(client: int, body: int, wheels: tuple[int, int], caster: int) -> Body:
    """A loaded body of which only those links touch the floor."""
    rollers = (*wheels, caster)
    for link in range(-1, bullet.getNumJoints(body, physicsClientId=client)):
        group, mask = (ROLLER, FLOOR) if link in rollers else (ROBOT, ROBOT | STATIC | FLOOR)
        bullet.setCollisionFilterGroupMask(body, link, group, mask, physicsClientId=client)
        bullet.changeDynamics(body, link, contactProcessingThreshold=0.0, physicsClientId=client)
    mass_x_m = bullet.getDynamicsInfo(body, -1, physicsClientId=client)[3][0]
    return Body(body, wheels, mass_x_m)


WHEEL_FRICTION, CASTER_FRICTION = 1.0, 0.1
"""those of the Burger's description"""
_CASTER_M = 0.005
"""radius of the ball"""
_CASTER_INSIDE_M = 0.02
"""from the body's end to the ball's middle, as a TurtleBot3 has it"""
_MASS_SHARE = 0.125
"""of the way from the axle to the caster, where the body's mass lies: on the axle it tips when it brakes"""
_WHEEL_MASS, _CASTER_MASS = 0.03, 0.005
"""shares of the robot's mass"""


def _build_robot(client: int, robot: RobotModel, pose: Pose2D) -> Body:
    """A body of a robot's measures: its hull from above, two wheels and a ball under the longer end."""
    front, back = max(x for x, _ in robot.body), min(x for x, _ in robot.body)
    caster_x = back + _CASTER_INSIDE_M if -back >= front else front - _CASTER_INSIDE_M
    mass_x, axle_z = _MASS_SHARE * caster_x, robot.wheel_radius_m
    low, high = 0.25 * axle_z, max(robot.lidar_height_m, axle_z)
    hull = [(x - mass_x, y, z - axle_z) for x, y in robot.body for z in (low, high)]

    def shape(kind: int, **measures: object) -> int:
        return int(bullet.createCollisionShape(kind, physicsClientId=client, **measures))

    wheel = shape(bullet.GEOM_SPHERE, radius=robot.wheel_radius_m)
    ball = shape(bullet.GEOM_SPHERE, radius=_CASTER_M)
    side = robot.wheel_separation_m / 2.0
    middles = [(-mass_x, side, 0.0), (-mass_x, -side, 0.0), (caster_x - mass_x, 0.0, _CASTER_M - axle_z)]
    masses = [share * robot.mass_kg for share in (_WHEEL_MASS, _WHEEL_MASS, _CASTER_MASS)]
    level = [(0.0, 0.0, 0.0, 1.0)] * 3
    start = pose.compose(Pose2D(mass_x, 0.0, 0.0))
    body = bullet.createMultiBody(
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
        physicsClientId=client,
    )
    inertia = robot.mass_kg * robot.gyration_radius_m * robot.gyration_radius_m
    bullet.changeDynamics(
        body,
        -1,
        localInertiaDiagonal=[inertia] * 3,
        linearDamping=0.0,
        angularDamping=0.0,
        physicsClientId=client,
    )
    for link, friction in ((0, WHEEL_FRICTION), (1, WHEEL_FRICTION), (2, CASTER_FRICTION)):
        bullet.changeDynamics(body, link, lateralFriction=friction, physicsClientId=client)
    return _on_wheels(client, body, (0, 1), 2)._replace(mass_x_m=mass_x)


class Drive:
    """The wheel motors of several robots: clamps commands and ramps each wheel towards its target.

    The ramp is the Gazebo plugin's wheelAcceleration, applied at every physics step. The plugin skips
    the ramp of both wheels as soon as one of them is near its target; that jump is not copied.
    """

    def __init__(self, robot: RobotModel, bodies: list[Body], client: int, step_s: float) -> None:
        self._robot = robot
        self._bodies = bodies
        self._client = client
        self._most = robot.rim_acceleration_mps2 * step_s
        self._targets = [(0.0, 0.0)] * len(bodies)
        self._speeds = [(0.0, 0.0)] * len(bodies)
        for number in range(len(bodies)):
            self._set_motors(number)

    def command(self, number: int, command: Command) -> None:
        """Take a new command; it is held until the next one, as the plugin holds it."""
        self._targets[number] = self._robot.rim_speeds(command)

    def step(self) -> None:
        """Move every wheel's speed one physics step closer to its target."""
        for number, (target, speed) in enumerate(zip(self._targets, self._speeds, strict=True)):
            if target != speed:
                self._speeds[number] = (
                    self._nearer(speed[0], target[0]),
                    self._nearer(speed[1], target[1]),
                )
                self._set_motors(number)

    def forget(self, number: int) -> None:
        """Never touch that robot's motors again."""
        self._targets[number] = self._speeds[number]

    def _nearer(self, speed: float, target: float) -> float:
        missing = target - speed
        return target if abs(missing) <= self._most else speed + math.copysign(self._most, missing)

    def _set_motors(self, number: int) -> None:
        body, robot = self._bodies[number], self._robot
        bullet.setJointMotorControlArray(
            body.body,
            body.wheels,
            bullet.VELOCITY_CONTROL,
            targetVelocities=[speed / robot.wheel_radius_m for speed in self._speeds[number]],
            forces=(robot.wheel_torque_nm, robot.wheel_torque_nm),
            physicsClientId=self._client,
        )
