"""Map construction of section II.A."""

from midnet_bench.experiments import columns
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.plugins import later

MAPPING = Experiment(
    name="mapping",
    summary="Section II.A: how robots explore an unknown arena and map it.",
    parameters=MappingParameters,
    run=later("midnet_bench.experiments.mapping.trial:run_mapping"),
    columns=columns.MAPPING,
    tables=later("midnet_bench.experiments.mapping.tables:tables"),
    printed=("mapping", "mapping_walls", "mapping_speedup", "mapping_choice"),
    figures=later("midnet_bench.experiments.figures:mapping_figures"),
)
