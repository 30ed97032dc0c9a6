"""The causes of errors in simulated trials and in recordings: what each means and needs."""

from functools import partial
from typing import Literal, NamedTuple

UNEXPLAINED = "unexplained"
MISS, FALSE = "miss", "false"
Need = Literal["", "truth", "no truth", "motion"]
TRUTH: Need = "truth"  # the simulator's: what each return hit, and the poses and ranges without their errors
NO_TRUTH: Need = "no truth"
"""of recordings alone, in place of the finer causes that the truth would tell apart"""
MOTION: Need = "motion"  # as ``NO_TRUTH``, and from the whole recording, which shows what stays where it is


class ErrorCause(NamedTuple):
    """One cause."""

    kind: str
    """``MISS``: an intruder in range has no box; ``FALSE``: a box is no intruder's, or not its first"""
    name: str
    meaning: str
    needs: Need = ""  # empty: simulations and recordings both have it


_miss, _false = partial(ErrorCause, MISS), partial(ErrorCause, FALSE)
CAUSES = (
    _miss("occluded_by_wall", "a wall is in front of it", TRUTH),
    _miss("occluded_by_guard", "a guard is in front of it", TRUTH),
    _miss(
        "occluded_outside_window", "an intruder is in front of it, and it is outside the local costmap", TRUTH
    ),
    _miss("occluded", "an intruder is in front of it", TRUTH),
    _miss("between_beams", "no beam goes where it is", TRUTH),
    _miss("beyond_range", "its returns are beyond the obstacle range"),
    _miss("delay", "it came into sight, or moved on, since the last scan", TRUTH),
    _miss("outside_window", "its returns are outside the local costmap"),
    _miss("below_threshold", "no cell at its returns has the cost that counts", TRUTH),
    _miss("outside_prior", "its returns are outside the prior map"),
    _miss("unknown_cells", "the map knows nothing where it is, which counts as a wall", NO_TRUTH),
    _miss("under_prior", "the inflated prior map covers it"),
    _miss("too_few_returns", "its box held fewer returns than min_returns asks for", NO_TRUTH),
    _miss("too_small", "its contour has too few cells, or too few returns"),
    _miss("deflated", "shrinking took its box off the intruder", TRUTH),
    _miss("pose_error", "the guard's pose error shifted its box off the intruder", TRUTH),
    _miss("crop_shift", "cropping shifted its box off the intruder", TRUTH),
    _miss("range_noise", "range noise shifted its box off the intruder", TRUTH),
    _miss("not_detected", "the detector made no box of its returns"),
    _miss("taken_for_ally", "ally removal took its box"),
    _miss("dropped_by_fusion", "fusion replaced its box by one that does not touch it"),
    _miss("merged", "the one box on it belongs to another intruder"),
    _miss("displaced", "its box is farther off than the matching distance", NO_TRUTH),
    _miss(UNEXPLAINED, "none of these", TRUTH),
    _false("intruder_trail", "where an intruder was", TRUTH),
    _false("stale", "where an intruder was at the last scan", TRUTH),
    _false("misplaced_by_pose", "an intruder, off by the guard's pose error", TRUTH),
    _false("misplaced_by_crop", "an intruder, off by the cells that the window is shifted by", TRUTH),
    _false("misplaced_by_noise", "an intruder, off by the noise of the ranges", TRUTH),
    _false("deflated", "an intruder, shrunk until it did not touch it", TRUTH),
    _false(
        "rim",
        "the rim of an intruder that the inflated prior map covers, or that lies beyond that map",
        TRUTH,
    ),
    _false("ally_trail", "where another guard was", TRUTH),
    _false("ally_left", "another guard, not removed", TRUTH),
    _false("ally_left", "a declared ally or another robot, not removed", NO_TRUTH),
    _false("wall_by_pose", "a wall, off by the guard's pose error", TRUTH),
    _false("wall_by_crop", "a wall, off by the cells that the window is shifted by", TRUTH),
    _false("wall_by_noise", "a wall, off by the range's noise", TRUTH),
    _false("wall_by_map", "a wall that the prior map does not have", TRUTH),
    _false("label_gap", "an object whose labels have a gap here", NO_TRUTH),
    _false("ally_late", "a declared ally whose pose is too old to be removed by", NO_TRUTH),
    _false("fragment", "a labelled object, which has a box or is beyond the matching distance", NO_TRUTH),
    _false("ghost", "no object: marks without any return of the last scan, or one return alone", NO_TRUTH),
    _false("unknown_cells", "returns from where the map knows nothing", NO_TRUTH),
    _false("pose_error", "a wall, off by the pose's error: a match to the map puts it back", NO_TRUTH),
    _false("near_wall", "a wall: its returns are within the tolerance of one", NO_TRUTH),
    _false("unmapped", "a stationary object that is not on the map", MOTION),
    _false("unlabelled", "a moving object without a label", MOTION),
    _false("fragment", "a further box on an intruder that has one", TRUTH),
    _false(UNEXPLAINED, "none of these", TRUTH),
)
"""Misses in the order of the stages that returns pass; the last stage that one reached counts."""


def causes_of(kind: str, *needs: Need) -> dict[str, str]:
    """Name -> meaning, in order, of the causes of a kind that need nothing or one of ``needs``."""
    return {one.name: one.meaning for one in CAUSES if one.kind == kind and one.needs in ("", *needs)}


MISS_CAUSES, FALSE_CAUSES = causes_of(MISS, TRUTH), causes_of(FALSE, TRUTH)  # of simulated trials
RECORDED_MISSES, RECORDED_BOXES = (causes_of(kind, NO_TRUTH, MOTION) for kind in (MISS, FALSE))
"""of recordings; without labels, ``RECORDED_BOXES`` says what each box is made of"""
