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
    centers = np.array([shape.mean(axis=0) for shape in shapes])
    radii = np.array([np.hypot(*(shape - c).T).max() for shape, c in zip(shapes, centers, strict=True)])
    deepest = 0.0
    for body in bodies:
        near = np.hypot(*(centers - body.mean(axis=0)).T) < radii + 0.14
        for shape in (shapes[k] for k in np.flatnonzero(near) if shapes[k] is not body):
            deepest = max(deepest, _inside(body, shape), _inside(shape, body))
    return deepest


def _inside(points, outline) -> float:
    """Depth of the deepest of ``points`` in a convex counter-clockwise ``outline``."""
    along = np.roll(outline, -1, axis=0) - outline
    along = along / np.hypot(*along.T)[:, None]
    offset = points[:, None, :] - outline[None]
    inward = along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0]
    return float(inward.min(axis=1).max())
