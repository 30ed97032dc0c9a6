"""``CentreDistance``: robots' boxes whose centres are near each other are one, by the Hungarian method."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from midnet_bench.geometry import lengths
from midnet_bench.midnet.detection import BoxArray


class CentreDistance:
    """Robot after robot: pairs within ``gap_m`` that are nearest in sum become their mean, the rest stays.

    The order of the robots matters here.
    """

    def __init__(self, gap_m: float = 0.3) -> None:
        self._gap_m = gap_m

    def fuse(self, found: Sequence[BoxArray], time_s: float) -> BoxArray:
        """One box for each thing, whatever the time is."""
        team, weights = np.empty((0, 4)), np.empty(0)
        for own in found:
            gaps = lengths(_centres(team)[:, None] - _centres(own)[None])
            # a pair within reach is worth more than all distances together, so most pairs come first
            worth = np.where(gaps <= self._gap_m, self._gap_m * (1 + min(gaps.shape)) - gaps, 0.0)
            rows, columns = linear_sum_assignment(worth, maximize=True)
            near = worth[rows, columns] > 0.0
            rows, columns = rows[near], columns[near]
            share = weights[rows, None]
            team[rows] = (team[rows] * share + own[columns]) / (share + 1.0)
            weights[rows] += 1.0
            alone = np.setdiff1d(np.arange(len(own)), columns)
            team = np.concatenate((team, own[alone]))
            weights = np.concatenate((weights, np.ones(len(alone))))
        return team


def _centres(boxes: BoxArray) -> BoxArray:
    return (boxes[:, :2] + boxes[:, 2:]) / 2.0
