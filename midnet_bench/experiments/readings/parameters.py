"""What the test of many readings at once lets a user set."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.readings.rules import digest
from midnet_bench.settings import option

CALIBRATION = "calibration"
KNOWN = ("items", CALIBRATION, "default")


@dataclass(frozen=True)
class ReadingsParameters(DetectionParameters):
    """The detection test under many readings at once; the parameters are what each one starts from."""

    recorded: ClassVar[tuple[str, ...] | None] = (*(DetectionParameters.recorded or ()), "readings")

    readings: str = option(
        "items",
        "Which readings are compared: the candidates of the calibration (calibration), one change of one "
        "option at a time (items), or none beside what the parameters say (default).",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, own in (("detector", "midnet"), ("fusion", "paper"), ("metrics", "none")):
            if getattr(self, name) != own:
                raise InputError(
                    f"{name}: readings are MIDNet's, by the paper's counts; leave {name} at {own}"
                )

    @property
    def expected_wall_s(self) -> float:
        """See :class:`Parameters`: many detectors look on, which triples the cost of a detection trial."""
        return 3.0 * super().expected_wall_s

    def with_files_read(self) -> Self:
        """See :class:`Parameters`; behind ``calibration`` a digest of its candidates and rules."""
        read = super().with_files_read()
        named = f"{CALIBRATION}:{digest()}"
        if self.readings in (CALIBRATION, named):
            return replace(read, readings=named)
        if self.readings in KNOWN:
            return read
        if self.readings.startswith(f"{CALIBRATION}:"):
            raise InputError(
                f"readings: '{self.readings}' is not the calibration that this version has, '{named}'"
            )
        raise InputError(f"readings: no '{self.readings}'{nearest_name(self.readings, KNOWN)}")
