"""The experiments by name: the parameters each one takes and the function that runs one trial of it."""

from midnet_bench.campaign.trial import TrialResult, TrialSpec
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.guarded.parameters import (
    DetectionParameters,
    LabyrinthParameters,
    ReadingsParameters,
)
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.io.checked_yaml import Spec

_PARAMETERS: dict[str, type[Spec]] = {
    "detection": DetectionParameters,
    "labyrinth": LabyrinthParameters,
    "mapping": MappingParameters,
    "readings": ReadingsParameters,
}


def parameters_model(experiment: str) -> type[Spec]:
    """The pydantic model of an experiment's parameters. Raises InputError on an unknown name."""
    if experiment not in _PARAMETERS:
        raise InputError(f"experiment: unknown name '{experiment}'{nearest_name(experiment, _PARAMETERS)}")
    return _PARAMETERS[experiment]


def run_trial(spec: TrialSpec) -> TrialResult:
    """The tables of one trial, a pure function of ``spec``. Imports the simulator on first use."""
    parameters = parameters_model(spec.experiment).model_validate(dict(spec.parameters))
    if isinstance(parameters, ReadingsParameters):
        from midnet_bench.experiments.readings.trial import run_readings

        return run_readings(parameters, spec.seed)
    if isinstance(parameters, DetectionParameters):
        from midnet_bench.experiments.detection.trial import run_detection

        return run_detection(parameters, spec.seed)
    if isinstance(parameters, MappingParameters):
        from midnet_bench.experiments.mapping.trial import run_mapping

        return run_mapping(parameters, spec.seed)
    from midnet_bench.experiments.labyrinth.trial import run_labyrinth

    assert isinstance(parameters, LabyrinthParameters)
    return run_labyrinth(parameters, spec.seed)
