"""The hill climb of scan matching and of map alignment, as in GMapping (``scanmatcher.cpp``, optimize)."""

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from midnet_bench.compiled import njit, numba
from midnet_bench.elementary import cos_sin
from midnet_bench.geometry import Pose2D

ArgsT = TypeVar("ArgsT")
ClimbT = TypeVar("ClimbT", bound=Callable[..., object])
Score = Callable[[ArgsT, Pose2D, float], float]
"""The score of a pose, or anything up to the third argument if it cannot get above that."""

_MOVES = ((1, 0, 0), (-1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1))


def _inlined(function: ClimbT) -> ClimbT:
    """``function`` as it is for Python; compiled loops take it in with the loop that they give it to call."""
    inlined: ClimbT = numba().extending.register_jitable(inline="always")(function)
    return inlined


@_inlined
def hill_climb(
    score: Score[ArgsT], args: ArgsT, start: Pose2D, linear_step: float, angular_step: float, halvings: int
) -> tuple[Pose2D, float]:
    """The best pose that a hill climb from ``start`` finds, and its score; ``score`` gets ``args`` first.

    Each round tries a step forth and back in x, y (any unit of length) and yaw (radians) and takes the best
    of the six if it beats the present score. A round that finds nothing halves both steps, ``halvings`` times
    at most.
    """
    pose, best = start, score(args, start, -math.inf)
    while True:
        round_pose, round_best = pose, best
        for dx, dy, turn in _MOVES:
            tried = Pose2D(
                pose.x + dx * linear_step, pose.y + dy * linear_step, pose.yaw + turn * angular_step
            )
            found = score(args, tried, round_best)
            if found > round_best:
                round_pose, round_best = tried, found
        if round_best > best:
            pose, best = round_pose, round_best
        elif halvings > 0:
            halvings -= 1
            linear_step *= 0.5
            angular_step *= 0.5
        else:
            return pose, best


@njit
def rotate(points: npt.NDArray[np.float64], yaw: float, rotated: npt.NDArray[np.float64]) -> None:
    """Fill ``rotated`` (B, 2) with the points (B, 2) turned by ``yaw``, radians."""
    cos, sin = cos_sin(yaw)
    for b in range(points.shape[0]):
        rotated[b, 0] = cos * points[b, 0] - sin * points[b, 1]
        rotated[b, 1] = sin * points[b, 0] + cos * points[b, 1]
