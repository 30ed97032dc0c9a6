"""Words and signs of right and wrong, the same in stills, films, storyboards and the page's player.

A true positive is a green box. A second box on one intruder is a dashed green one. A false positive is a
purple box with a cross in it. A missed intruder has four corners about it, those of the box that is not
there, and a disc with an exclamation mark. One that is out of range, which is no error, has a thin broken
ring. Shape tells them apart without colour.
"""

import math

import numpy as np

from midnet_bench.drawing.scene import Floats, Truth
from midnet_bench.geometry import Point

TRUE_POSITIVE = "true positive"
DUPLICATE = "second box on one intruder"
FALSE_POSITIVE = "false positive"
MISS = "missed intruder, in range"
NO_ERROR = "out of range: no error"

ARM = 0.45
"""of a corner, as a part of half the sign's side"""
DASHES = 10
"""of the ring"""

CORNERS: tuple[Floats, ...] = tuple(
    np.array([(x * (1.0 - ARM), y), (x, y), (x, y * (1.0 - ARM))])
    for x, y in ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
)
"""(3, 2) each, in the square from -1 to 1; the upper left one first"""
RING: tuple[Floats, ...] = tuple(
    np.array(
        [(math.cos(angle), math.sin(angle)) for angle in np.linspace(start, start + math.pi / DASHES, 4)]
    )
    for start in np.linspace(0.0, 2.0 * math.pi, DASHES, endpoint=False)
)
"""(4, 2) each, on the circle of radius 1"""


def place_of(truth: Truth, margin_m: float, least_m: float) -> tuple[Point, Point]:
    """Where the sign about an intruder stands: its middle (x, y) and half its sides, metres, map frame.

    Args:
        truth: the intruder.
        margin_m: between its outline and the sign.
        least_m: no half of a side is shorter.
    """
    corners = np.concatenate(truth.outlines)
    low, high = corners.min(axis=0), corners.max(axis=0)
    half = np.maximum((high - low) / 2.0 + margin_m, least_m)
    x, y = ((low + high) / 2.0).tolist()
    half_x, half_y = half.tolist()
    return (x, y), (half_x, half_y)
