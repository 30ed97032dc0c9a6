"""The detection test of section V.A."""

import math

from midnet_bench.experiments import columns
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.plugins import later

DETECTION = Experiment(
    name="detection",
    summary="Map 1, section V.A: which intruders are detected, frame by frame.",
    parameters=DetectionParameters,
    run=later("midnet_bench.experiments.detection.trial:run_detection"),
    result_key=later("midnet_bench.experiments.detection.parameters:result_key"),
    simulation_key=later("midnet_bench.experiments.detection.parameters:simulation_key"),
    run_together=later("midnet_bench.experiments.detection.trial:run_together"),
    columns=columns.DETECTION,
    tables=later("midnet_bench.experiments.detection.tables:tables"),
    printed=("detection_summary", "detection_counting", "detection_matching", "metrics_summary"),
    headline=later("midnet_bench.experiments.detection.conclusions:headline"),
    claims=later("midnet_bench.experiments.detection.conclusions:claims"),
    measures=later("midnet_bench.experiments.detection.tables:measures"),
    figures=later("midnet_bench.experiments.figures:detection_figures"),
    sweeps_beside=True,
    recordings=later("midnet_bench.experiments.guarded.recordings:recordings"),
    ranges={"f1_one_to_one": (0.0, 1.0), "gospa_per_frame_m": (0.0, math.inf)},
    lower_is_better=("gospa_per_frame_m",),
    ranked_by=("f1_one_to_one", "gospa_per_frame_m"),
    trial=later("midnet_bench.experiments.detection.trial:DetectionTrial"),
    demo=later("midnet_bench.experiments.scenes:detection_demo"),
)
