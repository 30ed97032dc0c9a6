"""The detection test under one disturbance."""

from contextlib import AbstractContextManager

from midnet_bench.campaign.trial import TrialResult
from midnet_bench.drawing.scene import Demo
from midnet_bench.experiments.detection import demo as detection
from midnet_bench.experiments.detection.trial import run_detection
from midnet_bench.experiments.robustness.parameters import RobustnessParameters


def run_robustness(parameters: RobustnessParameters, seed: int) -> TrialResult:
    """One trial: ``scores`` and ``robots`` of the detection test; its frames would fill the store."""
    result = run_detection(parameters.disturbed, seed)
    kept = {name: rows for name, rows in result.tables.items() if name != "frames"}
    return TrialResult(kept, result.simulated_s)


def demo(parameters: RobustnessParameters, seed: int) -> AbstractContextManager[Demo]:
    """The trial of that seed, scene by scene."""
    return detection.demo(parameters.disturbed, seed)
