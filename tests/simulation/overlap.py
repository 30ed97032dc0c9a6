"""How deep robots stand in solids and in each other, from contours alone; shares nothing with an engine."""

import math

import numpy as np

from midnet_bench.arena.layout import Layout
from midnet_bench.robots.burger import BURGER

BOXES = ((-0.102, -0.070, 0.038, 0.070), (-0.030, -0.089, 0.030, 0.089))
"""The URDF's two collision boxes from above: x and y of the lower left, then of the upper right corner."""


def deepest_m(layout: Layout, poses) -> float:
    """The deepest that a corner of one contour lies inside another shape, metres; 0 if none does."""
    there = [pose for pose in np.asarray(poses) if np.isfinite(pose).all()]
    bodies = [_to_map(pose, np.array(BURGER.body)) for pose in there]
    deepest = 0.0
    corners = [solid.outline() for solid in layout.solids]
    centers = np.array([outline.mean(axis=0) for outline in corners])
    radii = np.array([math.dist(o[0], c) for o, c in zip(corners, centers, strict=True)])
    for i, pose in enumerate(there):
        near = np.hypot(*(centers - pose[:2]).T) < radii + 0.14
        for outline in (corners[k] for k in np.flatnonzero(near)):
            deepest = max(deepest, _inside_polygon(bodies[i], outline), _inside_boxes(outline, pose))
        for j, other in enumerate(there):
            if i != j and math.dist(pose[:2], other[:2]) < 0.3:
                deepest = max(deepest, _inside_boxes(bodies[j], pose))
    return deepest


def _to_map(pose, points):
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([[c, s], [-s, c]]) + pose[:2]


def _inside_polygon(points, outline) -> float:
    """Depth of the deepest of ``points`` in a convex counter-clockwise ``outline``."""
    along = np.roll(outline, -1, axis=0) - outline
    along = along / np.hypot(*along.T)[:, None]
    offset = points[:, None, :] - outline[None]
    inward = along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0]
    return float(inward.min(axis=1).max())


def _inside_boxes(points, pose) -> float:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    local = (points - pose[:2]) @ np.array([[c, -s], [s, c]])
    depths = [
        np.minimum(
            np.minimum(local[:, 0] - x1, x2 - local[:, 0]), np.minimum(local[:, 1] - y1, y2 - local[:, 1])
        )
        for x1, y1, x2, y2 in BOXES
    ]
    return float(np.max(depths))
