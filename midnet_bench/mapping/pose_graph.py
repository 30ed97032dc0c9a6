"""A graph of poses and of what was measured between them, and the poses that fit all of it best."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from midnet_bench.elementary import directions
from midnet_bench.geometry import Pose2D

Floats = npt.NDArray[np.float64]

DOUBT = 25.0  # chi squared at which a doubted edge counts half
_CONVERGED = 1e-4  # metres and radians that a step moves a pose at most when the poses count as settled


class PoseGraph:
    """Nodes are planar poses, an edge is the pose of one node seen from another with its information matrix.

    The first node stays where it is.
    """

    def __init__(self) -> None:
        self.poses: Floats = np.empty((0, 3))
        """(N, 3) x, y (metres), yaw (radians)"""
        self._from: list[int] = []
        self._to: list[int] = []
        self._measured: list[Pose2D] = []
        self._information: list[Floats] = []
        self._doubted: list[bool] = []

    def pose(self, node: int) -> Pose2D:
        """Where a node lies now."""
        x, y, yaw = self.poses[node]
        return Pose2D(float(x), float(y), float(yaw))

    def add_node(self, pose: Pose2D) -> None:
        """A further node."""
        self.poses = np.vstack([self.poses, pose])

    def add_edge(self, a: int, b: int, measured: Pose2D, information: Floats, doubted: bool = False) -> None:
        """Node ``b`` was seen from ``a`` at ``measured``; (3, 3) information in 1/m^2, 1/m and 1.

        A doubted edge that disagrees with the others loses weight.
        """
        self._from.append(a)
        self._to.append(b)
        self._measured.append(measured)
        self._information.append(information)
        self._doubted.append(doubted)

    def optimize(self, rounds: int, doubting: bool = True) -> None:
        """Move the nodes to the least sum of squared, weighed disagreements (Gauss-Newton).

        Args:
            rounds: after which it ends; sooner when no pose moves any more.
            doubting: whether doubted edges weigh as Cauchy's loss lets them, or like all others.
        """
        if not self._from:
            return
        a, b = np.array(self._from), np.array(self._to)
        measured, information = np.array(self._measured), np.array(self._information)
        doubted = np.array(self._doubted) & doubting
        for _ in range(rounds):
            error, by_a, by_b = _disagreement(self.poses[a], self.poses[b], measured)
            chi_squared = (error * _times(information, error)).sum(axis=1)
            weight = np.where(doubted, 1.0 / (1.0 + chi_squared / DOUBT), 1.0)
            step = _gauss_newton(
                len(self.poses), ((a, by_a), (b, by_b)), error, weight[:, None, None] * information
            )
            self.poses[1:] += step
            if np.abs(step).max() < _CONVERGED:
                break


_ROWS, _COLUMNS = np.arange(3)[:, None], np.arange(3)[None, :]


def _gauss_newton(
    nodes: int, ends: Sequence[tuple[npt.NDArray[np.int64], Floats]], error: Floats, information: Floats
) -> Floats:
    """(N - 1, 3) how far to move the nodes after the first.

    Args:
        nodes: N.
        ends: of the edges, (E,) node numbers and (E, 3, 3) derivatives of the error by that node.
        error: (E, 3).
        information: (E, 3, 3).
    """
    gradient = np.zeros((nodes, 3))
    rows, columns, values = [], [], []
    for one, by_one in ends:
        weighed = _product(np.transpose(by_one, (0, 2, 1)), information)
        np.add.at(gradient, one, _times(weighed, error))
        for other, by_other in ends:
            block = _product(weighed, by_other)
            rows.append(np.broadcast_to(3 * one[:, None, None] + _ROWS, block.shape).ravel())
            columns.append(np.broadcast_to(3 * other[:, None, None] + _COLUMNS, block.shape).ravel())
            values.append(block.ravel())
    places = (np.concatenate(rows), np.concatenate(columns))
    normal = coo_matrix((np.concatenate(values), places), (3 * nodes, 3 * nodes)).tocsc()[3:, 3:]
    solver = splu(normal, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    step: Floats = solver.solve(-gradient.ravel()[3:]).reshape(-1, 3)
    return step


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
    error = np.stack(
        [x - measured[:, 0], y - measured[:, 1], (turn + math.pi) % (2.0 * math.pi) - math.pi], axis=1
    )
    zero, one = np.zeros(len(a)), np.ones(len(a))
    by_a = np.stack([-cos, -sin, y, sin, -cos, -x, zero, zero, -one], axis=1).reshape(-1, 3, 3)
    by_b = np.stack([cos, sin, zero, -sin, cos, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    return error, by_a, by_b
