"""A guarded trial in motion: an MP4 with the true world beside what MIDNet makes of it, and a storyboard."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from midnet_bench.drawing.canvas import (
    Canvas,
    Picture,
    blank_page,
    paint_detection,
    paint_floor_plan,
    paint_path,
    paint_robot,
    png_of,
    text_mask,
    write,
    write_right,
)
from midnet_bench.drawing.palette import (
    DETECTION,
    FAINT_INK,
    FALSE_DETECTION,
    GUARD,
    GUARD_FAINT,
    INK,
    INTRUDER,
    INTRUDER_FAINT,
    WHITE,
)
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Floats, Scene, Setup
from midnet_bench.drawing.video import mp4_file
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.io.files import write_atomically

WIDTH, HEIGHT = 1280, 720
MARGIN_M = 0.25
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
MAP_LEFT, MAP_TOP, MAP_PX = 764, 84, 480
COUNTS_TOP, LEGEND_TOP = 574, 613

SHADES = np.array(
    [WHITE, (205, 205, 205), (226, 226, 226), (70, 70, 70), (140, 140, 140), (240, 200, 40)], dtype=np.uint8
)
FREE, UNKNOWN, INFLATED, WALL, COMMON, FOREGROUND = range(len(SHADES))
"""What a cell is: of the prior map, or in grid C of some guard, or in grid D of one."""


@contextmanager
def trial_video(setup: Setup, directory: Path, speed: float) -> Iterator[Callable[[Scene], None]]:
    """What appends a scene to ``trial.mp4`` and ``storyboard.png`` in a folder.

    The files are there once the context ends without an error.

    Args:
        setup: of the trial.
        directory: where to.
        speed: how much faster than the trial's own time the video runs.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    painter, storyboard = ScenePainter(setup, speed), Storyboard(setup)
    with mp4_file(directory / "trial.mp4", WIDTH, HEIGHT, setup.frame_hz * speed) as append_picture:

        def append(scene: Scene) -> None:
            append_picture(painter.paint(scene))
            storyboard.offer(scene)

        yield append
    write_atomically(directory / "storyboard.png", png_of(storyboard.page()))


class WorldPanel:
    """The true world on a square of pixels: guards, intruders, paths, goals and detections over the walls."""

    def __init__(self, setup: Setup, side_px: int) -> None:
        """``side_px``: of the square."""
        self._usable_range_m = setup.usable_range_m
        self.view = setup.plan.view(MARGIN_M)
        self._still = blank_page(side_px, side_px)
        canvas = Canvas(self._still, self.view)
        paint_floor_plan(canvas, setup.plan)
        self.enlarged = canvas.enlarged
        """how many times as large as they are robots are drawn"""

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Fill ``picture``, (side, side, 3)."""
        picture[:] = self._still
        canvas = Canvas(picture, self.view)
        for robot in scene.guards:
            canvas.circle(robot.sensor, self._usable_range_m, GUARD_FAINT)
        for robot in scene.robots:
            color = GUARD if robot.is_guard else INTRUDER
            if robot.goal is not None:
                paint_path(canvas, robot.goal, robot.plan, color, robot.is_guard)
                canvas.label(robot.goal, str(robot.number), color, 11, 9)
        for robot in scene.robots:
            color = GUARD if robot.is_guard else INTRUDER
            paint_robot(canvas, robot.pose, self.enlarged, color, robot.model)
        for outlines in scene.others:
            for outline in outlines:
                canvas.polygon(outline, INTRUDER, WHITE)
        for found in scene.detections:
            paint_detection(canvas, found.box, found.is_false)
        for robot in scene.robots:
            canvas.label(robot.pose[:2], str(robot.number), GUARD if robot.is_guard else INTRUDER, 13, -13)
        for number, outlines in enumerate(scene.others, 1):
            x, y = np.concatenate(outlines).mean(axis=0).tolist()
            canvas.label((x, y), f"P{number}", INTRUDER, 13, -13)


class DetectionPanel:
    """What MIDNet makes of a frame: all guards' grids on the prior map, detections, and believed poses."""

    def __init__(self, setup: Setup) -> None:
        self.view = setup.plan.view(MARGIN_M)
        of_prior = [setup.prior_map.data >= 100, setup.prior.data == 0, setup.prior_map.data < 0]
        codes = np.select(of_prior, [WALL, INFLATED, UNKNOWN], FREE).astype(np.uint8)
        self._prior = setup.prior_map.with_data(codes)

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Draw over ``picture``, (height, width, 3); what is off the prior map stays as it is."""
        codes = self._prior.data.copy()
        for view in scene.explanation.views if scene.explanation else ():
            left, low = view.crop.x1_gmap, view.crop.y1_gmap
            window = codes[low : low + view.d.height, left : left + view.d.width]
            window[(view.c.data == 0) & (window != FOREGROUND)] = COMMON
            window[view.d.data != 0] = FOREGROUND
        canvas = Canvas(picture, self.view)
        canvas.cells(self._prior.with_data(codes), SHADES)
        for robot in scene.guards:
            canvas.circle(robot.believed[:2], 4.0 / canvas.scale, GUARD, -1)
        for found in scene.detections:
            paint_detection(canvas, found.box, found.is_false)
        for found in scene.detections:
            color = FALSE_DETECTION if found.is_false else DETECTION
            canvas.label((found.box.x_min, found.box.y_max), str(found.guard), color, 5, -8)


class ScenePainter:
    """Paints the pictures of a trial's video. What never moves is painted once."""

    def __init__(self, setup: Setup, speed: float) -> None:
        """``speed``: how much faster than the trial's own time the video runs."""
        self._world = WorldPanel(setup, HEIGHT)
        self._detections = DetectionPanel(setup)
        self._page = blank_page(WIDTH, HEIGHT)
        _write_title(self._page, setup, speed, self._world.enlarged)
        _draw_legend(self._page)

    def paint(self, scene: Scene) -> Picture:
        """(720, 1280, 3) the trial at the scene's instant."""
        picture = self._page.copy()
        self._world.paint(picture[:, :HEIGHT], scene)
        beside = picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
        self._detections.paint(beside, scene)
        write_right(picture, COLUMN_RIGHT, 8, f"{scene.time_s:.1f} s", 24, INK)
        boxes, false = len(scene.detections), sum(found.is_false for found in scene.detections)
        counts = f"detections: {boxes}, of which touch no intruder: {false}"
        write(picture, COLUMN_LEFT + 8, COUNTS_TOP, counts, 14, INK)
        return picture


def _write_title(page: Picture, setup: Setup, speed: float, enlarged: float) -> None:
    write(page, COLUMN_LEFT, 10, setup.plan.title, 20, INK, bold=True)
    intruders = setup.mobile_intruders + setup.other_intruders + len(setup.plan.stationary)
    size = f"; robots drawn {enlarged:.1f} times their size" if enlarged > 1.0 else ""
    team = f"{setup.guards} guard{_s(setup.guards)}, {intruders} intruder{_s(intruders)}"
    heading = f"{team}; {speed:g} x real time{size}"
    write(page, COLUMN_LEFT, 38, heading, 14, INK)
    write(page, MAP_LEFT, MAP_TOP - 20, "what MIDNet sees, on the prior map", 13, FAINT_INK)


def _s(count: int) -> str:
    return "" if count == 1 else "s"


def _draw_legend(page: Picture) -> None:
    """Two columns under the map: marks of the world, and marks of the map."""
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    of_world, of_map = COLUMN_LEFT + 16, COLUMN_LEFT + 262
    rows = [-(LEGEND_TOP + 23 * row) for row in range(5)]

    for y, color in ((rows[0], GUARD), (rows[1], INTRUDER)):
        paint_robot(canvas, Pose2D(of_world + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, color)
    canvas.polygon(_swatch(of_world, rows[2]), INTRUDER_FAINT, INTRUDER, 2)
    for y, is_guard in ((rows[3], True), (rows[4], False)):
        path = np.array([(of_world - 14.0, y), (of_world + 10.0, y)])
        paint_path(canvas, (of_world + 12.0, y), path, GUARD if is_guard else INTRUDER, is_guard)

    for y, is_false in ((rows[0], False), (rows[1], True)):
        paint_detection(canvas, Box(of_map - 8.0, y - 7.0, of_map + 8.0, y + 7.0), is_false)
    for y, code in ((rows[2], FOREGROUND), (rows[3], COMMON), (rows[4], INFLATED)):
        red, green, blue = SHADES[code].tolist()
        canvas.polygon(_swatch(of_map, y), (red, green, blue))

    texts = (
        ("guard", "detection, with its guard's number"),
        ("mobile intruder", "detection that touches no intruder"),
        ("stationary intruder", "seen, not on the prior map (D)"),
        ("path and goal of a guard", "seen, on the prior map (C)"),
        ("path and goal of an intruder", "margin of the prior map (Eq. 1)"),
    )
    for y, (world, seen) in zip(rows, texts, strict=True):
        write(page, of_world + 24, -y - 9, world, 13, INK)
        write(page, of_map + 18, -y - 9, seen, 13, INK)


def _swatch(x: float, y: float) -> Floats:
    return np.array([(x - 8.0, y - 6.0), (x + 8.0, y - 6.0), (x + 8.0, y + 6.0), (x - 8.0, y + 6.0)])


class Storyboard:
    """A page of scenes that are evenly spread over a trial, however long it turns out to be."""

    SCENES, COLUMNS = 12, 4
    TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 12, 44, 24
    LEGEND = (
        ("guards", GUARD),
        ("intruders", INTRUDER),
        ("detections", DETECTION),
        ("crossed out: detections that touch no intruder", FALSE_DETECTION),
    )

    def __init__(self, setup: Setup) -> None:
        self._title = setup.plan.title
        self._world = WorldPanel(setup, self.TILE_PX)
        self._scenes: list[Scene] = []
        self._every = 1
        self._offered = 0

    def offer(self, scene: Scene) -> None:
        """The next frame; most are not kept."""
        if self._offered % self._every == 0:
            self._scenes.append(replace(scene, explanation=None))  # grids would fill the memory
            # never more than four times what will be shown
            if len(self._scenes) > 4 * self.SCENES:
                self._scenes, self._every = self._scenes[::2], 2 * self._every
        self._offered += 1

    def chosen(self) -> list[Scene]:
        """The first frame, the last one kept and those between at even distances; at most a dozen."""
        last = len(self._scenes) - 1
        picked = np.linspace(0, last, min(self.SCENES, last + 1)).round().astype(int)
        return [self._scenes[index] for index in picked.tolist()]

    def page(self) -> Picture:
        """(height, width, 3) the chosen scenes in reading order."""
        chosen = self.chosen()
        step = self.TILE_PX + self.GAP_PX
        rows = -(-len(chosen) // self.COLUMNS)
        page = blank_page(self.COLUMNS * step + self.GAP_PX, self.HEAD_PX + rows * (step + self.CAPTION_PX))
        write(page, self.GAP_PX, 8, self._title, 20, INK, bold=True)
        left = self.GAP_PX + step
        for text, color in self.LEGEND:
            write(page, left, 11, text, 16, color, bold=True)
            left += text_mask(text, 16, True).shape[1] + 3 * self.GAP_PX
        for place, scene in enumerate(chosen):
            top = self.HEAD_PX + place // self.COLUMNS * (step + self.CAPTION_PX)
            left = self.GAP_PX + place % self.COLUMNS * step
            write(page, left, top, f"{scene.time_s:.1f} s", 16, INK)
            top += self.CAPTION_PX
            self._world.paint(page[top : top + self.TILE_PX, left : left + self.TILE_PX], scene)
        return page
