"""What is drawn stands where it belongs, in the colours that the legend names."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from midnet_bench.drawing.canvas import Canvas, Picture, text_mask, write
from midnet_bench.drawing.palette import (
    DETECTION,
    FALSE_DETECTION,
    FLOOR,
    GROUND,
    GUARD,
    INTRUDER,
    INTRUDER_FAINT,
    RGB,
    WOOD,
)
from midnet_bench.drawing.plots import png_of_figure
from midnet_bench.drawing.scene import Scene, body_at
from midnet_bench.drawing.stills import coarsened, draw_arena, draw_detections, draw_grids, known_corners
from midnet_bench.drawing.trial_video import (
    FOREGROUND,
    MAP_LEFT,
    MAP_PX,
    MAP_TOP,
    MARGIN_M,
    SHADES,
    ScenePainter,
    Storyboard,
    WorldPanel,
)
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Explanation
from tests.drawing.hand_made import GHOST, layout_of, setup_and_scene, without_explanation

BESIDE = (Pose2D(-0.05, 0.045, 0.0), Pose2D(-0.05, -0.045, 0.0))
"""points of a Burger's body on both sides of the line that shows its heading; a box's edge may hide one"""
SETUP, SCENE = setup_and_scene()


def explanation_of(scene: Scene) -> Explanation:
    assert scene.explanation is not None
    return scene.explanation


def picture_of(figure: Figure) -> Picture:
    picture = cv2.imdecode(np.frombuffer(png_of_figure(figure), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[..., ::-1].astype(np.uint8)


@pytest.mark.slow
def test_the_video_shows_walls_robots_and_intruders_where_they_are() -> None:
    picture = ScenePainter(SETUP, 2.0).paint(SCENE)
    assert picture.shape == (720, 1280, 3)
    world = Canvas(picture[:, :720], SETUP.plan.view(MARGIN_M))

    def color_at(x: float, y: float) -> RGB:
        column, row = np.floor(world.pixels((x, y))).astype(int).tolist()
        red, green, blue = world.picture[row, column].tolist()
        return red, green, blue

    for wall in SETUP.plan.walls:
        x, y = wall.mean(axis=0).tolist()
        if not any(found.box.distance_to_point(x, y) < 0.2 for found in SCENE.detections):
            assert color_at(x, y) == WOOD
    assert color_at(-3.2, -3.2) == GROUND
    for robot in SCENE.robots:
        color = GUARD if robot.is_guard else INTRUDER
        assert color in [color_at(*robot.pose.compose(point)[:2]) for point in BESIDE]
    inside = [color_at(*solid.pose.compose(Pose2D(0.15, 0.1, 0.0))[:2]) for solid in layout_of().stationary]
    assert INTRUDER_FAINT in inside
    shown = {tuple(color) for color in world.picture.reshape(-1, 3).tolist()}
    assert {FLOOR, DETECTION, FALSE_DETECTION} <= shown


def test_the_map_beside_it_shows_the_foreground_of_every_guard() -> None:
    picture = ScenePainter(SETUP, 2.0).paint(replace(SCENE, robots=[], detections=[]))
    beside = picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
    canvas = Canvas(beside, SETUP.plan.view(MARGIN_M))
    for view in explanation_of(SCENE).views:
        rows, columns = np.nonzero(view.d.data)
        assert len(rows) > 20
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            x, y = np.floor(canvas.pixels(view.d.center_of(column, row))).astype(int).tolist()
            assert canvas.picture[y, x].tolist() == SHADES[FOREGROUND].tolist()
    without = ScenePainter(SETUP, 2.0).paint(without_explanation(SCENE))
    assert not (without == SHADES[FOREGROUND]).all(axis=2)[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT:].any()


def test_the_arena_picture_has_the_same_things_in_the_same_colours() -> None:
    figure = draw_arena(SETUP, SCENE)
    picture, axes = picture_of(figure), figure.axes[0]

    def color_at(x: float, y: float) -> RGB:
        column, up = np.floor(axes.transData.transform((x, y))).astype(int).tolist()
        red, green, blue = picture[len(picture) - 1 - up, column].tolist()
        return red, green, blue

    assert color_at(-1.0, -3.0) == color_at(3.0, -1.0) == WOOD
    assert color_at(-3.3, -3.3) == GROUND
    for robot in SCENE.robots:
        color = GUARD if robot.is_guard else INTRUDER
        assert color in [color_at(*robot.pose.compose(point)[:2]) for point in BESIDE]
    assert "seed 7" in axes.get_title(loc="left")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"wall", "mobile intruder", "stationary intruder"} <= set(labels)
    assert len(set(labels)) == len(labels), "two entries of a legend say the same"


@pytest.mark.slow
def test_a_picture_is_as_wide_as_its_arena_and_its_legend_need() -> None:
    setup, scene = setup_and_scene("map2")
    plan = replace(setup.plan, walls=[wall * (1.0, 0.3) for wall in setup.plan.walls])
    wide = draw_arena(replace(setup, plan=replace(plan, enclosure=Box(-1, -1, 1, 1), stationary=[])), scene)
    for figure in (draw_arena(setup, scene), draw_detections(setup, scene), wide):
        figure.draw_without_rendering()
        axes, legend = figure.axes[0].get_tightbbox(), figure.legends[0].get_window_extent()
        assert axes is not None
        assert 0.0 <= axes.x0 < axes.x1 < legend.x0 < legend.x1 < figure.bbox.x1
        assert min(axes.y0, legend.y0) >= 0.0
        assert axes.x1 - axes.x0 > 900.0, "the arena has the full width"


def test_grids_have_a_row_per_guard_with_y_up_and_their_boxes() -> None:
    explanation = explanation_of(SCENE)
    figure = draw_grids(SETUP, SCENE, explanation)
    assert len(figure.axes) == 4 * len(explanation.views)
    assert {axes.get_xlabel() for axes in figure.axes[-4:]} == {"x / m"}
    assert {axes.get_ylabel() for axes in figure.axes[::4]} == {"y / m"}
    picture = picture_of(figure)
    compared = 0
    for robot, view in enumerate(explanation.views):
        row = figure.axes[4 * robot : 4 * robot + 4]
        removed = [item for item in explanation.removed if item.detection.robot == robot]
        assert len(row[0].patches) == len(view.kept) + len(removed) == len(view.found)
        # the middle of some cells of D, whichever are on and whichever are off
        for axes, grid in zip(row[1:], (view.b, view.c, view.d), strict=True):
            for line in range(3, grid.height - 3, 3):
                for column in range(3, grid.width - 3, 3):
                    x, up = np.floor(axes.transData.transform(grid.center_of(column, line))).astype(int)
                    around = grid.data[line - 1 : line + 2, column - 1 : column + 2]
                    on_the_cross = math.dist(grid.center_of(column, line), SCENE.guards[robot].believed[:2])
                    if (around == around[1, 1]).all() and on_the_cross > 0.3:
                        compared += around[1, 1] != grid.data[0, 0]
                        assert picture[len(picture) - 1 - up, x].tolist() == [grid.data[line, column]] * 3
    assert compared > 20
    assert explanation.removed, "no ally was seen: place the guards otherwise"


def test_detections_show_their_guards_and_both_kinds_of_error() -> None:
    figure = draw_detections(SETUP, SCENE)
    axes = figure.axes[0]
    bold = [text.get_text() for text in axes.texts if text.get_fontweight() == "bold"]
    assert bold == [str(found.guard) for found in SCENE.detections]
    assert any(found.is_false and found.box.intersection_area(GHOST) > 0.0 for found in SCENE.detections)

    def legend(figure: Figure) -> str:
        return " ".join(text.get_text() for text in figure.legends[0].get_texts()).replace("\n", " ")

    assert "detection that touches no intruder" in legend(figure)
    assert "intruder that no detection touches" in legend(figure)
    dashed = [patch.get_linestyle() != "solid" for patch in axes.patches[: len(SCENE.truths)]]
    assert dashed == [truth.is_missed for truth in SCENE.truths]
    assert 0 < sum(dashed) < len(dashed)
    seen = replace(SCENE, truths=[replace(truth, is_missed=False) for truth in SCENE.truths])
    right = replace(seen, detections=[found for found in SCENE.detections if not found.is_false])
    assert "touches" not in legend(draw_detections(SETUP, right))


def test_robots_of_a_large_arena_are_enlarged_and_those_that_are_gone_not_drawn() -> None:
    setup, scene = setup_and_scene("map2")
    panel = WorldPanel(setup, 720)
    assert panel.enlarged > 2.0
    gone = scene.intruders[0]
    left = [robot for robot in scene.robots if robot is not gone]
    pictures = [np.zeros((720, 720, 3), dtype=np.uint8) for _ in range(2)]
    panel.paint(pictures[0], replace(scene, detections=[]))
    panel.paint(pictures[1], replace(scene, detections=[], robots=left))
    beside = gone.pose.compose(Pose2D(-0.1, 0.1, 0.0))
    column, row = np.floor(Canvas(pictures[0], panel.view).pixels(beside[:2])).astype(int).tolist()
    assert pictures[0][row, column].tolist() == list(INTRUDER)
    assert pictures[1][row, column].tolist() != list(INTRUDER)


def test_row_0_of_a_grid_is_painted_at_the_bottom() -> None:
    picture = np.full((40, 60, 3), 9, dtype=np.uint8)
    shades = np.array([(1, 1, 1), (2, 2, 2), (3, 3, 3), (4, 4, 4)], dtype=np.uint8)
    codes = OccupancyGrid(np.array([[0, 1], [2, 3]], dtype=np.uint8), 1.0, (5.0, -1.0))
    Canvas(picture, Box(5.0, -1.0, 7.0, 1.0)).cells(codes, shades)
    assert picture[30, 20, 0] == 1
    assert picture[30, 40, 0] == 2
    assert picture[10, 20, 0] == 3
    assert picture[10, 40, 0] == 4
    assert (picture[:, :10] == 9).all(), "off the grid nothing changes"


def test_text_is_cut_off_at_the_edges_and_has_one_height() -> None:
    assert text_mask("gyp", 16).shape[0] == text_mask("ace", 16).shape[0]
    picture = np.zeros((20, 30, 3), dtype=np.uint8)
    for left, top in ((-10, -5), (25, 15), (100, 100)):
        write(picture, left, top, "8888", 16, (200, 100, 50))
    assert picture.max(axis=(0, 1)).tolist() == [200, 100, 50]


def test_an_enlarged_burger_keeps_its_place_and_heading() -> None:
    pose = Pose2D(1.0, -2.0, 0.7)
    true, larger = body_at(pose), body_at(pose, 3.0)
    assert larger - pose[:2] == pytest.approx(3.0 * (true - pose[:2]))


@pytest.mark.parametrize("frames", [1, 5, 12, 13, 48, 49, 50, 333])
def test_a_storyboard_spreads_its_scenes_evenly(frames: int) -> None:
    board = Storyboard(SETUP)
    for number in range(1, frames + 1):
        board.offer(Scene(number / 5.0, number, [], [], []))
    numbers = [scene.frame for scene in board.chosen()]
    assert len(numbers) == min(frames, 12)
    assert numbers[0] == 1
    assert numbers[-1] > 0.9 * frames
    if len(numbers) > 1:
        gaps = np.diff(numbers)
        assert 0 < gaps.max() <= 2 * gaps.min()
    if frames in (5, 13):
        assert board.page().shape[0] == 44 + (2 if frames == 5 else 3) * (480 + 12 + 24)


def test_the_known_part_of_a_map_is_what_a_picture_shows() -> None:
    data = np.full((20, 30), -1, dtype=np.int8)
    data[5, 10] = 0
    data[7, 12] = 100
    assert known_corners(OccupancyGrid(data, 0.5, (-1.0, 2.0))) == ((4.0, 4.5), (5.5, 6.0))
    nothing = OccupancyGrid(np.full((2, 4), -1, dtype=np.int8), 0.5, (0.0, 0.0))
    assert known_corners(nothing) == ((0.0, 0.0), (2.0, 1.0))


def test_a_large_map_is_drawn_with_larger_cells() -> None:
    data = np.full((5, 9), -1, dtype=np.int8)
    data[0, 3], data[1, 2], data[4, 8] = 0, 100, 0
    coarse = coarsened(OccupancyGrid(data, 0.5, (1.0, 2.0)), 5)
    assert coarse.data.tolist() == [[-1, 100, -1, -1, -1], [-1] * 5, [-1, -1, -1, -1, 0]]
    assert (coarse.resolution, coarse.origin) == (1.0, (1.0, 2.0))
    assert coarsened(coarse, 5) is coarse
