"""Ten floor plans of one flat in ten styles, as people draw and scan them, and options that read each."""

import cv2
import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8]
RESOLUTION_M = 0.02
WIDTH, HEIGHT, WALL = 500, 400, 8  # pixels: 10 m by 8 m, walls of 0.16 m
DOOR = 45  # 0.9 m
WHITE, BLACK, GREY, RED = (255, 255, 255), (0, 0, 0), (110, 110, 110), (0, 0, 220)  # blue, green, red
HINGES = ((200, 120), (296, 240))
"""x of the wall and y where its door begins: of two walls across"""


def walls() -> npt.NDArray[np.bool_]:
    """Outer walls and two walls with a door each."""
    dark = np.zeros((HEIGHT, WIDTH), np.bool_)
    dark[:WALL] = dark[-WALL:] = dark[:, :WALL] = dark[:, -WALL:] = True
    for x, y in HINGES:
        dark[:, x : x + WALL] = True
        dark[y : y + DOOR, x : x + WALL] = False
    return dark


def flat(color: tuple[int, int, int] = BLACK, ground: tuple[int, int, int] = WHITE) -> Pixels:
    picture = np.full((HEIGHT, WIDTH, 3), ground, np.uint8)
    picture[walls()] = color
    return picture


def with_margin(picture: Pixels, ground: tuple[int, int, int] = WHITE) -> Pixels:
    return cv2.copyMakeBorder(picture, 90, 90, 90, 90, cv2.BORDER_CONSTANT, value=ground).astype(np.uint8)


def door_arcs(picture: Pixels, color: tuple[int, int, int], thick: int) -> None:
    """Each door's leaf, open by a right angle, and its arc."""
    for x, y in HINGES:
        hinge = (x + WALL - 1, y)
        cv2.line(picture, hinge, (hinge[0] + DOOR, hinge[1]), color, thick)
        cv2.ellipse(picture, hinge, (DOOR, DOOR), 0, 0, 90, color, thick, cv2.LINE_AA)


def grey_door_arcs() -> Pixels:
    picture = flat()
    door_arcs(picture, GREY, 2)
    return picture


def thin_door_arcs() -> Pixels:
    picture = flat()
    door_arcs(picture, BLACK, 2)
    return picture


def red_dimensions() -> Pixels:
    """Dimension lines outside with numbers, and one through the whole flat that crosses the walls."""
    picture = with_margin(flat())
    cv2.line(picture, (90, 50), (590, 50), RED, 2)
    cv2.line(picture, (50, 90), (50, 490), RED, 2)
    for x in (90, 290, 386, 590):
        cv2.line(picture, (x, 42), (x, 58), RED, 2)
    cv2.putText(picture, "10.00", (310, 40), cv2.FONT_HERSHEY_SIMPLEX, 0.6, RED, 2)
    cv2.line(picture, (90, 400), (590, 400), RED, 2)
    return picture


def hatched_walls() -> Pixels:
    """Walls as outlines with strokes between them."""
    dark = walls()
    inner = cv2.erode(dark.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    rows, columns = np.indices(dark.shape)
    picture = np.full((HEIGHT, WIDTH, 3), WHITE, np.uint8)
    picture[dark & ~inner] = BLACK
    picture[inner & ((rows + columns) % 6 == 0)] = BLACK
    return picture


def furniture() -> Pixels:
    """Outlines of a bed, a table with chairs, a bath; names of rooms."""
    picture = flat()
    for low, high in (((20, 20), (110, 120)), ((330, 60), (430, 110)), ((30, 290), (110, 330))):
        cv2.rectangle(picture, low, high, BLACK, 1)
    for x in (345, 375, 405):
        cv2.rectangle(picture, (x, 118), (x + 20, 138), BLACK, 1)
        cv2.circle(picture, (x + 10, 40), 9, BLACK, 1)
    cv2.putText(picture, "Bedroom", (30, 200), cv2.FONT_HERSHEY_SIMPLEX, 0.7, BLACK, 1, cv2.LINE_AA)
    cv2.putText(picture, "Hall", (230, 200), cv2.FONT_HERSHEY_SIMPLEX, 0.7, BLACK, 1, cv2.LINE_AA)
    return picture


def jpeg_noise() -> Pixels:
    """A small file of bad quality."""
    _, data = cv2.imencode(".jpg", with_margin(flat()), [cv2.IMWRITE_JPEG_QUALITY, 12])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def skewed_scan() -> Pixels:
    """Laid on the scanner a degree off, with dust and a grey shade."""
    picture = with_margin(flat())
    height, width = picture.shape[:2]
    turn = cv2.getRotationMatrix2D((width / 2, height / 2), 1.0, 1.0)
    turned = cv2.warpAffine(picture, turn, (width, height), flags=cv2.INTER_LINEAR, borderValue=WHITE)
    rng = np.random.default_rng(49)
    shade = turned * np.linspace(0.8, 1.0, width)[None, :, None] + rng.normal(0, 6, turned.shape)
    scan = np.clip(shade, 0, 255).astype(np.uint8)
    for x, y in rng.integers(100, 480, (12, 2)).tolist():
        cv2.circle(scan, (x, y), 1, BLACK, -1)
    return scan


def inverse() -> Pixels:
    """White lines on blue, as a blueprint."""
    return with_margin(flat(WHITE, (120, 40, 10)), (120, 40, 10))


def scale_bar() -> Pixels:
    """A title above, a scale bar and a north arrow below."""
    picture = with_margin(flat())
    cv2.putText(picture, "GROUND FLOOR", (90, 60), cv2.FONT_HERSHEY_SIMPLEX, 1.0, BLACK, 2)
    for k in range(4):
        cv2.rectangle(picture, (90 + 50 * k, 520), (140 + 50 * k, 530), BLACK, -1 if k % 2 == 0 else 1)
    cv2.putText(picture, "4 m", (300, 530), cv2.FONT_HERSHEY_SIMPLEX, 0.6, BLACK, 2)
    cv2.arrowedLine(picture, (560, 560), (560, 505), BLACK, 4)
    return picture


def grey_walls() -> Pixels:
    """Walls in light grey with thin black outlines, and a door that is drawn too narrow."""
    dark = walls()
    dark[165:250, 200 : 200 + WALL] = True
    x, y = HINGES[0]
    dark[y : y + DOOR, x : x + WALL] = True
    dark[y : y + 11, x : x + WALL] = False  # 0.22 m
    inner = cv2.erode(dark.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0) > 0
    picture = np.full((HEIGHT, WIDTH, 3), WHITE, np.uint8)
    picture[dark] = (190, 190, 190)
    picture[dark & ~inner] = BLACK
    return picture


PLANS = {
    "grey_door_arcs": (grey_door_arcs, ("--threshold", 64)),
    "thin_door_arcs": (thin_door_arcs, ("--drop-thin", 0.1)),
    "red_dimensions": (red_dimensions, ("--drop-coloured",)),
    "hatched_walls": (hatched_walls, ()),
    "furniture": (furniture, ("--drop-thin", 0.1, "--drop-specks", 0.32)),
    "jpeg_noise": (jpeg_noise, ()),
    "skewed_scan": (skewed_scan, ("--drop-specks", 0.1)),
    "inverse": (inverse, ("--walls", "light")),
    "scale_bar": (scale_bar, ("--drop-beside",)),
    "grey_walls": (grey_walls, ()),
}
"""name -> the drawing, and the options that its remarks propose"""
