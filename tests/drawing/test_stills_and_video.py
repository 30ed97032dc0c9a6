"""What is drawn stands where it belongs, in the colours that the legend names."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.drawing import painter, stills
from midnet_bench.drawing.films import MAP_LEFT, MAP_PX, MAP_TOP, ScenePainter, Storyboard
from midnet_bench.drawing.growth import MAP_MARGIN_M, draw_map, known_corners
from midnet_bench.drawing.painter import FOREGROUND, MARGIN_M, SHADES, Canvas, Labels, Picture, WorldPanel
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
from midnet_bench.drawing.scene import Chase, Detection, Scene, Setup, Truth, body_at
from midnet_bench.drawing.stills import draw_arena, draw_detections, draw_grids
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


def plot_of(page: Picture, setup: Setup, lines: int) -> Canvas:
    """The part of a still that shows the arena, below so many lines of title."""
    view = setup.plan.view(MARGIN_M)
    rows, columns = stills.plot_area(view, lines)
    return Canvas(page[rows, columns], view)


def world_of(scene: Scene, setup: Setup = SETUP) -> Canvas:
    """The true world of a film's picture."""
    panel, film = WorldPanel(setup, 720), np.zeros((720, 720, 3), dtype=np.uint8)
    panel.paint(film, scene)
    return Canvas(film, panel.view)


def place_in(canvas: Canvas, at: Sequence[float]) -> tuple[int, int]:
    """Row and column of (x, y)."""
    column, row = np.floor(canvas.pixels(at)).astype(int).tolist()
    return row, column


def color_at(canvas: Canvas, *at: float) -> RGB:
    red, green, blue = canvas.picture[place_in(canvas, at)].tolist()
    return red, green, blue


def texts(entries: list[painter.Entry]) -> str:
    return "; ".join(text for _, text in entries)


@pytest.mark.parametrize("kind", ["film", "still"])
def test_walls_robots_and_intruders_are_shown_where_they_are(kind: str) -> None:
    scene = replace(SCENE, detections=[])
    world = world_of(scene) if kind == "film" else plot_of(draw_arena(SETUP, scene), SETUP, 1)
    for wall in SETUP.plan.walls:
        assert color_at(world, *wall.mean(axis=0).tolist()) == WOOD
    assert color_at(world, -3.2, -3.2) == GROUND
    for robot in SCENE.robots:
        color = GUARD if robot.is_guard else INTRUDER
        assert color in [color_at(world, *robot.pose.compose(point)[:2]) for point in BESIDE]
    places = [solid.pose.compose(Pose2D(0.15, 0.1, 0.0))[:2] for solid in layout_of().stationary]
    assert INTRUDER_FAINT in [color_at(world, *place) for place in places]
    assert (world.picture == FLOOR).all(axis=2).any()


def test_faults_of_an_arena_are_crossed() -> None:
    fault = draw_arena(SETUP, replace(SCENE, robots=[], detections=[]), {1: (0.5, 0.5)})
    assert color_at(plot_of(fault, SETUP, 1), 0.5, 0.5) == FALSE_DETECTION


def test_a_film_shows_the_world_with_its_detections() -> None:
    picture = ScenePainter(SETUP, 2.0).paint(SCENE)
    assert picture.shape == (720, 1280, 3)
    assert np.array_equal(picture[:, :720], world_of(SCENE).picture)
    for color in (DETECTION, FALSE_DETECTION):
        assert (picture[:, :720] == color).all(axis=2).any()


def test_the_map_beside_it_shows_the_foreground_of_every_guard() -> None:
    picture = ScenePainter(SETUP, 2.0).paint(replace(SCENE, robots=[], detections=[]))
    beside = picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
    canvas = Canvas(beside, SETUP.plan.view(MARGIN_M))
    for view in explanation_of(SCENE).views:
        rows, columns = np.nonzero(view.d.data)
        assert len(rows) > 20
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            assert color_at(canvas, *view.d.center_of(column, row)) == SHADES[FOREGROUND]
    without = ScenePainter(SETUP, 2.0).paint(without_explanation(SCENE))
    assert not (without == SHADES[FOREGROUND]).all(axis=2)[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT:].any()


@pytest.mark.parametrize("shape", [(1.0, 1.0), (1.0, 0.3), (0.2, 1.0)])
def test_a_page_has_room_for_the_arena_and_its_legend(shape: tuple[float, float]) -> None:
    setup, scene = setup_and_scene("map2")
    plan = replace(setup.plan, walls=[wall * shape for wall in setup.plan.walls], stationary=[])
    setup = replace(setup, plan=replace(plan, enclosure=Box(-1, -1, 1, 1)))
    page = draw_arena(setup, scene)
    rows, columns = stills.plot_area(setup.plan.view(MARGIN_M), 1)
    assert max(rows.stop - rows.start, columns.stop - columns.start) == stills.PLOT_PX
    assert page.shape[0] >= rows.stop + stills.BOTTOM_PX
    assert (page[:, -2:] == 255).all(), "the legend is cut off"
    assert (page[rows.start :, columns.stop + stills.GAP_PX :] < 128).any(), "there is no legend"
    assert (page[rows.stop : rows.stop + 5, columns] < 128).any(), "the axis has no ticks"


def test_grids_have_a_row_per_guard_with_y_up_and_their_boxes() -> None:
    explanation = explanation_of(SCENE)
    page = draw_grids(SETUP, SCENE, explanation)
    step = stills.TILE_PX + stills.TILE_GAP_PX
    compared = 0
    for robot, view in enumerate(explanation.views):
        for place, grid in ((1, view.b), (2, view.c), (3, view.d)):
            top, left = 70 + robot * step, stills.LEFT_PX + place * step
            tile = page[top : top + stills.TILE_PX, left : left + stills.TILE_PX]
            canvas = Canvas(tile, SETUP.window(SCENE.guards[robot]))
            # the middle of some cells, whichever are on and whichever are off
            for line in range(3, grid.height - 3, 3):
                for column in range(3, grid.width - 3, 3):
                    x, y = np.floor(canvas.pixels(grid.center_of(column, line))).astype(int).tolist()
                    around = grid.data[line - 1 : line + 2, column - 1 : column + 2]
                    off_the_cross = math.dist(grid.center_of(column, line), SCENE.guards[robot].believed[:2])
                    is_inside = 4 < x < stills.TILE_PX - 4 and 4 < y < stills.TILE_PX - 4
                    if is_inside and (around == around[1, 1]).all() and off_the_cross > 0.3:
                        compared += around[1, 1] != grid.data[0, 0]
                        assert tile[y, x].tolist() == [grid.data[line, column]] * 3
        first = page[70 + robot * step :, stills.LEFT_PX :][: stills.TILE_PX, : stills.TILE_PX]
        canvas = Canvas(first, SETUP.window(SCENE.guards[robot]))
        for box in view.kept:
            x, y = np.floor(canvas.pixels((box.x_min, box.center[1]))).astype(int).tolist()
            if 4 < x < stills.TILE_PX - 4 and 4 < y < stills.TILE_PX - 4:
                assert list(DETECTION) in first[y, x - 1 : x + 2].tolist()
    assert compared > 20
    assert explanation.removed, "no ally was seen: place the guards otherwise"


def test_a_legend_has_what_is_in_the_picture() -> None:
    assert any(found.is_false and found.box.intersection_area(GHOST) > 0.0 for found in SCENE.detections)

    def shown(scene: Scene) -> str:
        return texts([*painter.world_legend(SETUP, [scene]), *painter.detection_legend([scene])])

    assert {"mobile intruder", "stationary intruder"} <= set(shown(SCENE).split("; "))
    assert "false positive" in shown(SCENE)
    assert "out of range" in shown(SCENE)
    assert "missed" not in shown(SCENE)
    assert "second box" not in shown(SCENE)
    assert "missed" in shown(with_errors(SCENE))
    assert "second box" in shown(with_errors(SCENE))
    found = replace(SCENE, truths=[replace(truth, is_found=True) for truth in SCENE.truths])
    right = replace(found, detections=[found for found in SCENE.detections if not found.is_false])
    assert "false positive" not in shown(right)
    assert "out of range" not in shown(right)
    assert f"costmap {SETUP.local_size_m:g} m, LiDAR {SETUP.usable_range_m:g} m" in shown(SCENE)
    whole = texts([*painter.world_legend(SETUP), *painter.detection_legend()]).split("; ")
    assert len(set(whole)) == len(whole), "two entries say the same"
    assert "LiDAR returns" in texts(painter.world_legend(replace(SETUP, shows_scans=True)))


def test_detections_are_in_their_colours_over_the_true_outlines() -> None:
    canvas = plot_of(draw_detections(SETUP, SCENE), SETUP, 2)
    for found in SCENE.detections:
        y, x = place_in(canvas, (found.box.center[0], found.box.y_min))
        color = FALSE_DETECTION if found.is_false else DETECTION
        assert list(color) in canvas.picture[y - 1 : y + 2, x].tolist()
    outlines = canvas.picture.astype(int) - INTRUDER
    assert (np.abs(outlines).max(axis=2) < 40).any()


def test_a_map_shows_walls_path_and_truth() -> None:
    data = np.zeros((60, 80), dtype=np.int8)
    data[:, 0] = 100
    data[40:, 40:] = -1
    grid = OccupancyGrid(data, 0.05, (0.0, 0.0))
    path = np.array([(1.0, 1.0), (1.0, 2.0)])
    wall = np.array([(3.5, 0.5), (3.6, 0.5), (3.6, 1.5), (3.5, 1.5)])
    page = draw_map(grid, [path], "a map", [wall])
    view = Box(0.0, 0.0, 4.0, 3.0).shrunk(-MAP_MARGIN_M)
    rows, columns = stills.plot_area(view, 1)
    canvas = Canvas(page[rows, columns], view)

    def near(x: float, y: float) -> list[list[int]]:
        row, column = place_in(canvas, (x, y))
        around = canvas.picture[row - 1 : row + 2, column - 1 : column + 2].reshape(-1, 3)
        return [[int(value) for value in color] for color in around]

    assert [40, 40, 40] in near(0.025, 1.0)
    assert near(2.0, 0.5) == [[255, 255, 255]] * 9
    assert near(3.0, 2.5) == [[205, 205, 205]] * 9
    assert list(GUARD) in near(1.0, 1.5)
    assert min(abs(red - INTRUDER[0]) + abs(blue - INTRUDER[2]) for red, _, blue in near(3.5, 1.0)) < 100


def with_errors(scene: Scene) -> Scene:
    """All intruders missed that were found, the first detection a further one."""
    truths = [replace(truth, is_found=False) for truth in scene.truths]
    first, *others = scene.detections
    return replace(scene, truths=truths, detections=[replace(first, is_further=True), *others])


def darkest_about(truth: Truth) -> list[int]:
    """The darkest grey about a lone intruder, 0 to 255: in a film, and in a still; 255 if there is none."""
    scene = Scene(1.0, 5, [], [], [truth])
    darkest = []
    for shown in (world_of(scene), plot_of(draw_detections(SETUP, scene), SETUP, 2)):
        row, column = place_in(shown, truth.outlines[0].mean(axis=0).tolist())
        near = shown.picture[row - 40 : row + 40, column - 40 : column + 40].reshape(-1, 3)
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
    middle, half = painter.sign_box(Truth(legs, False, True), 0.02, 0.1)
    assert (*middle, *half) == pytest.approx((0.25, 0.05, 0.27, 0.1))
    assert all(len(np.unique(np.round(np.abs(stroke).max(axis=1), 6))) == 1 for stroke in painter.CORNERS)
    assert np.hypot(*np.concatenate(painter.RING).T) == pytest.approx(1.0)


def test_a_further_box_is_dashed_and_a_false_one_crossed() -> None:
    box = Box(-0.5, -0.5, 0.5, 0.5)
    inked = {}
    for name, marks in (("own", (False, False)), ("further", (False, True)), ("false", (True, False))):
        canvas = Canvas(np.full((200, 200, 3), 255, dtype=np.uint8), Box(-1.0, -1.0, 1.0, 1.0))
        painter.paint_detection(canvas, Detection(box, 1, *marks))
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
    assert WorldPanel(setup, 720).enlarged > 2.0
    gone = next(robot for robot in scene.robots if not robot.is_guard)
    left = [robot for robot in scene.robots if robot is not gone]
    beside = gone.pose.compose(Pose2D(-0.1, 0.1, 0.0))[:2]
    for robots, is_there in ((scene.robots, True), (left, False)):
        world = world_of(replace(scene, detections=[], robots=robots), setup)
        assert (color_at(world, *beside) == INTRUDER) is is_there


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
    assert painter.text_mask("gyp", 16).shape[0] == painter.text_mask("ace", 16).shape[0]
    picture = np.zeros((20, 30, 3), dtype=np.uint8)
    for left, top in ((-10, -5), (25, 15), (100, 100)):
        painter.write(picture, left, top, "8888", 16, (200, 100, 50))
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
    world = world_of(scene)
    row, column = place_in(world, (-1.7, 1.2))
    near = world.picture[row, column - 1 : column + 3]
    assert (near[:, 2] > near[:, 0] + 60).any()


def test_scans_are_shown_if_the_setup_says_so() -> None:
    points = np.array([(x, 0.9) for x in np.arange(-0.5, 0.5, 0.05)])
    scene = replace(SCENE, robots=[], detections=[], truths=[], scans=[points])
    without, shown = (world_of(scene, replace(SETUP, shows_scans=shows)) for shows in (False, True))
    row, column = place_in(shown, (0.0, 0.9))
    is_same = without.picture == shown.picture
    assert is_same[:300].mean() > 0.9
    assert not is_same[row - 2 : row + 3, column - 2 : column + 3].all()


def test_a_goal_under_a_stationary_intruder_is_not_drawn() -> None:
    x, y = SETUP.plan.stationary[0].mean(axis=0).tolist()
    hidden = replace(SCENE.guards[0], goal=(x, y), plan=None)
    scene = replace(SCENE, robots=[hidden], detections=[], truths=[])
    assert SETUP.plan.hides((x, y))
    assert not SETUP.plan.hides(hidden.pose[:2])
    pictures = [
        world_of(replace(scene, robots=[replace(hidden, goal=goal)])).picture for goal in ((x, y), None)
    ]
    assert np.array_equal(*pictures)


def test_the_known_part_of_a_map_is_what_a_picture_shows() -> None:
    data = np.full((20, 30), -1, dtype=np.int8)
    data[5, 10] = 0
    data[7, 12] = 100
    assert known_corners(OccupancyGrid(data, 0.5, (-1.0, 2.0))).tolist() == [[4.0, 4.5], [5.5, 6.0]]
    nothing = OccupancyGrid(np.full((2, 4), -1, dtype=np.int8), 0.5, (0.0, 0.0))
    assert known_corners(nothing).tolist() == [[0.0, 0.0], [2.0, 1.0]]
