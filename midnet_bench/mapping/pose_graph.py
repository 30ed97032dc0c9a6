"""A graph of poses and of what was measured between them, and the poses that fit all of it best."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from midnet_bench.elementary import directions
from midnet_bench.geometry import Pose2D

Floats = npt.NDArray[np.float64]

DOUBT = 25.0  # chi squared at which a doubted edge counts half
_CONVERGED = 1e-4  # metres and radians that a step moves a pose at most when the poses count as settled


class Edge(NamedTuple):
    """Node ``b`` was seen from ``a``; an edge that is doubted loses weight where it disagrees."""

    a: int
    b: int
    measured: Pose2D  # of b in the frame of a
    information: Floats  # (3, 3) in 1/m^2, 1/m and 1
    is_doubted: bool = False


class PoseGraph:
    """Nodes are planar poses, of which the first stays where it is; edges are measurements between them."""

    def __init__(self) -> None:
        self.poses: Floats = np.empty((0, 3))  # (N, 3) x, y (metres), yaw (radians)
        self.edges: list[Edge] = []

    def pose(self, node: int) -> Pose2D:
        """Where a node lies now; -1 is the last one."""
        return Pose2D(*self.poses[node].tolist())

    def add_node(self, pose: Pose2D) -> None:
        """A further node."""
        self.poses = np.vstack([self.poses, pose])

    def optimize(self, rounds: int, doubting: bool = True) -> None:
        """Move the nodes to the least sum of squared, weighed disagreements (Gauss-Newton).

        It ends after ``rounds``, or sooner when no pose moves any more. With ``doubting`` doubted edges
        weigh as Cauchy's loss lets them, else like all others.
        """
        if not self.edges:
            return
        a, b, measured, information, is_doubted = map(np.array, zip(*self.edges, strict=True))
        for _ in range(rounds):
            error, by_a, by_b = _disagreement(self.poses[a], self.poses[b], measured)
            chi_squared = (error * _times(information, error)).sum(axis=1)
            weight = np.where(is_doubted & doubting, 1.0 / (1.0 + chi_squared / DOUBT), 1.0)
            weighed = weight[:, None, None] * information
            gradient, rows, columns, values = np.zeros(self.poses.shape), [], [], []
            for one, by_one in ((a, by_a), (b, by_b)):
                pull = _product(np.transpose(by_one, (0, 2, 1)), weighed)
                np.add.at(gradient, one, _times(pull, error))
                for other, by_other in ((a, by_a), (b, by_b)):
                    block = _product(pull, by_other)
                    rows.append(np.broadcast_to(3 * one[:, None, None] + _ROWS, block.shape).ravel())
                    columns.append(np.broadcast_to(3 * other[:, None, None] + _ROWS.T, block.shape).ravel())
                    values.append(block.ravel())
            places = (np.concatenate(rows), np.concatenate(columns))
            shape = (gradient.size, gradient.size)
            normal = coo_matrix((np.concatenate(values), places), shape).tocsc()[3:, 3:]
            solver = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            step = solver.solve(-gradient.ravel()[3:]).reshape(-1, 3)
            self.poses[1:] += step
            if np.abs(step).max() < _CONVERGED:
                break


_ROWS = np.arange(3)[:, None]


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return (matrices * vectors[:, None, :]).sum(axis=2)


def _product(first: Floats, second: Floats) -> Floats:
    return (first[:, :, :, None] * second[:, None, :, :]).sum(axis=2)


def _disagreement(a: Floats, b: Floats, measured: Floats) -> tuple[Floats, Floats, Floats]:
    """(E, 3) pose of b seen from a, less the measured one, and its (E, 3, 3) derivatives by a and b."""
    cos, sin = directions(a[:, 2]).T
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    turn = b[:, 2] - a[:, 2] - measured[:, 2]
    turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
    error = np.stack([x - measured[:, 0], y - measured[:, 1], turn], axis=1)
    zero, one = np.zeros(len(a)), np.ones(len(a))
    by_a = np.stack([-cos, -sin, y, sin, -cos, -x, zero, zero, -one], axis=1).reshape(-1, 3, 3)
    by_b = np.stack([cos, sin, zero, -sin, cos, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    return error, by_a, by_b
