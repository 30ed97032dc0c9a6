"""The colours and words of every picture: Okabe and Ito's colours, for colour-blind readers, on wood."""

import functools

RGB = tuple[int, int, int]

WHITE: RGB = (255, 255, 255)
FLOOR: RGB = (250, 249, 246)
GROUND: RGB = (226, 226, 226)  # outside the walls
WOOD: RGB = (190, 154, 112)
WOOD_EDGE: RGB = (110, 80, 50)
INK: RGB = (30, 30, 30)
FAINT_INK: RGB = (130, 130, 130)

GUARD: RGB = (0, 114, 178)
GUARD_FAINT: RGB = (86, 180, 233)
GUARD_RANGE: RGB = (160, 208, 238)  # paler still: the usable range of LiDARs, which overlap
INTRUDER: RGB = (213, 94, 0)
INTRUDER_FAINT: RGB = (244, 190, 150)  # stationary intruders
DETECTION: RGB = (0, 158, 115)
FALSE_DETECTION: RGB = (170, 40, 130)  # Okabe and Ito's purple, darker, so that thin lines are seen on white
MISSED: RGB = (0, 0, 0)  # the sign about an intruder in range that no detection touches
OUT_OF_RANGE: RGB = FAINT_INK  # the sign about an intruder out of range: no error

EXPLORERS: tuple[RGB, ...] = (GUARD, (230, 159, 0), DETECTION, FALSE_DETECTION, GUARD_FAINT)
"""the first robot that maps, the second and so on, then from the first again"""
TRUTH: RGB = INTRUDER  # true walls, thin over a map

TRUE_POSITIVE = "true positive"
DUPLICATE = "second box on one intruder"
FALSE_POSITIVE = "false positive"
MISS = "missed intruder, in range"
NO_ERROR = "out of range: no error"


@functools.cache
def hexadecimal(color: RGB) -> str:
    """``#rrggbb``, as matplotlib takes it."""
    return "#{:02x}{:02x}{:02x}".format(*color)
