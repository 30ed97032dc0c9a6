"""``World``: one trial's Burgers, walls and intruders in a PyBullet client of their own."""

import math
from collections.abc import Sequence
from types import TracebackType
from typing import Annotated, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field

from midnet_bench.arena.free_space import cells_near
from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.io.checked_yaml import Spec
from midnet_bench.messages import Command, Odometry
from midnet_bench.rng import stream
from midnet_bench.robots.burger import LDS_01
from midnet_bench.simulation import lidar
from midnet_bench.simulation.bullet import rays
from midnet_bench.simulation.bullet.body import Drive, load_burger
from midnet_bench.simulation.bullet.engine import bullet
from midnet_bench.simulation.bullet.stage import add_floor, add_solids

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

TOO_NEAR_M = 0.0
"""The range of a beam that ends before the sensor's least range, as the LDS-01's driver reports it."""

_SETTLE_S = 1.0
_BLIND_M = 0.20
"""No solid this far from the middle of the axle's cell can be within the sensor's least range."""
_CONTACT_HZ = 10
_EPISODE_GAP_S = 1.0


class WorldSettings(Spec):
    """How the world is stepped and sensed."""

    step_hz: Annotated[int, Field(ge=30, le=1000, multiple_of=10)] = 60
    solver_iterations: Annotated[int, Field(ge=1, le=1000)] = 50
    robot_profile: lidar.RobotProfile = "urdf"
    lidar_noise: lidar.LidarNoise = "gazebo"


class World:
    """Security robots (index 0 up) and, after them, mobile intruders, in the layout's order.

    Time is ``tick`` / ``settings.step_hz`` and starts at 0 once the robots have settled on their wheels.
    Two worlds made alike and driven alike agree bit for bit, in any process, next to any other world.
    Arrays come back read-only and are fresh per tick. Close it, or use it as a context manager.
    """

    def __init__(self, layout: Layout, settings: WorldSettings | None = None) -> None:
        self.layout = layout
        self.settings = settings or WorldSettings()
        self.tick = 0
        starts = layout.robots + layout.intruders
        self._client = bullet.connect(bullet.DIRECT)
        bullet.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / self.settings.step_hz,
            numSolverIterations=self.settings.solver_iterations,
            deterministicOverlappingPairs=1,
            physicsClientId=self._client,
        )
        bullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self._client)
        self._floor = add_floor(self._client)
        add_solids(self._client, layout.solids)
        self._burgers = [load_burger(self._client, pose) for pose in starts]
        self._drive = Drive(self._burgers, self._client, 1.0 / self.settings.step_hz)
        self._active = np.ones(len(starts), dtype=np.bool_)
        # Named by side, so that an intruder's sensor does not change with the size of the team.
        owners = [("robot", i) for i in range(len(layout.robots))]
        owners += [("intruder", i) for i in range(len(layout.intruders))]
        self._lidar_scales = np.array(
            [lidar.draw_scale(stream(layout.seed, "lidar scale", side, i)) for side, i in owners]
        )
        self._blind_cells = cells_near(layout.arena, layout.solids, _BLIND_M)
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_contact = np.full(len(starts), -(10**9), dtype=np.int64)
        self._poses: list[Pose2D | None] = [None] * len(starts)
        self._pose_array: Floats | None = None
        for _ in range(round(_SETTLE_S * self.settings.step_hz)):
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
        """Give a robot its new velocity; held until the next one. Clamped to the Burger's limits."""
        self._require(index)
        self._drive.command(index, command)

    def step(self) -> None:
        """Let one tick of 1 / ``step_hz`` seconds pass."""
        self._drive.step()
        bullet.stepSimulation(physicsClientId=self._client)
        self.tick += 1
        self._forget_poses()
        if self.tick % (self.settings.step_hz // _CONTACT_HZ) == 0:
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
            poses = np.array([self.pose(index) for index in range(len(self._burgers))])
            poses.flags.writeable = False
            self._pose_array = poses
        return self._pose_array

    def odometry(self, index: int) -> Odometry:
        """A robot's true pose, forward speed (m/s) and yaw rate (rad/s), map frame."""
        self._require(index)
        (x, y, _), (_, _, turn) = bullet.getBaseVelocity(self._burgers[index].body, self._client)
        pose = self.pose(index)
        return Odometry(pose, x * math.cos(pose.yaw) + y * math.sin(pose.yaw), turn)

    def wheel_angles(self, index: int) -> Floats:
        """(2,) how far a robot's left and right wheel have turned, radians."""
        self._require(index)
        body, wheels = self._burgers[index]
        states = bullet.getJointStates(body, wheels, physicsClientId=self._client)
        return np.array([state[0] for state in states])

    def scan(self, indices: Sequence[int], rngs: Sequence[np.random.Generator]) -> Floats:
        """(len(indices), beams) ranges of those robots' LiDARs at this tick, metres, in one batch of rays.

        inf where nothing reflects within range; 0 (``TOO_NEAR_M``) where something stands closer than
        the sensor's least range. ``rngs`` are the robots' noise generators, one per index.
        """
        return self.scan_and_bodies(indices, rngs)[0]

    def scan_and_bodies(
        self, indices: Sequence[int], rngs: Sequence[np.random.Generator]
    ) -> tuple[Floats, Ints]:
        """What ``scan`` gives, and beside it which robot each beam met, both (len(indices), beams).

        ``SOLID`` where it met a wall or a stationary intruder, ``NOTHING`` where it met nothing.
        """
        for index in indices:
            self._require(index)
        low, high = LDS_01.range_min_m, LDS_01.range_max_m
        profile = lidar.PROFILES[self.settings.robot_profile]
        rows = list(indices)
        beams = lidar.beams_from(self.poses()[rows])
        true_ranges = rays.cast_on_solids(self._client, beams, low, high)
        for row in self._near_solids(rows):
            # The rays above start past the sensor's housing; what stands nearer needs rays of its own.
            one = lidar.Beams(beams.axes[row : row + 1], beams.directions[row : row + 1])
            near = rays.cast_on_solids(self._client, one, 0.0, low)[0]
            true_ranges[row] = np.minimum(true_ranges[row], near)
        bodies = lidar.hide_behind_robots(true_ranges, beams, self.poses(), profile, rows, high)
        ranges = lidar.add_noise(true_ranges, self.settings.lidar_noise, self._lidar_scales[rows], rngs)
        ranges[true_ranges < low] = TOO_NEAR_M
        return ranges, bodies

    def scan_outline(self, index: int) -> Box:
        """The true box, map frame, of what beams see of a robot (item 45); NaN once it is removed."""
        profile = lidar.PROFILES[self.settings.robot_profile]
        center = self.pose(index).compose(Pose2D(profile.offset_x_m, 0.0, 0.0))
        return Box.square(center.x, center.y, 2.0 * profile.radius_m)

    def remove(self, index: int) -> None:
        """Take a robot out of the arena for good, as a caught intruder is."""
        self._require(index)
        bullet.removeBody(self._burgers[index].body, physicsClientId=self._client)
        self._drive.forget(index)
        self._active[index] = False
        self._forget_poses()

    def collisions(self) -> Ints:
        """(n,) how often each robot has run into something so far, looked at ten times a second.

        Touching counts once until a second has passed without it.
        """
        return self._collisions.copy()

    def _require(self, index: int) -> None:
        if not 0 <= index < len(self._burgers) or not self._active[index]:
            raise ValueError(
                f"robot {index} is not in this world (it has {len(self._burgers)}, or it was removed)"
            )

    def _forget_poses(self) -> None:
        self._poses = [None] * len(self._burgers)
        self._pose_array = None

    def _fetch_pose(self, index: int) -> Pose2D:
        if not self._active[index]:
            return Pose2D(math.nan, math.nan, math.nan)
        at, (x, y, z, w) = bullet.getBasePositionAndOrientation(self._burgers[index].body, self._client)
        return Pose2D(at[0], at[1], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def _near_solids(self, rows: list[int]) -> list[int]:
        """Which of ``rows``, by place, may have a solid within their sensor's least range."""
        grid = self._blind_cells
        cells = [grid.cell_at(*self.pose(row)[:2]) for row in rows]
        return [i for i, cell in enumerate(cells) if grid.contains_cell(*cell) and grid.data[cell[::-1]]]

    def _count_collisions(self) -> None:
        gap = _EPISODE_GAP_S * self.settings.step_hz
        for index in self._active.nonzero()[0].tolist():
            contacts = bullet.getContactPoints(
                bodyA=self._burgers[index].body, linkIndexA=-1, physicsClientId=self._client
            )
            if any(contact[2] != self._floor and contact[8] <= 0.0 for contact in contacts):
                if self.tick - self._last_contact[index] > gap:
                    self._collisions[index] += 1
                self._last_contact[index] = self.tick
