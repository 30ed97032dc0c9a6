"""Map_server maps drawn in the styles of public ones, each a function of its own seed."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import yaml

Pixels = npt.NDArray[np.uint8]
WALL, FLOOR, UNKNOWN = 0, 254, 205


class DrawnMap(NamedTuple):
    """An image, row 0 at the top, and what its YAML file says."""

    pixels: Pixels
    keys: dict[str, object]

    def write(self, folder: Path, name: str = "map") -> Path:
        """The YAML file."""
        assert cv2.imwrite(str(folder / f"{name}.pgm"), self.pixels)
        (folder / f"{name}.yaml").write_text(yaml.safe_dump({"image": f"{name}.pgm", **self.keys}))
        return folder / f"{name}.yaml"


def keys(resolution: float = 0.05, **more: object) -> dict[str, object]:
    usual = {"negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196, "origin": [-10.0, -10.0, 0.0]}
    return {**usual, "resolution": resolution, **more}


def box(width_m: float, height_m: float, resolution: float = 0.05, wall: int = 1) -> Pixels:
    """A room: walls so many pixels thick around floor."""
    pixels = np.full((round(height_m / resolution), round(width_m / resolution)), FLOOR, np.uint8)
    pixels[:wall] = pixels[-wall:] = pixels[:, :wall] = pixels[:, -wall:] = WALL
    return pixels


def office(
    rng: np.random.Generator, width_m: float, height_m: float, resolution: float = 0.05, wall: int = 2
):
    """Rooms with a door each on both sides of corridors."""
    pixels = box(width_m, height_m, resolution, wall)
    px = lambda metres: round(metres / resolution)  # noqa: E731
    y = 0.0
    while y + 7.0 < height_m:
        for wall_y in (y + 4.0, y + 5.8):
            pixels[px(wall_y) : px(wall_y) + wall] = WALL
        x = 0.0
        while x < width_m - 1.0:
            end = min(x + rng.uniform(2.5, 4.5), width_m)
            for low, high, wall_y in ((y, y + 4.0, y + 4.0), (y + 5.8, min(y + 9.8, height_m), y + 5.8)):
                if end < width_m:
                    pixels[px(low) : px(high), px(end) : px(end) + wall] = WALL
                door = rng.uniform(x + 0.3, max(end - 1.2, x + 0.31))
                pixels[px(wall_y) : px(wall_y) + wall, px(door) : px(door + 0.9)] = FLOOR
            x = end
        y += 9.8
    pixels[:wall], pixels[-wall:] = WALL, WALL
    return pixels


def noisy(pixels: Pixels, rng: np.random.Generator, share: float) -> Pixels:
    """Dots on the floor, and walls that are ragged by a pixel, as scans make them."""
    grown = cv2.erode(pixels, np.ones((3, 3), np.uint8))
    ragged = np.where(rng.random(pixels.shape) < 0.4, grown, pixels)
    return np.where(rng.random(pixels.shape) < share, WALL, ragged).astype(np.uint8)


def in_unknown(pixels: Pixels, margin: int, rng: np.random.Generator) -> Pixels:
    """A margin that nobody has seen, with rays through the windows."""
    big = np.pad(pixels, margin, constant_values=UNKNOWN)
    height, width = big.shape
    for _ in range(12):
        at, angle = (rng.integers(width), rng.integers(height)), rng.uniform(0, 2 * math.pi)
        end = (int(at[0] + margin * math.cos(angle)), int(at[1] + margin * math.sin(angle)))
        free = np.zeros_like(big)
        cv2.line(free, (int(at[0]), int(at[1])), end, 1, 2)
        big[(free > 0) & (big == UNKNOWN)] = FLOOR
    return big


def turtlebot3_world(rng: np.random.Generator) -> DrawnMap:
    """A hexagon with nine pillars, seen from inside; unknown around."""
    pixels = np.full((384, 384), UNKNOWN, np.uint8)
    middle, radius = 192 + int(rng.integers(-5, 5)), 52
    corners = [
        (middle + radius * math.cos(math.pi / 3 * k), middle + radius * math.sin(math.pi / 3 * k))
        for k in range(6)
    ]
    points = np.array(corners, np.int32)
    cv2.fillPoly(pixels, [points], FLOOR)
    cv2.polylines(pixels, [points], True, WALL, 2)
    for x in (-22, 0, 22):
        for y in (-22, 0, 22):
            cv2.circle(pixels, (middle + x, middle + y), 3, UNKNOWN, -1)
            cv2.circle(pixels, (middle + x, middle + y), 3, WALL, 1)
    return DrawnMap(pixels, keys())


def racetrack(rng: np.random.Generator, resolution: float, size: int, width_m: float, thick: int) -> DrawnMap:
    """A closed track; its inside is free and closed too."""
    angles = np.linspace(0, 2 * math.pi, 240, endpoint=False)
    radius = size * (0.36 + 0.05 * np.sin(2 * angles) + 0.04 * np.sin(3 * angles + rng.uniform(0, 6)))
    half = width_m / resolution / 2
    pixels = np.full((size, size), FLOOR, np.uint8)
    for offset in (-half, half):
        line = size / 2 + np.stack(
            ((radius + offset) * np.cos(angles), (radius + offset) * np.sin(angles)), axis=1
        )
        cv2.polylines(pixels, [np.rint(line).astype(np.int32)], True, WALL, thick)
    return DrawnMap(pixels, keys(resolution, origin=[-30.0, -12.5, 0.0]))


def warehouse(rng: np.random.Generator, width_m: float, height_m: float, legs: bool) -> DrawnMap:
    """Shelves in rows: legs that beams pass and robots do not, or outlines with floor inside."""
    pixels = box(width_m, height_m, wall=2)
    for y in np.arange(2.5, height_m - 3.0, 3.0):
        for x in np.arange(2.0, width_m - 4.5, 5.0):
            left, top = round(x / 0.05), round(y / 0.05)
            if legs:
                for dx in range(0, 62, 5):
                    pixels[top : top + 2, left + dx : left + dx + 2] = WALL
                    pixels[top + 20 : top + 22, left + dx : left + dx + 2] = WALL
                pixels[top : top + 22, left : left + 2] = pixels[top : top + 22, left + 60 : left + 62] = WALL
            else:
                cv2.rectangle(pixels, (left, top), (left + 60, top + 20), WALL, 1)
    return DrawnMap(pixels, keys())


def cave(rng: np.random.Generator, size: int, resolution: float = 0.05) -> DrawnMap:
    """Floor as a threshold of smooth noise."""
    noise = cv2.GaussianBlur(rng.standard_normal((size, size)), (0, 0), 0.9 / resolution)
    pixels = np.where(noise > -0.25 * noise.std(), FLOOR, WALL).astype(np.uint8)
    pixels[:2] = pixels[-2:] = pixels[:, :2] = pixels[:, -2:] = WALL
    return DrawnMap(pixels, keys(resolution))


def grid_of_metres(rng: np.random.Generator, side: int) -> DrawnMap:
    """Cells of 1 m, a fifth of them wall."""
    pixels = np.where(rng.random((side, side)) < 0.2, WALL, FLOOR).astype(np.uint8)
    pixels[0] = pixels[-1] = pixels[:, 0] = pixels[:, -1] = WALL
    return DrawnMap(pixels, keys(1.0, origin=[0.0, 0.0, 0.0]))


def disconnected(rng: np.random.Generator) -> DrawnMap:
    """Three rooms without a door between them."""
    pixels = box(14.0, 6.0, wall=2)
    for x in (4.0, 9.0 + float(rng.uniform(-1, 1))):
        pixels[:, round(x / 0.05) : round(x / 0.05) + 2] = WALL
    return DrawnMap(pixels, keys())


def in_mode(mode: str, rng: np.random.Generator) -> DrawnMap:
    """A room with greys between free and occupied, read in one of map_server's modes."""
    pixels = office(rng, 12.0, 9.8)
    if mode == "raw":
        pixels = np.where(pixels == WALL, 100, 0).astype(np.uint8)
    else:
        pixels[60:70, 60:80] = 150
    return DrawnMap(pixels, keys(mode=mode))


def corridor_maze(rng: np.random.Generator, corridor_m: float) -> DrawnMap:
    """Corridors so wide between one-pixel walls that leave one end open in turn."""
    pixels = box(10.0, 10.0)
    step = round(corridor_m / 0.05) + 1
    for number, row in enumerate(range(step, 200 - step // 2, step)):
        pixels[row, : 200 - step] = WALL
        if number % 2:
            pixels[row] = WALL
            pixels[row, 1:step] = FLOOR
    return DrawnMap(pixels, keys())


def with_pixels(drawn: DrawnMap, change: Callable[[Pixels], Pixels], **more: object) -> DrawnMap:
    return DrawnMap(np.ascontiguousarray(change(drawn.pixels)), {**drawn.keys, **more})


def willow(rng: np.random.Generator, width_m: float, height_m: float, noise: float, resolution: float = 0.1):
    return DrawnMap(
        in_unknown(noisy(office(rng, width_m, height_m, resolution, 1), rng, noise), 60, rng),
        keys(resolution),
    )


STYLES: dict[str, Callable[[np.random.Generator], DrawnMap]] = {
    "turtlebot3_world": turtlebot3_world,
    "turtlebot3_world_2": turtlebot3_world,
    "turtlebot3_yaw": lambda rng: with_pixels(turtlebot3_world(rng), np.copy, origin=[-10.0, -10.0, 0.5]),
    "office": lambda rng: DrawnMap(office(rng, 20.0, 19.6), keys()),
    "office_one_pixel": lambda rng: DrawnMap(office(rng, 16.0, 9.8, wall=1), keys()),
    "office_fine": lambda rng: DrawnMap(office(rng, 12.0, 9.8, 0.01, 10), keys(0.01)),
    "office_fine_thin": lambda rng: DrawnMap(office(rng, 9.0, 9.8, 0.01, 1), keys(0.01)),
    "office_2_cm": lambda rng: DrawnMap(office(rng, 14.0, 9.8, 0.02, 5), keys(0.02)),
    "office_25_mm": lambda rng: DrawnMap(office(rng, 14.0, 9.8, 0.025, 4), keys(0.025)),
    "office_turned": lambda rng: DrawnMap(office(rng, 14.0, 9.8), keys(origin=[3.0, -2.0, 0.7])),
    "office_quarter_turn": lambda rng: DrawnMap(office(rng, 14.0, 9.8), keys(origin=[0.0, 0.0, 1.5707963])),
    "office_unknown": lambda rng: DrawnMap(in_unknown(office(rng, 14.0, 9.8), 40, rng), keys()),
    "office_negated": lambda rng: with_pixels(
        DrawnMap(office(rng, 14.0, 9.8), keys()), lambda pixels: 255 - pixels, negate=1
    ),
    "willow": lambda rng: willow(rng, 40.0, 29.4, 0.0005),
    "willow_small": lambda rng: willow(rng, 20.0, 19.6, 0.001),
    "willow_large": lambda rng: willow(rng, 60.0, 58.8, 0.0005),
    "willow_noise": lambda rng: willow(rng, 40.0, 39.2, 0.01),
    "scan_noise": lambda rng: DrawnMap(noisy(office(rng, 20.0, 19.6), rng, 0.002), keys()),
    "scan_heavy_noise": lambda rng: DrawnMap(noisy(office(rng, 20.0, 19.6), rng, 0.02), keys()),
    "scan_large": lambda rng: DrawnMap(noisy(office(rng, 50.0, 49.0), rng, 0.0005), keys()),
    "scan_fine": lambda rng: DrawnMap(noisy(office(rng, 12.0, 9.8, 0.02, 4), rng, 0.001), keys(0.02)),
    "static": lambda rng: DrawnMap(
        np.where(rng.random((400, 400)) < 0.3, WALL, FLOOR).astype(np.uint8), keys()
    ),
    "racetrack": lambda rng: racetrack(rng, 0.05, 500, 1.8, 1),
    "racetrack_thick": lambda rng: racetrack(rng, 0.08, 600, 3.0, 4),
    "racetrack_fine": lambda rng: racetrack(rng, 0.02, 900, 1.6, 3),
    "racetrack_100_m": lambda rng: racetrack(rng, 0.05796, 1700, 2.2, 2),
    "racetrack_narrow": lambda rng: racetrack(rng, 0.05, 400, 0.7, 1),
    "racetrack_too_large": lambda rng: racetrack(rng, 0.25, 1000, 10.0, 2),
    "warehouse": lambda rng: warehouse(rng, 20.0, 15.0, False),
    "warehouse_legs": lambda rng: warehouse(rng, 20.0, 15.0, True),
    "warehouse_large": lambda rng: warehouse(rng, 60.0, 40.0, False),
    "warehouse_large_legs": lambda rng: warehouse(rng, 60.0, 40.0, True),
    "cave": lambda rng: cave(rng, 300),
    "cave_large": lambda rng: cave(rng, 800),
    "cave_coarse": lambda rng: cave(rng, 200, 0.2),
    "cave_100_m": lambda rng: cave(rng, 1000, 0.1),
    "metres": lambda rng: grid_of_metres(rng, 12),
    "metres_100": lambda rng: grid_of_metres(rng, 100),
    "metres_empty": lambda rng: DrawnMap(box(30.0, 20.0, 1.0), keys(1.0)),
    "hall_100_m": lambda rng: DrawnMap(box(100.0, 100.0, wall=2), keys()),
    "tiny": lambda rng: DrawnMap(box(1.0, 1.0, 0.1), keys(0.1)),
    "tiny_2_m": lambda rng: DrawnMap(box(2.0, 2.0), keys()),
    "tiny_3_m": lambda rng: DrawnMap(box(3.0, 1.6), keys()),
    "disconnected": disconnected,
    "trinary": lambda rng: in_mode("trinary", rng),
    "scale": lambda rng: in_mode("scale", rng),
    "raw": lambda rng: in_mode("raw", rng),
    "maze": lambda rng: corridor_maze(rng, 1.0),
    "maze_narrow": lambda rng: corridor_maze(rng, 0.6),
    "no_wall": lambda rng: DrawnMap(np.full((100, 100), FLOOR, np.uint8), keys()),
    "no_floor": lambda rng: DrawnMap(np.full((100, 100), UNKNOWN, np.uint8), keys()),
}
REFUSED = {
    "static": "no floor",
    "racetrack_too_large": "198 m a side",
    "tiny": "m wide",
    "no_wall": "no wall",
    "no_floor": "no cell of the map is known",
}
"""of which no arena can be made -> what the line says of it"""


def drawn(name: str) -> DrawnMap:
    """The map of a style."""
    return STYLES[name](np.random.default_rng([49, sorted(STYLES).index(name)]))
