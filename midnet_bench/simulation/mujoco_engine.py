"""``MujocoEngine``: the engine ``mujoco``, planar bodies with two wheels; the extra ``midnet-bench[mujoco]``.

Wheels that stand on a floor as contacts were tried. MuJoCo's convex contact lifts what slides: a robot that
pushes a wall hopped by 5 mm and stood up to 20 mm off it. So a wheel is what it does to the body: a motor at
the point where it touches the floor, whose force stays within what the tyre can transmit.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from midnet_bench.arena.layout import Layout
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Booleans, Command, Floats, Pose2D, Solid
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import Beams

LEAST_HZ = 120  # a longer tick is stepped in pieces: a body gets into another by what it drives in a step
STIFFNESS = 2.0  # speed that a tyre lacks falls by 1 + this in a step, or as fast as its grip allows
GRAVITY_MPS2, GRIP = 9.81, 1.0
WALL_FRICTION, BODY_FRICTION = 0.5, 0.25
"""MuJoCo takes the larger of both sides: 0.5 on walls, 0.25 between robots, as on the other engines"""
IMPEDANCE = 0.99
"""of contacts, for MuJoCo's ``solimp``: the nearer to 1, the less a steady push gets into a wall"""
STILL, ROBOTS = 0, 1  # groups of shapes; beams look for the first
ALONG_LEFT, ALONG_RIGHT, ASIDE = range(3)  # the motors of a robot: both wheels roll, the axle does not slide


class MujocoEngine:
    """The :class:`~midnet_bench.simulation.engine.Engine` that MuJoCo makes."""

    def __init__(self, layout: Layout, robot: RobotModel, step_hz: int) -> None:
        self._robot, self._step_hz = robot, step_hz
        starts = np.array(layout.robots + layout.intruders).reshape(-1, 3)
        self._pieces = math.ceil(LEAST_HZ / step_hz)
        self._spec = described(layout, robot, len(starts), 1.0 / step_hz / self._pieces)
        self._model = self._spec.compile()
        self._data = mujoco.MjData(self._model)
        self._look()
        self._places[:] = starts
        mujoco.mj_forward(self._model, self._data)
        self._asked, self._rims = np.zeros((2, len(starts), 2))
        self._wheels = np.zeros((len(starts), 2))

    def _look(self) -> None:
        self._places = self._data.qpos.reshape(-1, 3)
        self._motors = self._data.ctrl.reshape(-1, 3)
        self._owners = self._model.geom_bodyid.astype(np.int64) - 1
        """(shapes,) whose each is; robots come first, and what is no robot's is below 0 or beyond them"""

    def step(self) -> None:
        """Let 1 / ``step_hz`` seconds pass."""
        most = self._robot.rim_acceleration_mps2 / self._step_hz
        self._rims += np.clip(self._asked - self._rims, -most, most)
        self._wheels += self._rims / self._robot.wheel_radius_m / self._step_hz
        self._motors[:, [ALONG_LEFT, ALONG_RIGHT]] = self._rims
        mujoco.mj_step(self._model, self._data, self._pieces)

    def drive(self, index: int, command: Command) -> None:
        """Give a robot its new velocity, within its limits; held until the next one."""
        self._asked[index] = self._robot.rim_speeds(command)

    def remove(self, index: int) -> None:
        """Let a robot stand where it is, and everything pass through it."""
        self._asked[index] = 0.0
        shapes = self._owners == index
        self._model.geom_contype[shapes] = self._model.geom_conaffinity[shapes] = 0

    def obstruct(self, solids: Sequence[Solid]) -> None:
        """Let ``solids`` stand in the robots' way, the same number at each call; beams pass them."""
        if not self._model.nmocap:
            for number, solid in enumerate(solids):
                body = self._spec.worldbody.add_body(name=f"obstacle {number}", mocap=True)
                upright = replace(solid, pose=Pose2D(0.0, 0.0, 0.0))
                add_solid(self._spec, body, upright, f"obstacle {number}", ROBOTS)
            self._model, self._data = self._spec.recompile(self._model, self._data)
            self._look()
            mujoco.mj_forward(self._model, self._data)
        for number, (x, y, yaw) in enumerate(solid.pose for solid in solids):
            self._data.mocap_pos[number, :2] = x, y
            self._data.mocap_quat[number] = about_z(yaw)

    def poses(self) -> Floats:
        """(n, 3) x, y, yaw of each robot's base frame."""
        poses = self._places.copy()
        poses[:, 2] = (poses[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        return poses

    def wheel_angles(self) -> Floats:
        """(n, 2) how far the left and right wheel have turned; they turn on while they slip."""
        return self._wheels

    def contacts(self) -> Booleans:
        """(n,) whether each robot touches anything now."""
        contacts = self._data.contact
        shapes = contacts.geom[contacts.dist <= 0.0]
        return np.isin(np.arange(len(self._places)), self._owners[shapes])

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        model, data, count = self._model, self._data, beams.directions.shape[1]
        ranges = np.empty(beams.directions.shape[:2])
        axis, ways = np.full(3, self._robot.lidar_height_m), np.zeros((count, 3))
        groups = np.zeros(6, dtype=np.uint8)
        groups[STILL] = 1
        met = np.empty(count, dtype=np.int32)
        for place, directions, found in zip(beams.axes, beams.directions, ranges, strict=True):
            axis[:2], ways[:, :2] = place, directions
            mujoco.mj_multiRay(
                model, data, axis, ways.reshape(-1), groups, True, -1, met, found, None, count, far_m
            )
            # what begins too near may end, or hide something, farther on
            for k in np.flatnonzero((met >= 0) & (found < near_m)).tolist():
                start = axis + near_m * ways[k]
                beyond_m = mujoco.mj_ray(model, data, start, ways[k], groups, True, -1, met[k : k + 1])
                found[k] = near_m + beyond_m
            found[(met < 0) | (found > far_m)] = np.inf
        return ranges


def described(layout: Layout, robot: RobotModel, robots: int, step_s: float) -> mujoco.MjSpec:
    """All that stands still, and ``robots`` bodies at the origin, whose three joints are x, y and yaw."""
    spec = mujoco.MjSpec()
    spec.option.timestep = step_s
    spec.option.gravity = np.zeros(3)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    shape = spec.default.geom
    shape.type = mujoco.mjtGeom.mjGEOM_MESH
    shape.solref = [2.0 * step_s, 1.0]  # as hard as a contact may be, and without bouncing
    shape.solimp[:2] = IMPEDANCE
    for number, solid in enumerate(layout.solids):
        add_solid(spec, spec.worldbody, solid, f"solid {number}", STILL)
    add_prism(spec, "body", np.array(robot.body), robot.lidar_height_m)
    for number in range(robots):
        add_robot(spec, robot, f"robot {number}")
    return spec


def about_z(yaw_rad: float) -> tuple[float, float, float, float]:
    """The quaternion w, x, y, z of a turn."""
    c, s = cos_sin(yaw_rad / 2.0)
    return c, 0.0, 0.0, s


def add_solid(spec: mujoco.MjSpec, body: mujoco.MjsBody, solid: Solid, name: str, group: int) -> None:
    """Shape a body: a box as such, since beams find it in half the time, or an outline."""
    shape = body.add_geom(group=group, friction=[WALL_FRICTION, 0.0, 0.0])
    if solid.kind == "cylinder":
        add_prism(spec, name, solid.outline, solid.height_m)
        shape.meshname = name
        return
    half_m = np.array([solid.length_m, solid.width_m, solid.height_m]) / 2.0
    shape.type, shape.size = mujoco.mjtGeom.mjGEOM_BOX, half_m
    shape.pos, shape.quat = [solid.pose.x, solid.pose.y, half_m[2]], about_z(solid.pose.yaw)


def add_prism(spec: mujoco.MjSpec, name: str, outline: Floats, height_m: float) -> None:
    """An upright mesh on the floor: the convex hull of (k, 2) corners."""
    rings = [np.column_stack((outline, np.full(len(outline), z_m))) for z_m in (0.0, height_m)]
    spec.add_mesh(name=name, uservert=np.concatenate(rings).ravel())


def add_robot(spec: mujoco.MjSpec, robot: RobotModel, name: str) -> None:
    """A body with its motors: speeds of the rims, forces within the grip of the weight on the wheels."""
    inertia = robot.mass_kg * robot.gyration_radius_m * robot.gyration_radius_m
    body = spec.worldbody.add_body(
        name=name, mass=robot.mass_kg, inertia=np.full(3, inertia), explicitinertial=True
    )
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 1, 0])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
    body.add_geom(meshname="body", group=ROBOTS, friction=[BODY_FRICTION, 0.0, 0.0])
    half_m = robot.wheel_separation_m / 2.0
    # the share of both wheels, how far aside, and along which axis of the body
    motors = {ALONG_LEFT: (0.5, half_m, 0), ALONG_RIGHT: (0.5, -half_m, 0), ASIDE: (1.0, 0.0, 1)}
    for motor, (share, side_m, axis) in motors.items():
        point = f"{name} {motor}"
        body.add_site(name=point, pos=[0.0, side_m, 0.0])
        most_n = share * GRIP * GRAVITY_MPS2 * robot.mass_kg
        added = spec.add_actuator(
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target=point,
            gear=np.eye(6)[axis],
            forcelimited=True,
            forcerange=[-most_n, most_n],
        )
        added.set_to_velocity(kv=share * STIFFNESS * robot.mass_kg / spec.option.timestep)
