"""Maps: one with its robots' paths, and how it grew in an exploration or along a log: a page, a film."""

import zlib
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.films import HEIGHT, HOLD_S, WIDTH, mp4_file
from midnet_bench.drawing.painter import (
    MARGIN_M,
    Canvas,
    Entry,
    Picture,
    blank_page,
    burger,
    outline,
    paint_floor_plan,
    paint_robot,
    swatch,
    tiles,
    write,
    write_legend,
)
from midnet_bench.drawing.palette import EXPLORERS, FAINT_INK, RGB, TRUTH, WHITE
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.drawing.stills import LABEL_PX, plot_page
from midnet_bench.geometry import Box, Floats, Point, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER

SHADES: tuple[RGB, ...] = (WHITE, (205, 205, 205), (40, 40, 40))
FREE, UNKNOWN, WALL = range(len(SHADES))
_CODES = np.repeat(np.array([FREE, WALL, UNKNOWN], dtype=np.uint8), (65, 63, 128))
"""of each value of a map's cell, -1 and below at the end as in its bytes"""

SNAPSHOTS, COLUMNS = 6, 3
TILE_PX, MIN_TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 240, 12, 44, 26
EXPLORATION_PICTURES_PER_S, LOG_PICTURES_PER_S = 20, 10
SPEEDS, MAX_FILM_S = (1, 2, 4, 8, 16, 32, 64, 128, 256), 30.0
MAP_MARGIN_M, MIN_MARGIN_M, MARGIN_SHARE = 0.3, 0.25, 0.02
"""around the known part of a map; around a growing one, or so much of its longest side"""
MAP_TOP, SECOND_LINE, LEGEND_LEFT = 80, 46, 330


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """A map and the robots that make it at one instant, map frame, metres."""

    clock: float  # when: simulated seconds of an exploration, or how many scans of a log are done
    known: float
    """how much the map knows: of an exploration, the share of the reachable free cells; of a log, m2"""
    grid: OccupancyGrid  # the map, int8
    poses: Floats  # (n, 3) true poses; (0, 3) where they are not known
    believed: Floats  # (n, 3) poses by the robots' own localization
    goals: list[Point | None]
    paths: list[Floats]
    """of each robot, (k, 2): the positions that it believes to have driven through; empty: those of all
    snapshots so far"""
    model: RobotModel = BURGER  # what the robots are


class MapHistory:
    """The snapshots of one map, compressed; between two of them robots go straight and the map stays."""

    def __init__(self) -> None:
        self._snapshots: list[MapSnapshot] = []
        self._maps: list[bytes] = []

    def take(self, snapshot: MapSnapshot) -> None:
        """Keep the next snapshot."""
        data = snapshot.grid.data
        # a map of 24 x 24 m has 230 kB; packed, an hour of them fits in memory
        self._maps.append(zlib.compress(data.tobytes(), 1))
        blank = np.broadcast_to(np.int8(-1), data.shape)
        self._snapshots.append(replace(snapshot, grid=snapshot.grid.with_data(blank)))

    @property
    def clocks(self) -> list[float]:
        """When the snapshots were taken, in order."""
        return [snapshot.clock for snapshot in self._snapshots]

    @property
    def known(self) -> float:
        """How much the map knows in the last snapshot."""
        return self._snapshots[-1].known

    def paths(self) -> list[Floats]:
        """Of each robot, (k, 2): its believed positions, snapshot by snapshot."""
        believed = np.array([snapshot.believed[:, :2] for snapshot in self._snapshots])
        return list(believed.transpose(1, 0, 2))

    def view(self) -> Box:
        """What shows the map in every snapshot: before a loop closes, it may lie beside the last one."""
        extents = np.array([one.grid.extent for one in self._snapshots if one.grid.data.size])
        view = Box(*extents[:, :2].min(axis=0).tolist(), *extents[:, 2:].max(axis=0).tolist())
        side_m = max(view.x_max - view.x_min, view.y_max - view.y_min)
        return view.shrunk(-max(MIN_MARGIN_M, MARGIN_SHARE * side_m))

    def at(self, clock: float) -> MapSnapshot:
        """How it was between the first snapshot and the last."""
        after = bisect_right(self._snapshots, clock, key=lambda snapshot: snapshot.clock)
        earlier = max(after - 1, 0)
        one, two = self._snapshots[earlier], self._snapshots[min(after, len(self._snapshots) - 1)]
        gap = two.clock - one.clock
        share = (clock - one.clock) / gap if gap > 0.0 else 0.0
        believed = _between(one.believed, two.believed, share)
        paths = one.paths or [path[: earlier + 1] for path in self.paths()]
        data = np.frombuffer(zlib.decompress(self._maps[earlier]), dtype=np.int8)
        return replace(
            one,
            clock=clock,
            grid=one.grid.with_data(data.reshape(one.grid.data.shape)),
            poses=_between(one.poses, two.poses, share),
            believed=believed,
            paths=[np.vstack([path, here]) for path, here in zip(paths, believed[:, :2], strict=True)],
        )


def _between(one: Floats, two: Floats, share: float) -> Floats:
    """(n, 3) poses from ``one`` (share 0) to ``two`` (share 1), turning the short way round."""
    step = two - one
    step[:, 2] = [wrap_angle(turn) for turn in step[:, 2].tolist()]
    return one + share * step


def draw_map(
    grid: OccupancyGrid, paths: Sequence[Floats], title: str, walls: Sequence[Floats] = ()
) -> Picture:
    """The known part of a map, and all true walls, with each robot's path on it, metres of the map frame.

    ``grid``: int8, 100 occupied, 0 free, -1 unknown; ``paths``: of each robot, (k, 3) or (k, 2) poses in
    driving order; ``walls``: outlines of the true walls, (n, 2) each, where they are known.
    """
    corners = np.array([*known_corners(grid), *(corner for wall in walls for corner in wall)])
    view = Box(*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()).shrunk(-MAP_MARGIN_M)
    ends = np.array([path[-1] if path.shape[1] == 3 else (*path[-1], 0.0) for path in paths]).reshape(-1, 3)
    driven = [path[:, :2] for path in paths]
    snapshot = MapSnapshot(0.0, 0.0, grid, np.empty((0, 3)), ends, [], driven)
    truth = [outline(TRUTH, "true walls")] if walls else []
    entries = [*CELLS, *truth, (_path_mark, "a robot's path, start (ring) and end")]

    def paint(picture: Picture) -> None:
        paint_map(picture, view, snapshot)
        canvas = Canvas(picture, view, LABEL_PX)
        for wall in walls:
            canvas.polygon(wall, None, TRUTH)
        for robot, path in enumerate(driven):
            canvas.circle(path[0].tolist(), 5.0 / canvas.scale, color_of(robot), 2)

    return plot_page(view, [title], entries, paint)


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


class Growth:
    """The pictures of how one map grew: a page of six snapshots, and a film."""

    def __init__(self, history: MapHistory, heading: str, plan: FloorPlan | None = None) -> None:
        """``plan``: the arena that was explored; None of a log, whose clock counts scans."""
        self._history, self._heading, self._plan = history, heading, plan
        self._view = history.view() if plan is None else plan.view(MARGIN_M)

    def page(self) -> Picture:
        """(height, width, 3) snapshots from the first to the last, evenly spread, each under its caption.

        Six of an exploration, at most six of a log.
        """
        clocks = self._history.clocks
        if self._plan is None:
            chosen = np.unique(np.linspace(0, len(clocks) - 1, SNAPSHOTS).round().astype(int)).tolist()
            shown = [clocks[k] for k in chosen]
        else:
            shown = np.linspace(clocks[0], clocks[-1], SNAPSHOTS).tolist()
        view = self._view
        aspect = (view.y_max - view.y_min) / (view.x_max - view.x_min)
        height_px = min(max(round(TILE_PX * aspect), MIN_TILE_PX), TILE_PX)
        across, down = TILE_PX + GAP_PX, height_px + GAP_PX + CAPTION_PX
        page = blank_page(COLUMNS * across + GAP_PX, HEAD_PX + -(-len(shown) // COLUMNS) * down)
        write(page, GAP_PX, 10, self._heading, 20, bold=True)
        places = tiles(len(shown), COLUMNS, across, down, GAP_PX, HEAD_PX)
        for clock, (left, top) in zip(shown, places, strict=True):
            snapshot = self._history.at(clock)
            write(page, left, top, ": ".join(self._words(snapshot)), 16)
            top += CAPTION_PX
            paint_map(page[top : top + height_px, left : left + TILE_PX], view, snapshot)
        return page

    def write_film(self, path: Path) -> None:
        """Write an MP4 of at most about half a minute. Raises what ``mp4_file`` does.

        A short exploration is shown in real time, beside the true arena; of a log each snapshot.
        """
        clocks, heading, rate = self._history.clocks, self._heading, LOG_PICTURES_PER_S
        map_px, entries = WIDTH, ENTRIES[:-1]  # robots of a log have no goals
        if self._plan is not None:
            entries = ENTRIES
            speed = next((s for s in SPEEDS if clocks[-1] <= MAX_FILM_S * s), SPEEDS[-1])
            heading, rate, map_px = f"{heading}; {speed} x real time", EXPLORATION_PICTURES_PER_S, WIDTH // 2
            clocks = [*np.arange(clocks[0], clocks[-1], speed / rate).tolist(), clocks[-1]]
        blank = blank_page(WIDTH, HEIGHT)
        write(blank, GAP_PX, 10, heading, 20, bold=True)
        write_legend(blank, entries, LEGEND_LEFT, SECOND_LINE + 9, 0, 13, right=WIDTH)
        if self._plan is not None:
            paint_floor_plan(Canvas(blank[MAP_TOP:, map_px:], self._view), self._plan)
        with mp4_file(path, WIDTH, HEIGHT, rate) as append:
            for clock in clocks:
                picture, snapshot = blank.copy(), self._history.at(clock)
                paint_map(picture[MAP_TOP:, :map_px], self._view, snapshot)
                if self._plan is not None:
                    truth = Canvas(picture[MAP_TOP:, map_px:], self._view)
                    _paint_robots(truth, snapshot.poses, snapshot.model)
                now, known = self._words(snapshot)
                write(picture, WIDTH - GAP_PX, 10, now, 20, bold=True, before=1.0)
                write(picture, GAP_PX, SECOND_LINE, known, 16)
                append(picture)
            for _ in range(round(HOLD_S * rate)):
                append(picture)

    def _words(self, snapshot: MapSnapshot) -> tuple[str, str]:
        """When a snapshot was taken, and how much the map knows then."""
        if self._plan is None:
            last = self._history.clocks[-1]
            return f"scan {snapshot.clock:.0f} of {last:.0f}", f"{snapshot.known:.0f} m² known"
        return f"{snapshot.clock:.0f} s", f"{percent(snapshot.known)} explored"


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
ENTRIES: tuple[Entry, ...] = (  # what the marks of a film mean
    *CELLS,
    (burger(color_of(0)), "robot, on the map where it believes to be"),
    (lambda canvas: canvas.line([(-14.0, 0.0), (12.0, 0.0)], color_of(0), 2), "its path"),
    (lambda canvas: canvas.cross((0.0, 0.0), color_of(0)), "its goal"),
)
