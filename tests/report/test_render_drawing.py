"""What is drawn stands where it belongs, in the colours that the legend names."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from midnet_bench.drawing.arena_view import draw_arena
from midnet_bench.drawing.canvas import Canvas, text_mask, write
from midnet_bench.drawing.clip import MAP_LEFT, MAP_PX, MAP_TOP, Clip
from midnet_bench.drawing.grid_view import draw_detections, draw_grids
from midnet_bench.drawing.map_view import FOREGROUND, SHADES
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
from midnet_bench.drawing.plots import png_of
from midnet_bench.drawing.scene import BURGER_OUTLINE, Scene, burger_at, scene_of, view_of
from midnet_bench.drawing.storyboard import Storyboard
from midnet_bench.drawing.world_view import MARGIN_M, WorldView
from midnet_bench.experiments.detection.trial import DetectionTrial, ScoredFrame
from midnet_bench.experiments.guarded.parameters import DetectionParameters, LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.pipeline import Explanation
from midnet_bench.robots.burger import URDF

BESIDE = (Pose2D(-0.05, 0.045, 0.0), Pose2D(-0.05, -0.045, 0.0))
"""points of a Burger's body on both sides of the line that shows its heading; a box's edge may hide one"""


class Moment(NamedTuple):
    trial: DetectionTrial
    scored: list[ScoredFrame]
    scenes: list[Scene]

    @property
    def scene(self) -> Scene:
        return self.scenes[-1]

    @property
    def explanation(self) -> Explanation:
        explanation = self.scored[-1].midnet.explanation
        assert explanation is not None
        return explanation


@pytest.fixture(scope="module")
def moment() -> Iterator[Moment]:
    # ghosts that no beam clears, so that there are false detections to draw
    with DetectionTrial(DetectionParameters(robots=3, frames=25, inf_is_valid=False), 7) as trial:
        scored, scenes = [], []
        for frame in trial.frames(explain=True):
            scored.append(frame)
            scenes.append(scene_of(trial, frame.midnet))
        yield Moment(trial, scored, scenes)


def test_the_outline_of_a_burger_is_that_of_its_collision_boxes() -> None:
    root = ET.parse(URDF).getroot()
    corners, filled = [], np.zeros((400, 400), dtype=bool)
    at = (np.arange(400) + 0.5) * 0.001 - 0.2
    for collision in root.findall("./link[@name='base_link']/collision"):
        origin, box = collision.find("origin"), collision.find("geometry/box")
        assert origin is not None
        assert box is not None
        x, y, _ = map(float, origin.attrib["xyz"].split())
        length, width, _ = map(float, box.attrib["size"].split())
        filled |= (np.abs(at - x) < length / 2.0) & (np.abs(at[:, None] - y) < width / 2.0)
        corners += [(x + sx * length / 2.0, y + sy * width / 2.0) for sx in (-1, 1) for sy in (-1, 1)]
    assert BURGER_OUTLINE.min(axis=0) == pytest.approx(np.min(corners, axis=0))
    assert BURGER_OUTLINE.max(axis=0) == pytest.approx(np.max(corners, axis=0))
    x, y = BURGER_OUTLINE.T
    area = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    assert area == pytest.approx(filled.sum() * 1e-6, rel=1e-9)


def test_false_detections_are_those_that_the_score_counts(moment: Moment) -> None:
    marked = [sum(found.is_false for found in scene.detections) for scene in moment.scenes]
    assert marked == [frame.counts.fp for frame in moment.scored]
    assert sum(marked) > 0, "a trial without any shows nothing here"


def test_the_clip_shows_walls_robots_and_intruders_where_they_are(moment: Moment) -> None:
    trial, scene = moment.trial, moment.scene
    picture = Clip(trial, 2.0).paint(scene, moment.explanation)
    assert picture.shape == (720, 1280, 3)
    world = Canvas(picture[:, :720], view_of(trial, MARGIN_M))

    def color_at(x: float, y: float) -> RGB:
        column, row = np.floor(world.pixels((x, y))).astype(int).tolist()
        red, green, blue = world.picture[row, column].tolist()
        return red, green, blue

    for wall in trial.arena.wall_solids():
        if not any(found.box.distance_to_point(*wall.pose[:2]) < 0.2 for found in scene.detections):
            assert color_at(*wall.pose[:2]) == WOOD
    assert color_at(-3.2, -3.2) == GROUND
    for robot in scene.robots:
        color = GUARD if robot.is_guard else INTRUDER
        assert color in [color_at(*robot.pose.compose(point)[:2]) for point in BESIDE]
    colors = [color_at(*solid.pose.compose(Pose2D(0.15, 0.1, 0.0))[:2]) for solid in trial.layout.stationary]
    assert INTRUDER_FAINT in colors
    shown = {tuple(color) for color in world.picture.reshape(-1, 3).tolist()}
    assert {FLOOR, DETECTION, FALSE_DETECTION} <= shown


def test_the_map_beside_it_shows_the_foreground_of_every_guard(moment: Moment) -> None:
    trial, scene = moment.trial, moment.scene
    without_boxes = Scene(scene.time_s, [], [])
    picture = Clip(trial, 2.0).paint(without_boxes, moment.explanation)
    canvas = Canvas(
        picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX], view_of(trial, MARGIN_M)
    )
    view = moment.explanation.views[0]
    rows, columns = np.nonzero(view.d.data)
    assert len(rows) > 20
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        x, y = np.floor(canvas.pixels(view.d.center_of(column, row))).astype(int).tolist()
        assert canvas.picture[y, x].tolist() == SHADES[FOREGROUND].tolist()


def test_the_arena_picture_has_the_same_things_in_the_same_colours(moment: Moment) -> None:
    trial, scene = moment.trial, moment.scene
    figure = draw_arena(trial, scene)
    picture = cv2.imdecode(np.frombuffer(png_of(figure), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    axes = figure.axes[0]

    def color_at(x: float, y: float) -> RGB:
        column, up = np.floor(axes.transData.transform((x, y))).astype(int).tolist()
        red, green, blue = picture[len(picture) - 1 - up, column].tolist()
        return red, green, blue

    assert color_at(-1.0, -3.0) == color_at(3.0, -1.0) == WOOD
    assert color_at(-3.3, -3.3) == GROUND
    for robot in scene.robots:
        color = GUARD if robot.is_guard else INTRUDER
        assert color in [color_at(*robot.pose.compose(point)[:2]) for point in BESIDE]
    assert "seed 7" in axes.get_title(loc="left")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"wall", "mobile intruder", "stationary intruder"} <= set(labels)


def test_grids_have_a_row_per_guard_with_y_up_and_their_boxes(moment: Moment) -> None:
    figure = draw_grids(moment.trial, moment.scene, moment.explanation)
    explanation = moment.explanation
    assert len(figure.axes) == 4 * len(explanation.views)
    picture = cv2.imdecode(np.frombuffer(png_of(figure), np.uint8), cv2.IMREAD_GRAYSCALE)
    for robot, view in enumerate(explanation.views):
        row = figure.axes[4 * robot : 4 * robot + 4]
        removed = [item for item in explanation.removed if item.sighting.robot == robot]
        assert len(row[0].patches) == len(view.kept) + len(removed) == len(view.found)
        # the middle of some cells of D, whichever are on and whichever are off
        for axes, grid in zip(row[1:], (view.b, view.c, view.d), strict=True):
            for line in range(3, grid.height - 3, 11):
                for column in range(3, grid.width - 3, 11):
                    x, up = np.floor(axes.transData.transform(grid.center_of(column, line))).astype(int)
                    around = grid.data[line - 1 : line + 2, column - 1 : column + 2]
                    on_the_cross = math.dist(
                        grid.center_of(column, line), moment.scene.guards[robot].believed[:2]
                    )
                    if (around == around[1, 1]).all() and on_the_cross > 0.3:
                        assert picture[len(picture) - 1 - up, x] == grid.data[line, column]
    assert explanation.removed, "no ally was seen: take another seed"


def test_detections_carry_the_numbers_of_their_guards(moment: Moment) -> None:
    figure = draw_detections(moment.trial, moment.scene)
    bold = [text.get_text() for text in figure.axes[0].texts if text.get_fontweight() == "bold"]
    assert bold == [str(robot + 1) for robot in moment.scored[-1].midnet.robots]


def test_robots_that_are_gone_are_not_drawn_and_escapes_are() -> None:
    with LabyrinthTrial(LabyrinthParameters(robots=2, intruders=2), 3) as trial:
        frame = next(iter(trial.frames(explain=True)))
        before = scene_of(trial, frame)
        assert [robot.goal for robot in before.intruders] == [
            trial.fates[robot.index].escape for robot in trial.intruders
        ]
        world = WorldView(trial, 720)
        pictures = []
        for scene in (before, None):
            if scene is None:
                trial.fleet.remove(trial.intruders[0])
                scene = scene_of(trial, frame)
                assert [robot.number for robot in scene.intruders] == [2]
            picture = np.zeros((720, 720, 3), dtype=np.uint8)
            world.paint(picture, scene)
            pictures.append(picture)
        canvas = Canvas(pictures[0], view_of(trial, MARGIN_M))
        beside = before.intruders[0].pose.compose(Pose2D(-0.1, 0.1, 0.0))
        column, row = np.floor(canvas.pixels(beside[:2])).astype(int).tolist()
        assert world.enlarged > 2.0
        assert pictures[0][row, column].tolist() == list(INTRUDER)
        assert pictures[1][row, column].tolist() != list(INTRUDER)
        assert draw_arena(trial, before).axes[0].texts, "the same renderer serves every arena"


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
    true, larger = burger_at(pose), burger_at(pose, 3.0)
    assert larger - pose[:2] == pytest.approx(3.0 * (true - pose[:2]))


@pytest.mark.parametrize("frames", [1, 5, 12, 13, 48, 49, 50, 333])
def test_a_storyboard_spreads_its_moments_evenly(moment: Moment, frames: int, tmp_path: Path) -> None:
    board = Storyboard(moment.trial)
    for number in range(1, frames + 1):
        board.offer(Scene(number / 5.0, [], []))
    times = [round(5.0 * scene.time_s) for scene in board.moments()]
    assert len(times) == min(frames, 12)
    assert times[0] == 1
    assert times[-1] > 0.9 * frames
    if len(times) > 1:
        gaps = np.diff(times)
        assert 0 < gaps.max() <= 2 * gaps.min()
    if frames in (5, 13):
        assert board.page().shape[0] == 44 + (2 if frames == 5 else 3) * (480 + 12 + 24)
