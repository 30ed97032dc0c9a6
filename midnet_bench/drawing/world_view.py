"""``WorldView``: the true world from above, on a square of pixels."""

import numpy as np

from midnet_bench.drawing.canvas import Canvas, Picture
from midnet_bench.drawing.marks import BURGER_LENGTH_M, paint_box, paint_burger, paint_standing, paint_way
from midnet_bench.drawing.palette import GUARD, GUARD_FAINT, INTRUDER
from midnet_bench.drawing.scene import Scene, view_of
from midnet_bench.experiments.guarded.arena import GuardedArena

MARGIN_M = 0.25
LEAST_BURGER_PX = 13.0


class WorldView:
    """Guards, intruders, plans, goals and detections over walls that are painted once."""

    def __init__(self, trial: GuardedArena, side_px: int) -> None:
        self._reach_m = trial.parameters.obstacle_range_m
        self._view = view_of(trial, MARGIN_M)
        self._standing = np.zeros((side_px, side_px, 3), dtype=np.uint8)
        canvas = Canvas(self._standing, self._view)
        paint_standing(canvas, trial)
        self.enlarged = max(1.0, LEAST_BURGER_PX / (BURGER_LENGTH_M * canvas.scale))
        """how many times as large as they are robots are drawn: they stay visible in a large arena"""

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Fill ``picture``, (side, side, 3), with the scene."""
        picture[:] = self._standing
        canvas = Canvas(picture, self._view)
        for robot in scene.guards:
            canvas.circle(robot.sensor, self._reach_m, GUARD_FAINT)
        for robot in scene.robots:
            color = GUARD if robot.is_guard else INTRUDER
            if robot.goal is not None:
                paint_way(canvas, robot.goal, robot.plan, color, robot.is_guard)
                canvas.label(robot.goal, str(robot.number), color, 11, 9)
        for robot in scene.robots:
            paint_burger(canvas, robot.pose, self.enlarged, GUARD if robot.is_guard else INTRUDER)
        for found in scene.detections:
            paint_box(canvas, found.box, found.is_false)
        for robot in scene.robots:
            canvas.label(robot.pose[:2], str(robot.number), GUARD if robot.is_guard else INTRUDER, 13, -13)
