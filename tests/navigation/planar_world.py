"""A small world for the tests: boxes and Burgers in the plane, analytic scans, exact unicycle motion."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import STOP, Box, Command, LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.navigator import Navigator, Status
from midnet_bench.robots.turtlebot3 import LDS_01
from tests.mapping.drawn_buildings import cast

LDS_RADIUS_M = 0.055
LDS_CENTRE = Pose2D(-0.017, 0.0, 0.0)
BODY = np.array(
    [(x, y) for x in np.linspace(-0.102, 0.038, 15) for y in (-0.089, 0.089)]
    + [(x, y) for y in np.linspace(-0.089, 0.089, 18) for x in (-0.102, 0.038)]
)


def bresenham(x0: int, y0: int, x1: int, y1: int) -> list[tuple[int, int]]:
    """The cells of a line by its closed form."""
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    sx, sy = (1 if x1 > x0 else -1), (1 if y1 > y0 else -1)
    major = max(dx, dy)
    cells = []
    for i in range(major + 1):
        minor = (major // 2 + i * min(dx, dy)) // major if major else 0
        cells.append((x0 + sx * i, y0 + sy * minor) if dx >= dy else (x0 + sx * minor, y0 + sy * i))
    return cells


@dataclass
class World:
    """Axis-aligned walls; cells of ``occupancy`` are occupied when a wall covers their centre."""

    boxes: list[Box]
    extent: Box
    resolution: float = 0.05

    def occupancy(self) -> OccupancyGrid:
        x0, y0, x1, y1 = self.extent
        columns = x0 + (np.arange(round((x1 - x0) / self.resolution)) + 0.5) * self.resolution
        rows = y0 + (np.arange(round((y1 - y0) / self.resolution)) + 0.5) * self.resolution
        data = np.zeros((len(rows), len(columns)), dtype=np.int8)
        for box in self.boxes:
            inside_x = (box.x_min <= columns) & (columns < box.x_max)
            inside_y = (box.y_min <= rows) & (rows < box.y_max)
            data[np.ix_(inside_y, inside_x)] = 100
        return OccupancyGrid(data, self.resolution, (x0, y0))

    def scan(
        self,
        pose: Pose2D,
        others: list[Pose2D],
        geometry: LidarGeometry,
        noise: npt.NDArray[np.float64] | float = 0.0,
    ) -> npt.NDArray[np.float64]:
        sensor = pose.compose(geometry.mount)
        angles = geometry.angles_rad + sensor.yaw
        ux, uy = np.cos(angles), np.sin(angles)
        ranges = cast(self.boxes, sensor.x, sensor.y, angles)
        for other in others:
            disc = other.compose(LDS_CENTRE)
            dx, dy = disc.x - sensor.x, disc.y - sensor.y
            along = dx * ux + dy * uy
            off = LDS_RADIUS_M**2 - (dx * dx + dy * dy - along * along)
            entry = along - np.sqrt(np.maximum(off, 0.0))
            ranges = np.where((off > 0.0) & (entry > 0.0) & (entry < ranges), entry, ranges)
        ranges = ranges + noise
        ranges[(ranges < geometry.range_min_m) | (ranges >= geometry.range_max_m)] = np.inf
        return ranges

    def body_hits(self, pose: Pose2D, others: list[Pose2D]) -> bool:
        """Whether a Burger's body at ``pose`` is in a wall or in the body of another one."""
        points = [pose.compose(Pose2D(float(x), float(y), 0.0)) for x, y in BODY]
        if any(b.x_min < p.x < b.x_max and b.y_min < p.y < b.y_max for b in self.boxes for p in points):
            return True
        backs = [other.inverse() for other in others if pose.distance_to(other) < 0.3]
        inside = (back.compose(point) for back in backs for point in points)
        return any(-0.102 < p.x < 0.038 and abs(p.y) < 0.089 for p in inside)


def moved(pose: Pose2D, command: Command, seconds: float) -> Pose2D:
    """The exact pose after an arc."""
    v, w = command
    half = 0.5 * w * seconds
    chord = v * seconds * (math.sin(half) / half if half else 1.0)
    return pose.compose(Pose2D(chord * math.cos(half), chord * math.sin(half), 2.0 * half))


def ramped(velocity: Command, wanted: Command, rim_step_mps: float) -> Command:
    """The next velocity, when no wheel's rim changes its speed by more than ``rim_step_mps``."""
    half = 0.08
    wheels = []
    for side in (-1.0, 1.0):
        now = velocity.linear_mps + side * half * velocity.angular_radps
        target = wanted.linear_mps + side * half * wanted.angular_radps
        wheels.append(now + min(max(target - now, -rim_step_mps), rim_step_mps))
    return Command((wheels[0] + wheels[1]) / 2.0, (wheels[1] - wheels[0]) / (2.0 * half))


@dataclass
class Robot:
    navigator: Navigator
    pose: Pose2D
    velocity: Command = STOP
    travelled_m: float = 0.0
    hits: int = 0  # control periods that ended with the body in a wall or in another robot


def drive(
    world: World,
    robots: list[Robot],
    seconds: float,
    sigma_m: float = 0.0,
    seed: int = 0,
    others: list[Pose2D] | None = None,
    on_tick: Callable[[float], object] | None = None,
) -> float:
    """The seconds until no robot is active; control at 10 Hz, scans at 5 Hz, rims that gain 1 m/s2.

    ``others`` are Burgers that ``on_tick`` may move. Robots pass through walls and through each other.
    """
    geometry = LDS_01
    rng = np.random.default_rng(seed)
    others = others if others is not None else []
    for tick in range(round(seconds * 10)):
        now = tick / 10
        poses = [robot.pose for robot in robots]
        for i, robot in enumerate(robots):
            seen = poses[:i] + poses[i + 1 :] + others
            if (tick + i) % 2 == 0:
                ranges = world.scan(robot.pose, seen, geometry, rng.normal(0.0, sigma_m, geometry.beams))
                robot.navigator.observe(robot.pose, ranges, geometry, now)
            wanted = robot.navigator.control(robot.pose, robot.velocity, now)
            robot.velocity = ramped(robot.velocity, wanted, 0.1)
        for robot in robots:
            before = robot.pose
            robot.pose = moved(robot.pose, robot.velocity, 0.1)
            robot.travelled_m += before.distance_to(robot.pose)
        poses = [robot.pose for robot in robots]
        for i, robot in enumerate(robots):
            robot.hits += world.body_hits(robot.pose, poses[:i] + poses[i + 1 :] + others)
        if on_tick is not None:
            on_tick(now)
        if all(robot.navigator.status is not Status.ACTIVE for robot in robots):
            return now
    return seconds
