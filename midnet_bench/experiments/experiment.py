"""``Experiment``: all that commands ask of an experiment, in one record.

An experiment of your own is a Python file with such a record in it. A campaign file names it by
``experiment: path/file.py:NAME`` or ``experiment: package.module:NAME``; a package can offer it under a name
by an entry point of the group ``midnet_bench.experiments``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from midnet_bench.plugins import load_reference

if TYPE_CHECKING:
    from midnet_bench.campaign.trial import TrialResult
    from midnet_bench.io.parameters import Parameters

Measures = Mapping[tuple[str, str], Mapping[int, float]]
"""(cell, measure) -> its value at each seed"""


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment: its parameters, one trial of it, and what is made of a campaign's results.

    Importing a record should be cheap: ``plugins.later`` imports a function when it is called. ``results`` is
    an ``analysis.frames.Results``.
    """

    name: str
    summary: str
    """one sentence for the help"""
    parameters: "type[Parameters] | str"
    """the class of its parameters, a subclass of ``io.parameters.Parameters``; or a reference to it"""
    run: "Callable[[Any, int], TrialResult]"
    """(parameters, seed) -> the tables of one trial: a pure function, no file, no clock, no global state"""
    trial: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager with ``frames(explain)`` for ``simulate``; else None"""
    demo: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager that gives a ``drawing.scene.Demo``, a trial for
    ``midnet-bench render``; None if there is nothing to draw"""

    @property
    def model(self) -> "type[Parameters]":
        """The class of the parameters, imported if ``parameters`` is a reference."""
        model = load_reference(self.parameters) if isinstance(self.parameters, str) else self.parameters
        return model
