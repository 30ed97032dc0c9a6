"""What one trial is, and what comes out of it."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from midnet_bench.settings import Scalar as Scalar

Row = dict[str, Scalar]


@dataclass(frozen=True)
class TrialSpec:
    """Everything that decides a trial's outcome. Two equal specs give the same bytes anywhere."""

    experiment: str
    """its name"""
    parameters: Mapping[str, Scalar]
    """every parameter of the experiment, resolved (defaults filled in)"""
    seed: int

    @property
    def trial_id(self) -> str:
        """16 hex digits: a hash of what defines the trial and of nothing else."""
        definition = {"experiment": self.experiment, "parameters": dict(self.parameters), "seed": self.seed}
        canonical = json.dumps(definition, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class TrialResult:
    """The tables of one trial by name, rows in a fixed order; no clock time, no host, no path.

    ``simulated_s`` is how long the trial lasted in its world.
    """

    tables: Mapping[str, list[Row]]
    simulated_s: float


RunTrial = Callable[[TrialSpec], TrialResult]
"""What runs one trial: a pure function of the spec."""
