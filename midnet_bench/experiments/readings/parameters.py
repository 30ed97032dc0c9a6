"""What the test of many readings at once lets a user set."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.settings import option


@dataclass(frozen=True)
class ReadingsParameters(DetectionParameters):
    """The detection test under many readings at once; the parameters are what each one starts from."""

    recorded: ClassVar[tuple[str, ...] | None] = (*(DetectionParameters.recorded or ()), "readings")

    readings: Literal["calibration", "items"] = option(
        "items",
        "Which readings are compared: all combinations of the calibrated values (calibration), or one "
        "change of one option at a time (items).",
    )
