"""Scenes made by hand, without a simulator, and MIDNet's true answer to what the guards in them would see."""

from functools import cache

import numpy as np

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.drawing.scene import Detection, FloorPlan, Robot, Scene, Setup, Truth
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import MIDNet, Observation
from midnet_bench.scoring.frame_counts import TruthObject, match_frame

GUARDS = 3
LOCAL_SIZE_M = 4.0
GHOST = Box.square(-1.0, -2.4, 0.3)  # marked in the costmaps where nothing stands


@cache
def setup_and_scene(arena_name: str = "map1", seed: int = 7) -> tuple[Setup, Scene]:
    """Three guards and the intruders of a seed's layout, each with a goal half a metre off."""
    arena = load_arena(arena_name)
    layout = place(arena, seed, GUARDS)
    # the middle guard stands where the others see it
    guards = [layout.robots[0], Pose2D(*layout.robots[0]).compose(Pose2D(0.9, 0.0, 2.0)), layout.robots[2]]
    prior_map = render_exact(arena)
    prior = prior_map.with_data(np.where(prior_map.data == 100, 0, 255).astype(np.uint8))
    setup = Setup(
        FloorPlan.of(arena, layout, seed),
        prior_map,
        prior,
        len(guards),
        len(layout.intruders),
        2.5,
        LOCAL_SIZE_M,
        5.0,
    )
    robots = [_robot(number, True, pose) for number, pose in enumerate(guards, 1)]
    robots += [_robot(number, False, pose) for number, pose in enumerate(layout.intruders, 1)]
    bodies = [solid.bounding_box() for solid in layout.stationary]
    bodies += [Box.square(*robot.pose[:2], 0.2) for robot in robots if not robot.is_guard]
    allies = [Box.square(*robot.pose[:2], 0.2) for robot in robots if robot.is_guard]
    observations = [
        Observation(guard, _costmap(prior_map, guard, [*bodies, GHOST, *allies[:k], *allies[k + 1 :]]))
        for k, guard in enumerate(guards)
    ]
    frame = MIDNet(prior).update(observations, explain=True)
    match = match_frame(frame.detections, [TruthObject("", body, body.center) for body in bodies])
    detections = [
        Detection(box, robot + 1, not touched, bool(touched) and truth is None)
        for box, robot, touched, truth in zip(
            frame.detections, frame.robots, match.touched, match.truth_of, strict=True
        )
    ]
    outlines = [*setup.plan.stationary, *(robot.outline for robot in robots if not robot.is_guard)]
    truths = [
        Truth(
            [outline],
            any(number in touched for touched in match.touched),
            any(body.distance_to_point(*guard[:2]) <= setup.usable_range_m for guard in guards),
        )
        for number, (outline, body) in enumerate(zip(outlines, bodies, strict=True))
    ]
    return setup, Scene(5.0, 25, robots, detections, truths, frame.explanation)


def _robot(number: int, is_guard: bool, pose: Pose2D) -> Robot:
    goal = pose.compose(Pose2D(0.5, 0.0, 0.0))
    return Robot(number, is_guard, pose, pose, goal[:2], np.array([pose[:2], goal[:2]]))


def _costmap(prior_map: OccupancyGrid, guard: Pose2D, bodies: list[Box]) -> OccupancyGrid:
    """What is within two metres of a guard, int8 published costs, no inflation."""
    data = np.where(prior_map.data == 100, 100, 0).astype(np.int8)
    for body in bodies:
        columns, rows = (
            slice(*sorted((prior_map.cell_at(body.x_min, body.y_min)[axis], last + 1)))
            for axis, last in enumerate(prior_map.cell_at(body.x_max, body.y_max))
        )
        data[rows, columns] = 100
    column, row = prior_map.cell_at(guard.x - LOCAL_SIZE_M / 2.0, guard.y - LOCAL_SIZE_M / 2.0)
    side = round(LOCAL_SIZE_M / prior_map.resolution)
    left, low = max(column, 0), max(row, 0)
    x, y = prior_map.origin
    origin = (x + left * prior_map.resolution, y + low * prior_map.resolution)
    window = data[low : row + side, left : column + side]
    return OccupancyGrid(window.copy(), prior_map.resolution, origin)
