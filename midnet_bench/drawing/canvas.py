"""``Canvas``: a view of the map frame on a numpy picture, and what is drawn on it; with OpenCV."""

import math
from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from midnet_bench.drawing.palette import (
    DETECTION,
    FALSE_DETECTION,
    FLOOR,
    GROUND,
    GUARD,
    GUARD_RANGE,
    INK,
    INTRUDER,
    INTRUDER_FAINT,
    MISSED,
    OUT_OF_RANGE,
    RGB,
    WHITE,
    WOOD,
    WOOD_EDGE,
)
from midnet_bench.drawing.scene import (
    BURGER_LENGTH_M,
    Detection,
    Floats,
    FloorPlan,
    Robot,
    Setup,
    Truth,
    body_at,
)
from midnet_bench.drawing.signs import CORNERS, RING, place_of
from midnet_bench.geometry import Box, Point, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel

Picture = npt.NDArray[np.uint8]
"""(height, width, 3) red, green, blue"""

LABEL_PX = 13
SIGN_PX = 10.0
"""half a side of a sign about an intruder is no shorter"""
BADGE_PX = 6.5
"""radius of the disc with the exclamation mark"""
SCALES_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
LEAST_SCALE_PX = 40.0
"""a bar that shows the scale is no shorter, if one of ``SCALES_M`` is long enough"""
MIN_BURGER_PX = 14.0
"""Robots in a large arena are drawn larger than they are, so that they stay visible."""
OUTSIDE: RGB = (204, 204, 204)
"""no grid"""
GREYS = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
GRID_LABEL_PX = 15
_SHIFT = 4
"""OpenCV takes coordinates in sixteenths of a pixel, which keeps slow motion smooth."""


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

    def dashes(self, points: npt.ArrayLike, color: RGB, dash_px: float = 5.0, gap_px: float = 6.0) -> None:
        """A line of two pixels through (n, 2) points in dashes; each piece begins with a whole one."""
        path = np.asarray(points, dtype=np.float64)
        for start, end in pairwise(path):
            length_px = float(np.hypot(*(end - start))) * self.scale
            for at in np.arange(0.0, length_px, dash_px + gap_px).tolist():
                ends = np.array([at, min(at + dash_px, length_px)]) / length_px
                self.line(start + ends[:, None] * (end - start), color, 2)

    def dots(self, points: npt.ArrayLike, color: RGB, gap_px: float = 6.0) -> None:
        """Dots of two pixels along (n, 2) points, ``gap_px`` apart."""
        path = self.pixels(points)
        reached = np.concatenate(([0.0], np.hypot(*np.diff(path, axis=0).T).cumsum()))
        at = np.arange(0.0, reached[-1], gap_px)
        columns, rows = (np.interp(at, reached, path[:, axis]).astype(int) for axis in (0, 1))
        height, width = self.picture.shape[:2]
        seen = (columns >= 0) & (rows >= 0) & (columns < width - 1) & (rows < height - 1)
        for down in (0, 1):
            for right in (0, 1):
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

    def dashed_box(self, box: Box, color: RGB) -> None:
        """The outline of a box in dashes."""
        self.dashes(_corners(box), color)

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
        _blend(self.picture, _halo(text, self.label_px), round(left), round(top), (255, 255, 255))
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
        height, width = canvas.picture.shape[:2]
        self._size = np.array([width, height])
        self._taken: list[Floats] = []
        """columns and rows from and to, y down"""

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
            hidden += _areas(
                np.maximum(low[:, None], taken[:, :2]), np.minimum(high[:, None], taken[:, 2:])
            ).sum(axis=1)
        best = int(hidden.argmin())
        self._taken.append(np.concatenate([low[best], high[best]]))
        right_px, down_px = places[best].tolist()
        self._canvas.label(at, text, color, right_px, down_px)


def _areas(low: Floats, high: Floats) -> Floats:
    """(...) square pixels of boxes from ``low`` to ``high``, (..., 2) each; 0 for an empty one."""
    sides = np.maximum(high - low, 0.0)
    return sides[..., 0] * sides[..., 1]


def paint_floor_plan(canvas: Canvas, plan: FloorPlan) -> None:
    """Ground, floor, walls and stationary intruders, over the whole picture."""
    canvas.picture[:] = GROUND
    if plan.ground is None:
        canvas.box(plan.enclosure, None, fill=FLOOR)
    else:  # unknown cells look like what is outside, not like floor
        codes = plan.ground.with_data((plan.ground.data >= 0).astype(np.uint8))
        canvas.cells(codes, [GROUND, FLOOR])
    # edges first, so that pieces of wall that share an end look like one
    for wall in plan.walls:
        canvas.polygon(wall, None, WOOD_EDGE, 3)
    for wall in plan.walls:
        canvas.polygon(wall, WOOD)
    paint_stationary(canvas, plan)


def paint_stationary(canvas: Canvas, plan: FloorPlan) -> None:
    """The stationary intruders."""
    for outline in plan.stationary:
        canvas.polygon(outline, INTRUDER_FAINT, INTRUDER, 2)


def label_stationary(canvas: Canvas, plan: FloorPlan, labels: Labels) -> None:
    """The numbers of the stationary intruders, in their middles."""
    for number, outline in enumerate(plan.stationary, 1):
        x, y = outline.mean(axis=0).tolist()
        canvas.label((x, y), f"S{number}", INTRUDER)
        labels.keep_free((x, y), 10.0)


def paint_robot(
    canvas: Canvas, pose: Pose2D, enlarged: float, color: RGB, model: RobotModel = BURGER
) -> None:
    """A robot from above, ``enlarged`` times as large as it is; a white line points ahead."""
    canvas.polygon(body_at(pose, enlarged, model), color, WHITE)
    ahead = pose.compose(Pose2D(0.045 * enlarged, 0.0, 0.0))
    canvas.line([pose[:2], ahead[:2]], WHITE, 2)


def paint_reach(canvas: Canvas, setup: Setup, guard: Robot) -> None:
    """A guard's local costmap, a thin square, and the usable range of its LiDAR, a paler circle."""
    canvas.circle(guard.sensor, setup.usable_range_m, GUARD_RANGE)
    canvas.box(setup.window(guard), GUARD)


def paint_scans(canvas: Canvas, scans: Sequence[Floats]) -> None:
    """The returns of scans, (n, 2) each, as small dots."""
    for points in scans:
        for x, y in points.tolist():
            canvas.circle((x, y), 0.7 / canvas.scale, GUARD, -1)


def paint_scale(canvas: Canvas, view: Box) -> None:
    """A bar of a round length at the lower right of ``view``, with that length in metres."""
    length_m = next(one for one in SCALES_M if one * canvas.scale >= LEAST_SCALE_PX or one == SCALES_M[-1])
    end, y = view.x_max - 8.0 / canvas.scale, view.y_min + 7.0 / canvas.scale
    canvas.line([(end - length_m, y), (end, y)], WHITE, 6)
    canvas.line([(end - length_m, y), (end, y)], INK, 3)
    canvas.label((end - length_m / 2.0, y), f"{length_m:g} m", INK, down_px=-11.0)


def paint_path(canvas: Canvas, goal: Point, plan: Floats | None, color: RGB, is_guard: bool) -> None:
    """A robot's path in dots, and its goal: a cross for a guard, a diamond for an intruder."""
    if plan is not None:
        canvas.dots(plan, color)
    if is_guard:
        canvas.cross(goal, color)
        return
    x, y = goal
    arm = 5.0 / canvas.scale
    canvas.polygon([(x - arm, y), (x, y - arm), (x + arm, y), (x, y + arm)], WHITE, color, 2)


def paint_detection(canvas: Canvas, found: Detection) -> None:
    """A detection. A false one is crossed out as well: colour alone does not tell all readers.

    A further one on an intruder that has its own is dashed.
    """
    box = found.box
    if found.is_further:
        canvas.dashed_box(box, DETECTION)
    elif found.is_false:
        canvas.box(box, FALSE_DETECTION, 2)
        canvas.line([box[:2], box[2:]], FALSE_DETECTION)
        canvas.line([(box.x_min, box.y_max), (box.x_max, box.y_min)], FALSE_DETECTION)
    else:
        canvas.box(box, DETECTION, 2)


def paint_sign(canvas: Canvas, truth: Truth, enlarged: float = 1.0, least_px: float = SIGN_PX) -> Box | None:
    """What is to be said about an intruder without a detection; nothing about one that is found.

    Returns:
        The box of the four corners about a missed one, its disc on the upper left of them; else None.
    """
    least_m = max(least_px / canvas.scale, 0.7 * enlarged * BURGER_LENGTH_M)
    middle, half = place_of(truth, 5.0 / canvas.scale, least_m)
    if truth.is_out_of_range:
        for stroke in RING:
            canvas.line(stroke * max(half) + middle, OUT_OF_RANGE, 1)
    if not truth.is_missed:
        return None
    for stroke in CORNERS:
        canvas.line(stroke * half + middle, WHITE, 4)
    for stroke in CORNERS:
        canvas.line(stroke * half + middle, MISSED, 2)
    (x, y), (half_x, half_y) = middle, half
    at = (x - half_x, y + half_y)
    canvas.circle(at, (BADGE_PX + 1.5) / canvas.scale, WHITE, -1)
    canvas.circle(at, BADGE_PX / canvas.scale, MISSED, -1)
    column, row = canvas.pixels(at).tolist()
    mask = text_mask("!", LABEL_PX, True)
    left, top = column - mask.shape[1] / 2.0, row - mask.shape[0] / 2.0
    _blend(canvas.picture, mask, round(left), round(top), WHITE)
    return Box(x - half_x, y - half_y, x + half_x, y + half_y)


def paint_grid(page: Picture, left: int, top: int, side_px: int, view: Box, grid: OccupancyGrid) -> Canvas:
    """A grid of greys (uint8) in a square of a page; the canvas of that square, which shows ``view``."""
    tile = page[top : top + side_px, left : left + side_px]
    tile[:] = OUTSIDE
    canvas = Canvas(tile, view, GRID_LABEL_PX)
    canvas.cells(grid, GREYS)
    return canvas


def paint_removed(canvas: Canvas, box: Box, ally: str) -> None:
    """A box that was taken for an ally, and which."""
    canvas.dashed_box(box, GUARD)
    canvas.label((box.x_max, box.y_max), ally, GUARD, 7, -5)


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
    color: RGB,
    bold: bool = False,
    before: float = 0.0,
) -> None:
    """Draw a line of text; what lies outside is cut off.

    ``before``: which part of it stands on the left of ``column``, 0 to 1.
    """
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


def _corners(box: Box) -> Floats:
    """(5, 2), the first one again at the end."""
    x1, y1, x2, y2 = box
    return np.array([(x1, y1), (x2, y1), (x2, y2), (x1, y2), (x1, y1)])


@cache
def _font(size_px: int, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)


def _blend(picture: Picture, mask: Picture, left: int, top: int, color: RGB) -> None:
    height, width = picture.shape[:2]
    x1, y1, x2, y2 = (
        max(left, 0),
        max(top, 0),
        min(left + mask.shape[1], width),
        min(top + mask.shape[0], height),
    )
    if x1 >= x2 or y1 >= y2:
        return
    weight = mask[y1 - top : y2 - top, x1 - left : x2 - left, None].astype(np.float32) / 255.0
    under = picture[y1:y2, x1:x2]
    under += ((np.array(color, dtype=np.float32) - under) * weight).astype(np.int16).astype(np.uint8)
