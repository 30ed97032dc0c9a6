"""GOSPA, a distance between boxes and intruders that charges for misses, false boxes and misplaced ones.

Rahmathullah, Garcia-Fernandez and Svensson, "Generalized optimal sub-pattern assignment metric" (2017), with
p = 1 and alpha = 2, so that a frame's value is a sum in metres: the distances of the pairs, and half the
cut-off for each intruder and each box without a partner. It cannot be made better by leaving boxes unfused.
"""

import math
from collections.abc import Sequence

import numpy as np

CUTOFF_M = 1.0
"""A box farther than this from an intruder is no partner for it; a miss or a false box costs half of it."""


def gospa(
    boxes: Sequence[tuple[float, float]],
    intruders: Sequence[tuple[float, float]],
    in_range: Sequence[bool],
    cutoff_m: float = CUTOFF_M,
) -> float:
    """GOSPA of one frame, metres; 0 where every intruder in range has its box and there is no other.

    Args:
        boxes: (x, y) of the centres of the detections, map frame, metres.
        intruders: (x, y) of the centres of the intruders.
        in_range: for each intruder, whether missing it counts. One out of range may have a partner, which
            costs their distance, and costs nothing without (item 47).
        cutoff_m: c of the metric.
    """
    alone = 0.5 * cutoff_m * (len(boxes) + sum(in_range))
    if not boxes or not intruders:
        return alone
    from scipy.optimize import linear_sum_assignment  # not needed by who makes tables of the counts

    # what a pair costs beside both of them alone; worse than alone is no pair
    change = np.array(
        [
            [
                min(0.0, math.dist(box, intruder) - 0.5 * cutoff_m * (1 + counts))
                for intruder, counts in zip(intruders, in_range, strict=True)
            ]
            for box in boxes
        ]
    )
    rows, columns = linear_sum_assignment(change)
    return alone + float(change[rows, columns].sum())
