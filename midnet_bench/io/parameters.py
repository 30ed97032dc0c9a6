"""``Parameters``: an experiment's settings as the flat keys of a campaign file and of ``--set``."""

import functools
from collections.abc import Mapping
from typing import Any, Self, cast

from pydantic import Field, create_model

from midnet_bench.errors import InputError
from midnet_bench.io.checked_yaml import Spec, parse
from midnet_bench.settings import Scalar, Settings, leaves


class Parameters(Settings):
    """Base of an experiment's parameters: a frozen dataclass of its own options and of nested settings."""

    @classmethod
    def parse(cls, values: Mapping[str, Any], source: str) -> Self:
        """What a user wrote, checked; files by their contents.

        Args:
            values: flat keys, as read from YAML.
            source: what a message names first.

        Raises:
            InputError: ``source: key: what is wrong``: an unknown key, a value of the wrong type or out of
                range, values that do not go together, or a file that cannot be used.
        """
        checked = parse(flat_model(cls), values, source)
        try:
            return cls.from_flat(checked.model_dump(exclude_unset=True)).with_files_read()
        except InputError as error:
            raise InputError(f"{source}: {error}") from error

    @classmethod
    def of(cls, **values: Any) -> Self:
        """The same by keywords: ``DetectionParameters.of(robots=5, thresh_local=90)``."""
        return cls.parse(values, "parameters")

    def with_files_read(self) -> Self:
        """These parameters with the contents of the files that they name, checked. Here: the same."""
        return self

    @property
    def effort(self) -> float:
        """About how long a trial takes, compared with the trials of other cells. Here: all the same."""
        return 1.0

    @property
    def expected_wall_s(self) -> float:
        """About how long a trial takes on one core, seconds, for an estimate before any is measured."""
        return 15.0  # a rule of thumb

    @classmethod
    def defaults(cls) -> dict[str, Scalar]:
        """The default of every flat key."""
        return {key: leaf.default for key, leaf in leaves(cls).items()}


def flat_model(parameters: type[Settings]) -> type[Spec]:
    """The pydantic model of the flat keys: what YAML and the command line are checked against."""
    return _model(cast(Any, parameters))


@functools.cache
def _model(parameters: type[Settings]) -> type[Spec]:
    named: dict[str, Any] = {}
    for key, leaf in leaves(parameters).items():
        field = Field(leaf.default, description=leaf.help, **cast(Any, leaf.limits))
        named[key] = (leaf.annotation, field)
    return cast(type[Spec], create_model(parameters.__name__, __base__=Spec, **named))
