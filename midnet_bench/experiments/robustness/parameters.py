"""What the test of disturbances lets a user set."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self

from midnet_bench.campaign.definition import parse_settings
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.io.checked_yaml import parse
from midnet_bench.io.parameters import flat_model
from midnet_bench.settings import Scalar, option

NONE = "none"
"""the disturbance of trials in which nothing is disturbed"""


@dataclass(frozen=True)
class RobustnessParameters(DetectionParameters):
    """The detection test, disturbed; the parameters are what a disturbance starts from."""

    recorded: ClassVar[tuple[str, ...] | None] = (*(DetectionParameters.recorded or ()), "disturbance")

    disturbance: str = option(
        NONE,
        "What is disturbed: none, or changes of parameters such as 'lidar_dropout=0.2', separated by spaces.",
        source="ours: off, the paper disturbs nothing",
    )

    @property
    def disturbed(self) -> DetectionParameters:
        """The parameters of the detection test with the disturbance in them; files by their contents.

        Raises:
            InputError: an unknown or unsuited parameter, or a value that it cannot have.
        """
        base = self.flat_values()
        del base["disturbance"]
        changes = changes_of(self.disturbance)
        for key in changes:
            if key in ("robot", "robots"):
                raise InputError(f"disturbance: {key}: the team is no disturbance; set {key} itself")
            if key not in base:
                raise InputError(f"disturbance: {key}: unknown key{nearest_name(key, base)}")
        checked = parse(flat_model(DetectionParameters), {**base, **changes}, "disturbance")
        try:
            disturbed = DetectionParameters.from_flat(checked.model_dump()).with_files_read()
        except InputError as error:
            raise InputError(f"disturbance: {error}") from error
        for key in ("arena", "prior_map", "detector", "fusion", "patrol", "metrics", "engine"):
            value = str(disturbed.flat_values()[key])
            if key in changes and (value.startswith("{") or "#" in value):
                raise InputError(f"disturbance: {key}: a file is no disturbance; give it by {key} itself")
        return disturbed

    def with_files_read(self) -> Self:
        """See :class:`Parameters`: the files' contents; the disturbance checked, in one form of writing."""
        read = super().with_files_read()
        disturbed = read.disturbed.flat_values()
        words = [f"{key}={_written(disturbed[key])}" for key in changes_of(read.disturbance)]
        return replace(read, disturbance=" ".join(words) or NONE)


def changes_of(disturbance: str) -> Mapping[str, Scalar]:
    """Flat key -> value. Raises InputError: not ``key=value``, or a key given twice."""
    if disturbance.strip() == NONE:
        return {}
    try:
        return parse_settings(disturbance.split())
    except InputError as error:
        raise InputError(f"disturbance: {str(error).removeprefix('--set ')}") from error


def _written(value: Scalar) -> str:
    """As YAML has it."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)
