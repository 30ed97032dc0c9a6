"""The labyrinth test of section V.B."""

from midnet_bench.experiments.experiment import Experiment
from midnet_bench.plugins import later

LABYRINTH = Experiment(
    name="labyrinth",
    summary="Map 2, section V.B: which intruders are caught before they escape.",
    parameters="midnet_bench.experiments.labyrinth.parameters:LabyrinthParameters",
    run=later("midnet_bench.experiments.labyrinth.trial:run_labyrinth"),
    trial=later("midnet_bench.experiments.labyrinth.trial:LabyrinthTrial"),
    demo=later("midnet_bench.experiments.labyrinth.demo:demo"),
)
