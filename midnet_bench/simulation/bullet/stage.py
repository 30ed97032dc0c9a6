"""What never moves, as PyBullet holds it: the floor, and all walls and stationary intruders as one mesh."""

import numpy as np

from midnet_bench.arena.solids import Solid
from midnet_bench.simulation.bullet.body import FLOOR, RAY, ROBOT, ROLLER, STATIC
from midnet_bench.simulation.bullet.engine import bullet

_BELOW_FLOOR_M = 0.05


def add_floor(client: int) -> int:
    """The body id of an endless floor that robots stand on and beams do not see."""
    shape = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=client)
    return _add_static(client, shape, FLOOR, ROBOT | ROLLER)


def add_solids(client: int, solids: tuple[Solid, ...]) -> int:
    """The body id of one triangle mesh of all ``solids``, which beams see and robots run into.

    Sides only: nothing reaches a top. The mesh is passed inline, because PyBullet remembers files by name.
    """
    vertices: list[list[float]] = []
    triangles: list[int] = []
    for solid in solids:
        outline = solid.outline()
        count, first = len(outline), len(vertices)
        for height in (-_BELOW_FLOOR_M, solid.height_m):
            vertices += np.column_stack((outline, np.full(count, height))).tolist()
        for corner in range(count):
            low, low_next = first + corner, first + (corner + 1) % count
            triangles += [low, low_next, low_next + count, low, low_next + count, low + count]
    shape = bullet.createCollisionShape(
        bullet.GEOM_MESH,
        vertices=vertices,
        indices=triangles,
        flags=bullet.GEOM_FORCE_CONCAVE_TRIMESH,
        physicsClientId=client,
    )
    return _add_static(client, shape, STATIC, RAY | ROBOT)


def _add_static(client: int, shape: int, group: int, mask: int) -> int:
    body = bullet.createMultiBody(0.0, shape, physicsClientId=client)
    bullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=client)
    bullet.changeDynamics(
        body, -1, lateralFriction=1.0, contactProcessingThreshold=0.0, physicsClientId=client
    )
    return int(body)
