"""What a store was made for, and how much of it another campaign may change."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from pydantic import TypeAdapter

from midnet_bench.campaign.spec import Campaign, Experiments, cells
from midnet_bench.campaign.trial import Scalar
from midnet_bench.experiments import registry

MOST_SHOWN = 60
"""characters of a value in a message: an arena taken in from a file is long"""


@dataclass(frozen=True)
class Definition:
    """A campaign with nothing left to defaults, so that its store can be read without the experiments."""

    experiment: str
    base_seed: int
    trials: int
    grid: dict[str, list[Scalar]]
    parameters: dict[str, Scalar]
    """every parameter that is not a factor of the grid, defaults filled in; files by their contents"""

    def to_json(self) -> str:
        """The text that :meth:`from_json` reads."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> "Definition":
        """The definition that :meth:`to_json` wrote. Raises ValueError if that is not what ``text`` is."""
        return TypeAdapter(cls).validate_json(text)

    @property
    def cells(self) -> int:
        """How many cells the grid has."""
        return math.prod(len(values) for values in self.grid.values())

    def cell_of(self, parameters: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """The factors' values among the ``parameters`` of a trial: which cell it belongs to."""
        return {factor: parameters[factor] for factor in self.grid}


def definition_of(campaign: Campaign, experiments: Experiments = registry) -> Definition:
    """What ``campaign`` runs, resolved."""
    resolved = cells(campaign, experiments)
    grid = {factor: list(dict.fromkeys(cell[factor] for cell in resolved)) for factor in campaign.grid}
    parameters = {name: _in_all_cells(name, resolved) for name in resolved[0] if name not in grid}
    return Definition(
        experiment=campaign.experiment,
        base_seed=campaign.base_seed,
        trials=campaign.trials,
        grid=grid,
        parameters=parameters,
    )


def _in_all_cells(name: str, cells: list[dict[str, Scalar]]) -> Scalar:
    """The value that a parameter has in every cell; if they differ, all that there are.

    They may where one parameter names what goes with another: each arena has an explored map of its own.
    """
    values = list(dict.fromkeys(cell[name] for cell in cells))
    return values[0] if len(values) == 1 else " | ".join(map(str, values))


def differences(old: Definition, new: Definition) -> list[str]:
    """What forbids ``new`` to go on where ``old`` stopped; empty if it only adds trials or grid values."""
    before, after = _flat(old), _flat(new)
    found = []
    for name in [*before, *(name for name in after if name not in before)]:
        was, is_now = before.get(name, "(absent)"), after.get(name, "(absent)")
        if name == "trials":
            extends = new.trials >= old.trials
        elif isinstance(was, list) and isinstance(is_now, list):
            extends = all(value in is_now for value in was)
        else:
            extends = was == is_now
        if not extends:
            found.append(f"{name} {_show(was)} -> {_show(is_now)}")
    return found


def _flat(definition: Definition) -> dict[str, Scalar | list[Scalar]]:
    return {
        "experiment": definition.experiment,
        "base_seed": definition.base_seed,
        "trials": definition.trials,
        **{f"grid.{factor}": values for factor, values in definition.grid.items()},
        **definition.parameters,
    }


def _show(value: Scalar | list[Scalar]) -> str:
    text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
