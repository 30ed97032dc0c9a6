"""costmap_2d: obstacles by scans, inflation, and the rolling and global costmaps made of them."""

import functools
import math
from abc import ABC, abstractmethod
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, from_python, hypot
from midnet_bench.errors import InputError
from midnet_bench.geometry import Box, Floats, Indices, LidarGeometry, Point, Pose2D, cell_along, lengths
from midnet_bench.grid import OCCUPIED, UNKNOWN, OccupancyGrid, same_resolution
from midnet_bench.navigation.navigation_settings import CostmapSettings

Cells = npt.NDArray[np.uint8]

FREE_SPACE = 0
INSCRIBED = 253  # the robot's centre here means contact, whatever its heading
LETHAL = 254  # an obstacle is in this cell
NO_INFORMATION = 255

SINCE_COSTS, SINCE_PLAN = 0, 1
"""index of a rectangle of ``GlobalCostmap.touched``"""
NOWHERE = (2**31, 2**31, 0, 0)  # a rectangle that grows to whatever it takes in

PUBLISHED = np.array([0, *(1 + 97 * np.arange(252) // 251), 99, OCCUPIED, UNKNOWN], dtype=np.int8)
"""(256,) int8: published occupancy of each cost: 0 -> 0, 1..252 -> 1..98, 253 -> 99, 254 -> 100, 255 -> -1"""


def published(costs: Cells) -> npt.NDArray[np.int8]:
    """(H, W) int8 occupancy values of a costmap, as costmap_2d publishes them."""
    return np.asarray(cv2.LUT(costs, PUBLISHED), dtype=np.int8)


def reach_cells(radius_m: float, resolution: float) -> int:
    """A length as whole cells, rounded up, at least 0: how costmap_2d turns radii and ranges into cells."""
    return max(0, math.ceil(round(radius_m / resolution, 9)))


@functools.cache  # the costmaps of a team share it: not to be written to
def inflation_costs(settings: CostmapSettings, radius_m: float) -> Cells:
    """(cells of the radius**2 + 1,) uint8: a cell's cost by its squared distance, in cells, to a lethal one.

    254 at 0, 253 within the inscribed radius, then 252 exp(-k (distance - inscribed radius)), truncated.
    """
    reach = reach_cells(radius_m, settings.resolution)
    distance_m = np.sqrt(np.arange(reach * reach + 1)) * settings.resolution
    beyond_m = np.maximum(distance_m - settings.inscribed_radius_m, 0.0)
    graded = (252.0 * from_python.exponentials(-settings.cost_scaling_factor * beyond_m)).astype(np.uint8)
    costs = np.where(beyond_m == 0.0, np.uint8(INSCRIBED), graded)
    costs[0] = LETHAL
    return costs


class Costmap(ABC):
    """The obstacles that scans mark, on a lattice that never moves, and their inflation.

    The lower-left corner lies ``column``, ``row`` whole cells from ``lattice_origin``, so that two grids of
    one lattice always differ by whole cells. Marks stay until a beam passes, the footprint covers them, they
    leave the window, they outlive ``memory_s`` or ``clear_outside`` takes them. Points are kept in double
    precision, where ROS has 32-bit floats.
    """

    def __init__(self, settings: CostmapSettings, width: int, height: int, lattice_origin: Point) -> None:
        self.settings = settings
        self.column = self.row = 0
        self._inflation = inflation_costs(settings, settings.inflation_radius_m)
        self._unseen = NO_INFORMATION if settings.track_unknown else FREE_SPACE
        self.marks: Cells = np.full((height, width), self._unseen, dtype=np.uint8)
        """(H, W) uint8: free (0), an obstacle (254) or unseen (255)"""
        self.touched: Indices = np.empty((0, 4), dtype=np.int64)
        """(k, 4) rectangles x0, y0, x1, y1 in cells, each of which grows to hold all marks that may change; a
        window, which moves, has none"""
        self._costs: Cells | None = None
        self._remembers_for_ever = math.isinf(settings.memory_s)
        self._marked_at_s = np.full((height, width), -math.inf)
        cleared = settings.footprint if settings.footprint_clearing else np.empty((0, 2))
        self._footprint_cells = np.array(cleared) / settings.resolution
        self._raytrace_cells = reach_cells(settings.raytrace_range_m, settings.resolution)
        reach_m = max(settings.obstacle_range_m, *lengths(np.array(cleared).reshape(-1, 2)), 0.0)
        self._touched_cells = 1 + max(self._raytrace_cells, reach_cells(reach_m, settings.resolution))
        self._lattice = (float(lattice_origin[0]), float(lattice_origin[1]), float(settings.resolution))

    @property
    def costs(self) -> Cells:
        """(H, W) uint8 costs, row 0 lowest y; computed on first use after a change.

        Not to be written to, nor to be kept: the next ones may be written into the same array.
        """
        if self._costs is None:
            self._costs = self._inflated()
        return self._costs

    @property
    def origin(self) -> Point:
        """(x, y) of the lower-left corner, metres."""
        x, y, resolution = self._lattice
        return x + self.column * resolution, y + self.row * resolution

    @property
    def extent(self) -> Box:
        """Where it lies, in its own frame, metres."""
        (x, y), (height, width) = self.origin, self.marks.shape
        return Box(x, y, x + width * self.settings.resolution, y + height * self.settings.resolution)

    def to_cells(self, x: float, y: float) -> tuple[float, float]:
        """A point in cells from the lower-left corner, not rounded."""
        left, bottom, resolution = self._lattice
        return (x - left) / resolution - self.column, (y - bottom) / resolution - self.row

    def update(self, pose: Pose2D, ranges_m: Floats, geometry: LidarGeometry, time_s: float) -> None:
        """Take one scan: clear along all beams, then mark all hits, then free the footprint.

        ``pose``: the robot's at the scan's instant, in the costmap's frame. ``ranges_m``: (B,), inf or NaN
        where nothing came back, which never marks. Raises ValueError: a pose is not finite, or there is not
        one range a beam.
        """
        mount = geometry.mount
        pose.require_finite()
        mount.require_finite()
        if ranges_m.shape != (geometry.beams,):
            raise ValueError(f"{ranges_m.shape} ranges of a LiDAR with {geometry.beams} beams")
        settings = self.settings
        self._follow(pose)
        if not self._remembers_for_ever:
            if settings.memory_s == 0.0:
                self.marks.fill(self._unseen)
            is_old = self._marked_at_s < time_s - settings.memory_s
            self.marks[(self.marks == LETHAL) & is_old] = FREE_SPACE
            self._touch_all()
        marked = take_scan(
            self.marks,
            (*self._lattice, float(self.column), float(self.row)),
            (float(pose[0]), float(pose[1]), float(pose[2])),
            (float(mount[0]), float(mount[1]), float(mount[2])),
            np.ascontiguousarray(ranges_m, dtype=np.float64),
            geometry.directions,
            (geometry.range_min_m, geometry.range_max_m, settings.obstacle_range_m),
            self._raytrace_cells,
            settings.inf_is_valid,
            self._footprint_cells,
            self.touched,
            self._touched_cells,
        )
        if not self._remembers_for_ever:
            self._marked_at_s.reshape(-1)[marked] = time_s
        self._costs = None

    def clear_outside(self, x: float, y: float, side_m: float) -> None:
        """Forget obstacles (never a static map) outside the square of side ``side_m`` around (x, y), metres.

        The bounds are excluded. move_base's clearing recovery looks for a layer named ``obstacles``,
        TurtleBot3's is called ``obstacle_layer``, and so the original clears nothing.
        """
        half = side_m / 2.0
        x0, y0 = (int(value) for value in self.to_cells(x - half, y - half))
        x1, y1 = (int(value) for value in self.to_cells(x + half, y + half))
        kept = (slice(max(y0 + 1, 0), max(y1, 0)), slice(max(x0 + 1, 0), max(x1, 0)))
        cleared = np.full_like(self.marks, self._unseen)
        cleared[kept] = self.marks[kept]
        self.marks = cleared
        self._touch_all()
        self._costs = None

    def published(self) -> OccupancyGrid:
        """The costmap as nav_msgs has it: int8, 0 to 100 and -1."""
        return OccupancyGrid(published(self.costs), self.settings.resolution, self.origin)

    def _move_to(self, column: int, row: int, width: int, height: int) -> None:
        """Cover another rectangle of the lattice; what leaves is forgotten, what enters is unseen."""
        right, up = column - self.column, row - self.row
        if (right, up) == (0, 0) and self.marks.shape == (height, width):
            return
        self.marks = _moved(self.marks, right, up, width, height, self._unseen)
        if not self._remembers_for_ever:
            self._marked_at_s = _moved(self._marked_at_s, right, up, width, height, -math.inf)
        self.column, self.row = column, row

    def _follow(self, pose: Pose2D) -> None:  # noqa: B027 - a whole map stays where it is
        """Move the costmap to the robot, if it is a window."""

    def _touch_all(self) -> None:
        """Let marks count as changed everywhere."""
        height, width = self.marks.shape
        self.touched[:] = 0, 0, width, height

    @abstractmethod
    def _inflated(self) -> Cells:
        """(H, W) uint8: the costs of the marks as they are."""


def _moved(
    old: npt.NDArray[Any], right: int, up: int, width: int, height: int, unseen: float
) -> npt.NDArray[Any]:
    """(height, width): what ``old`` holds from column ``right``, row ``up`` on, and ``unseen`` beyond it."""
    kept = old[max(up, 0) : max(up + height, 0), max(right, 0) : max(right + width, 0)]
    x, y = max(-right, 0), max(-up, 0)
    new = np.empty((height, width), dtype=old.dtype)
    new.fill(unseen)
    new[y : y + kept.shape[0], x : x + kept.shape[1]] = kept
    return new


class RollingCostmap(Costmap):
    """A square window that follows its robot, without a static map.

    The window always lies on the lattice of ``lattice_origin`` (a prior map's origin, say). With
    ``settings.centered`` the robot's cell c (by floor) is the middle one and the window is
    [c - n // 2, c - n // 2 + n) at every update, as Eqs. 2 to 4 of the paper take for granted. Without,
    the window moves as costmap_2d's does: towards robot - (n - 0.5) / 2 cells, by whole cells truncated
    towards zero, which leaves the robot up to about one cell off the middle, depending on where it came from.
    """

    def __init__(self, settings: CostmapSettings, lattice_origin: Point = (0.0, 0.0)) -> None:
        side = max(1, round(settings.size_m / settings.resolution))
        super().__init__(settings, side, side, lattice_origin)
        self._near = 0, 0, 0, 0
        """x0, y0, x1, y1 in cells: the rectangle beyond which no cell has a cost, unless it is unseen"""

    def published(self) -> OccupancyGrid:
        """See :class:`Costmap`; without unknown cells all is 0 but what surrounds marks."""
        if self.settings.track_unknown:
            return super().published()
        costs = self.costs  # first, as these say where they are
        x0, y0, x1, y1 = self._near
        values = np.zeros(costs.shape, dtype=np.int8)
        if x1:
            values[y0:y1, x0:x1] = published(costs[y0:y1, x0:x1])
        return OccupancyGrid(values, self.settings.resolution, self.origin)

    def _inflated(self) -> Cells:
        costs, self._near = inflate_around(self.marks, self._inflation)
        return np.asarray(costs)

    def _follow(self, pose: Pose2D) -> None:
        n = len(self.marks)
        left, bottom, resolution = self._lattice
        if self.settings.centered:
            column = cell_along(pose.x - left, resolution) - n // 2
            row = cell_along(pose.y - bottom, resolution) - n // 2
        else:
            x, y = (pose.x - left) / resolution, (pose.y - bottom) / resolution
            half = (n - 0.5) / 2.0
            column, row = self.column + int(x - half - self.column), self.row + int(y - half - self.row)
        self._move_to(column, row, n, n)


class GlobalCostmap(Costmap):
    """The costmap of a whole map: a static layer below the obstacles."""

    def __init__(self, settings: CostmapSettings, static_map: OccupancyGrid) -> None:
        super().__init__(settings, static_map.width, static_map.height, static_map.origin)
        self.touched = np.empty((2, 4), dtype=np.int64)
        """since the newest costs, and since the planner set its own (``SINCE_PLAN``) to ``NOWHERE``"""
        self.set_static(static_map)

    def set_static(self, static_map: OccupancyGrid) -> None:
        """Put another static map (int8, -1 to 100) below the obstacles; marks stay where they are.

        The map may have grown or moved by whole cells, as a map under construction does. Raises InputError
        for another resolution.
        """
        if not same_resolution(static_map.resolution, self.settings.resolution):
            raise InputError(
                f"prior map: resolution {static_map.resolution} differs from the global costmap's "
                f"{self.settings.resolution}; set both to the same"
            )
        x, y = self.to_cells(*static_map.origin)
        self._move_to(self.column + round(x), self.row + round(y), static_map.width, static_map.height)
        values = static_map.data
        self.static, self.static_costs = _static_layers(
            values.tobytes(), values.dtype, values.shape, self.settings
        )
        """(H, W) uint8 the map's obstacles, and the costs without any other"""
        self._newest = self.static_costs.copy()
        self._touch_all()
        self._costs = None

    def _inflated(self) -> Cells:
        touched = self.touched[SINCE_COSTS]
        inflate_within(touched, self.static, self.marks, self._inflation, self._newest)
        touched[:] = NOWHERE
        return self._newest


@functools.lru_cache(maxsize=4)  # the costmaps of a team share them: not to be written to
def _static_layers(
    values: bytes, dtype: npt.DTypeLike, shape: tuple[int, int], settings: CostmapSettings
) -> tuple[Cells, Cells]:
    """Two of ``shape``, uint8: the static layer of a map's values, and its costs."""
    data = np.frombuffer(values, dtype=dtype).reshape(shape)
    layer = static_layer(OccupancyGrid(data, settings.resolution, (0.0, 0.0)), settings.track_unknown)
    return layer, inflate(layer, inflation_costs(settings, settings.inflation_radius_m))


def static_layer(static_map: OccupancyGrid, track_unknown: bool) -> Cells:
    """(H, W) uint8: 254 where the map says 100, 255 where unknown (0 unless tracked), 0 elsewhere.

    That is the static layer with its default threshold and ``trinary_costmap``: 99 is free. One
    ``track_unknown`` serves all layers, where costmap_2d has one per layer and lets an obstacle layer that
    does not track wipe out the static layer's unknown cells.
    """
    values = static_map.data
    if values.dtype != np.int8:
        raise ValueError(f"a static map holds int8 occupancy (-1 to 100), got {values.dtype}")
    layer = np.where(values >= OCCUPIED, np.uint8(LETHAL), np.uint8(FREE_SPACE))
    if track_unknown:
        layer[values < 0] = NO_INFORMATION
    return layer


def static_costs(static_map: OccupancyGrid, settings: CostmapSettings) -> OccupancyGrid:
    """The published global costmap (int8) of a map without any scan: what the prior map is cut from."""
    costs_by_distance = inflation_costs(settings, settings.inflation_radius_m)
    costs = inflate(static_layer(static_map, settings.track_unknown), costs_by_distance)
    return static_map.with_data(published(costs))


@njit
def line_steps(dx: int, dy: int, width: int) -> tuple[int, int, int, int]:
    """(steps along the dominant axis, steps along the other, flat index step of each) of Bresenham's line.

    x dominates ties. ``next_cell`` walks the line, with an error that starts at half the dominant count.
    """
    step_x = 1 if dx > 0 else -1
    step_y = width if dy > 0 else -width
    if abs(dx) >= abs(dy):
        return abs(dx), abs(dy), step_x, step_y
    return abs(dy), abs(dx), step_y, step_x


@njit
def next_cell(index: int, error: int, line: tuple[int, int, int, int]) -> tuple[int, int]:
    """(flat index, error) one step farther along ``line``, which ``line_steps`` gives."""
    major, minor, major_step, minor_step = line
    error += minor
    if error >= major:
        return index + major_step + minor_step, error - major
    return index + major_step, error


@njit
def clear_line(flat: Cells, width: int, x0: int, y0: int, x1: int, y1: int, max_cells: int) -> None:
    """Set the cells from (x0, y0) towards (x1, y1) free, both ends too, ``max_cells`` (Euclidean) at most.

    ``flat``: the cells of a grid of ``width`` columns, row by row.
    """
    major, minor, major_step, minor_step = line_steps(x1 - x0, y1 - y0, width)
    steps = major
    if major * major + minor * minor > max_cells * max_cells:
        steps = int(max_cells / hypot(x1 - x0, y1 - y0) * major)
    # counted from -major, so that a step aside is due when it comes to 0
    error = major // 2 - major
    # Unsigned, so that no index is asked whether it counts from the end; steps back wrap round.
    index = np.uint64(y0 * width + x0)
    along, both = np.uint64(np.int64(major_step)), np.uint64(np.int64(major_step + minor_step))
    for _ in range(steps + 1):
        flat[index] = FREE_SPACE
        # no branch, which the processor would guess wrong half the time, and both outcomes at once
        is_over = error + minor >= 0
        error = error + (minor - major) if is_over else error + minor
        index = index + both if is_over else index + along


@njit
def is_open_line(cells: Cells, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether no cell from (x0, y0) to (x1, y1), both ends too, is lethal; never to a point off the grid."""
    height, width = cells.shape
    if not (0.0 <= x0 < width and 0.0 <= y0 < height and 0.0 <= x1 < width and 0.0 <= y1 < height):
        return False
    flat = cells.reshape(-1)
    line = line_steps(int(x1) - int(x0), int(y1) - int(y0), width)
    index, error = int(y0) * width + int(x0), line[0] // 2
    for _ in range(line[0] + 1):
        if flat[index] == LETHAL:
            return False
        index, error = next_cell(index, error, line)
    return True


@njit
def clear_footprint(cells: Cells, footprint: Floats, pose: tuple[float, float, float]) -> None:
    """Set the cells under a convex footprint free; nothing if a corner is off the grid or they are under 3.

    ``footprint``: (N, 2) in cells in the frame of ``pose`` (x, y in cells from the grid's lower-left corner,
    yaw). Each column is filled between the outline's lowest and highest cell.
    """
    height, width = cells.shape
    n = len(footprint)
    if n < 3:
        return
    c, s = cos_sin(pose[2])
    corners = np.empty_like(footprint)
    for i in range(n):
        corners[i, 0] = pose[0] + c * footprint[i, 0] - s * footprint[i, 1]
        corners[i, 1] = pose[1] + s * footprint[i, 0] + c * footprint[i, 1]
        # not "x < 0 or x >= width", which lets a NaN through
        if not (0.0 <= corners[i, 0] < width and 0.0 <= corners[i, 1] < height):
            return
    lowest = np.full(width, height, dtype=np.int64)
    highest = np.full(width, -1, dtype=np.int64)
    for i in range(n):
        x0, y0 = int(corners[i - 1, 0]), int(corners[i - 1, 1])
        x1, y1 = int(corners[i, 0]), int(corners[i, 1])
        line = line_steps(x1 - x0, y1 - y0, width)
        index, error = y0 * width + x0, line[0] // 2
        for _ in range(line[0] + 1):
            y, x = index // width, index % width
            lowest[x] = min(lowest[x], y)
            highest[x] = max(highest[x], y)
            index, error = next_cell(index, error, line)
    for x in range(width):
        for y in range(lowest[x], highest[x] + 1):
            cells[y, x] = FREE_SPACE


@njit
def take_scan(
    cells: Cells,
    frame: tuple[float, float, float, float, float],
    pose: tuple[float, float, float],
    mount: tuple[float, float, float],
    ranges: Floats,
    directions: Floats,
    range_limits: tuple[float, float, float],
    raytrace_cells: int,
    inf_is_valid: bool,
    footprint: Floats,
    touched: Indices,
    touched_cells: int,
) -> Indices:
    """``integrate_scan`` of a LiDAR on a robot, then ``clear_footprint`` of that robot; what was marked.

    ``frame``: x and y of the lattice's corner and a cell's side, metres, and the column and row on it where
    ``cells`` begin. ``pose``: the robot's; ``mount``: the LiDAR's in the robot's frame, metres and radians.
    ``touched``: (k, 4) rectangles, x0, y0, x1, y1 in cells, which grow to hold all that may change: what lies
    within ``touched_cells`` of robot and LiDAR.
    """
    left, bottom, resolution, column, row = frame
    c, s = cos_sin(pose[2])
    x, y = pose[0] + c * mount[0] - s * mount[1], pose[1] + s * mount[0] + c * mount[1]
    sensor = (x - left) / resolution - column, (y - bottom) / resolution - row, pose[2] + mount[2]
    marked = integrate_scan(
        cells, resolution, sensor, ranges, directions, range_limits, raytrace_cells, inf_is_valid
    )
    robot = (pose[0] - left) / resolution - column, (pose[1] - bottom) / resolution - row, pose[2]
    clear_footprint(cells, footprint, robot)
    height, width = cells.shape
    reach = touched_cells + (abs(mount[0]) + abs(mount[1])) / resolution
    for box in touched:
        box[0] = min(box[0], int(min(max(sensor[0] - reach, 0.0), width)))
        box[1] = min(box[1], int(min(max(sensor[1] - reach, 0.0), height)))
        box[2] = max(box[2], int(min(max(sensor[0] + reach + 1.0, 0.0), width)))
        box[3] = max(box[3], int(min(max(sensor[1] + reach + 1.0, 0.0), height)))
    return marked


@njit
def integrate_scan(
    cells: Cells,
    resolution: float,
    sensor: tuple[float, float, float],
    ranges: Floats,
    directions: Floats,
    range_limits: tuple[float, float, float],
    raytrace_cells: int,
    inf_is_valid: bool,
) -> Indices:
    """Clear along every beam, then mark every hit; the flat indices marked.

    ``sensor``: the LiDAR's x, y in cells from the grid's lower-left corner, yaw. ``ranges``: (B,) metres;
    ``directions``: (B, 2) cosine and sine of each beam in the sensor frame. ``range_limits``: least and
    largest range and the obstacle range, metres. A range outside [least, largest) neither clears nor marks,
    except that +inf clears under ``inf_is_valid``. A hit at the obstacle range exactly is not marked.

    A beam without a return never marks (item 8). costmap_2d takes it for a return at the largest range less
    0.1 mm, and marks that where the obstacle range reaches as far.
    """
    height, width = cells.shape
    flat = cells.reshape(-1)
    sensor_x, sensor_y, yaw = sensor
    cos_yaw, sin_yaw = cos_sin(yaw)
    inside = 0.0 <= sensor_x < width and 0.0 <= sensor_y < height
    start_x, start_y = int(sensor_x), int(sensor_y)
    pulled_in = 0.001 / resolution
    marked = np.empty(len(ranges), dtype=np.int64)
    count = 0
    last_end = -1
    for i in range(len(ranges)):
        distance = ranges[i]
        if inf_is_valid and distance == math.inf:
            distance = range_limits[1] - 0.0001
        if not (range_limits[0] <= distance < range_limits[1]):
            continue
        reach = distance / resolution
        a = reach * (cos_yaw * directions[i, 0] - sin_yaw * directions[i, 1])
        b = reach * (sin_yaw * directions[i, 0] + cos_yaw * directions[i, 1])
        x, y = sensor_x + a, sensor_y + b
        # not "distance", which is finite where nothing came back
        if ranges[i] < range_limits[2] and 0.0 <= x < width and 0.0 <= y < height:
            marked[count] = int(y) * width + int(x)
            count += 1
        if not inside:
            continue
        if x < 0.0:
            x, y = 0.0, sensor_y - b * sensor_x / a
        if y < 0.0:
            x, y = sensor_x - a * sensor_y / b, 0.0
        if x > width:
            x, y = width - pulled_in, sensor_y + b * (width - sensor_x) / a
        if y > height:
            x, y = sensor_x + a * (height - sensor_y) / b, height - pulled_in
        # A beam may end on the right or upper edge, or be cut there by a rounding error past a corner.
        end_x, end_y = min(int(x), width - 1), min(int(y), height - 1)
        # Beams a degree apart often end in one cell, and the line to it is the same.
        if end_x >= 0 and end_y >= 0 and end_y * width + end_x != last_end:
            last_end = end_y * width + end_x
            clear_line(flat, width, start_x, start_y, end_x, end_y, raytrace_cells)
    for i in range(count):
        flat[marked[i]] = LETHAL
    return marked[:count]


@njit
def inflate(base: Cells, cost_by_squared_distance: Cells) -> Cells:
    """(H, W) uint8: ``base`` with the cost of the distance to its nearest lethal cell, where that is higher.

    Exact Euclidean distances in two passes: down the columns first, then along the rows over the columns'
    results. Unknown cells take a cost of 253 or more only. ``cost_by_squared_distance``, of
    ``inflation_costs``, has at most 100**2 + 1 entries, and nothing is inflated beyond it.
    To raise a disc about each obstacle instead takes four times as long, 5 % of a labyrinth's trial.
    """
    height, width = base.shape
    limit = len(cost_by_squared_distance) - 1
    reach = round(math.sqrt(limit))
    far = np.int16(reach + 1)
    # Each row has ``reach`` cells behind it in which nothing lies, so that no row sees the next one's.
    stride = width + reach
    gap = np.full((height + 2, stride), far, dtype=np.int16)
    # Rows are taken out before their loops: the compiler then sees them apart and takes many cells at once.
    for row in range(height):
        cells, below, here = base[row], gap[row], gap[row + 1]
        for x in range(width):
            here[x] = 0 if cells[x] == LETHAL else min(np.int16(below[x] + 1), far)
    for row in range(height - 1, -1, -1):
        above, here = gap[row + 2], gap[row + 1]
        for x in range(width):
            here[x] = min(np.int16(above[x] + 1), here[x])
    count = height * stride
    along_columns = np.full(count + 2 * reach, far * far, dtype=np.int16)
    gaps, squared = gap.reshape(-1)[stride : stride + count], along_columns[reach : reach + count]
    for i in range(count):
        squared[i] = gaps[i] * gaps[i]
    squared = squared.copy()
    for offset in range(1, reach + 1):
        left = along_columns[reach - offset : reach - offset + count]
        right = along_columns[reach + offset : reach + offset + count]
        added = np.int16(offset * offset)
        for i in range(count):
            squared[i] = min(squared[i], np.int16(min(left[i], right[i]) + added))
    cost_of = np.zeros(far * far + 1, dtype=np.uint8)
    cost_of[: limit + 1] = cost_by_squared_distance
    costs = np.empty_like(base)
    for row in range(height):
        known, here, raised = base[row], squared[row * stride : row * stride + width], costs[row]
        for x in range(width):
            cost, old = cost_of[np.uint16(here[x])], known[x]
            is_raised = cost >= INSCRIBED if old == NO_INFORMATION else cost > old
            raised[x] = cost if is_raised else old
    return costs


@njit
def inflate_around(marks: Cells, cost_by_squared_distance: Cells) -> tuple[Cells, tuple[int, int, int, int]]:
    """(H, W) uint8, what ``inflate`` gives; and x0, y0, x1, y1 in cells, the rectangle that marks reach.

    Only that rectangle is inflated: in the window of a LiDAR of long range most cells are far from any mark.
    It is all 0 where no cell is lethal.
    """
    height, width = marks.shape
    reach = round(math.sqrt(len(cost_by_squared_distance) - 1))
    in_column = np.zeros(width, dtype=np.uint8)
    left, low, right, high = width, height, 0, 0
    for row in range(height):
        # without a branch: the compiler takes many cells at once
        here, found = marks[row], np.uint8(0)
        for x in range(width):
            found |= np.uint8(here[x] == LETHAL)
        if found:
            low, high = min(low, row), row + 1
            for x in range(width):
                in_column[x] |= np.uint8(here[x] == LETHAL)
    for x in range(width):
        if in_column[x]:
            left, right = min(left, x), x + 1
    costs = marks.copy()
    if high == 0:
        return costs, (0, 0, 0, 0)
    left, low = max(left - reach, 0), max(low - reach, 0)
    right, high = min(right + reach, width), min(high + reach, height)
    costs[low:high, left:right] = inflate(marks[low:high, left:right].copy(), cost_by_squared_distance)
    return costs, (left, low, right, high)


@njit
def inflate_within(
    touched: Indices, static: Cells, marks: Cells, cost_by_squared_distance: Cells, costs: Cells
) -> None:
    """Bring the ``costs`` of a static layer and marks up to date, after marks have changed.

    ``touched``: (4,) x0, y0, x1, y1 in cells: the rectangle, empty perhaps, in which they have.
    """
    x0, y0, x1, y1 = touched
    if x0 >= x1 or y0 >= y1:
        return
    height, width = costs.shape
    reach = round(math.sqrt(len(cost_by_squared_distance) - 1))
    left, right = max(x0 - reach, 0), min(x1 + reach, width)
    low, high = max(y0 - reach, 0), min(y1 + reach, height)
    column, row = max(left - reach, 0), max(low - reach, 0)  # what lies as far again counts there
    base = np.empty((min(high + reach, height) - row, min(right + reach, width) - column), dtype=np.uint8)
    for y in range(base.shape[0]):
        below, above, here = static[row + y, column:], marks[row + y, column:], base[y]
        for x in range(len(here)):
            # the higher of both; unknown gives way to known (combination method 1), as 255 + 1 is 0 in a byte
            here[x] = np.uint8(max(np.uint8(below[x] + 1), np.uint8(above[x] + 1)) - 1)
    inflated = inflate(base, cost_by_squared_distance)
    costs[low:high, left:right] = inflated[low - row : high - row, left - column : right - column]
