"""How a map grew, in an exploration or along a recorded log: snapshots, a page of six of them, a video."""

import zlib
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from midnet_bench.drawing.canvas import (
    Canvas,
    Picture,
    blank_page,
    paint_floor_plan,
    paint_robot,
    text_mask,
    write,
    write_right,
)
from midnet_bench.drawing.palette import EXPLORERS, FAINT_INK, INK, RGB, WHITE
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Floats, FloorPlan
from midnet_bench.drawing.video import mp4_file
from midnet_bench.geometry import Box, Point, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel

SHADES = np.array([WHITE, (205, 205, 205), (40, 40, 40)], dtype=np.uint8)
FREE, UNKNOWN, WALL = range(len(SHADES))
_CODES = np.repeat(np.array([FREE, WALL, UNKNOWN], dtype=np.uint8), (65, 63, 128))
"""of each value of a map's cell, -1 and below at the end as in its bytes"""

WIDTH, HEIGHT = 1280, 720
LAST_PICTURE_S = 2.0
"""how long a video stands still at its end"""

SNAPSHOTS, COLUMNS = 6, 3
TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 12, 44, 26
MIN_TILE_PX = 240

ARENA_MARGIN_M = 0.25
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
TRUTH_LEFT, TRUTH_TOP, TRUTH_PX = 764, 112, 480
LEGEND_TOP = 622
EXPLORATION_PICTURES_PER_S = 20
SPEEDS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
MAX_VIDEO_S = 30.0

MIN_MARGIN_M, MARGIN_SHARE = 0.25, 0.02
MAP_TOP = 80
LEFT, RIGHT = 16, 1264
SECOND_LINE, LEGEND_LEFT = 46, 752
LOG_PICTURES_PER_S = 10


@dataclass(frozen=True, eq=False)
class MapSnapshot:
    """A map and the robots that make it at one instant, map frame, metres."""

    clock: float
    """when: simulated seconds of an exploration, or how many scans of a log are done"""
    known: float
    """how much the map knows: of an exploration, the share of the reachable free cells; of a log, m2"""
    grid: OccupancyGrid
    """the map, int8"""
    poses: Floats
    """(n, 3) true poses; (0, 3) where they are not known"""
    believed: Floats
    """(n, 3) poses by the robots' own localization"""
    goals: list[Point | None]
    paths: list[Floats]
    """of each robot, (k, 2): the positions that it believes to have driven through; empty: those of all
    snapshots so far"""
    model: RobotModel = BURGER
    """what the robots are"""


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


class MapPanel:
    """Paints the map of a snapshot with the robots where they believe to be."""

    def __init__(self, view: Box, width_px: int, height_px: int) -> None:
        """``view``: what the pictures show, metres of the map frame."""
        self.view = view
        self.width_px, self.height_px = width_px, height_px

    def paint(self, picture: Picture, snapshot: MapSnapshot) -> None:
        """Fill ``picture``, (height, width, 3)."""
        picture[:] = SHADES[UNKNOWN]
        canvas = Canvas(picture, self.view)
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


def growth_page(
    history: MapHistory,
    clocks: Sequence[float],
    panel: MapPanel,
    heading: str,
    caption: Callable[[MapSnapshot], str],
) -> Picture:
    """(height, width, 3) the snapshots at ``clocks`` in reading order, each under its caption."""
    across, down = panel.width_px + GAP_PX, panel.height_px + GAP_PX + CAPTION_PX
    rows = -(-len(clocks) // COLUMNS)
    page = blank_page(COLUMNS * across + GAP_PX, HEAD_PX + rows * down)
    write(page, GAP_PX, 10, heading, 20, INK, bold=True)
    for place, clock in enumerate(clocks):
        snapshot = history.at(clock)
        top = HEAD_PX + place // COLUMNS * down
        left = GAP_PX + place % COLUMNS * across
        write(page, left, top, caption(snapshot), 16, INK)
        top += CAPTION_PX
        panel.paint(page[top : top + panel.height_px, left : left + panel.width_px], snapshot)
    return page


def exploration_page(plan: FloorPlan, team: str, history: MapHistory) -> Picture:
    """(height, width, 3) six snapshots from the beginning to the end, evenly spread, in reading order.

    Args:
        plan: of the arena that was explored.
        team: the explorers, such as "explored by 2 Burgers".
        history: with the share of the reachable free cells as ``known``.
    """
    times_s = np.linspace(history.clocks[0], history.clocks[-1], SNAPSHOTS).tolist()
    panel = MapPanel(plan.view(ARENA_MARGIN_M), TILE_PX, TILE_PX)

    def caption(snapshot: MapSnapshot) -> str:
        return f"{snapshot.clock:.0f} s: {percent(snapshot.known)} explored"

    return growth_page(history, times_s, panel, f"{plan.title}: {team}", caption)


def write_exploration_video(plan: FloorPlan, team: str, history: MapHistory, path: Path) -> None:
    """Write an MP4 of at most about half a minute, map and true arena side by side.

    A short exploration is shown in real time. Arguments as for ``exploration_page``; raises what
    ``mp4_file`` does.
    """
    begin_s, end_s = history.clocks[0], history.clocks[-1]
    speed = next((s for s in SPEEDS if end_s <= MAX_VIDEO_S * s), SPEEDS[-1])
    panel = MapPanel(plan.view(ARENA_MARGIN_M), HEIGHT, HEIGHT)
    times_s = np.arange(begin_s, end_s, speed / EXPLORATION_PICTURES_PER_S).tolist()
    page = _exploration_video_page(plan, team, speed)

    def paint(picture: Picture, snapshot: MapSnapshot) -> None:
        panel.paint(picture[:, :HEIGHT], snapshot)
        _paint_robots(Canvas(_truth_of(picture), panel.view), snapshot.poses, snapshot.model)
        write_right(picture, COLUMN_RIGHT, 8, f"{snapshot.clock:.0f} s", 24, INK)
        write(picture, COLUMN_LEFT, 62, f"{percent(snapshot.known)} explored", 18, INK, bold=True)

    _write_video(path, history, [*times_s, end_s], EXPLORATION_PICTURES_PER_S, page, paint)


def log_page(history: MapHistory, heading: str) -> Picture:
    """(height, width, 3) at most six snapshots from the first scan to the last, evenly spread."""
    clocks, view = history.clocks, history.view()
    chosen = np.unique(np.linspace(0, len(clocks) - 1, SNAPSHOTS).round().astype(int)).tolist()
    aspect = (view.y_max - view.y_min) / (view.x_max - view.x_min)
    panel = MapPanel(view, TILE_PX, min(max(round(TILE_PX * aspect), MIN_TILE_PX), TILE_PX))

    def caption(snapshot: MapSnapshot) -> str:
        return f"{_scans(snapshot, clocks[-1])}: {_known(snapshot)}"

    return growth_page(history, [clocks[k] for k in chosen], panel, heading, caption)


def write_log_video(history: MapHistory, heading: str, path: Path) -> None:
    """Write an MP4 of all snapshots, about 20 seconds at most. Raises what ``mp4_file`` does."""
    panel = MapPanel(history.view(), WIDTH, HEIGHT - MAP_TOP)
    clocks = history.clocks

    def paint(picture: Picture, snapshot: MapSnapshot) -> None:
        panel.paint(picture[MAP_TOP:], snapshot)
        write_right(picture, RIGHT, 10, _scans(snapshot, clocks[-1]), 20, INK)
        write(picture, LEFT, SECOND_LINE, _known(snapshot), 16, INK)

    _write_video(path, history, clocks, LOG_PICTURES_PER_S, _log_video_page(heading), paint)


def color_of(robot: int) -> RGB:
    """The colour of a robot that maps, counted from 0."""
    return EXPLORERS[robot % len(EXPLORERS)]


def percent(share: float) -> str:
    """A share with one digit, rounded down: 100.0 % is complete."""
    return f"{np.floor(1000.0 * share) / 10.0:.1f} %"


def _write_video(
    path: Path,
    history: MapHistory,
    clocks: Sequence[float],
    pictures_per_s: int,
    page: Picture,
    paint: Callable[[Picture, MapSnapshot], None],
) -> None:
    """A picture at each of ``clocks``, painted over a copy of ``page``; the last one stands still."""
    height, width = page.shape[:2]
    with mp4_file(path, width, height, pictures_per_s) as append:
        for clock in clocks:
            picture = page.copy()
            paint(picture, history.at(clock))
            append(picture)
        for _ in range(round(LAST_PICTURE_S * pictures_per_s)):
            append(picture)


def _exploration_video_page(plan: FloorPlan, team: str, speed: int) -> Picture:
    """What stands still in the video of an exploration."""
    page = blank_page(WIDTH, HEIGHT)
    write(page, COLUMN_LEFT, 10, plan.title, 20, INK, bold=True)
    write(page, COLUMN_LEFT, 38, f"{team}; {speed} x real time", 14, INK)
    write(page, TRUTH_LEFT, TRUTH_TOP - 20, "the arena and the robots in it", 13, FAINT_INK)
    paint_floor_plan(Canvas(_truth_of(page), plan.view(ARENA_MARGIN_M)), plan)
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    for row, (code, text) in enumerate(((FREE, "free"), (WALL, "occupied"), (UNKNOWN, "unknown"))):
        _paint_shade(page, COLUMN_LEFT + 20, LEGEND_TOP + 24 * row - 9, code, text)
    left = COLUMN_LEFT + 180.0
    y = -float(LEGEND_TOP)
    paint_robot(canvas, Pose2D(left, y, 0.0), 18.0 / BURGER_LENGTH_M, color_of(0))
    canvas.line([(left - 14.0, y - 24.0), (left + 12.0, y - 24.0)], color_of(0), 2)
    canvas.cross((left, y - 48.0), color_of(0))
    texts = ("robot; on the map, its believed pose", "its path", "the frontier it is driving to")
    for row, text in enumerate(texts):
        write(page, round(left) + 24, LEGEND_TOP + 24 * row - 9, text, 13, INK)
    return page


def _truth_of(page: Picture) -> Picture:
    """The part of an exploration's video that shows the true arena."""
    return page[TRUTH_TOP : TRUTH_TOP + TRUTH_PX, TRUTH_LEFT : TRUTH_LEFT + TRUTH_PX]


def _log_video_page(heading: str) -> Picture:
    """What stands still in the video of a log."""
    page = blank_page(WIDTH, HEIGHT)
    write(page, LEFT, 10, heading, 20, INK, bold=True)
    left = LEGEND_LEFT
    for code, text in ((FREE, "free"), (WALL, "occupied"), (UNKNOWN, "unknown")):
        _paint_shade(page, left, SECOND_LINE, code, text)
        left += 60 + text_mask(text, 13).shape[1]
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    y = -(SECOND_LINE + 9.0)
    paint_robot(canvas, Pose2D(left + 8.0, y, 0.0), 18.0 / BURGER_LENGTH_M, color_of(0))
    write(page, left + 28, SECOND_LINE, "robot", 13, INK)
    canvas.line([(left + 100.0, y), (left + 126.0, y)], color_of(0), 2)
    write(page, left + 134, SECOND_LINE, "its path", 13, INK)
    return page


def _paint_robots(canvas: Canvas, poses: Floats, model: RobotModel) -> None:
    """Robots at (n, 3) poses, large enough to be seen; numbered if there are several."""
    for robot, pose in enumerate(poses.tolist()):
        paint_robot(canvas, Pose2D(*pose), canvas.enlarged, color_of(robot), model)
    for robot, (x, y, _) in enumerate(poses.tolist()):
        if len(poses) > 1:
            canvas.label((x, y), str(robot + 1), color_of(robot), 14, -14)


def _paint_shade(page: Picture, left: int, top: int, code: int, text: str) -> None:
    """A line of a legend: what a shade of the map means."""
    red, green, blue = SHADES[code].tolist()
    cv2.rectangle(page, (left, top + 3), (left + 16, top + 15), (red, green, blue), -1)
    cv2.rectangle(page, (left, top + 3), (left + 16, top + 15), FAINT_INK, 1)
    write(page, left + 26, top, text, 13, INK)


def _scans(snapshot: MapSnapshot, of: float) -> str:
    return f"scan {snapshot.clock:.0f} of {of:.0f}"


def _known(snapshot: MapSnapshot) -> str:
    return f"{snapshot.known:.0f} m² known"
