"""``World``: one trial's robots, walls and intruders in a PyBullet client of their own; and its ``Rays``.

What ``rayTestBatch`` takes grows with the number of its rays and with their length. ``reaches`` tells from
the solids' sides between which two distances a beam can meet anything first. Only that piece of it is cast,
and a beam that can meet nothing is not cast. The bounds err to the safe side by more than PyBullet's mesh.
"""

import math
from collections.abc import Sequence
from operator import itemgetter
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from midnet_bench.arena.layout import Layout
from midnet_bench.arena.solids import Solid
from midnet_bench.compiled import njit
from midnet_bench.elementary import atan2, cos, cos_sin, hypot
from midnet_bench.geometry import Pose2D
from midnet_bench.messages import Command
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.bullet.body import Drive, load_robot
from midnet_bench.simulation.bullet.engine import bullet, give_back, take_client
from midnet_bench.simulation.bullet.stage import add_floor, add_obstacle, add_solids, move_obstacle
from midnet_bench.simulation.integrity import surfaces
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams, require_active

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

_SETTLE_S = 1.0
_CONTACT_HZ = 10
_EPISODE_GAP_S = 1.0

MAX_BATCH = 16383
"""One ray more, and PyBullet answers with nothing at all."""
SECTORS = 180
"""of the full circle about a sensor, for each of which there is one pair of bounds"""
MARGIN_M = 0.01
"""PyBullet's mesh is met up to 0.3 mm beside the edges of the solids that it was made of."""
SLIVER = 1e-3
"""of a sector: a side that is seen so narrow, end on, is taken to be all where its nearer end is"""

_FRACTION = itemgetter(2)
"""of a ray's result, as PyBullet gives it"""


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
        self._mass_x_m = self._robots[0].mass_x_m if starts else 0.0
        self._drive = Drive(robot, self._robots, self._client, 1.0 / self.step_hz)
        self._active = np.ones(len(starts), dtype=np.bool_)
        self._present = list(range(len(starts)))
        """the robots that are still in the arena"""
        self._collisions = np.zeros(len(starts), dtype=np.int64)
        self._last_contact = np.full(len(starts), -(10**9), dtype=np.int64)
        self._obstacles: list[int] = []
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
        return self._rays.cast(beams, near_m, far_m)

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


class Rays:
    """Beams against all walls and stationary intruders, in a PyBullet client that holds nothing else.

    Beside floor and robots, which no beam meets, a ray would take a third longer.
    """

    def __init__(self, layout: Layout, height_m: float) -> None:
        """The scan plane lies ``height_m`` above the floor."""
        self._client = take_client()
        add_solids(self._client, layout.solids)
        self._sides = surfaces(layout)
        self._height_m = height_m

    def close(self) -> None:
        """Give the client back; more than once does no harm."""
        if self._client >= 0:
            give_back(self._client)
            self._client = -1

    def cast(self, beams: Beams, near_m: float, far_m: float) -> Floats:
        """(m, beams) metres from the axis to the first solid between near and far; inf if there is none."""
        starts, ends, spans, places = pieces(*beams, self._sides, near_m, far_m, self._height_m)
        ranges = np.full(beams.directions.shape[:2], np.inf)
        if len(places):
            meet(ranges.reshape(-1), places, spans, self.fractions(starts, ends))
        return ranges

    def fractions(self, starts: Floats, ends: Floats) -> Floats:
        """(n,) how far along each ray from (n, 3) starts to ends the first solid is; 1 if none."""
        return ray_fractions(self._client, starts, ends)


def ray_fractions(client: int, starts: Floats, ends: Floats) -> Floats:
    """(n,) how far along each ray the first solid is, 1 if there is none; (n, 3) starts and ends, metres.

    PyBullet answers with a tuple of tuples; most of what that costs is making them and giving them back.
    """
    fractions = np.empty(len(starts))
    for first in range(0, len(starts), MAX_BATCH):
        batch = slice(first, first + MAX_BATCH)
        hits = bullet.rayTestBatch(starts[batch], ends[batch], numThreads=1, physicsClientId=client)
        fractions[batch] = np.fromiter(map(_FRACTION, hits), np.float64, len(hits))
    return fractions


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


@njit
def pieces(
    axes: Floats, directions: Floats, sides: Floats, near_m: float, far_m: float, height_m: float
) -> tuple[Floats, Floats, Floats, Ints]:
    """Of the n beams that may meet a solid, the piece in which they do so.

    Returns its start and its end, (n, 3) each; (n, 2) how far from the axis these are; and (n,) the beam's
    place among all beams, counted sensor by sensor.
    """
    sensors, beams = directions.shape[:2]
    starts, ends = np.empty((sensors * beams, 3)), np.empty((sensors * beams, 3))
    spans = np.empty((sensors * beams, 2))
    places = np.empty(sensors * beams, dtype=np.int64)
    n = 0
    for i in range(sensors):
        nearest, farthest = reaches(axes[i, 0], axes[i, 1], sides, near_m, far_m)
        for k in range(beams):
            x, y = directions[i, k, 0], directions[i, k, 1]
            sector = int((atan2(y, x) + math.pi) * (SECTORS / (2.0 * math.pi))) % SECTORS
            start, end = max(near_m, nearest[sector]), min(far_m, farthest[sector])
            if start >= end:
                continue
            for axis in range(2):
                starts[n, axis] = axes[i, axis] + start * directions[i, k, axis]
                ends[n, axis] = axes[i, axis] + end * directions[i, k, axis]
            starts[n, 2] = ends[n, 2] = height_m
            spans[n, 0], spans[n, 1] = start, end
            places[n] = i * beams + k
            n += 1
    return starts[:n], ends[:n], spans[:n], places[:n]


@njit
def reaches(x: float, y: float, sides: Floats, near_m: float, far_m: float) -> tuple[Floats, Floats]:
    """Two of (SECTORS,): no beam from (x, y) meets a side before the first, each beam does by the second.

    Sector k holds the directions from -pi + 2 pi k / SECTORS up to the next. The first is inf where no side
    up to ``far_m`` reaches into it; the second where none beyond ``near_m`` covers all of it.
    """
    nearest, farthest = np.full(SECTORS, np.inf), np.full(SECTORS, np.inf)
    width = 2.0 * math.pi / SECTORS
    for side in range(len(sides)):
        ax, ay, bx, by = sides[side, 0] - x, sides[side, 1] - y, sides[side, 2] - x, sides[side, 3] - y
        reach_m = far_m + MARGIN_M
        if min(ax, bx) > reach_m or max(ax, bx) < -reach_m or min(ay, by) > reach_m or max(ay, by) < -reach_m:
            continue
        along_x, along_y = bx - ax, by - ay
        if ax * by - ay * bx < 0.0:
            ax, ay, bx, by, along_x, along_y = bx, by, ax, ay, -along_x, -along_y
        across = ax * by - ay * bx
        if across > reach_m * hypot(along_x, along_y):
            continue
        first_m, last_m = hypot(ax, ay), hypot(bx, by)
        # both directions as sectors, fractions of one included, from the right end to the left one
        first = (atan2(ay, ax) + math.pi) / width
        last = first + atan2(across, ax * bx + ay * by) / width
        # by so much a beam may pass an end and still meet the mesh, or meet the end and pass the mesh
        slack_first = MARGIN_M / (first_m + MARGIN_M) / width
        slack_last = MARGIN_M / (last_m + MARGIN_M) / width
        if last - first < SLIVER:
            first_m = last_m = min(first_m, last_m)
        left_m = first_m
        for k in range(math.floor(first - slack_first), math.floor(last + slack_last) + 1):
            right_m, left_m = left_m, last_m
            if k + 1 < last and last - first >= SLIVER:
                if k + 1 > first:
                    c, s = cos_sin((k + 1) * width - math.pi)
                    left_m = across / (c * along_y - s * along_x)
                else:
                    left_m = first_m
            sector = k % SECTORS
            least_m = min(right_m, left_m) * cos(width) - MARGIN_M
            nearest[sector] = min(nearest[sector], least_m)
            if least_m > near_m and k >= first + slack_first and k + 1 <= last - slack_last:
                farthest[sector] = min(farthest[sector], max(right_m, left_m) + MARGIN_M)
    return nearest, farthest


@njit
def meet(ranges: Floats, places: Ints, spans: Floats, met: Floats) -> None:
    """Put into ``ranges``, (all beams,), where each piece meets something: at its share ``met`` below 1."""
    for i in range(len(met)):
        if met[i] < 1.0:
            ranges[places[i]] = spans[i, 0] + met[i] * (spans[i, 1] - spans[i, 0])
