"""The arena from above, the paper's first figure, with everybody in it."""

import math

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from midnet_bench.drawing.palette import (
    FLOOR,
    GROUND,
    GUARD,
    GUARD_FAINT,
    INTRUDER,
    INTRUDER_FAINT,
    WOOD,
    WOOD_EDGE,
    hexadecimal,
)
from midnet_bench.drawing.plots import add_box, add_label, add_polygon, new_figure, show_metres
from midnet_bench.drawing.scene import RobotMark, Scene, enclosure_of, title_of, view_of
from midnet_bench.experiments.guarded.arena import GuardedArena

MARGIN_M = 0.4
HATCH = "////"


def draw_arena(trial: GuardedArena, scene: Scene) -> Figure:
    """Walls, stationary and mobile intruders, guards and the reach of their sensors, and who heads where."""
    figure = new_figure(9.6, 7.3)
    axes = figure.add_axes((0.065, 0.075, 0.68, 0.87))
    show_metres(axes, view_of(trial, MARGIN_M))
    axes.set_facecolor(hexadecimal(GROUND))
    axes.set_title(f"{title_of(trial)}, t = {scene.time_s:.1f} s", fontsize=11, loc="left")
    axes.set_xlabel("x / m", fontsize=9)
    axes.set_ylabel("y / m", fontsize=9)
    add_box(axes, enclosure_of(trial), FLOOR, fill=True, facecolor=hexadecimal(FLOOR), zorder=0)
    reach_m = trial.parameters.obstacle_range_m
    for robot in scene.guards:
        axes.add_patch(Circle(robot.sensor, reach_m, color=hexadecimal(GUARD_FAINT), alpha=0.05, zorder=1))
        axes.add_patch(
            Circle(robot.sensor, reach_m, fill=False, color=hexadecimal(GUARD_FAINT), linewidth=0.7, zorder=1)
        )
    _add_walls(axes, trial)
    _add_stationary(axes, trial)
    for robot in scene.robots:
        _add_way(axes, robot)
    for robot in scene.robots:
        _add_robot(axes, robot, scene)
    figure.legend(
        handles=_legend(trial, scene),
        loc="upper left",
        bbox_to_anchor=(0.755, 0.95),
        fontsize=8.5,
        frameon=False,
        labelspacing=0.9,
    )
    return figure


def _add_walls(axes: Axes, trial: GuardedArena) -> None:
    solids = trial.arena.wall_solids()
    # edges first, so that pieces of wall that share an end look like one
    for solid in solids:
        add_polygon(
            axes, solid.outline(), fill=False, edgecolor=hexadecimal(WOOD_EDGE), linewidth=2, zorder=2
        )
    for solid in solids:
        add_polygon(axes, solid.outline(), facecolor=hexadecimal(WOOD), edgecolor="none", zorder=2.1)


def _add_stationary(axes: Axes, trial: GuardedArena) -> None:
    for number, solid in enumerate(trial.layout.stationary, 1):
        add_polygon(
            axes,
            solid.outline(),
            facecolor=hexadecimal(INTRUDER_FAINT),
            edgecolor=hexadecimal(INTRUDER),
            hatch=HATCH,
            linewidth=1.2,
            zorder=3,
        )
        add_label(axes, solid.pose[:2], f"S{number}", INTRUDER, ha="center", va="center", xytext=(0, 0))


def _add_way(axes: Axes, robot: RobotMark) -> None:
    if robot.goal is None:
        return
    color = GUARD if robot.is_guard else INTRUDER
    marker = "x" if robot.is_guard else "D"
    axes.plot(*robot.goal, marker=marker, color=hexadecimal(color), markersize=5, fillstyle="none", zorder=4)
    add_label(axes, robot.goal, str(robot.number), color, fontsize=7, xytext=(4, -7))
    if robot.plan is not None:
        axes.plot(*robot.plan.T, color=hexadecimal(color), linewidth=0.9, linestyle=":", zorder=3.5)


def _add_robot(axes: Axes, robot: RobotMark, scene: Scene) -> None:
    color = GUARD if robot.is_guard else INTRUDER
    x, y, _ = robot.pose
    # a disc of fixed size under it, to be found by where a Burger to scale is a few dots
    axes.scatter([x], [y], s=40, color=hexadecimal(color), alpha=0.35, linewidths=0, zorder=4)
    add_polygon(axes, robot.outline, facecolor=hexadecimal(color), edgecolor="white", linewidth=0.4, zorder=5)
    axes.plot(*zip((x, y), robot.front, strict=True), color="white", linewidth=1.2, zorder=6)
    right, up = _away_from_others(robot, scene)
    add_label(
        axes,
        (x, y),
        str(robot.number),
        color,
        fontweight="bold",
        fontsize=9,
        xytext=(11 * right, 11 * up),
        ha="center",
        va="center",
    )


def _away_from_others(robot: RobotMark, scene: Scene) -> tuple[float, float]:
    """A unit vector to where a label does not lie on the next robot."""
    x, y, _ = robot.pose
    others = [other.pose for other in scene.robots if other is not robot]
    nearest = min(others, key=robot.pose.distance_to, default=None)
    if nearest is None or robot.pose.distance_to(nearest) > 0.6:
        return math.sqrt(0.5), math.sqrt(0.5)
    gap = robot.pose.distance_to(nearest)
    return (x - nearest.x) / gap, (y - nearest.y) / gap


def _legend(trial: GuardedArena, scene: Scene) -> list[Artist]:
    """What the colours and marks of this very picture mean."""
    wood = Patch(facecolor=hexadecimal(WOOD), edgecolor=hexadecimal(WOOD_EDGE), label="wall")
    guard = Patch(facecolor=hexadecimal(GUARD), label="guard, white: ahead")
    reach = Line2D(
        [], [], color=hexadecimal(GUARD_FAINT), marker="o", markersize=9, fillstyle="none", linestyle="none"
    )
    reach.set_label(f"its usable range, {trial.parameters.obstacle_range_m:g} m")
    guard_way = Line2D([], [], color=hexadecimal(GUARD), marker="x", linestyle=":", label="its way and goal")
    handles: list[Artist] = [wood, guard, reach, guard_way]
    if trial.intruders:
        mobile = Patch(facecolor=hexadecimal(INTRUDER), label="mobile intruder")
        way = Line2D([], [], color=hexadecimal(INTRUDER), marker="D", fillstyle="none", linestyle=":")
        way.set_label("its way and goal")
        handles += [mobile, way]
    if trial.layout.stationary:
        stationary = Patch(
            facecolor=hexadecimal(INTRUDER_FAINT), edgecolor=hexadecimal(INTRUDER), hatch=HATCH
        )
        stationary.set_label("stationary intruder")
        handles.append(stationary)
    return handles
