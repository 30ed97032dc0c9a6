"""Buildings drawn by chance and the maps that a robot with a LiDAR makes of a part of them."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid

WALL_M = 0.15
RANGE_M = 3.5
VALUES = {" ": 0, "#": 100, "?": -1, ".": 30, "~": 50, "i": 99}


def grid(picture: str, resolution: float = 1.0, origin: tuple[float, float] = (0.0, 0.0)) -> OccupancyGrid:
    """A map or costmap drawn as text; the first line has the highest y."""
    rows = [[VALUES[letter] for letter in line] for line in reversed(picture.strip("\n").split("\n"))]
    return OccupancyGrid(np.array(rows, dtype=np.int8), resolution, origin)


class Building(NamedTuple):
    boxes: list[Box]
    width_m: float
    height_m: float


def wall(x0: float, y0: float, x1: float, y1: float) -> Box:
    half = WALL_M / 2.0
    return Box(min(x0, x1) - half, min(y0, y1) - half, max(x0, x1) + half, max(y0, y1) + half)


def hull(width: float, height: float) -> list[Box]:
    corners = [(0.0, 0.0), (width, 0.0), (width, height), (0.0, height), (0.0, 0.0)]
    return [wall(*a, *b) for a, b in pairwise(corners)]


def wall_with_door(across: bool, at: float, low: float, high: float, rng: np.random.Generator) -> list[Box]:
    """A wall along x (``across``) or y from ``low`` to ``high`` with a door somewhere in it."""
    door, half = rng.uniform(low + 0.7, high - 0.7), rng.uniform(0.4, 0.6)
    ends = [(low, door - half), (door + half, high)]
    return [wall(a, at, b, at) if across else wall(at, a, at, b) for a, b in ends if b - a > 0.05]


def rooms(rng: np.random.Generator) -> Building:
    """A hull that walls with doors cut in two again and again, and three pieces of furniture."""
    width, height = rng.uniform(10.0, 15.0), rng.uniform(8.0, 12.0)
    boxes = hull(width, height)

    def cut(x0: float, y0: float, x1: float, y1: float) -> None:
        if max(x1 - x0, y1 - y0) < 4.0 or min(x1 - x0, y1 - y0) < 1.8:
            return
        if x1 - x0 > y1 - y0:
            x = rng.uniform(0.65 * x0 + 0.35 * x1, 0.35 * x0 + 0.65 * x1)
            boxes.extend(wall_with_door(False, x, y0, y1, rng))
            cut(x0, y0, x, y1)
            cut(x, y0, x1, y1)
        else:
            y = rng.uniform(0.65 * y0 + 0.35 * y1, 0.35 * y0 + 0.65 * y1)
            boxes.extend(wall_with_door(True, y, x0, x1, rng))
            cut(x0, y0, x1, y)
            cut(x0, y, x1, y1)

    cut(0.0, 0.0, width, height)
    for _ in range(3):
        x, y = rng.uniform(1.0, width - 1.0), rng.uniform(1.0, height - 1.0)
        boxes.append(Box.square(x, y, rng.uniform(0.3, 0.8)))
    return Building(boxes, width, height)


def corridor(rng: np.random.Generator) -> Building:
    """Rooms of unequal width, each with a door, on either side of a corridor."""
    width, height = rng.uniform(13.0, 17.0), rng.uniform(9.6, 10.6)
    boxes = hull(width, height)
    for wall_y, low, high in ((4.0, 0.0, 4.0), (5.6, 5.6, height)):
        x = 0.0
        while x < width:
            end = x + rng.uniform(2.6, 4.2)
            end = width if width - end < 2.0 else end
            boxes += wall_with_door(True, wall_y, x, end, rng)
            if end < width:
                boxes.append(wall(end, low, end, high))
            x = end
    return Building(boxes, width, height)


def viewpoints(
    building: Building, rng: np.random.Generator, left: float, right: float, count: int = 30
) -> list[tuple[float, float]]:
    """Places at least 0.2 m from everything, between two shares of the building's width."""
    places: list[tuple[float, float]] = []
    while len(places) < count:
        x = rng.uniform(left, right) * building.width_m
        y = rng.uniform(0.0, 1.0) * building.height_m
        if all(box.distance_to_point(x, y) > 0.2 for box in building.boxes):
            places.append((x, y))
    return places


def map_of(
    building: Building,
    places: list[tuple[float, float]],
    frame: Pose2D,
    rng: np.random.Generator,
    pose_error_m: float = 0.0,
    resolution: float = 0.05,
) -> OccupancyGrid:
    """What 360 beams from each of the places show, in a frame that lies at ``frame`` in the building's.

    Ranges carry 1 cm of noise; each place is believed ``pose_error_m`` off, and half as many radians.
    """
    to_map = frame.inverse()
    angles = np.radians(np.arange(360))
    along = np.arange(0.0, RANGE_M, 0.8 * resolution)
    hits, passes = [], []
    for x, y in places:
        ranges = np.minimum(cast(building.boxes, x, y, angles), RANGE_M)
        hit = ranges < RANGE_M
        ranges = ranges + rng.normal(0.0, 0.01, 360) * hit
        believed = to_map.compose(Pose2D(x, y, 0.0))
        dx, dy, dyaw = rng.normal(0.0, pose_error_m, 3) if pose_error_m else (0.0, 0.0, 0.0)
        heading = angles + believed.yaw + 0.5 * dyaw
        rays = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        eye = np.array([believed.x + dx, believed.y + dy])
        hits.append(eye + rays[hit] * ranges[hit, None])
        clear = along < ranges[:, None] - resolution / 2.0
        passes.append((eye + rays[:, None, :] * along[None, :, None])[clear])
    return counted(np.concatenate(hits), np.concatenate(passes), resolution)


def counted(
    hits: npt.NDArray[np.float64], passes: npt.NDArray[np.float64], resolution: float
) -> OccupancyGrid:
    """Occupied where a quarter of what a cell has seen are hits; a margin of ten unknown cells all around."""
    points = np.concatenate((hits, passes))
    origin = np.floor(points.min(axis=0) / resolution) * resolution - 10 * resolution
    width, height = np.ceil((points.max(axis=0) - origin) / resolution).astype(int) + 10
    counts = []
    for ends in (hits, passes):
        columns, rows = ((ends - origin) / resolution).astype(int).T
        counts.append(np.bincount(rows * width + columns, minlength=height * width).reshape(height, width))
    seen = counts[0] + counts[1] / 2.0
    data = np.where(seen == 0.0, -1, np.where(counts[0] > 0.25 * seen, 100, 0)).astype(np.int8)
    return OccupancyGrid(data, resolution, (float(origin[0]), float(origin[1])))


def cast(boxes: list[Box], x: float, y: float, angles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(B,) distance to the nearest box along each angle, inf where there is none (slab method)."""
    rays = np.stack((np.cos(angles), np.sin(angles)), axis=1)[:, None, :]
    corners = np.array(boxes)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (corners[:, :2] - (x, y)) / rays, (corners[:, 2:] - (x, y)) / rays
    enter = np.minimum(low, high).max(axis=2)
    leave = np.maximum(low, high).min(axis=2)
    met = (enter > 0.0) & (enter < leave)
    return np.where(met, enter, np.inf).min(axis=1)


def random_frame(rng: np.random.Generator) -> Pose2D:
    """Anywhere, turned anyhow."""
    return Pose2D(rng.uniform(-5.0, 15.0), rng.uniform(-5.0, 15.0), rng.uniform(-math.pi, math.pi))
