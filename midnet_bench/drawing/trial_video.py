"""A guarded trial in motion: an MP4 with the true world beside what MIDNet makes of it, and a storyboard."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from midnet_bench.drawing.canvas import (
    BADGE_PX,
    LABEL_PX,
    Canvas,
    Labels,
    Picture,
    blank_page,
    label_stationary,
    paint_detection,
    paint_floor_plan,
    paint_path,
    paint_reach,
    paint_robot,
    paint_scale,
    paint_scans,
    paint_sign,
    paint_stationary,
    png_of,
    text_mask,
    write,
    write_right,
)
from midnet_bench.drawing.palette import (
    DETECTION,
    FAINT_INK,
    FALSE_DETECTION,
    GROUND,
    GUARD,
    GUARD_RANGE,
    INK,
    INTRUDER,
    INTRUDER_FAINT,
    WHITE,
)
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Floats, Scene, Setup, Truth
from midnet_bench.drawing.signs import DUPLICATE, FALSE_POSITIVE, MISS, NO_ERROR, TRUE_POSITIVE
from midnet_bench.drawing.video import mp4_file
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.io.files import write_atomically

WIDTH, HEIGHT = 1280, 720
MARGIN_M = 0.25
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
MAP_LEFT, MAP_TOP, MAP_PX = 786, 84, 436
COUNTS_TOP, LEGEND_TOP, LEGEND_ROW_PX = 529, 566, 20
HOLD_S = 2.0
"""for so long the film shows its last picture, which has the outcome"""
LEG_PX = 8.0
"""half a side of what is kept free of labels about a leg"""
AT_GOAL_PX = 24.0
"""nearer to its goal than this, a robot's number stands for both"""

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
        last: list[Picture] = []

        def append(scene: Scene) -> None:
            last[:] = [painter.paint(scene)]
            append_picture(last[0])
            storyboard.offer(scene)

        yield append
        for picture in last * round(HOLD_S * setup.frame_hz * speed):
            append_picture(picture)
    write_atomically(directory / "storyboard.png", png_of(storyboard.page()))


class WorldPanel:
    """The true world on a square of pixels: guards, intruders, paths, goals and detections over the walls."""

    def __init__(self, setup: Setup, side_px: int, label_px: int = LABEL_PX) -> None:
        """``side_px``: of the square; ``label_px``: height of its labels."""
        self._setup, self._label_px = setup, label_px
        self.view = setup.plan.view(MARGIN_M)
        self._still = blank_page(side_px, side_px)
        canvas = Canvas(self._still, self.view)
        paint_floor_plan(canvas, setup.plan)
        self._plan = setup.plan
        self.enlarged = canvas.enlarged
        """how many times as large as they are robots are drawn"""

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Fill ``picture``, (side, side, 3)."""
        picture[:] = self._still
        canvas = Canvas(picture, self.view, self._label_px)
        labels = Labels(canvas)
        paint_scale(canvas, self.view)
        for robot in scene.guards:
            paint_reach(canvas, self._setup, robot)
        if self._setup.shows_scans:
            paint_scans(canvas, scene.scans)
        for robot in scene.robots:
            color = GUARD if robot.is_guard else INTRUDER
            if robot.goal is not None:
                paint_path(canvas, robot.goal, robot.plan, color, robot.is_guard)
                labels.keep_free(robot.goal, 5.0)
        # robots do not know of stationary intruders: a goal under one is hidden, or it would look like a part
        paint_stationary(canvas, self._plan)
        for robot in scene.robots:
            color = GUARD if robot.is_guard else INTRUDER
            paint_robot(canvas, robot.pose, self.enlarged, color, robot.model)
            labels.keep_free(robot.pose[:2], 0.4 * BURGER_LENGTH_M * self.enlarged * canvas.scale)
        for outlines in scene.others:
            for outline in outlines:
                canvas.polygon(outline, INTRUDER, WHITE)
                x, y = outline.mean(axis=0).tolist()
                labels.keep_free((x, y), LEG_PX)
        for found in scene.detections:
            paint_detection(canvas, found.box, found.is_false, found.is_further)
            labels.keep_edges_free(found.box)
        _paint_signs(canvas, scene, labels, self.enlarged)
        label_stationary(canvas, self._plan, labels)
        for robot in scene.robots:
            labels.put(robot.pose[:2], str(robot.number), GUARD if robot.is_guard else INTRUDER, 13.0)
        for number, outlines in enumerate(scene.others, 1):
            x, y = np.concatenate(outlines).mean(axis=0).tolist()
            labels.put((x, y), f"P{number}", INTRUDER, 13.0)
        for robot in scene.robots:
            # a robot at its goal has its number there already
            if (
                robot.goal is not None
                and math.dist(robot.goal, robot.pose[:2]) * canvas.scale > AT_GOAL_PX
                and not self._plan.hides(robot.goal)
            ):
                labels.put(robot.goal, str(robot.number), GUARD if robot.is_guard else INTRUDER, 10.0)


class DetectionPanel:
    """What MIDNet makes of a frame: all guards' grids on the prior map, detections, and believed poses."""

    def __init__(self, setup: Setup) -> None:
        self._setup, self.view = setup, setup.plan.view(MARGIN_M)
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
            paint_reach(canvas, self._setup, robot)
        if self._setup.shows_scans:
            paint_scans(canvas, scene.scans)
        for robot in scene.guards:
            canvas.circle(robot.believed[:2], 4.0 / canvas.scale, GUARD, -1)
        labels = Labels(canvas)
        for found in scene.detections:
            paint_detection(canvas, found.box, found.is_false, found.is_further)
            labels.keep_edges_free(found.box)
        _paint_signs(canvas, scene, labels, 1.0)
        for found in scene.detections:
            color = FALSE_DETECTION if found.is_false else DETECTION
            labels.put((found.box.x_min, found.box.y_max), str(found.guard), color, 8.0)


def _paint_signs(canvas: Canvas, scene: Scene, labels: Labels, enlarged: float) -> None:
    """The signs about intruders without a detection, which labels keep off."""
    for truth in scene.truths:
        corners = paint_sign(canvas, truth, enlarged)
        if corners is not None:
            labels.keep_edges_free(corners)
            labels.keep_free((corners.x_min, corners.y_max), BADGE_PX)


class ScenePainter:
    """Paints the pictures of a trial's video. What never moves is painted once."""

    def __init__(self, setup: Setup, speed: float) -> None:
        """``speed``: how much faster than the trial's own time the video runs."""
        self._world = WorldPanel(setup, HEIGHT)
        self._detections = DetectionPanel(setup)
        self._page = blank_page(WIDTH, HEIGHT)
        _write_title(self._page, setup, speed, self._world.enlarged)
        _draw_legend(self._page, setup)

    def paint(self, scene: Scene) -> Picture:
        """(720, 1280, 3) the trial at the scene's instant."""
        picture = self._page.copy()
        self._world.paint(picture[:, :HEIGHT], scene)
        beside = picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
        self._detections.paint(beside, scene)
        write_right(picture, COLUMN_RIGHT, 8, f"{scene.time_s:.1f} s", 24, INK)
        write(picture, COLUMN_LEFT + 8, COUNTS_TOP, scene.counter, 14, INK, bold=True)
        remark_px = text_mask(scene.remark, 14).shape[1]
        write(picture, COLUMN_RIGHT - remark_px, COUNTS_TOP, scene.remark, 14, INK)
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


def _draw_legend(page: Picture, setup: Setup) -> None:
    """Two columns under the map: what the trial may show of the world, and of what MIDNet makes of it."""
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    of_world: list[tuple[Mark, str]] = [(_guard, "guard")]
    if setup.mobile_intruders:
        of_world.append((_intruder, "mobile intruder"))
    if setup.plan.stationary:
        of_world.append((_stationary, "stationary intruder"))
    if setup.other_intruders:
        of_world.append((_legs, "person (two legs) or thing"))
    of_world += [
        (_missed, MISS),
        (_out_of_range, NO_ERROR),
        (_paths if setup.mobile_intruders else _path, "path and goal"),
        *([(_unknown, "unknown on the map")] if setup.plan.ground is not None else []),
        (_reach, f"costmap {setup.local_size_m:g} m, LiDAR {setup.usable_range_m:g} m"),
    ]
    of_map: list[tuple[Mark, str]] = [
        (_detection, f"{TRUE_POSITIVE}, with its guard's number"),
        (_further, DUPLICATE),
        (_false, FALSE_POSITIVE),
        (_shade(FOREGROUND), "seen, not on the prior map (D)"),
        (_shade(COMMON), "seen, on the prior map (C)"),
        (_shade(INFLATED), "margin of the prior map (Eq. 1)"),
    ]
    if setup.shows_scans:
        of_map.append((_returns, "LiDAR returns"))
    for left, marks in ((COLUMN_LEFT + 16, of_world), (COLUMN_LEFT + 262, of_map)):
        for row, (mark, text) in enumerate(marks):
            y = LEGEND_TOP + LEGEND_ROW_PX * row
            mark(canvas, left, -y)
            write(page, left + 21, y - 9, text, 13, INK)


Mark = Callable[[Canvas, float, float], None]
"""Draws what a legend explains on a canvas of one pixel a metre, about (x, y)."""
MARK_PX = 7.0
"""half a side"""


def _guard(canvas: Canvas, x: float, y: float) -> None:
    paint_robot(canvas, Pose2D(x + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, GUARD)


def _intruder(canvas: Canvas, x: float, y: float) -> None:
    paint_robot(canvas, Pose2D(x + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, INTRUDER)


def _stationary(canvas: Canvas, x: float, y: float) -> None:
    canvas.polygon(_swatch(x, y), INTRUDER_FAINT, INTRUDER, 2)


def _legs(canvas: Canvas, x: float, y: float) -> None:
    for leg in (-4.0, 4.0):
        canvas.circle((x + leg, y), 3.0, INTRUDER, -1)


def _path(canvas: Canvas, x: float, y: float) -> None:
    paint_path(canvas, (x + 9.0, y), np.array([(x - 14.0, y), (x + 7.0, y)]), GUARD, True)


def _paths(canvas: Canvas, x: float, y: float) -> None:
    paint_path(canvas, (x - 6.0, y), np.array([(x - 14.0, y), (x - 8.0, y)]), GUARD, True)
    paint_path(canvas, (x + 9.0, y), np.array([(x + 1.0, y), (x + 7.0, y)]), INTRUDER, False)


def _missed(canvas: Canvas, x: float, y: float) -> None:
    paint_sign(canvas, Truth([np.array([(x, y)])], False, True), 0.0, MARK_PX)


def _out_of_range(canvas: Canvas, x: float, y: float) -> None:
    paint_sign(canvas, Truth([np.array([(x, y)])], False, False), 0.0, MARK_PX)


def _unknown(canvas: Canvas, x: float, y: float) -> None:
    canvas.polygon(_swatch(x, y), GROUND)


def _reach(canvas: Canvas, x: float, y: float) -> None:
    canvas.circle((x, y), MARK_PX - 2.0, GUARD_RANGE)
    canvas.box(Box.square(x, y, 2.0 * MARK_PX), GUARD)


def _returns(canvas: Canvas, x: float, y: float) -> None:
    paint_scans(canvas, [np.array([(x - 6.0, y), (x, y), (x + 6.0, y)])])


def _detection(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), False)


def _further(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), False, is_further=True)


def _false(canvas: Canvas, x: float, y: float) -> None:
    paint_detection(canvas, Box.square(x, y, 2.0 * MARK_PX), True)


def _shade(code: int) -> Mark:
    red, green, blue = SHADES[code].tolist()
    return lambda canvas, x, y: canvas.polygon(_swatch(x, y), (red, green, blue))


def _swatch(x: float, y: float) -> Floats:
    return np.array([(x - 8.0, y - 6.0), (x + 8.0, y - 6.0), (x + 8.0, y + 6.0), (x - 8.0, y + 6.0)])


class Storyboard:
    """A page of scenes that are evenly spread over a trial, however long it turns out to be."""

    SCENES, COLUMNS = 6, 3
    TILE_PX, GAP_PX, LINE_PX = 400, 14, 23
    TEXT_PX, LABEL_PX = 18, 16
    """large enough for a page that is printed half as wide as paper"""
    TIME_PX = 84
    """room for the time before a scene's counter"""

    def __init__(self, setup: Setup) -> None:
        self._title = setup.plan.title
        self._has_stationary = bool(setup.plan.stationary)
        self._reach = setup.reach.replace("\n", " ")
        self._world = WorldPanel(setup, self.TILE_PX, self.LABEL_PX)
        self._scenes: list[Scene] = []
        self._turns: list[Scene] = []
        """the scenes with something new in their remark, of a trial that is about catching"""
        self._last: Scene | None = None
        self._every = 1
        self._offered = 0

    def offer(self, scene: Scene) -> None:
        """The next frame; most are not kept."""
        scene = replace(scene, explanation=None)  # grids would fill the memory
        if scene.chase and scene.remark and (self._last is None or self._last.remark != scene.remark):
            self._turns.append(scene)
        if self._offered % self._every == 0:
            self._scenes.append(scene)
            # never more than four times what will be shown
            if len(self._scenes) > 4 * self.SCENES:
                self._scenes, self._every = self._scenes[::2], 2 * self._every
        self._last = scene
        self._offered += 1

    def chosen(self) -> list[Scene]:
        """The first frame, the last one, the last catches and escapes, and others at even distances."""
        if self._last is None:
            return []
        kept = {scene.frame: scene for scene in [*self._scenes, self._last]}
        fixed = {scene.frame: scene for scene in self._turns[1 - self.SCENES :]}
        frames = sorted(kept)
        even = np.linspace(0, len(frames) - 1, min(self.SCENES, len(frames))).round().astype(int).tolist()
        # from both ends inwards: the first and the last scene tell the most
        fixed = {self._last.frame: self._last, **fixed}
        for place in sorted(even, key=lambda place: min(place, len(frames) - 1 - place)):
            if len(fixed) < self.SCENES:
                fixed[frames[place]] = kept[frames[place]]
        return [fixed[frame] for frame in sorted(fixed)]

    def page(self) -> Picture:
        """(height, width, 3) the chosen scenes in reading order."""
        chosen = self.chosen()
        step = self.TILE_PX + self.GAP_PX
        width = self.COLUMNS * step + self.GAP_PX
        legend = self._legend(chosen, width)
        head_px = 44 + self.LINE_PX * (1 + max((row for _, _, _, row in legend), default=0)) + 4
        caption_px = self.LINE_PX * (2 if any(scene.remark for scene in chosen) else 1) + 4
        rows = -(-len(chosen) // self.COLUMNS)
        page = blank_page(width, head_px + rows * (step + caption_px))
        write(page, self.GAP_PX, 8, self._title, 22, INK, bold=True)
        canvas = Canvas(page, Box(0.0, -float(page.shape[0]), float(page.shape[1]), 0.0))
        for mark, text, left, row in legend:
            middle = 44 + self.LINE_PX * row + 10
            mark(canvas, left + 8.0, -float(middle))
            write(page, left + 28, middle - 11, text, 16, INK)
        told = ""
        for place, scene in enumerate(chosen):
            top = head_px + place // self.COLUMNS * (step + caption_px)
            left = self.GAP_PX + place % self.COLUMNS * step
            write(page, left, top, f"{scene.time_s:.1f} s", self.TEXT_PX, INK, bold=True)
            write(page, left + self.TIME_PX, top, scene.counter, self.TEXT_PX, INK)
            if scene.remark != told:  # a catch is told once
                told = scene.remark
                write(page, left, top + self.LINE_PX, told, 16, INK)
            top += caption_px
            self._world.paint(page[top : top + self.TILE_PX, left : left + self.TILE_PX], scene)
        return page

    def _legend(self, scenes: Sequence[Scene], width: int) -> list[tuple[Mark, str, int, int]]:
        """What the marks mean that are in these scenes: mark, text, pixels from the left, row."""
        boxes = [found for scene in scenes for found in scene.detections]
        truths = [truth for scene in scenes for truth in scene.truths]
        some_intrude = any(scene.intruders for scene in scenes)
        is_labelled = any(scene.is_labelled for scene in scenes)
        entries: list[tuple[Mark, str, bool]] = [
            (_guard, "guard", True),
            (_intruder, "mobile intruder", some_intrude),
            (_stationary, "stationary intruder", self._has_stationary),
            (_legs, "person (two legs) or thing", any(scene.others for scene in scenes)),
            (_paths if some_intrude else _path, "path and goal", is_labelled or some_intrude),
            (
                _detection,
                TRUE_POSITIVE if is_labelled else "detection",
                any(not (one.is_false or one.is_further) for one in boxes),
            ),
            (_further, DUPLICATE, any(one.is_further for one in boxes)),
            (_false, FALSE_POSITIVE, any(one.is_false for one in boxes)),
            (_missed, MISS, any(truth.is_missed for truth in truths)),
            (_out_of_range, NO_ERROR, any(truth.is_out_of_range for truth in truths)),
            (_reach, self._reach, True),
        ]
        placed, left, row = [], self.GAP_PX, 0
        for mark, text, is_there in entries:
            wide = 28 + text_mask(text, 16).shape[1] + 24
            if is_there:
                if left + wide > width and left > self.GAP_PX:
                    left, row = self.GAP_PX, row + 1
                placed.append((mark, text, left, row))
                left += wide
        return placed
