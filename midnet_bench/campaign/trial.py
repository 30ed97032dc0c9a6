"""What one trial is, and what comes out of it."""

import hashlib
import json
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from midnet_bench.settings import Scalar as Scalar

Row = dict[str, Scalar]
VARIANT = "variant"
"""the factor whose values are the names of a campaign's variants; it is no parameter of an experiment"""


def factor_text(name: str, value: object) -> str:
    """``oracle=window``; of a variant its name alone."""
    return str(value) if name == VARIANT else f"{name}={value}"


@dataclass(frozen=True)
class Cell:
    """What the trials of one cell have in common. Their ids are quick to find from here."""

    experiment: str  # its name
    parameters: Mapping[str, Scalar]  # every parameter of the experiment, resolved (defaults filled in)

    @cached_property
    def _canonical(self) -> str:
        common = {"experiment": self.experiment, "parameters": dict(self.parameters)}
        return json.dumps(common, sort_keys=True, separators=(",", ":"))

    @cached_property
    def number(self) -> int:
        """A hash of the cell, from 0 up to 2**63."""
        return int.from_bytes(hashlib.sha256(self._canonical.encode()).digest()[:8]) >> 1

    @cached_property
    def _before_seed(self) -> "hashlib._Hash":
        return hashlib.sha256(f'{self._canonical[:-1]},"seed":'.encode())

    def trial_id(self, seed: int) -> str:
        """16 hex digits: a hash of what defines the trial and of nothing else."""
        whole = self._before_seed.copy()
        whole.update(f"{seed}}}".encode())
        return whole.hexdigest()[:16]


@dataclass(frozen=True)
class TrialSpec:
    """Everything that decides a trial's outcome. Two equal specs give the same bytes anywhere."""

    experiment: str  # its name
    parameters: Mapping[str, Scalar]
    """every parameter of the experiment, resolved (defaults filled in), and the name of the variant if any"""
    seed: int

    @property
    def settings(self) -> dict[str, Scalar]:
        """The parameters of the experiment alone."""
        return {name: value for name, value in self.parameters.items() if name != VARIANT}

    @property
    def trial_id(self) -> str:
        """See :meth:`Cell.trial_id`."""
        return Cell(self.experiment, self.parameters).trial_id(self.seed)


@dataclass(frozen=True)
class TrialResult:
    """The tables of one trial by name, rows in a fixed order; no clock time, no host, no path.

    ``simulated_s`` is how long the trial lasted in its world.
    """

    tables: Mapping[str, list[Row]]
    simulated_s: float


@dataclass(frozen=True)
class Outcome:
    """What a worker hands back of a trial; exactly one of ``payload`` and ``failure`` is there."""

    trial_id: str
    wall_s: float
    simulated_s: float | None = None
    payload: bytes | None = None
    failure: str | None = None


RunTrials = Callable[[Sequence[TrialSpec]], Sequence[TrialResult | Exception]]
"""What runs trials of one seed that may share a simulation: each gives what it gives alone, or why it failed.

A pure function of the specs; what it raises has nothing to do with one trial more than with another.
"""


def run_alone(run_trials: RunTrials, spec: TrialSpec) -> TrialResult:
    """One trial by itself. Raises what it failed by."""
    (result,) = run_trials([spec])
    if isinstance(result, Exception):
        raise result
    return result


class Sharing(NamedTuple):
    """What tells which trials of one seed have work in common."""

    simulation_key: Hashable  # trials that agree in it share one simulation
    result_key: Hashable
    """trials that agree in it give the same numbers; they agree in ``simulation_key`` too"""
