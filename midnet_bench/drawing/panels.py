"""The two views of a guarded trial's instant: the true world, and what MIDNet makes of it."""

import math

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
)
from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, INTRUDER, RGB, WHITE
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Robot, Scene, Setup

MARGIN_M = 0.25
"""around an arena"""
LEG_PX = 8.0
"""half a side of what is kept free of labels about a leg"""
AT_GOAL_PX = 24.0
"""nearer to its goal than this, a robot's number stands for both"""

SHADES: tuple[RGB, ...] = (
    WHITE,
    (205, 205, 205),
    (226, 226, 226),
    (70, 70, 70),
    (140, 140, 140),
    (240, 200, 40),
)
FREE, UNKNOWN, INFLATED, WALL, COMMON, FOREGROUND = range(len(SHADES))
"""What a cell is: of the prior map, or in grid C of some guard, or in grid D of one."""


class WorldPanel:
    """The true world: guards, intruders, paths, goals and detections over the walls."""

    def __init__(
        self, setup: Setup, width_px: int, height_px: int | None = None, label_px: int = LABEL_PX
    ) -> None:
        """``height_px``: as the width unless given; ``label_px``: height of the labels."""
        self._setup, self._label_px = setup, label_px
        self.view = setup.plan.view(MARGIN_M)
        self._still = blank_page(width_px, height_px or width_px)
        canvas = Canvas(self._still, self.view)
        paint_floor_plan(canvas, setup.plan)
        self.enlarged = canvas.enlarged
        """how many times as large as they are robots are drawn"""

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Fill ``picture``, (height, width, 3)."""
        picture[:] = self._still
        canvas = Canvas(picture, self.view, self._label_px)
        labels = Labels(canvas)
        paint_scale(canvas, self.view)
        _paint_sensing(canvas, self._setup, scene)
        for robot in scene.robots:
            if robot.goal is not None:
                paint_path(canvas, robot.goal, robot.plan, _color_of(robot), robot.is_guard)
                labels.keep_free(robot.goal, 5.0)
        # robots do not know of stationary intruders: a goal under one is hidden, or it would look like a part
        paint_stationary(canvas, self._setup.plan)
        for robot in scene.robots:
            paint_robot(canvas, robot.pose, self.enlarged, _color_of(robot), robot.model)
            labels.keep_free(robot.pose[:2], 0.4 * BURGER_LENGTH_M * self.enlarged * canvas.scale)
        for outlines in scene.others:
            for outline in outlines:
                canvas.polygon(outline, INTRUDER, WHITE)
                x, y = outline.mean(axis=0).tolist()
                labels.keep_free((x, y), LEG_PX)
        _paint_results(canvas, scene, labels, self.enlarged)
        label_stationary(canvas, self._setup.plan, labels)
        for robot in scene.robots:
            labels.put(robot.pose[:2], str(robot.number), _color_of(robot), 13.0)
        for number, outlines in enumerate(scene.others, 1):
            x, y = np.concatenate(outlines).mean(axis=0).tolist()
            labels.put((x, y), f"P{number}", INTRUDER, 13.0)
        for robot in scene.robots:
            # a robot at its goal has its number there already
            if (
                robot.goal is not None
                and math.dist(robot.goal, robot.pose[:2]) * canvas.scale > AT_GOAL_PX
                and not self._setup.plan.hides(robot.goal)
            ):
                labels.put(robot.goal, str(robot.number), _color_of(robot), 10.0)


class DetectionPanel:
    """What MIDNet makes of a frame: all guards' grids on the prior map, detections, and believed poses."""

    def __init__(self, setup: Setup, label_px: int = LABEL_PX, shows_outlines: bool = False) -> None:
        """``shows_outlines``: whether the true outlines of robots and intruders are drawn too, thin."""
        self._setup, self.view = setup, setup.plan.view(MARGIN_M)
        self._label_px, self._shows_outlines = label_px, shows_outlines
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
        canvas = Canvas(picture, self.view, self._label_px)
        canvas.cells(self._prior.with_data(codes), SHADES)
        _paint_sensing(canvas, self._setup, scene)
        if self._shows_outlines:
            paint_scale(canvas, self.view)
            for outline in [outline for truth in scene.truths for outline in truth.outlines]:
                canvas.polygon(outline, None, INTRUDER)
            for robot in scene.guards:
                canvas.polygon(robot.outline, None, GUARD)
        for robot in scene.guards:
            canvas.circle(robot.believed[:2], 4.0 / canvas.scale, GUARD, -1)
        labels = Labels(canvas)
        _paint_results(canvas, scene, labels, 1.0)
        if self._shows_outlines:
            for robot in scene.guards:
                labels.put(robot.believed[:2], str(robot.number), GUARD, 12.0)
        for found in scene.detections:
            color = FALSE_DETECTION if found.is_false else DETECTION
            labels.put((found.box.x_min, found.box.y_max), str(found.guard), color, 8.0)


def _color_of(robot: Robot) -> RGB:
    return GUARD if robot.is_guard else INTRUDER


def _paint_sensing(canvas: Canvas, setup: Setup, scene: Scene) -> None:
    """How far the guards see, and what their LiDARs have met."""
    for robot in scene.guards:
        paint_reach(canvas, setup, robot)
    if setup.shows_scans:
        paint_scans(canvas, scene.scans)


def _paint_results(canvas: Canvas, scene: Scene, labels: Labels, enlarged: float) -> None:
    """Detections, and the signs about intruders without one; labels keep off both."""
    for found in scene.detections:
        paint_detection(canvas, found)
        labels.keep_edges_free(found.box)
    for truth in scene.truths:
        corners = paint_sign(canvas, truth, enlarged)
        if corners is not None:
            labels.keep_edges_free(corners)
            labels.keep_free((corners.x_min, corners.y_max), BADGE_PX)
