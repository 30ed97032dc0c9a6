"""What never moves, as PyBullet holds it: the floor, and all walls and stationary intruders as one mesh."""

import numpy as np

from midnet_bench.arena.solids import Solid
from midnet_bench.simulation.bullet.body import FLOOR, RAY, ROBOT, ROLLER, STATIC
from midnet_bench.simulation.bullet.client import bullet

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


def add_obstacle(client: int, solid: Solid) -> int:
    """The body id of something that robots run into and beams do not see; :func:`move_obstacle` moves it."""
    if solid.kind == "cylinder":
        shape = bullet.createCollisionShape(
            bullet.GEOM_CYLINDER,
            radius=solid.length_m / 2.0,
            height=solid.height_m,
            physicsClientId=client,
        )
    else:
        half = [solid.length_m / 2.0, solid.width_m / 2.0, solid.height_m / 2.0]
        shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, physicsClientId=client)
    body = _add_static(client, shape, ROBOT, ROBOT)
    move_obstacle(client, body, solid)
    return body


def move_obstacle(client: int, body: int, solid: Solid) -> None:
    """Put an obstacle where ``solid`` is now."""
    turn = bullet.getQuaternionFromEuler([0.0, 0.0, solid.pose.yaw])
    at = [solid.pose.x, solid.pose.y, solid.height_m / 2.0]
    bullet.resetBasePositionAndOrientation(body, at, turn, physicsClientId=client)


def _add_static(client: int, shape: int, group: int, mask: int) -> int:
    body = bullet.createMultiBody(0.0, shape, physicsClientId=client)
    bullet.setCollisionFilterGroupMask(body, -1, group, mask, physicsClientId=client)
    bullet.changeDynamics(
        body, -1, lateralFriction=1.0, contactProcessingThreshold=0.0, physicsClientId=client
    )
    return int(body)
