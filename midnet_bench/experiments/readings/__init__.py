"""What each reading of the paper's gaps moves."""

from midnet_bench.experiments import columns
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.plugins import later

READINGS = Experiment(
    name="readings",
    summary="The detection test under many readings of the paper's gaps at once.",
    parameters="midnet_bench.experiments.readings.parameters:ReadingsParameters",
    run=later("midnet_bench.experiments.readings.trial:run_readings"),
    columns=columns.READINGS,
    printed=("calibration_choice", "readings_table"),
    tables=later("midnet_bench.experiments.readings.tables:tables"),
    demo=later("midnet_bench.experiments.detection.demo:demo"),
)
