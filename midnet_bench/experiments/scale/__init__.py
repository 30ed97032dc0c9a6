"""Section IV.C alone for teams of up to 200 robots, whose boxes are made up."""

import math

from midnet_bench.experiments import columns
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.plugins import later

SCALE = Experiment(
    name="scale",
    summary="Ally removal and fusion alone, for 1 to 200 robots in scenes made up of boxes.",
    parameters="midnet_bench.experiments.scale.parameters:ScaleParameters",
    run=later("midnet_bench.experiments.scale.trial:run_scale"),
    columns=columns.SCALE,
    tables=later("midnet_bench.experiments.scale.tables:tables"),
    measures=later("midnet_bench.experiments.scale.tables:measures"),
    ranges={
        "f1_one_to_one": (0.0, 1.0),
        "gospa_per_intruder_m": (0.0, math.inf),
        "duplicates_per_intruder": (0.0, math.inf),
        "overlapping_share": (0.0, 1.0),
        "reordered_share": (0.0, 1.0),
    },
    lower_is_better=(
        "gospa_per_intruder_m",
        "duplicates_per_intruder",
        "overlapping_share",
        "reordered_share",
    ),
    ranked_by=("f1_one_to_one", "gospa_per_intruder_m"),
    printed=("scale",),
)
"""What becomes of the paper's claim that any number of robots can join (section VI)."""
