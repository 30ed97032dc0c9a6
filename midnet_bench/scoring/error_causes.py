"""The causes of errors by name, and what each means."""

UNEXPLAINED = "unexplained"

MISS_CAUSES = {
    "occluded_by_wall": "a wall is in front of it",
    "occluded_by_guard": "a guard is in front of it",
    "occluded_outside_window": "an intruder is in front of it, and it is outside the local costmap",
    "occluded": "an intruder is in front of it",
    "between_beams": "no beam goes where it is",
    "beyond_range": "its returns are beyond the obstacle range",
    "delay": "it came into sight, or moved on, since the last scan",
    "outside_window": "its returns are outside the local costmap",
    "below_threshold": "no cell at its returns has the cost that counts",
    "outside_prior": "its returns are outside the prior map",
    "under_prior": "the inflated prior map covers it",
    "too_small": "its contour has too few cells, or too few returns",
    "deflated": "shrinking took its box off the intruder",
    "pose_error": "the guard's pose error shifted its box off the intruder",
    "crop_shift": "cropping shifted its box off the intruder",
    "range_noise": "range noise shifted its box off the intruder",
    "not_detected": "the detector made no box of its returns",
    "taken_for_ally": "ally removal took its box",
    "dropped_by_fusion": "fusion replaced its box by one that does not touch it",
    "merged": "the one box on it belongs to another intruder",
    UNEXPLAINED: "none of these",
}
"""Why an intruder in range has no box of its own: the stages of the loss funnel in their order."""

FALSE_CAUSES = {
    "intruder_trail": "where an intruder was",
    "stale": "where an intruder was at the last scan",
    "misplaced_by_pose": "an intruder, off by the guard's pose error",
    "misplaced_by_crop": "an intruder, off by the cells that the window is shifted by",
    "misplaced_by_noise": "an intruder, off by the noise of the ranges",
    "deflated": "an intruder, shrunk until it did not touch it",
    "rim": "the rim of an intruder that the inflated prior map covers, or that lies beyond that map",
    "ally_trail": "where another guard was",
    "ally_left": "another guard, not removed",
    "wall_by_pose": "a wall, off by the guard's pose error",
    "wall_by_crop": "a wall, off by the cells that the window is shifted by",
    "wall_by_noise": "a wall, off by the range's noise",
    "wall_by_map": "a wall that the prior map does not have",
    "fragment": "a further box on an intruder that has one",
    UNEXPLAINED: "none of these",
}
"""What a box is made of that is no intruder's, or not its first."""

REMOVED_BY = {
    "pose": ("pose_error", "misplaced_by_pose", "wall_by_pose"),
    "crop": ("crop_shift", "misplaced_by_crop", "wall_by_crop"),
    "noise": ("range_noise", "misplaced_by_noise", "wall_by_noise", "beyond_range"),
    "map": ("wall_by_map",),
    "delay": ("delay", "stale"),
    "window": ("outside_window",),
    "marks": ("intruder_trail", "ally_trail"),
    "allies": ("taken_for_ally", "ally_left", "ally_trail"),
    "occlusion": ("occluded",),
    "sight": ("occluded_outside_window",),
    "fusion": ("merged", "dropped_by_fusion", "fragment"),
}
"""oracle -> the causes that it takes away"""
