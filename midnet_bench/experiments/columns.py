"""The columns of each experiment's tables: meaning, unit, range, and how far another platform may lie off.

A trial's tables are held to them when it ends and when a store or a CSV file is read. ``docs/results.md`` and
the bounds of ``compare --exact`` are made of them. Where a factor of a grid has the name of a column, files
have the column as ``trial_NAME``.
"""

from dataclasses import replace
from functools import partial

from midnet_bench.campaign.trial import ANY_DRIFT, LARGEST, Column, Columns, Drift, Tables
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES

LONGEST_RECORD = 20_000  # characters of what is kept of one frame in one column
FEW, LENGTH, FIFTH, TENTH, ONE = Drift(20.0, 0.5), Drift(0.0, 0.3), Drift(0.0, 0.2), Drift(0.1), Drift(1.0)
"""physics in floating point parts ways between processors, and after a minute robots are elsewhere"""


_count = partial(Column, int)
_event = partial(Column, int, drift=ANY_DRIFT)  # a count that differs between platforms
_share = partial(Column, float, most=1.0, may_be_empty=True)
_metres = partial(Column, float, unit="m")
_coordinate = partial(Column, float, unit="m", least=-LARGEST)
_seconds = partial(Column, float, unit="s")
_packed = partial(Column, str, longest=LONGEST_RECORD)

FRAME = Column(int, "counted from 1", least=1)
COUNTS = {  # as ``scoring.frame_counts.FrameCounts`` has them
    "tp": _count(
        "boxes that overlap some intruder; with `tp_boxes=one_per_intruder` or `surplus_false` one box for "
        "each, `matched`",
        drift=FIFTH,
    ),
    "fp": _count("boxes that overlap none; with `tp_boxes=surplus_false` the `duplicates` too", drift=FEW),
    "fn": _count("intruders in range that no box overlaps", drift=FEW),
    "intruders_in_range": _count("intruders within the usable range of some guard", drift=FIFTH),
    "matched": _count("one-to-one matching: pairs of an intruder and a box", drift=FIFTH),
    "duplicates": _count(
        "one-to-one matching: further boxes on intruders that have theirs; `matched + duplicates` is `tp` "
        "by default",
        drift=FEW,
    ),
    "missed": _count("one-to-one matching: intruders in range without a box", drift=FEW),
    "error_sum_m": _metres(
        "distance from box centre to intruder centre, summed over the pairs", drift=LENGTH
    ),
    "gospa_m": _metres(
        "GOSPA: distances of pairs, and 0.5 m for each miss and each false or further box "
        "(`docs/metrics.md`)",
        drift=FEW,
    ),
}
CAUSES = {  # as ``scoring.frame_counts.Causes`` has them
    "fn_hidden": _event(
        "of `fn`: no beam of any guard meets the intruder within range at the frame's instant"
    ),
    "fn_new": _event("of `fn`: the intruder was out of range one frame (0.2 s) before"),
    "fp_left": _event("of `fp`: the box lies where an intruder was one frame before"),
    "overlapping": _event("frames in which two fused boxes overlap"),
    "reordered": _event("frames of `looked_at` with other boxes if the robots come in opposite order"),
    "looked_at": _count("each tenth frame, teams only"),
    "fn_outside_window": _event("of `fn`: no part of the intruder lies in the local costmap of any guard"),
    "fn_hidden_in_window": _event("of `fn_hidden`: those in the local costmap of some guard"),
    "fn_new_in_window": _event(
        "of `fn` in the local costmap of some guard: out of range, or of every costmap, one frame before"
    ),
}
PATROL = {
    "patrol_relaxations": _event(
        "how often the least distance between patrol goals (Eq. 12) was shrunk by a tenth because no point "
        "kept it"
    )
}

SCORES = Columns(
    {
        "frames": Column(int, "how many", least=1, is_parameter=True),
        **COUNTS,
        "precision": _share("Eq. 8 of the sums", drift=TENTH),
        "recall": _share("Eq. 9 of the sums", drift=TENTH),
        "f1": _share("Eq. 10 of the sums", drift=TENTH),
        **CAUSES,
        **PATROL,
    },
    "One row per trial: the columns of `frames` summed over its frames, their ratios, and what the misses "
    "come from.",
    one_row=True,
)
EXPLORERS = Columns(
    {
        "robot": Column(str, "its name, such as `guard 1`"),
        "distance_m": _metres("path length driven", drift=Drift(1.0, 0.3)),
        "goals_reached": _event("how many"),
        "goals_given_up": _event("how many"),
        "stuck_s": _seconds("time without progress towards its goal", drift=ANY_DRIFT),
        "collisions": _event("contacts with walls, intruders or robots that began"),
        "walls_crossed": _count(
            "walls that its centre went through; anything but 0 is a failure of the physics"
        ),
        "recoveries": _event("recovery behaviours of its navigator"),
        "pose_error_m": _metres(
            "distance between believed and true position at the end; empty for a robot that has left",
            drift=TENTH,
            may_be_empty=True,
        ),
    },
    "One row per trial and robot.",
)
ROBOTS = Columns(
    {**EXPLORERS.columns, "role": Column(str, "not in mapping", choices=("guard", "intruder"))},
    EXPLORERS.about,
)

METRICS = Columns(
    {
        "metric": Column(str, "the value's name, such as `ospa_m`"),
        "value": Column(
            float, "its mean over the trial's frames, or what it is for the whole trial", least=-LARGEST
        ),
    },
    "One row per trial and value of a further metric; only with `metrics` "
    "([howto/metric.md](howto/metric.md)).",
    optional=True,
)


RECORDED = Columns(  # as ``guarded.record.RecordedFrame`` has them
    {
        "frame": FRAME,
        "poses": _packed(
            "for each row of `robots`: true x, y, yaw, believed x, y, yaw, and x, y of its goal if it has "
            "one, then 1 if it pursues that; null for one that is gone"
        ),
        "truths": _packed(
            "of each intruder: name, box, whether missing it counts, index of the detection paired with it"
        ),
        "found": _packed(
            "of each box before fusion: index of the guard, box, index of the ally that it was removed for"
        ),
        "detections": _packed(
            "of each box of the team: index of the guard, box, index of the intruder paired with it"
        ),
        "scans": _packed(
            "of each guard in base64: a byte for each fourth beam, centimetres, 255 where nothing came back "
            "within 2.54 m; after `@` x, y, yaw of the LiDAR as the guard believed it then"
        ),
    },
    "One row per trial and frame, only with `record`: the trial as the player shows it. "
    "`RecordedFrame.from_row` of `midnet_bench/experiments/guarded/record.py` reads one. Lists are JSON; "
    "lengths are millimetres, angles milliradians, map frame.",
    optional=True,
)


ERRORS = Columns(  # as ``guarded.recorder.Recorder`` has them
    {
        "frame": FRAME,
        "kind": Column(
            str,
            "`false`: a box on no intruder; `fragment`: a further box on one that has its own",
            choices=("miss", "false", "fragment"),
        ),
        "cause": Column(str, "why ([errors.md](errors.md))", choices=tuple({**MISS_CAUSES, **FALSE_CAUSES})),
        "guard": _count("number of the guard at which it came about, 0 for none"),
        "intruder": Column(str, "of a miss, its name"),
        "by": Column(str, "another that had a part: what stands before the intruder, whose trail it is"),
        "age_s": _seconds("since the newest return that has a part"),
        "offset_m": _metres("the error of position that did it, or how far an intruder has moved"),
        "x_min_m": _coordinate("of the box, or of the missed intruder's true one"),
        **dict.fromkeys(("y_min_m", "x_max_m", "y_max_m"), _coordinate("likewise")),
        "paper": Column(bool, "whether the paper's counts, `tp_boxes=every`, have it too, as `fn` or `fp`"),
    },
    "One row per trial and error, only with `record`: intruders in range without a box, boxes without an "
    "intruder, by one-to-one matching.",
    optional=True,
)

DETECTION: Tables = {
    "scores": SCORES,
    "frames": Columns({"frame": FRAME, **COUNTS}, "One row per trial and frame (0.2 s)."),
    "robots": ROBOTS,
    "metrics": METRICS,
    "recorded": RECORDED,
    "errors": ERRORS,
}
LABYRINTH: Tables = {
    "trial": Columns(
        {
            "caught": Column(int, "how many intruders", at_most="detected", drift=ONE),
            "detected": Column(int, "how many intruders", at_most="intruders", drift=ONE),
            "escaped": Column(int, "how many intruders", at_most="intruders", drift=ONE),
            "success_rate": Column(
                float, "Eq. 11: share of the intruders that were caught", "%", most=100.0, drift=Drift(50.0)
            ),
            "duration_s": _seconds("simulated", drift=ANY_DRIFT),
            "ended": Column(str, "`nobody left`, or `time limit`", drift=ANY_DRIFT),
            **PATROL,
            "targets": _event("tracks of boxes that guards could pursue, 0 under `pursuit=oracle`"),
            "ghost_targets": _event("of these, tracks whose first box was on no intruder"),
            "false_target_s": replace(
                _seconds(
                    "time that guards pursued those of `ghost_targets`, summed over the guards",
                    drift=ANY_DRIFT,
                ),
                may_be_missing=True,
            ),
        },
        "One row per trial.",
        one_row=True,
    ),
    "intruders": Columns(
        {
            "intruder": _count("counted from 1"),
            "outcome": Column(
                str,
                "`at large` when the time was up",
                choices=("caught", "escaped", "at large"),
                drift=ANY_DRIFT,
            ),
            **{
                f"{what}_at_s": _seconds(about, drift=ANY_DRIFT, may_be_empty=True)
                for what, about in {
                    "detected": "since the start of the trial; empty if it did not happen",
                    "caught": "likewise",
                    "escaped": "likewise",
                    "left": "when it was caught or escaped; empty if it was there to the end",
                }.items()
            },
            "straight_m": _metres("straight line from its start to its way out", drift=Drift(1e-6)),
        },
        "One row per trial and intruder.",
    ),
    "captures": Columns(
        {"intruder": _count("counted from 1"), "guard": _event("number of the guard that caught it")},
        "One row per trial and caught intruder, only with `record`.",
        optional=True,
    ),
    "robots": ROBOTS,
    "metrics": METRICS,
    "recorded": RECORDED,
}
MAPPING: Tables = {
    "maps": Columns(
        {
            "coverage": _share(
                "of the free cells within a robot's reach, known in the map", may_be_empty=False
            ),
            "occupied_precision": _share("of the map's occupied cells, with a true one within one cell"),
            "occupied_recall": _share(
                "of the true occupied cells that face reachable space, with one of the map's within one cell"
            ),
            "wall_error_m": _metres(
                "mean distance from the map's occupied cells to the nearest true one", may_be_empty=True
            ),
            "time_s": _seconds("simulated"),
            "distance_m": _metres("driven by all robots together"),
            "finished": Column(
                bool,
                "whether no frontier and no gap was left before the time limit but those that were given up",
            ),
            "merge_confidence": Column(
                float,
                "of merging by features: the worst merged pair, or the best refused one; empty where starts "
                "are known",
                may_be_empty=True,
            ),
        },
        "One row per trial.",
        one_row=True,
    ),
    "gaps": Columns(
        {
            "length_m": _metres("of the free cells' border on unknown ones, at a wall's end"),
            "x_m": _coordinate("the middle of that border, map frame"),
            "y_m": _coordinate("the same"),
        },
        "One row per gap in the map's walls; only where there is one.",
        optional=True,
    ),
    "robots": EXPLORERS,
}
