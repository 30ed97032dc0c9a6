"""What is drawn stands where it belongs, in the colours that the legend names."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.drawing import painter, stills
from midnet_bench.drawing.films import MAP_LEFT, MAP_PX, MAP_TOP, ScenePainter
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
from midnet_bench.scoring.frame_counts import Ratios
from tests.drawing.hand_made import GHOST, setup_and_scene

BESIDE = (Pose2D(-0.05, 0.045, 0.0), Pose2D(-0.05, -0.045, 0.0))
"""points of a Burger's body on both sides of the line that shows its heading; a box's edge may hide one"""
SETUP, SCENE = setup_and_scene()
BARE = replace(SCENE, robots=[], detections=[], truths=[])
EXPLANATION = SCENE.explanation


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


def texts(*entries: painter.Entry) -> list[str]:
    return [text for _, text in entries]


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
    places = [0.4 * outline.mean(axis=0) + 0.6 * outline[0] for outline in SETUP.plan.stationary]
    assert INTRUDER_FAINT in [color_at(world, *place.tolist()) for place in places]
    assert (world.picture == FLOOR).all(axis=2).any()


def test_faults_of_an_arena_are_crossed() -> None:
    fault = draw_arena(SETUP, BARE, {1: (0.5, 0.5)})
    assert color_at(plot_of(fault, SETUP, 1), 0.5, 0.5) == FALSE_DETECTION


def test_a_film_shows_the_world_beside_the_foreground_of_every_guard() -> None:
    picture = ScenePainter(SETUP, 2.0).paint(SCENE)
    assert picture.shape == (720, 1280, 3)
    assert np.array_equal(picture[:, :720], world_of(SCENE).picture)
    for color in (DETECTION, FALSE_DETECTION):
        assert (picture[:, :720] == color).all(axis=2).any()
    maps = [
        ScenePainter(SETUP, 2.0).paint(scene)[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
        for scene in (replace(SCENE, robots=[], detections=[]), replace(SCENE, explanation=None))
    ]
    canvas = Canvas(maps[0], SETUP.plan.view(MARGIN_M))
    for view in EXPLANATION.views:
        rows, columns = np.nonzero(view.d.data)
        assert len(rows) > 20
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            assert color_at(canvas, *view.d.center_of(column, row)) == SHADES[FOREGROUND]
    assert not (maps[1] == SHADES[FOREGROUND]).all(axis=2).any()


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
    page = draw_grids(SETUP, SCENE, EXPLANATION)
    side, step, compared = stills.TILE_PX, stills.TILE_PX + stills.TILE_GAP_PX, 0
    for robot, (guard, view) in enumerate(zip(SCENE.guards, EXPLANATION.views, strict=True)):
        tiles = [page[70 + robot * step :, stills.LEFT_PX + k * step :][:side, :side] for k in range(4)]
        canvases = [Canvas(tile, SETUP.window(guard)) for tile in tiles]
        for canvas, grid in zip(canvases[1:], (view.b, view.c, view.d), strict=True):
            # the middle of some cells, whichever are on and whichever are off
            for line in range(3, grid.height - 3, 3):
                for column in range(3, grid.width - 3, 3):
                    center = grid.center_of(column, line)
                    y, x = place_in(canvas, center)
                    around = grid.data[line - 1 : line + 2, column - 1 : column + 2]
                    is_inside = 4 < x < side - 4 and 4 < y < side - 4
                    off_the_cross = math.dist(center, guard.believed[:2]) > 0.3
                    if is_inside and (around == around[1, 1]).all() and off_the_cross:
                        compared += around[1, 1] != grid.data[0, 0]
                        assert canvas.picture[y, x].tolist() == [grid.data[line, column]] * 3
        for box in view.kept:
            y, x = place_in(canvases[0], (box.x_min, box.center[1]))
            if 4 < x < side - 4 and 4 < y < side - 4:
                assert list(DETECTION) in tiles[0][y, x - 1 : x + 2].tolist()
    assert compared > 20
    assert EXPLANATION.removed, "no ally was seen: place the guards otherwise"


def with_errors(scene: Scene) -> Scene:
    """All intruders missed that were found, the first detection a further one."""
    truths = [replace(truth, is_found=False) for truth in scene.truths]
    first, *others = scene.detections
    return replace(scene, truths=truths, detections=[replace(first, is_further=True), *others])


def test_a_legend_has_what_is_in_the_picture() -> None:
    assert any(found.is_false and found.box.intersection_area(GHOST) > 0.0 for found in SCENE.detections)

    def shown(*scenes: Scene) -> set[str]:
        entries = [*painter.world_legend(SETUP, scenes), *painter.detection_legend(scenes)]
        return {text.split(":")[0].split(",")[0] for text in texts(*entries)}

    errors = {"false positive", "out of range", "missed intruder", "second box on one intruder"}
    assert {"mobile intruder", "stationary intruder"} <= shown(SCENE)
    assert shown(SCENE) & errors == {"false positive", "out of range"}
    assert shown(with_errors(SCENE)) >= {"missed intruder", "second box on one intruder"}
    found = replace(SCENE, truths=[replace(truth, is_found=True) for truth in SCENE.truths])
    right = replace(found, detections=[found for found in SCENE.detections if not found.is_false])
    assert not shown(right) & errors
    whole = texts(*painter.world_legend(replace(SETUP, shows_scans=True)), *painter.detection_legend())
    assert f"costmap {SETUP.local_size_m:g} m, LiDAR {SETUP.usable_range_m:g} m" in whole
    assert "LiDAR returns" in whole
    assert len(set(whole)) == len(whole), "two entries say the same"


def test_detections_are_in_their_colours_over_the_true_outlines() -> None:
    canvas = plot_of(draw_detections(SETUP, SCENE), SETUP, 2)
    for found in SCENE.detections:
        y, x = place_in(canvas, (found.box.center[0], found.box.y_min))
        color = FALSE_DETECTION if found.is_false else DETECTION
        assert list(color) in canvas.picture[y - 1 : y + 2, x].tolist()
    assert (np.abs(canvas.picture.astype(int) - INTRUDER).max(axis=2) < 40).any()


@pytest.mark.parametrize(
    ("is_found", "in_range", "darkest"),
    [
        (False, True, (MISSED[0], 5)),
        (False, False, (OUT_OF_RANGE[0] - 5, 199)),
        (True, True, None),
        (True, False, None),
    ],
)
def test_an_intruder_without_a_detection_has_a_sign_that_says_whether_it_is_an_error(
    is_found: bool, in_range: bool, darkest: tuple[int, int] | None
) -> None:
    truth = Truth([body_at(Pose2D(-0.5, -0.5, 0.3))], is_found, in_range)
    scene = Scene(1.0, 5, [], [], [truth])
    for shown in (world_of(scene), plot_of(draw_detections(SETUP, scene), SETUP, 2)):
        row, column = place_in(shown, truth.outlines[0].mean(axis=0).tolist())
        near = shown.picture[row - 40 : row + 40, column - 40 : column + 40].reshape(-1, 3)
        greys = near[np.ptp(near.astype(int), axis=1) < 6].max(axis=1)
        assert ((greys < 200).sum() > 20) == (darkest is not None)
        assert darkest is None or darkest[0] <= greys.min() <= darkest[1]


def test_signs_differ_in_shape_and_a_person_has_one_about_both_legs() -> None:
    legs = [np.array([(x, 0.0), (x + 0.1, 0.0), (x + 0.1, 0.1), (x, 0.1)]) for x in (0.0, 0.4)]
    middle, half = painter.sign_box(Truth(legs, False, True), 0.02, 0.1)
    assert (*middle, *half) == pytest.approx((0.25, 0.05, 0.27, 0.1))
    assert all(len(np.unique(np.round(np.abs(stroke).max(axis=1), 6))) == 1 for stroke in painter.CORNERS)
    assert np.hypot(*np.concatenate(painter.RING).T) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("marks", "edge", "is_crossed"),
    [((), 1.0, False), ((False, True), 0.6, False), ((True, False), 1.0, True)],
)
def test_a_further_box_is_dashed_and_a_false_one_crossed(
    marks: tuple[bool, ...], edge: float, is_crossed: bool
) -> None:
    canvas = Canvas(painter.blank_page(200, 200), Box(-1.0, -1.0, 1.0, 1.0))
    found = Detection(Box(-0.5, -0.5, 0.5, 0.5), 1, *(marks or (False, False)))
    painter.paint_detection(canvas, found)
    inked = (canvas.picture < 128).any(axis=2)
    assert inked[50, 55:145].mean() == pytest.approx(edge, abs=0.0 if edge == 1.0 else 0.3)
    assert inked[95:105, 95:105].any() == is_crossed


EVENTS = ["intruder 1 caught by guard 2, 18.4 s", "intruder 3 escaped, 20.0 s"]


@pytest.mark.parametrize(
    ("scene", "counter", "remark"),
    [
        (SCENE, "found 6 of 6 in range, 1 false", ""),
        (with_errors(SCENE), "found 0 of 6 in range, 1 false", ""),
        (BARE, "no intruder in range, 0 false", ""),
        (replace(BARE, is_labelled=False), "0 detections, no labels", ""),
        (replace(BARE, is_labelled=False, detections=SCENE.detections[:1]), "1 detection, no labels", ""),
        (replace(BARE, so_far=Ratios(0.876, 0.5, 0.6)), None, "so far: recall 0.50, precision 0.88"),
        (replace(BARE, so_far=Ratios(math.nan, 0.5, math.nan)), None, "so far: recall 0.50"),
        (replace(SCENE, chase=Chase(3, 0, 0)), "caught 0 of 3", ""),
        (replace(SCENE, chase=Chase(3, 1, 1, EVENTS)), "caught 1 of 3, 1 escaped", EVENTS[-1]),
    ],
)
def test_counters_say_how_it_stands(scene: Scene, counter: str | None, remark: str) -> None:
    assert counter in (None, scene.counter)
    assert scene.remark == remark


def test_labels_lie_on_no_other_one_and_on_nothing_that_is_to_stay_in_sight() -> None:
    canvas = Canvas(np.zeros((200, 200, 3), dtype=np.uint8), Box(-1.0, -1.0, 1.0, 1.0))
    labels = Labels(canvas)
    labels.keep_free((0.0, 0.0), 8.0)
    labels.keep_edges_free(Box(-0.25, -0.25, 0.25, 0.25))
    for color in range(100, 106):
        labels.put((0.0, 0.0), "8", (color, 0, 0), 13.0)
    taken = [Box(*one) for one in np.array(labels._taken).tolist()]
    for number in range(len(taken) - 6, len(taken)):
        assert all(taken[number].intersection_area(other) == 0.0 for other in taken[:number])
    corner = Labels(canvas)
    corner.put((0.99, 0.99), "8", GUARD, 13.0)
    (box,) = corner._taken
    assert box.min() >= 0.0
    assert box.max() <= 200.0


def test_robots_of_a_large_arena_are_enlarged_and_those_that_are_gone_not_drawn() -> None:
    setup, scene = setup_and_scene("map2")
    assert WorldPanel(setup, 720).enlarged > 2.0
    gone = next(robot for robot in scene.robots if not robot.is_guard)
    left = [robot for robot in scene.robots if robot is not gone]
    beside = gone.pose.compose(Pose2D(-0.1, 0.1, 0.0))[:2]
    for robots, is_there in ((scene.robots, True), (left, False)):
        world = world_of(replace(scene, detections=[], robots=robots), setup)
        assert (color_at(world, *beside) == INTRUDER) is is_there
    pose = Pose2D(1.0, -2.0, 0.7)
    assert body_at(pose, 3.0) - pose[:2] == pytest.approx(3.0 * (body_at(pose) - pose[:2]))


def test_row_0_of_a_grid_is_painted_at_the_bottom() -> None:
    picture = np.full((40, 60, 3), 9, dtype=np.uint8)
    codes = OccupancyGrid(np.array([[0, 1], [2, 3]], dtype=np.uint8), 1.0, (5.0, -1.0))
    Canvas(picture, Box(5.0, -1.0, 7.0, 1.0)).cells(codes, [[k, k, k] for k in (1, 2, 3, 4)])
    assert picture[[30, 30, 10, 10], [20, 40, 20, 40], 0].tolist() == [1, 2, 3, 4]
    assert (picture[:, :10] == 9).all(), "off the grid nothing changes"


def test_text_is_cut_off_at_the_edges_and_has_one_height() -> None:
    assert painter.text_mask("gyp", 16).shape[0] == painter.text_mask("ace", 16).shape[0]
    picture = np.zeros((20, 30, 3), dtype=np.uint8)
    for left, top in ((-10, -5), (25, 15), (100, 100)):
        painter.write(picture, left, top, "8888", 16, (200, 100, 50))
    assert picture.max(axis=(0, 1)).tolist() == [200, 100, 50]


def test_the_local_costmap_is_a_square_about_where_a_guard_takes_itself_to_be() -> None:
    believed = Pose2D(0.3, -0.2, 1.0)
    guard = replace(SCENE.guards[0], believed=believed, pose=Pose2D(0.0, 0.0, 1.0), goal=None)
    assert tuple(SETUP.window(guard)) == pytest.approx((-1.7, -2.2, 2.3, 1.8))
    world = world_of(replace(BARE, robots=[guard], explanation=None))
    row, column = place_in(world, (-1.7, 1.2))
    near = world.picture[row, column - 1 : column + 3]
    assert (near[:, 2] > near[:, 0] + 60).any()


def test_scans_are_shown_if_the_setup_says_so() -> None:
    scene = replace(BARE, scans=[np.array([(x, 0.9) for x in np.arange(-0.5, 0.5, 0.05)])])
    without, shown = (world_of(scene, replace(SETUP, shows_scans=shows)) for shows in (False, True))
    row, column = place_in(shown, (0.0, 0.9))
    is_same = without.picture == shown.picture
    assert is_same[:300].mean() > 0.9
    assert not is_same[row - 2 : row + 3, column - 2 : column + 3].all()


def test_a_goal_under_a_stationary_intruder_is_not_drawn() -> None:
    x, y = SETUP.plan.stationary[0].mean(axis=0).tolist()
    hidden = replace(SCENE.guards[0], goal=(x, y), plan=None)
    assert SETUP.plan.hides((x, y))
    assert not SETUP.plan.hides(hidden.pose[:2])
    robots = (hidden, replace(hidden, goal=None))
    assert np.array_equal(*(world_of(replace(BARE, robots=[robot])).picture for robot in robots))
