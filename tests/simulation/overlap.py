"""How deep robots stand in solids and in each other, from contours alone; shares nothing with an engine."""

import numpy as np

from midnet_bench.arena.layout import Layout
from midnet_bench.geometry import Pose2D
from midnet_bench.robots.turtlebot3 import BURGER

HULL = np.array([(x, y) for x, y in BURGER.body if (abs(x), abs(y)) != (0.030, 0.070)])
"""a Burger without the two corners on each side that its convex hull leaves out"""


def deepest_m(layout: Layout, poses) -> float:
    """The deepest that a corner of one contour lies inside another shape, metres; 0 if none does."""
    bodies = [Pose2D(*pose).transform(HULL) for pose in np.asarray(poses).tolist() if np.isfinite(pose).all()]
    shapes = [solid.outline for solid in layout.solids] + bodies
    low, high = np.array([(shape.min(axis=0), shape.max(axis=0)) for shape in shapes]).transpose(1, 0, 2)
    deepest = 0.0
    for own in range(len(shapes) - len(bodies), len(shapes)):
        near = ((low < high[own]) & (low[own] < high)).all(axis=1)
        for other in np.flatnonzero(near[:own]):
            one, two = shapes[own], shapes[other]
            deepest = max(deepest, _inside(one, two), _inside(two, one))
    return deepest


def _inside(points, outline) -> float:
    """Depth of the deepest of ``points`` in a convex counter-clockwise ``outline``."""
    along = np.roll(outline, -1, axis=0) - outline
    along = along / np.hypot(*along.T)[:, None]
    offset = points[:, None, :] - outline[None]
    inward = along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0]
    return float(inward.min(axis=1).max())
