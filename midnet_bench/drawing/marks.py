"""The marks that a clip draws on a canvas: walls, Burgers, ways and goals, detections."""

from midnet_bench.agents.mobile_robot import Point
from midnet_bench.drawing.canvas import Canvas, Floats
from midnet_bench.drawing.palette import (
    DETECTION,
    FALSE_DETECTION,
    FLOOR,
    GROUND,
    INTRUDER,
    INTRUDER_FAINT,
    RGB,
    WHITE,
    WOOD,
    WOOD_EDGE,
)
from midnet_bench.drawing.scene import Stage, burger_at, enclosure_of
from midnet_bench.geometry import Box, Pose2D

BURGER_LENGTH_M = 0.14


def paint_standing(canvas: Canvas, trial: Stage) -> None:
    """Ground, floor, walls and stationary intruders."""
    canvas.picture[:] = GROUND
    canvas.fill(enclosure_of(trial), FLOOR)
    solids = trial.arena.wall_solids()
    # edges first, so that pieces of wall that share an end look like one
    for solid in solids:
        canvas.polygon(solid.outline(), None, WOOD_EDGE, 3)
    for solid in solids:
        canvas.polygon(solid.outline(), WOOD)
    for number, solid in enumerate(trial.layout.stationary, 1):
        canvas.polygon(solid.outline(), INTRUDER_FAINT, INTRUDER, 2)
        canvas.label(solid.pose[:2], f"S{number}", INTRUDER)


def paint_burger(canvas: Canvas, pose: Pose2D, enlarged: float, color: RGB) -> None:
    """A Burger from above, so many times as large as it is; a white line points ahead."""
    canvas.polygon(burger_at(pose, enlarged), color, WHITE)
    ahead = pose.compose(Pose2D(0.045 * enlarged, 0.0, 0.0))
    canvas.line([pose[:2], ahead[:2]], WHITE, 2)


def paint_way(canvas: Canvas, goal: Point, plan: Floats | None, color: RGB, is_guard: bool) -> None:
    """The plan in dots; the goal, a cross for a guard and a diamond for an intruder."""
    if plan is not None:
        canvas.dots(plan, color)
    x, y = goal
    arm = 5.0 / canvas.scale
    if is_guard:
        canvas.line([(x - arm, y - arm), (x + arm, y + arm)], color, 2)
        canvas.line([(x - arm, y + arm), (x + arm, y - arm)], color, 2)
    else:
        canvas.polygon([(x - arm, y), (x, y - arm), (x + arm, y), (x, y + arm)], WHITE, color, 2)


def paint_box(canvas: Canvas, box: Box, is_false: bool) -> None:
    """A detection. A false one is crossed out as well: colour alone is not for everybody."""
    color = FALSE_DETECTION if is_false else DETECTION
    canvas.box(box, color, 2)
    if is_false:
        canvas.line([box[:2], box[2:]], color)
