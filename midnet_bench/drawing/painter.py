"""The one painter of maps, robots, boxes and their legend: on numpy pictures, by OpenCV.

A true positive is a green box; a second one on one intruder is dashed; a false positive is purple and crossed
out. A missed intruder has the corners of the box that is not there, and a disc with an exclamation mark. One
out of range, which is no error, has a thin broken ring. Shape tells them apart without colour.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache, partial
from itertools import pairwise
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from midnet_bench.drawing import palette
from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, INTRUDER, RGB, WHITE
from midnet_bench.drawing.scene import (
    BURGER_LENGTH_M,
    Detection,
    FloorPlan,
    Robot,
    Scene,
    Setup,
    Truth,
    body_at,
)
from midnet_bench.geometry import Box, Floats, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.turtlebot3 import BURGER

Picture = npt.NDArray[np.uint8]  # (height, width, 3) red, green, blue
Mark = Callable[["Canvas"], object]
"""draws what a legend explains on a canvas of one pixel a metre, about its origin"""
Entry = tuple[Mark, str]

LABEL_PX = 13
SIGN_PX, BADGE_PX = 10.0, 6.5
"""least half side of a sign about an intruder; radius of the disc with the exclamation mark"""
SCALES_M, LEAST_SCALE_PX = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0), 40.0
"""lengths of the bar that shows the scale; no shorter than that, if one is long enough"""
MIN_BURGER_PX = 14.0  # robots in a large arena are drawn larger than they are, so that they stay visible
MARGIN_M = 0.25  # around an arena
LEG_PX, AT_GOAL_PX = 8.0, 24.0
"""kept free of labels about a leg; a robot nearer to its goal has one number for both"""
ARM, DASHES = 0.45, 10  # length of a sign's corner as a part of half its side; dashes of the ring
CORNERS: tuple[Floats, ...] = tuple(  # (3, 2) each, in the square from -1 to 1
    np.array([(x * (1.0 - ARM), y), (x, y), (x, y * (1.0 - ARM))])
    for x, y in ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
)
RING: tuple[Floats, ...] = tuple(  # (4, 2) each, on the circle of radius 1
    np.array(
        [(math.cos(angle), math.sin(angle)) for angle in np.linspace(start, start + math.pi / DASHES, 4)]
    )
    for start in np.linspace(0.0, 2.0 * math.pi, DASHES, endpoint=False)
)

SHADES: tuple[RGB, ...] = (
    WHITE,
    (205, 205, 205),
    (226, 226, 226),
    (70, 70, 70),
    (140, 140, 140),
    (240, 200, 40),
)
FREE, UNKNOWN, INFLATED, WALL, COMMON, FOREGROUND = range(len(SHADES))
"""what a cell is: of the prior map, or in grid C of some guard, or in grid D of one"""
_SHIFT = 4  # OpenCV takes coordinates in sixteenths of a pixel, which keeps slow motion smooth


class Canvas:
    """A picture that shows ``view`` in its middle, as large as fits; drawing changes the picture."""

    def __init__(self, picture: Picture, view: Box, label_px: int = LABEL_PX) -> None:
        self.picture = picture
        self.label_px = label_px
        height, width = picture.shape[:2]
        self.scale = min(width / (view.x_max - view.x_min), height / (view.y_max - view.y_min))
        """pixels per metre"""
        x, y = view.center
        self._offset = np.array([width / 2.0 - x * self.scale, height / 2.0 + y * self.scale])

    @property
    def enlarged(self) -> float:
        """How many times as large as they are robots are drawn, 1 or more."""
        return max(1.0, MIN_BURGER_PX / (BURGER_LENGTH_M * self.scale))

    def pixels(self, points: npt.ArrayLike) -> Floats:
        """(n, 2) points in metres as column and row, y down, fractions kept."""
        return np.asarray(points, dtype=np.float64) * (self.scale, -self.scale) + self._offset

    def polygon(
        self, corners: npt.ArrayLike, fill: RGB | None, edge: RGB | None = None, width: int = 1
    ) -> None:
        """A closed polygon through (n, 2) corners."""
        points = self._fixed(corners)
        if fill is not None:
            cv2.fillPoly(self.picture, [points], fill, cv2.LINE_AA, _SHIFT)
        if edge is not None:
            cv2.polylines(self.picture, [points], True, edge, width, cv2.LINE_AA, _SHIFT)

    def line(self, points: npt.ArrayLike, color: RGB, width: int = 1) -> None:
        """Straight pieces through (n, 2) points."""
        cv2.polylines(self.picture, [self._fixed(points)], False, color, width, cv2.LINE_AA, _SHIFT)

    def dots(self, points: npt.ArrayLike, color: RGB, gap_px: float = 6.0) -> None:
        """Dots of two pixels along (n, 2) points, ``gap_px`` apart."""
        path = self.pixels(points)
        reached = np.concatenate(([0.0], np.hypot(*np.diff(path, axis=0).T).cumsum()))
        at = np.arange(0.0, reached[-1], gap_px)
        columns, rows = (np.interp(at, reached, path[:, axis]).astype(int) for axis in (0, 1))
        height, width = self.picture.shape[:2]
        seen = (columns >= 0) & (rows >= 0) & (columns < width - 1) & (rows < height - 1)
        for down, right in ((0, 0), (0, 1), (1, 0), (1, 1)):
            self.picture[rows[seen] + down, columns[seen] + right] = color

    def circle(self, center: Point, radius_m: float, color: RGB, width: int = 1) -> None:
        """A circle; filled if ``width`` is -1."""
        x, y = self._fixed([center])[0].tolist()
        radius = round(radius_m * self.scale * 2**_SHIFT)
        cv2.circle(self.picture, (x, y), radius, color, width, cv2.LINE_AA, _SHIFT)

    def cross(self, at: Point, color: RGB) -> None:
        """A diagonal cross of ten pixels: a goal."""
        x, y = at
        arm = 5.0 / self.scale
        self.line([(x - arm, y - arm), (x + arm, y + arm)], color, 2)
        self.line([(x - arm, y + arm), (x + arm, y - arm)], color, 2)

    def box(self, box: Box, edge: RGB | None, width: int = 1, fill: RGB | None = None) -> None:
        """A box along the axes."""
        self.polygon(_corners(box)[:4], fill, edge, width)

    def dashed_box(self, box: Box, color: RGB, dash_px: float = 5.0, gap_px: float = 6.0) -> None:
        """The outline of a box, two pixels wide, in dashes; each side begins with a whole one."""
        for start, end in pairwise(_corners(box)):
            length_px = float(np.hypot(*(end - start))) * self.scale
            for at in np.arange(0.0, length_px, dash_px + gap_px).tolist():
                ends = np.array([at, min(at + dash_px, length_px)]) / length_px
                self.line(start + ends[:, None] * (end - start), color, 2)

    def cells(self, codes: OccupancyGrid, shades: npt.ArrayLike) -> None:
        """A grid over the whole picture; cell value i, an uint8, looks like row i of ``shades`` (k, 3)."""
        height, width = self.picture.shape[:2]
        left, base = self.pixels(codes.origin)
        per_pixel = 1.0 / (self.scale * codes.resolution)
        # of the picture's pixel centres, into cells
        columns = np.floor((np.arange(width) + 0.5 - left) * per_pixel).astype(int)
        rows = np.floor((base - np.arange(height) - 0.5) * per_pixel).astype(int)
        on_x, on_y = (columns >= 0) & (columns < codes.width), (rows >= 0) & (rows < codes.height)
        self.picture[np.ix_(on_y, on_x)] = np.asarray(shades, np.uint8)[
            codes.data[np.ix_(rows[on_y], columns[on_x])]
        ]

    def label(self, at: Point, text: str, color: RGB, right_px: float = 0, down_px: float = 0) -> None:
        """Bold text with a white halo in the middle of a point that lies so far from (x, y)."""
        x, y = self.pixels(at)
        mask = text_mask(text, self.label_px, True)
        left, top = x + right_px - mask.shape[1] / 2.0, y + down_px - mask.shape[0] / 2.0
        _blend(self.picture, _halo(text, self.label_px), round(left), round(top), WHITE)
        _blend(self.picture, mask, round(left), round(top), color)

    def _fixed(self, points: npt.ArrayLike) -> npt.NDArray[np.int32]:
        return np.rint(self.pixels(points) * 2**_SHIFT).astype(np.int32)


class Labels:
    """Labels beside what they name, each where no other one stands and nothing that is to stay in sight."""

    SIDES = np.array([(1, -1), (1, 1), (-1, -1), (-1, 1), (0, -1), (0, 1), (1, 0), (-1, 0)])
    """right and down of the point, the most liked first"""
    FARTHER = (1.0, 1.3, 1.6, 2.0)

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._size = np.array(canvas.picture.shape[1::-1])
        self._taken: list[Floats] = []  # columns and rows from and to, y down

    def keep_free(self, at: Point, half_px: float) -> None:
        """Let no label lie so near to (x, y), metres, if there is another place."""
        middle = self._canvas.pixels(at)
        self._taken.append(np.concatenate([middle - half_px, middle + half_px]))

    def keep_edges_free(self, box: Box) -> None:
        """Let no label lie on the outline of a box, if there is another place."""
        x1, y2, x2, y1 = self._canvas.pixels([box[:2], box[2:]]).reshape(-1).tolist()
        for side in ((x1, y1, x2, y1), (x1, y2, x2, y2), (x1, y1, x1, y2), (x2, y1, x2, y2)):
            self._taken.append(np.add(side, (-1.5, -1.5, 1.5, 1.5)))

    def put(self, at: Point, text: str, color: RGB, gap_px: float) -> None:
        """A label whose middle is ``gap_px`` right or left of (x, y) and above or below; or farther off."""
        rows, columns = text_mask(text, self._canvas.label_px, True).shape
        # a line of figures has no ink in its upper and lower fifth
        half = np.array([columns / 2.0, 0.3 * rows])
        aside = np.array([max(0.0, half[0] - 6.0), 0.0])  # of a longer text, its end is near
        places = np.concatenate([self.SIDES * (gap_px * far + aside) for far in self.FARTHER])
        low, high = self._canvas.pixels(at) + places - half, self._canvas.pixels(at) + places + half
        inside = _areas(np.maximum(low, 0.0), np.minimum(high, self._size))
        hidden = _areas(low, high) - inside
        if self._taken:
            taken = np.array(self._taken)
            common = np.maximum(low[:, None], taken[:, :2]), np.minimum(high[:, None], taken[:, 2:])
            hidden += _areas(*common).sum(axis=1)
        best = int(hidden.argmin())
        self._taken.append(np.concatenate([low[best], high[best]]))
        self._canvas.label(at, text, color, *places[best].tolist())


def _areas(low: Floats, high: Floats) -> Floats:
    """(...) square pixels of boxes from ``low`` to ``high``, (..., 2) each; 0 for an empty one."""
    sides = np.maximum(high - low, 0.0)
    return sides[..., 0] * sides[..., 1]


def _corners(box: Box) -> Floats:
    """(5, 2), the first one again at the end."""
    x1, y1, x2, y2 = box
    return np.array([(x1, y1), (x2, y1), (x2, y2), (x1, y2), (x1, y1)])


def blank_page(width: int, height: int) -> Picture:
    """(height, width, 3) a white picture."""
    return np.full((height, width, 3), WHITE, dtype=np.uint8)


def png_of(picture: Picture) -> bytes:
    """A picture as a PNG file."""
    _, png = cv2.imencode(".png", picture[..., ::-1])
    return png.tobytes()


def write(
    picture: Picture,
    column: int,
    top: int,
    text: str,
    size_px: int,
    color: RGB = palette.INK,
    bold: bool = False,
    before: float = 0.0,
) -> None:
    """Draw a line of text, ``before`` of it (0 to 1) on the left of ``column``; the edges cut it off."""
    mask = text_mask(text, size_px, bold)
    _blend(picture, mask, column - int(before * mask.shape[1]), top, color)


@lru_cache(maxsize=1024)
def text_mask(text: str, size_px: int, bold: bool = False) -> Picture:
    """(height, width) how much ink is where, 0 to 255; equal sizes give equal heights and baselines."""
    font = _font(size_px, bold)
    ascent, descent = font.getmetrics()
    image = Image.new("L", (math.ceil(font.getlength(text)) + 2, ascent + descent + 2))
    ImageDraw.Draw(image).text((1, 1), text, fill=255, font=font)
    mask = np.array(image)
    mask.flags.writeable = False
    return mask


@lru_cache(maxsize=1024)
def _halo(text: str, size_px: int) -> Picture:
    return cv2.dilate(text_mask(text, size_px, True), np.ones((3, 3), dtype=np.uint8)).astype(np.uint8)


@cache
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)


def _blend(picture: Picture, mask: Picture, left: int, top: int, color: RGB) -> None:
    height, width = picture.shape[:2]
    x1, x2 = max(left, 0), min(left + mask.shape[1], width)
    y1, y2 = max(top, 0), min(top + mask.shape[0], height)
    if x1 >= x2 or y1 >= y2:
        return
    weight = mask[y1 - top : y2 - top, x1 - left : x2 - left, None].astype(np.float32) / 255.0
    under = picture[y1:y2, x1:x2]
    under += ((np.array(color, dtype=np.float32) - under) * weight).astype(np.int16).astype(np.uint8)


def tiles(count: int, columns: int, across: int, down: int, left: int, top: int) -> Iterator[tuple[int, int]]:
    """(left, top) of so many tiles in reading order, ``across`` and ``down`` pixels apart."""
    for place in range(count):
        yield left + place % columns * across, top + place // columns * down


def paint_floor_plan(canvas: Canvas, plan: FloorPlan) -> None:
    """Ground, floor, walls and stationary intruders, over the whole picture."""
    canvas.picture[:] = palette.GROUND
    if plan.ground is None:
        canvas.box(plan.enclosure, None, fill=palette.FLOOR)
    else:  # unknown cells look like what is outside, not like floor
        codes = plan.ground.with_data((plan.ground.data >= 0).astype(np.uint8))
        canvas.cells(codes, [palette.GROUND, palette.FLOOR])
    # edges first, so that pieces of wall that share an end look like one
    for wall in plan.walls:
        canvas.polygon(wall, None, palette.WOOD_EDGE, 3)
    for wall in plan.walls:
        canvas.polygon(wall, palette.WOOD)
    paint_stationary(canvas, plan)


def paint_stationary(canvas: Canvas, plan: FloorPlan) -> None:
    """The stationary intruders."""
    for outline in plan.stationary:
        canvas.polygon(outline, palette.INTRUDER_FAINT, INTRUDER, 2)


def paint_robot(
    canvas: Canvas, pose: Pose2D, enlarged: float, color: RGB, model: RobotModel = BURGER
) -> None:
    """A robot from above, ``enlarged`` times as large as it is; a white line points ahead."""
    canvas.polygon(body_at(pose, enlarged, model), color, WHITE)
    ahead = pose.compose(Pose2D(0.045 * enlarged, 0.0, 0.0))
    canvas.line([pose[:2], ahead[:2]], WHITE, 2)


def paint_scans(canvas: Canvas, scans: Sequence[Floats]) -> None:
    """The returns of scans, (n, 2) each, as small dots."""
    for points in scans:
        for x, y in points.tolist():
            canvas.circle((x, y), 0.7 / canvas.scale, GUARD, -1)


def paint_scale(canvas: Canvas, view: Box) -> None:
    """A bar of a round length at the lower right of ``view``, with that length in metres."""
    length_m = next((one for one in SCALES_M if one * canvas.scale >= LEAST_SCALE_PX), SCALES_M[-1])
    end, y = view.x_max - 8.0 / canvas.scale, view.y_min + 7.0 / canvas.scale
    canvas.line([(end - length_m, y), (end, y)], WHITE, 6)
    canvas.line([(end - length_m, y), (end, y)], palette.INK, 3)
    canvas.label((end - length_m / 2.0, y), f"{length_m:g} m", palette.INK, down_px=-11.0)


def paint_path(canvas: Canvas, goal: Point, plan: Floats | None, is_guard: bool) -> None:
    """A robot's path in dots, and its goal: a cross for a guard, a diamond for an intruder."""
    color = GUARD if is_guard else INTRUDER
    if plan is not None:
        canvas.dots(plan, color)
    if is_guard:
        canvas.cross(goal, color)
        return
    (x, y), arm = goal, 5.0 / canvas.scale
    canvas.polygon([(x - arm, y), (x, y - arm), (x + arm, y), (x, y + arm)], WHITE, color, 2)


def paint_detection(canvas: Canvas, found: Detection) -> None:
    """A detection: a second one on an intruder dashed, a false one crossed out."""
    box = found.box
    if found.is_further:
        canvas.dashed_box(box, DETECTION)
    elif found.is_false:
        canvas.box(box, FALSE_DETECTION, 2)
        canvas.line([box[:2], box[2:]], FALSE_DETECTION)
        canvas.line([(box.x_min, box.y_max), (box.x_max, box.y_min)], FALSE_DETECTION)
    else:
        canvas.box(box, DETECTION, 2)


def sign_box(truth: Truth, margin_m: float, least_m: float) -> tuple[Floats, Floats]:
    """The middle (x, y) of the sign about an intruder, and half its sides, ``least_m`` or more; metres."""
    corners = np.concatenate(truth.outlines)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return (low + high) / 2.0, np.maximum((high - low) / 2.0 + margin_m, least_m)


def paint_sign(canvas: Canvas, truth: Truth, enlarged: float = 1.0, least_px: float = SIGN_PX) -> Box | None:
    """The sign about an intruder without a detection; nothing about one that is found.

    Returns:
        The box of the four corners about a missed one, its disc on the upper left of them; else None.
    """
    least_m = max(least_px / canvas.scale, 0.7 * enlarged * BURGER_LENGTH_M)
    middle, half = sign_box(truth, 5.0 / canvas.scale, least_m)
    if truth.is_out_of_range:
        for stroke in RING:
            canvas.line(stroke * half.max() + middle, palette.OUT_OF_RANGE, 1)
    if not truth.is_missed:
        return None
    for color, width in ((WHITE, 4), (palette.MISSED, 2)):
        for stroke in CORNERS:
            canvas.line(stroke * half + middle, color, width)
    box = Box._make([*(middle - half).tolist(), *(middle + half).tolist()])
    at = (box.x_min, box.y_max)
    canvas.circle(at, (BADGE_PX + 1.5) / canvas.scale, WHITE, -1)
    canvas.circle(at, BADGE_PX / canvas.scale, palette.MISSED, -1)
    column, row = canvas.pixels(at).tolist()
    mask = text_mask("!", LABEL_PX, True)
    left, top = column - mask.shape[1] / 2.0, row - mask.shape[0] / 2.0
    _blend(canvas.picture, mask, round(left), round(top), WHITE)
    return box


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
        self.enlarged = canvas.enlarged  # how many times as large as they are robots are drawn

    def paint(self, picture: Picture, scene: Scene) -> None:
        """Fill ``picture``, (height, width, 3)."""
        picture[:] = self._still
        canvas = Canvas(picture, self.view, self._label_px)
        labels, plan = Labels(canvas), self._setup.plan
        paint_scale(canvas, self.view)
        _paint_sensing(canvas, self._setup, scene)
        for robot in scene.robots:
            if robot.goal is not None:
                paint_path(canvas, robot.goal, robot.plan, robot.is_guard)
                labels.keep_free(robot.goal, 5.0)
        # robots do not know of stationary intruders: a goal under one is hidden, or it would look like a part
        paint_stationary(canvas, plan)
        for robot in scene.robots:
            paint_robot(canvas, robot.pose, self.enlarged, _color_of(robot), robot.model)
            labels.keep_free(robot.pose[:2], 0.4 * BURGER_LENGTH_M * self.enlarged * canvas.scale)
        for outline in [outline for outlines in scene.others for outline in outlines]:
            canvas.polygon(outline, INTRUDER, WHITE)
            labels.keep_free(_middle(outline), LEG_PX)
        _paint_results(canvas, scene, labels, self.enlarged)
        for number, outline in enumerate(plan.stationary, 1):
            canvas.label(_middle(outline), f"S{number}", INTRUDER)
            labels.keep_free(_middle(outline), 10.0)
        for robot in scene.robots:
            labels.put(robot.pose[:2], str(robot.number), _color_of(robot), 13.0)
        for number, outlines in enumerate(scene.others, 1):
            labels.put(_middle(np.concatenate(outlines)), f"P{number}", INTRUDER, 13.0)
        for robot in scene.robots:
            # a robot at its goal has its number there already
            if (
                robot.goal is not None
                and math.dist(robot.goal, robot.pose[:2]) * canvas.scale > AT_GOAL_PX
                and not plan.hides(robot.goal)
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
            window = view.crop.of_prior(codes)
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


def _middle(outline: Floats) -> Point:
    x, y = outline.mean(axis=0).tolist()
    return x, y


def _paint_sensing(canvas: Canvas, setup: Setup, scene: Scene) -> None:
    """Each guard's local costmap, a thin square, its LiDAR's usable range, a paler circle; returns."""
    for robot in scene.guards:
        canvas.circle(robot.sensor, setup.usable_range_m, palette.GUARD_RANGE)
        canvas.box(setup.window(robot), GUARD)
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


MARK_PX = 7.0  # half a side of a legend's mark
SQUARE, SWATCH = Box.square(0.0, 0.0, 2.0 * MARK_PX), Box(-8.0, -6.0, 8.0, 6.0)


def world_legend(setup: Setup, scenes: Sequence[Scene] | None = None) -> list[Entry]:
    """The marks of the true world in some scenes; None: of a whole trial, all that its setup allows."""
    have_paths = scenes is None or any(robot.goal for scene in scenes for robot in scene.robots)
    return [
        *_if(setup.guards, burger(GUARD, 4.0), "guard"),
        *_if(setup.mobile_intruders, burger(INTRUDER, 4.0), "mobile intruder"),
        *_if(setup.plan.stationary, *swatch(palette.INTRUDER_FAINT, "stationary intruder", INTRUDER, 2)),
        *_if(setup.other_intruders, _legs, "person (two legs) or thing"),
        *sign_legend(scenes),
        *_if(have_paths, _paths if setup.mobile_intruders else _path, "path and goal"),
        *_if(setup.plan.ground is not None, *swatch(palette.GROUND, "unknown on the map")),
        reach_entry(setup),
        *scan_legend(setup),
    ]


def sign_legend(scenes: Sequence[Scene] | None) -> list[Entry]:
    """The signs about intruders without a detection."""
    truths = [truth for scene in scenes or () for truth in scene.truths]
    entries = []
    for in_range, text in ((True, palette.MISS), (False, palette.NO_ERROR)):
        is_there = any(not truth.is_found and truth.in_range == in_range for truth in truths)
        example = Truth([np.zeros((1, 2))], False, in_range)
        mark = partial(paint_sign, truth=example, enlarged=0.0, least_px=MARK_PX)
        entries += _if(scenes is None or is_there, mark, text)
    return entries


def detection_legend(scenes: Sequence[Scene] | None = None, numbered: bool = False) -> list[Entry]:
    """The boxes of detections; ``numbered`` where they have their guards' numbers."""
    boxes = [found for scene in scenes or () for found in scene.detections]
    shown = {(found.is_false, found.is_further) for found in boxes}
    is_labelled = scenes is None or any(scene.is_labelled for scene in scenes)
    own = (palette.TRUE_POSITIVE if is_labelled else "detection") + ", with its guard's number" * numbered
    kinds = {(False, False): own, (False, True): palette.DUPLICATE, (True, False): palette.FALSE_POSITIVE}
    return [
        (partial(paint_detection, found=Detection(SQUARE, 0, *kind)), text)
        for kind, text in kinds.items()
        if scenes is None or kind in shown
    ]


def grid_legend() -> list[Entry]:
    """The shades of the prior map and of the guards' grids."""
    texts = {
        FOREGROUND: "seen, not on the prior map (D)",
        COMMON: "seen, on the prior map (C)",
        INFLATED: "margin of the prior map (Eq. 1)",
        WALL: "wall on the prior map",
    }
    return [swatch(SHADES[code], text) for code, text in texts.items()]


def reach_entry(setup: Setup) -> Entry:
    """The local costmap and the usable range of a guard."""

    def mark(canvas: Canvas) -> None:
        canvas.circle((0.0, 0.0), MARK_PX - 2.0, palette.GUARD_RANGE)
        canvas.box(SQUARE, GUARD)

    return mark, f"costmap {setup.local_size_m:g} m, LiDAR {setup.usable_range_m:g} m"


def scan_legend(setup: Setup) -> list[Entry]:
    """The returns of scans, if the setup shows them."""
    points = np.array([(-6.0, 0.0), (0.0, 0.0), (6.0, 0.0)])
    return _if(setup.shows_scans, partial(paint_scans, scans=[points]), "LiDAR returns")


def outline(color: RGB, text: str) -> Entry:
    """A thin outline."""
    return partial(Canvas.box, box=SWATCH, edge=color), text


def swatch(fill: RGB, text: str, edge: RGB | None = None, width: int = 1) -> Entry:
    """A filled rectangle."""
    return partial(Canvas.box, box=SWATCH, edge=edge, width=width, fill=fill), text


def burger(color: RGB, ahead_px: float = 0.0) -> Mark:
    """A Burger, its axle ``ahead_px`` on the right."""
    pose = Pose2D(ahead_px, 0.0, 0.0)
    return partial(paint_robot, pose=pose, enlarged=18.0 / BURGER_LENGTH_M, color=color)


def _if(is_there: object, mark: Mark, text: str) -> list[Entry]:
    return [(mark, text)] if is_there else []


def _legs(canvas: Canvas) -> None:
    for leg in (-4.0, 4.0):
        canvas.circle((leg, 0.0), 3.0, INTRUDER, -1)


def _path(canvas: Canvas) -> None:
    paint_path(canvas, (9.0, 0.0), np.array([(-14.0, 0.0), (7.0, 0.0)]), True)


def _paths(canvas: Canvas) -> None:
    paint_path(canvas, (-6.0, 0.0), np.array([(-14.0, 0.0), (-8.0, 0.0)]), True)
    paint_path(canvas, (9.0, 0.0), np.array([(1.0, 0.0), (7.0, 0.0)]), False)


def legend_rows(entries: Sequence[Entry], left: int, right: int, size_px: int) -> list[tuple[int, int]]:
    """Of each entry its pixels from the left and its row: as many in a row as end before ``right``."""
    placed, at, row = [], left, 0
    for _, text in entries:
        wide = 52 + text_mask(text, size_px).shape[1]
        if at + wide > right and at > left:
            at, row = left, row + 1
        placed.append((at, row))
        at += wide
    return placed


def write_legend(
    page: Picture,
    entries: Sequence[Entry],
    left: int,
    top: int,
    row_px: int,
    size_px: int,
    right: int | None = None,
) -> None:
    """Write entries; the middle of the first row is at ``top``.

    ``right``: up to where entries lie beside each other; None: below each other.
    """
    height, width = page.shape[:2]
    places = legend_rows(entries, left, left if right is None else right, size_px)
    for (mark, text), (column, row) in zip(entries, places, strict=True):
        x, y = column + 8.0, float(top + row_px * row)
        mark(Canvas(page, Box(-x, y - height, width - x, y)))
        write(page, column + 29, top + row_px * row - round(0.7 * size_px), text, size_px)
