"""A map with its robots' paths: a picture, and a film of such pictures of the growing map."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.films import HOLD_S, mp4_file
from midnet_bench.drawing.painter import Canvas, Entry, Picture, outline, paint_robot, swatch
from midnet_bench.drawing.palette import EXPLORERS, FAINT_INK, RGB, TRUTH, WHITE
from midnet_bench.drawing.stills import LABEL_PX, plot_page
from midnet_bench.geometry import Box, Floats, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER

SHADES: tuple[RGB, ...] = (WHITE, (205, 205, 205), (40, 40, 40))
FREE, UNKNOWN, WALL = range(len(SHADES))
_CODES = np.repeat(np.array([FREE, WALL, UNKNOWN], dtype=np.uint8), (65, 63, 128))
"""of each value of a map's cell, -1 and below at the end as in its bytes"""

PICTURES_PER_S, MOST_PICTURES = 10, 300  # of a film
MARGIN_M = 0.3  # around the known part of a map


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """A map and the robots that make it at one instant, map frame, metres."""

    caption: str  # when, and how much the map knows
    grid: OccupancyGrid  # the map, int8
    believed: Floats  # (n, 3) poses by the robots' own localization
    goals: Sequence[Point | None]
    paths: Sequence[Floats]  # of each robot, (k, 2): where it believes to have driven; empty: see MapHistory
    model: RobotModel = BURGER  # what the robots are


class MapHistory:
    """The snapshots of one map, compressed: one of 24 x 24 m has 230 kB, and there are thousands."""

    def __init__(self) -> None:
        self._snapshots: list[MapSnapshot] = []
        self._maps: list[bytes] = []

    def take(self, snapshot: MapSnapshot) -> None:
        """Keep the next snapshot."""
        data = snapshot.grid.data
        self._maps.append(zlib.compress(data.tobytes(), 1))
        blank = np.broadcast_to(np.int8(-1), data.shape)
        self._snapshots.append(replace(snapshot, grid=snapshot.grid.with_data(blank)))

    def paths(self) -> list[Floats]:
        """Of each robot, (k, 2): its believed positions, snapshot by snapshot."""
        believed = np.array([snapshot.believed[:, :2] for snapshot in self._snapshots])
        return list(believed.transpose(1, 0, 2))

    def snapshots(self, most: int) -> Iterator[MapSnapshot]:
        """At most so many, evenly spread from the first to the last; paths that were empty lead so far."""
        count, paths = len(self._snapshots), self.paths()
        for k in np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist():
            snapshot = self._snapshots[k]
            data = np.frombuffer(zlib.decompress(self._maps[k]), dtype=np.int8)
            grid = snapshot.grid.with_data(data.reshape(snapshot.grid.data.shape))
            yield replace(snapshot, grid=grid, paths=snapshot.paths or [path[: k + 1] for path in paths])

    def view(self) -> Box:
        """What shows the map in every snapshot: before a loop closes, it may lie beside the last one."""
        extents = np.array([one.grid.extent for one in self._snapshots if one.grid.data.size])
        return Box(*extents[:, :2].min(axis=0).tolist(), *extents[:, 2:].max(axis=0).tolist())


def draw_map(
    grid: OccupancyGrid, paths: Sequence[Floats], title: str, walls: Sequence[Floats] = ()
) -> Picture:
    """The known part of a map, and all true walls, with each robot's path on it, metres of the map frame.

    ``grid``: int8, 100 occupied, 0 free, -1 unknown; ``paths``: of each robot, (k, 3) or (k, 2) poses in
    driving order; ``walls``: outlines of the true walls, (n, 2) each, where they are known.
    """
    corners = np.array([*known_corners(grid), *(corner for wall in walls for corner in wall)])
    view = Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist())
    ends = np.array([path[-1] if path.shape[1] == 3 else (*path[-1], 0.0) for path in paths]).reshape(-1, 3)
    return _page(view, [title], MapSnapshot("", grid, ends, [], [path[:, :2] for path in paths]), walls)


def film_map(path: Path, history: MapHistory, title: str, walls: Sequence[Floats] = ()) -> None:
    """Write an MP4 of at most half a minute: the map's picture at each snapshot, or at 300 of them.

    Raises what ``mp4_file`` does.
    """
    view = history.view()
    pages = (_page(view, [title, one.caption], one, walls) for one in history.snapshots(MOST_PICTURES))
    last = next(pages)
    height, width = (side // 2 * 2 for side in last.shape[:2])
    with mp4_file(path, width, height, PICTURES_PER_S) as append:
        append(last[:height, :width])
        for last in pages:
            append(last[:height, :width])
        for _ in range(round(HOLD_S * PICTURES_PER_S)):
            append(last[:height, :width])


def _page(view: Box, title: Sequence[str], snapshot: MapSnapshot, walls: Sequence[Floats]) -> Picture:
    view = view.shrunk(-MARGIN_M)
    truth = [outline(TRUTH, "true walls")] if walls else []
    goals = [GOAL] if any(snapshot.goals) else []

    def paint(picture: Picture) -> None:
        paint_map(picture, view, snapshot)
        canvas = Canvas(picture, view, LABEL_PX)
        for wall in walls:
            canvas.polygon(wall, None, TRUTH)
        for robot, path in enumerate(snapshot.paths):
            canvas.circle(path[0].tolist(), 5.0 / canvas.scale, color_of(robot), 2)

    entries = [*CELLS, *truth, (_path_mark, "a robot's path, start (ring) and end"), *goals]
    return plot_page(view, title, entries, paint)


def known_corners(grid: OccupancyGrid) -> Floats:
    """(2, 2) the lower left and the upper right corner of the known cells, or of a grid without any."""
    rows, columns = np.nonzero(grid.data >= 0)
    if not len(rows):
        return np.array(grid.extent).reshape(2, 2)
    cells = [(columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)]
    return np.array(grid.origin) + grid.resolution * np.array(cells)


def paint_map(picture: Picture, view: Box, snapshot: MapSnapshot) -> None:
    """Fill ``picture``, (height, width, 3), with a map, paths, goals, and robots where they believe to be.

    ``view``: what it shows, metres of the map frame.
    """
    picture[:] = SHADES[UNKNOWN]
    canvas = Canvas(picture, view)
    codes = _CODES[snapshot.grid.data.view(np.uint8)]
    cells_per_px = 1.0 / (canvas.scale * snapshot.grid.resolution)
    if cells_per_px > 1.0 and codes.size:
        # a pixel shows one of its cells; a wall one cell thick must be seen whichever that is
        side = int(np.ceil(cells_per_px))
        walls = (codes == WALL).astype(np.uint8)
        codes[cv2.dilate(walls, np.ones((side, side), dtype=np.uint8)) > 0] = WALL
    canvas.cells(snapshot.grid.with_data(codes), SHADES)
    for robot, path in enumerate(snapshot.paths):
        canvas.line(path, color_of(robot), 2)
    for robot, goal in enumerate(snapshot.goals):
        if goal is not None:
            canvas.cross(goal, color_of(robot))
    _paint_robots(canvas, snapshot.believed, snapshot.model)


def color_of(robot: int) -> RGB:
    """The colour of a robot that maps, counted from 0."""
    return EXPLORERS[robot % len(EXPLORERS)]


def percent(share: float) -> str:
    """A share with one digit, rounded down: 100.0 % is complete."""
    return f"{np.floor(1000.0 * share) / 10.0:.1f} %"


def _paint_robots(canvas: Canvas, poses: Floats, model: RobotModel) -> None:
    """Robots at (n, 3) poses, large enough to be seen; numbered if there are several."""
    for robot, pose in enumerate(poses.tolist()):
        paint_robot(canvas, Pose2D(*pose), canvas.enlarged, color_of(robot), model)
    for robot, (x, y, _) in enumerate(poses.tolist()):
        if len(poses) > 1:
            canvas.label((x, y), str(robot + 1), color_of(robot), 14, -14)


def _path_mark(canvas: Canvas) -> None:
    canvas.line([(-6.0, 0.0), (6.0, 0.0)], color_of(0), 2)
    canvas.circle((-6.0, 0.0), 4.0, color_of(0), 2)
    canvas.circle((6.0, 0.0), 4.0, color_of(0), -1)


CELLS: tuple[Entry, ...] = (
    swatch(SHADES[WALL], "occupied"),
    swatch(SHADES[FREE], "free", FAINT_INK),
    swatch(SHADES[UNKNOWN], "unknown"),
)
GOAL: Entry = (lambda canvas: canvas.cross((0.0, 0.0), color_of(0)), "its goal")
