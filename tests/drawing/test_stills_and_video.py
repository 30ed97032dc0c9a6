"""What is drawn stands where it belongs, in the colours that the legend names."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from midnet_bench.drawing.canvas import Canvas, Labels, Picture, paint_detection, text_mask, write
from midnet_bench.drawing.palette import (
    DETECTION,
    FALSE_DETECTION,
    FLOOR,
    GROUND,
    GUARD,
    INTRUDER,
    INTRUDER_FAINT,
    MISSED,
    OUT_OF_RANGE,
    RGB,
    WOOD,
)
from midnet_bench.drawing.plots import png_of_figure
from midnet_bench.drawing.scene import Chase, Scene, Truth, body_at
from midnet_bench.drawing.signs import CORNERS, RING, place_of
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
from midnet_bench.scoring.frame_counts import Ratios
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
        boxes = [patch for patch in row[0].patches if isinstance(patch, Rectangle)]
        assert len(boxes) == len(view.kept) + len(removed) == len(view.found)
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

    assert "false positive" in legend(figure)
    assert "out of range" in legend(figure)
    assert "missed" not in legend(figure)
    assert "second box" not in legend(figure)
    assert "missed" in legend(draw_detections(SETUP, with_errors(SCENE)))
    assert "second box" in legend(draw_detections(SETUP, with_errors(SCENE)))
    found = replace(SCENE, truths=[replace(truth, is_found=True) for truth in SCENE.truths])
    right = replace(found, detections=[found for found in SCENE.detections if not found.is_false])
    assert "false positive" not in legend(draw_detections(SETUP, right))
    assert "out of range" not in legend(draw_detections(SETUP, right))


def with_errors(scene: Scene) -> Scene:
    """All intruders missed that were found, the first detection a further one."""
    truths = [replace(truth, is_found=False) for truth in scene.truths]
    first, *others = scene.detections
    return replace(scene, truths=truths, detections=[replace(first, is_further=True), *others])


def darkest_about(truth: Truth) -> list[int]:
    """The darkest grey about a lone intruder, 0 to 255: in a film, and in a still; 255 if there is none."""
    scene = Scene(1.0, 5, [], [], [truth])
    film = np.zeros((720, 720, 3), dtype=np.uint8)
    WorldPanel(SETUP, 720).paint(film, scene)
    canvas = Canvas(film, SETUP.plan.view(MARGIN_M))
    figure = draw_detections(SETUP, scene)
    still, axes = picture_of(figure), figure.axes[0]
    x, y = truth.outlines[0].mean(axis=0).tolist()
    darkest = []
    for picture, (column, row) in (
        (film, canvas.pixels((x, y)).tolist()),
        (still, axes.transData.transform((x, y)).tolist()),
    ):
        row = row if picture is film else len(picture) - 1 - row
        near = picture[int(row) - 40 : int(row) + 40, int(column) - 40 : int(column) + 40].reshape(-1, 3)
        greys = near[np.ptp(near.astype(int), axis=1) < 6]
        dark = greys.max(axis=1)
        darkest.append(int(dark.min()) if (dark < 200).sum() > 20 else 255)
    return darkest


def test_an_intruder_without_a_detection_has_a_sign_that_says_whether_it_is_an_error() -> None:
    body = body_at(Pose2D(-0.5, -0.5, 0.3))
    assert max(darkest_about(Truth([body], False, in_range=True))) <= max(MISSED) + 5
    for dark in darkest_about(Truth([body], False, in_range=False)):
        assert OUT_OF_RANGE[0] - 5 <= dark < 200, "it is as loud as an error, or there is none"
    for in_range in (True, False):
        assert darkest_about(Truth([body], True, in_range)) == [255, 255]


def test_signs_differ_in_shape_and_a_person_has_one_about_both_legs() -> None:
    legs = [np.array([(x, 0.0), (x + 0.1, 0.0), (x + 0.1, 0.1), (x, 0.1)]) for x in (0.0, 0.4)]
    middle, half = place_of(Truth(legs, False, True), 0.02, 0.1)
    assert (*middle, *half) == pytest.approx((0.25, 0.05, 0.27, 0.1))
    assert all(len(np.unique(np.round(np.abs(stroke).max(axis=1), 6))) == 1 for stroke in CORNERS)
    assert np.hypot(*np.concatenate(RING).T) == pytest.approx(1.0)


def test_a_further_box_is_dashed_and_a_false_one_crossed() -> None:
    box = Box(-0.5, -0.5, 0.5, 0.5)
    inked = {}
    for name, marks in (("own", (False, False)), ("further", (False, True)), ("false", (True, False))):
        canvas = Canvas(np.full((200, 200, 3), 255, dtype=np.uint8), Box(-1.0, -1.0, 1.0, 1.0))
        paint_detection(canvas, box, *marks)
        inked[name] = (canvas.picture < 128).any(axis=2)
    assert inked["own"][50, 55:145].all()
    assert 0.3 < inked["further"][50, 55:145].mean() < 0.9
    assert not inked["own"][95:105, 95:105].any()
    assert inked["false"][95:105, 95:105].any()


def test_counters_say_how_it_stands() -> None:
    assert SCENE.counter == "found 6 of 6 in range, 1 false"
    assert with_errors(SCENE).counter == "found 0 of 6 in range, 1 false"
    assert replace(SCENE, truths=[], detections=[]).counter == "no intruder in range, 0 false"
    unlabelled = replace(SCENE, truths=[], is_labelled=False)
    assert unlabelled.counter == f"{len(SCENE.detections)} detections, no labels"
    assert replace(unlabelled, detections=SCENE.detections[:1]).counter == "1 detection, no labels"
    assert SCENE.remark == ""
    assert replace(SCENE, so_far=Ratios(0.876, 0.5, 0.6)).remark == "so far: recall 0.50, precision 0.88"
    assert replace(SCENE, so_far=Ratios(math.nan, 0.5, math.nan)).remark == "so far: recall 0.50"
    at_first = replace(SCENE, chase=Chase(3, 0, 0))
    assert (at_first.counter, at_first.remark) == ("caught 0 of 3", "")
    events = ["intruder 1 caught by guard 2, 18.4 s", "intruder 3 escaped, 20.0 s"]
    later = replace(SCENE, chase=Chase(3, 1, 1, events))
    assert (later.counter, later.remark) == ("caught 1 of 3, 1 escaped", events[-1])


def test_labels_lie_on_no_other_one_and_on_nothing_that_is_to_stay_in_sight() -> None:
    canvas = Canvas(np.zeros((200, 200, 3), dtype=np.uint8), Box(-1.0, -1.0, 1.0, 1.0))
    labels = Labels(canvas)
    labels.keep_free((0.0, 0.0), 8.0)
    labels.keep_edges_free(Box(-0.25, -0.25, 0.25, 0.25))
    for color in range(100, 106):
        labels.put((0.0, 0.0), "8", (color, 0, 0), 13.0)
    taken = [Box(*one) for one in np.array(labels._taken).tolist()]
    texts, kept = taken[-6:], taken[:-6]
    for number, text in enumerate(texts):
        assert all(text.intersection_area(other) == 0.0 for other in texts[:number] + kept)
    corner = Labels(canvas)
    corner.put((0.99, 0.99), "8", GUARD, 13.0)
    (x1, y1, x2, y2) = corner._taken[0].tolist()
    assert 0.0 <= x1 < x2 <= 200.0
    assert 0.0 <= y1 < y2 <= 200.0


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
    assert len(numbers) == min(frames, 6)
    assert numbers[0] == 1
    assert numbers[-1] == frames
    if len(numbers) > 1:
        gaps = np.diff(numbers)
        assert gaps.min() > 0
        assert gaps.max() <= 0.4 * frames + 1
    if frames in (5, 13):
        assert board.page().shape[1] == 3 * (400 + 14) + 14
        assert board.page().shape[0] > 2 * 400


def test_a_storyboard_shows_each_catch_and_ends_with_the_outcome() -> None:
    board = Storyboard(SETUP)
    events = {78: "intruder 1 caught by guard 2, 15.6 s", 203: "intruder 2 escaped, 40.6 s"}
    for number in range(1, 204):
        told = [text for frame, text in events.items() if frame <= number]
        board.offer(replace(SCENE, time_s=number / 5.0, frame=number, chase=Chase(2, 0, 0, told)))
    chosen = board.chosen()
    assert {78, 203} <= {scene.frame for scene in chosen}
    assert chosen[-1].remark == events[203]
    assert len(chosen) == 6


def test_the_local_costmap_is_a_square_about_where_a_guard_takes_itself_to_be() -> None:
    guard = replace(SCENE.guards[0], believed=Pose2D(0.3, -0.2, 1.0), pose=Pose2D(0.0, 0.0, 1.0))
    scene = replace(SCENE, robots=[replace(guard, goal=None)], detections=[], truths=[], explanation=None)
    box = SETUP.window(guard)
    assert tuple(box) == pytest.approx((-1.7, -2.2, 2.3, 1.8))
    for figure in (draw_arena(SETUP, scene), draw_detections(SETUP, scene)):
        drawn = [patch.get_extents() for patch in figure.axes[0].patches]
        axes = figure.axes[0]
        (x0, y0), (x1, y1) = axes.transData.transform([(-1.7, -2.2), (2.3, 1.8)])
        assert any(one.extents == pytest.approx((x0, y0, x1, y1), abs=0.01) for one in drawn)
        assert "local costmap 4 m" in " ".join(text.get_text() for text in figure.legends[0].get_texts())
    film = np.zeros((720, 720, 3), dtype=np.uint8)
    WorldPanel(SETUP, 720).paint(film, scene)
    world = Canvas(film, SETUP.plan.view(MARGIN_M))
    column, row = world.pixels((-1.7, 1.2)).round().astype(int).tolist()
    assert (film[row, column - 1 : column + 2, 2] > film[row, column - 1 : column + 2, 0] + 60).any()


def test_scans_are_shown_if_the_setup_says_so() -> None:
    points = np.array([(x, 0.9) for x in np.arange(-0.5, 0.5, 0.05)])
    scene = replace(SCENE, robots=[], detections=[], truths=[], scans=[points])
    pictures = []
    for shows in (False, True):
        film = np.zeros((720, 720, 3), dtype=np.uint8)
        WorldPanel(replace(SETUP, shows_scans=shows), 720).paint(film, scene)
        pictures.append(film)
    column, row = Canvas(film, SETUP.plan.view(MARGIN_M)).pixels((0.0, 0.9)).round().astype(int).tolist()
    assert (pictures[0] == pictures[1])[:300].mean() > 0.9
    assert not (pictures[0] == pictures[1])[row - 2 : row + 3, column - 2 : column + 3].all()


def test_a_goal_under_a_stationary_intruder_is_not_drawn() -> None:
    x, y = SETUP.plan.stationary[0].mean(axis=0).tolist()
    hidden = replace(SCENE.guards[0], goal=(x, y), plan=None)
    scene = replace(SCENE, robots=[hidden], detections=[], truths=[])
    assert SETUP.plan.hides((x, y))
    assert not SETUP.plan.hides(hidden.pose[:2])
    marked = [line for line in draw_arena(SETUP, scene).axes[0].lines if line.get_marker() == "x"]
    assert marked == []
    pictures = []
    for goal in ((x, y), None):
        film = np.zeros((720, 720, 3), dtype=np.uint8)
        WorldPanel(SETUP, 720).paint(film, replace(scene, robots=[replace(hidden, goal=goal)]))
        pictures.append(film)
    assert (pictures[0] == pictures[1]).all()


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
