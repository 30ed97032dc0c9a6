"""The columns of each experiment's tables, which a store or a CSV file from elsewhere is held to.

``docs/results.md`` says what they mean. A parameter that has the name of a column can be no factor of a grid.
"""

from midnet_bench.campaign.columns import LARGEST, Column, Columns, Tables
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES

LONGEST_RECORD = 20_000
"""characters of what is kept of one frame in one column"""
COUNT = Column(int)
AMOUNT = Column(float)
TIME_OR_NONE = Column(float, may_be_empty=True)
SHARE = Column(float, most=1.0)
SHARE_OR_NONE = Column(float, most=1.0, may_be_empty=True)

FRAMES = Column(int, least=1)
COUNTS = {
    **dict.fromkeys(("tp", "fp", "fn", "intruders_in_range", "matched", "duplicates", "missed"), COUNT),
    "error_sum_m": AMOUNT,
    "gospa_m": AMOUNT,
}
"""as ``scoring.frame_counts.FrameCounts`` has them"""
CAUSES = {
    **dict.fromkeys(("fn_hidden", "fn_new", "fp_left", "overlapping", "reordered", "looked_at"), COUNT),
    **dict.fromkeys(("fn_outside_window", "fn_hidden_in_window", "fn_new_in_window"), COUNT),
}
"""as ``scoring.causes.Causes`` has them"""
RATIOS = dict.fromkeys(("precision", "recall", "f1"), SHARE_OR_NONE)

SCORES = Columns(
    {"frames": FRAMES, **COUNTS, **RATIOS, **CAUSES, "patrol_relaxations": COUNT},
    one_row=True,
)
EXPLORERS = Columns(
    {
        "robot": Column(str),
        "distance_m": AMOUNT,
        "goals_reached": COUNT,
        "goals_given_up": COUNT,
        "stuck_s": AMOUNT,
        "collisions": COUNT,
        "walls_crossed": COUNT,
        "recoveries": COUNT,
        "pose_error_m": TIME_OR_NONE,
    }
)
ROBOTS = Columns({**EXPLORERS.columns, "role": Column(str, choices=("guard", "intruder"))})

METRICS = Columns({"metric": Column(str), "value": Column(float, least=-LARGEST)}, optional=True)

RECORDED = Columns(
    {
        "frame": FRAMES,
        **dict.fromkeys(
            ("poses", "truths", "found", "detections", "scans"), Column(str, longest=LONGEST_RECORD)
        ),
    },
    optional=True,
)
"""as ``guarded.record.RecordedFrame`` has them"""
PLACE = Column(float, least=-LARGEST)
ERRORS = Columns(
    {
        "frame": FRAMES,
        "kind": Column(str, choices=("miss", "false", "fragment")),
        "cause": Column(str, choices=(*MISS_CAUSES, *(set(FALSE_CAUSES) - set(MISS_CAUSES)))),
        "guard": COUNT,
        "intruder": Column(str),
        "by": Column(str),
        "age_s": AMOUNT,
        "offset_m": AMOUNT,
        **dict.fromkeys(("x_min_m", "y_min_m", "x_max_m", "y_max_m"), PLACE),
        "paper": Column(bool),
    },
    optional=True,
)
"""as ``guarded.recorder.Recorder`` has them"""

DETECTION: Tables = {
    "scores": SCORES,
    "frames": Columns({"frame": FRAMES, **COUNTS}),
    "robots": ROBOTS,
    "metrics": METRICS,
    "recorded": RECORDED,
    "errors": ERRORS,
}
LABYRINTH: Tables = {
    "trial": Columns(
        {
            "caught": Column(int, at_most="detected"),
            "detected": Column(int, at_most="intruders"),
            "escaped": Column(int, at_most="intruders"),
            "success_rate": Column(float, most=100.0),
            "duration_s": AMOUNT,
            "ended": Column(str),
            "patrol_relaxations": COUNT,
            "targets": COUNT,
            "ghost_targets": COUNT,
        },
        one_row=True,
    ),
    "intruders": Columns(
        {
            "intruder": COUNT,
            "outcome": Column(str, choices=("caught", "escaped", "at large")),
            "detected_at_s": TIME_OR_NONE,
            "caught_at_s": TIME_OR_NONE,
            "escaped_at_s": TIME_OR_NONE,
            "left_at_s": TIME_OR_NONE,
            "straight_m": AMOUNT,
        }
    ),
    "robots": ROBOTS,
    "metrics": METRICS,
    "recorded": RECORDED,
}
MAPPING: Tables = {
    "maps": Columns(
        {
            "coverage": SHARE,
            "occupied_precision": SHARE_OR_NONE,
            "occupied_recall": SHARE_OR_NONE,
            "wall_error_m": TIME_OR_NONE,
            "time_s": AMOUNT,
            "distance_m": AMOUNT,
            "finished": Column(bool),
            "merge_confidence": TIME_OR_NONE,
        },
        one_row=True,
    ),
    "robots": EXPLORERS,
}
