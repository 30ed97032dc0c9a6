"""``Canvas``: a view of the map frame on a numpy picture, and what is drawn on it; with OpenCV."""

import math
from functools import cache, lru_cache
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
    INTRUDER,
    INTRUDER_FAINT,
    RGB,
    WHITE,
    WOOD,
    WOOD_EDGE,
)
from midnet_bench.drawing.scene import BURGER_LENGTH_M, Floats, FloorPlan, Point, body_at
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel

Picture = npt.NDArray[np.uint8]
"""(height, width, 3) red, green, blue"""

MIN_BURGER_PX = 14.0
"""Robots in a large arena are drawn larger than they are, so that they stay visible."""
_SHIFT = 4
"""OpenCV takes coordinates in sixteenths of a pixel, which keeps slow motion smooth."""


class Canvas:
    """A picture that shows ``view`` in its middle, as large as fits; drawing changes the picture."""

    def __init__(self, picture: Picture, view: Box) -> None:
        self.picture = picture
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

    def box(self, box: Box, color: RGB, width: int = 1) -> None:
        """The outline of a box."""
        self.polygon(_corners(box), None, color, width)

    def fill(self, box: Box, color: RGB) -> None:
        """A filled box."""
        self.polygon(_corners(box), color)

    def cells(self, codes: OccupancyGrid, shades: Picture) -> None:
        """A grid over the whole picture; cell value i, an uint8, looks like row i of ``shades`` (k, 3)."""
        height, width = self.picture.shape[:2]
        x, y = codes.origin
        left, base = self.pixels((x, y))
        per_pixel = 1.0 / (self.scale * codes.resolution)
        # of the picture's pixel centres, into cells
        columns = np.floor((np.arange(width) + 0.5 - left) * per_pixel).astype(int)
        rows = np.floor((base - np.arange(height) - 0.5) * per_pixel).astype(int)
        on_x, on_y = (columns >= 0) & (columns < codes.width), (rows >= 0) & (rows < codes.height)
        self.picture[np.ix_(on_y, on_x)] = shades[codes.data[np.ix_(rows[on_y], columns[on_x])]]

    def label(self, at: Point, text: str, color: RGB, right_px: float = 0, down_px: float = 0) -> None:
        """Bold text with a white halo in the middle of a point that lies so far from (x, y)."""
        x, y = self.pixels(at)
        mask = text_mask(text, 13, True)
        left, top = x + right_px - mask.shape[1] / 2.0, y + down_px - mask.shape[0] / 2.0
        _blend(self.picture, _halo(text, 13), round(left), round(top), (255, 255, 255))
        _blend(self.picture, mask, round(left), round(top), color)

    def _fixed(self, points: npt.ArrayLike) -> npt.NDArray[np.int32]:
        return np.rint(self.pixels(points) * 2**_SHIFT).astype(np.int32)


def paint_floor_plan(canvas: Canvas, plan: FloorPlan) -> None:
    """Ground, floor, walls and stationary intruders, over the whole picture."""
    canvas.picture[:] = GROUND
    canvas.fill(plan.enclosure, FLOOR)
    # edges first, so that pieces of wall that share an end look like one
    for wall in plan.walls:
        canvas.polygon(wall, None, WOOD_EDGE, 3)
    for wall in plan.walls:
        canvas.polygon(wall, WOOD)
    for number, outline in enumerate(plan.stationary, 1):
        canvas.polygon(outline, INTRUDER_FAINT, INTRUDER, 2)
        x, y = outline.mean(axis=0).tolist()
        canvas.label((x, y), f"S{number}", INTRUDER)


def paint_robot(
    canvas: Canvas, pose: Pose2D, enlarged: float, color: RGB, model: RobotModel = BURGER
) -> None:
    """A robot from above, ``enlarged`` times as large as it is; a white line points ahead."""
    canvas.polygon(body_at(pose, enlarged, model), color, WHITE)
    ahead = pose.compose(Pose2D(0.045 * enlarged, 0.0, 0.0))
    canvas.line([pose[:2], ahead[:2]], WHITE, 2)


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


def paint_detection(canvas: Canvas, box: Box, is_false: bool) -> None:
    """A detection. A false one is crossed out as well: not everybody can go by colour alone."""
    color = FALSE_DETECTION if is_false else DETECTION
    canvas.box(box, color, 2)
    if is_false:
        canvas.line([box[:2], box[2:]], color)


def blank_page(width: int, height: int) -> Picture:
    """(height, width, 3) a white picture."""
    return np.full((height, width, 3), WHITE, dtype=np.uint8)


def png_of(picture: Picture) -> bytes:
    """A picture as a PNG file."""
    _, png = cv2.imencode(".png", picture[..., ::-1])
    return png.tobytes()


def write(
    picture: Picture, left: int, top: int, text: str, size_px: int, color: RGB, bold: bool = False
) -> None:
    """Draw a line of text whose upper left corner is at (left, top); what lies outside is cut off."""
    _blend(picture, text_mask(text, size_px, bold), left, top, color)


def write_right(picture: Picture, right: int, top: int, text: str, size_px: int, color: RGB) -> None:
    """Draw a bold line of text whose upper right corner is at (right, top)."""
    write(picture, right - text_mask(text, size_px, True).shape[1], top, text, size_px, color, bold=True)


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
    x1, y1, x2, y2 = box
    return np.array([(x1, y1), (x2, y1), (x2, y2), (x1, y2)])


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
