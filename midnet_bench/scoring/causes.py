"""How often the causes that the paper names for its errors were there, and what it says of the fused list.

Section V.A puts misses down to intruders that hide behind others, and both kinds of error to the LiDAR's
delay. Section IV.C says of the fused list that no two boxes overlap and that the order of the robots does not
matter (item 35). Each is counted here as the paper words it; an error may have several causes or none.
"""

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from midnet_bench.geometry import Box
from midnet_bench.scoring.frame_counts import TruthObject


class Causes(NamedTuple):
    """Counts of one frame, or their sums over frames."""

    fn_hidden: int
    """of fn: no beam of any guard meets the intruder within range at this instant"""
    fn_new: int
    """of fn: the intruder was out of range one frame (0.2 s) before"""
    fp_left: int
    """of fp: where an intruder was one frame before"""
    overlapping: int
    """frames in which two of the fused boxes overlap"""
    reordered: int
    """of the frames looked at so: those with other boxes if the robots come in opposite order"""
    looked_at: int
    """frames in which MIDNet was also given the robots in opposite order"""
    fn_outside_window: int
    """of fn: no part of the intruder lies in the local costmap of any guard"""
    fn_hidden_in_window: int
    """of fn_hidden: those in the local costmap of some guard"""
    fn_new_in_window: int
    """of fn in the local costmap of some guard: out of range, or of every costmap, one frame before"""


NONE = Causes(*[0] * 9)


class CauseCounter:
    """Counts frame by frame; it remembers where the intruders were in the frame before."""

    def __init__(self) -> None:
        """Before the first frame nothing is known of any intruder."""
        self._before: dict[str, tuple[Box, bool, bool]] = {}

    def count(
        self,
        detections: Sequence[Box],
        truths: Sequence[TruthObject],
        touched: Sequence[Sequence[int]],
        in_range: Sequence[bool],
        in_sight: Callable[[], Sequence[bool]],
        in_window: Sequence[bool],
        opposite: Sequence[Box] | None = None,
    ) -> Causes:
        """One frame.

        Args:
            detections: MIDNet's boxes, map frame, metres.
            truths: the intruders at the frame's instant, each under its own name.
            touched: for each detection the truths that it covers some area of, as ``FrameMatch`` has them.
            in_range: for each truth, whether missing it counts.
            in_sight: for each truth, whether a beam meets it; asked only if something was missed.
            in_window: for each truth, whether some part of it lies in some guard's local costmap.
            opposite: MIDNet's boxes if the robots come in opposite order; None in frames that skip this.
        """
        found = {index for indices in touched for index in indices}
        missed = [index for index, counts in enumerate(in_range) if counts and index not in found]
        false = [box for box, indices in zip(detections, touched, strict=True) if not indices]
        before, self._before = (
            self._before,
            {
                truth.name: (truth.box, near, near and inside)
                for truth, near, inside in zip(truths, in_range, in_window, strict=True)
            },
        )
        seen = in_sight() if missed else ()
        known = [index for index in missed if truths[index].name in before]
        old = [box for box, _, _ in before.values()]
        return Causes(
            fn_hidden=sum(not seen[index] for index in missed),
            fn_new=sum(not before[truths[index].name][1] for index in known),
            fp_left=sum(any(box.intersection_area(place) > 0.0 for place in old) for box in false),
            overlapping=int(
                any(
                    one.intersection_area(other) > 0.0 for one, other in itertools.combinations(detections, 2)
                )
            ),
            reordered=int(opposite is not None and sorted(opposite) != sorted(detections)),
            looked_at=int(opposite is not None),
            fn_outside_window=sum(not in_window[index] for index in missed),
            fn_hidden_in_window=sum(in_window[index] and not seen[index] for index in missed),
            fn_new_in_window=sum(in_window[index] and not before[truths[index].name][2] for index in known),
        )


def total_causes(causes: Iterable[Causes]) -> Causes:
    """The sums over frames; of no frames, zeros."""
    frames = list(causes)
    return Causes(*map(sum, zip(*frames, strict=True))) if frames else NONE
