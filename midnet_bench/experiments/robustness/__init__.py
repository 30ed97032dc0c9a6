"""How much the detection test suffers from what a simulation usually spares it."""

import math

from midnet_bench.experiments import columns
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.plugins import later

ROBUSTNESS = Experiment(
    name="robustness",
    summary="The detection test under one disturbance at a time: noise, slip, delay, dead guards.",
    parameters="midnet_bench.experiments.robustness.parameters:RobustnessParameters",
    run=later("midnet_bench.experiments.robustness.trial:run_robustness"),
    columns=columns.ROBUSTNESS,
    tables=later("midnet_bench.experiments.robustness.tables:tables"),
    measures=later("midnet_bench.experiments.detection.tables:measures"),
    ranges={"f1_one_to_one": (0.0, 1.0), "gospa_per_frame_m": (0.0, math.inf)},
    lower_is_better=("gospa_per_frame_m",),
    ranked_by=("f1_one_to_one", "gospa_per_frame_m"),
    printed=("robustness_scores", "metrics_summary"),
    figures=later("midnet_bench.experiments.robustness.figures:figures"),
    demo=later("midnet_bench.experiments.robustness.trial:demo"),
)
