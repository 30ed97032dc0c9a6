"""The labyrinth test of section V.B."""

import math

from midnet_bench.experiments import columns
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.plugins import later

LABYRINTH = Experiment(
    name="labyrinth",
    summary="Map 2, section V.B: which intruders are caught before they escape.",
    parameters=LabyrinthParameters,
    run=later("midnet_bench.experiments.labyrinth.trial:run_labyrinth"),
    result_key=later("midnet_bench.experiments.guarded.parameters:result_key"),
    columns=columns.LABYRINTH,
    tables=later("midnet_bench.experiments.labyrinth.tables:tables"),
    printed=("success_rate", "metrics_summary", "labyrinth_health", "labyrinth_speed"),
    headline=later("midnet_bench.experiments.labyrinth.tables:headline"),
    claims=later("midnet_bench.experiments.labyrinth.tables:claims"),
    measures=later("midnet_bench.experiments.labyrinth.tables:measures"),
    recordings=later("midnet_bench.experiments.guarded.recordings:recordings"),
    ranges={"caught_percent": (0.0, 100.0), "time_to_capture_s": (0.0, math.inf)},
    lower_is_better=("duration_s", "time_to_capture_s"),
    ranked_by=("caught_percent", "time_to_capture_s"),
    comparison_tables=later("midnet_bench.experiments.labyrinth.tables:comparison_tables"),
    power=later("midnet_bench.experiments.labyrinth.tables:power_table"),
    figures=later("midnet_bench.experiments.figures:labyrinth_figures"),
    comparison_figures=later("midnet_bench.experiments.figures:comparison_figures"),
    trial=later("midnet_bench.experiments.labyrinth.trial:LabyrinthTrial"),
    demo=later("midnet_bench.experiments.scenes:labyrinth_demo"),
)
