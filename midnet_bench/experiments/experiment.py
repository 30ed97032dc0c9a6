"""``Experiment``: all that commands need of an experiment, in one record.

An experiment of your own is a Python file with such a record in it. A campaign file names it by
``experiment: path/file.py:NAME`` or ``experiment: package.module:NAME``; a package can offer it under a name
by an entry point of the group ``midnet_bench.experiments``.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from midnet_bench.analysis.claims import Finding
    from midnet_bench.analysis.frames import Results
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.trial import Sharing, Tables, TrialResult
    from midnet_bench.io.checked_yaml import Parameters
    from midnet_bench.page.recording import Recording

WANTED_LOW = ("_s", "_m", "_switches", "never_detected")  # how names of metrics end of which less is better


@dataclass(frozen=True)
class Headline:
    """What a terminal and a page show of a campaign's results first."""

    tables: "Sequence[Table]"
    conclusion: Sequence[str]  # the result in sentences, made from the numbers
    notes: Sequence[str]  # how the numbers in ``tables`` are to be read, for a terminal
    following: str  # the command to type next


def _nothing(results: object) -> "Sequence[Any]":
    return ()


def _no_figures(results: object) -> "Mapping[str, Figure]":
    return {}


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment: its parameters, one trial of it, and what is made of a campaign's results.

    Importing a record should be cheap: ``plugins.later`` imports a function when it is called. ``results`` is
    an ``analysis.frames.Results``.
    """

    name: str
    summary: str  # one sentence for the help
    parameters: "type[Parameters]"  # the class of its parameters
    run: "Callable[[Any, int], TrialResult]"
    """(parameters, seed) -> the tables of one trial: a pure function, no file, no clock, no global state"""
    result_key: Callable[[Any], Hashable] | None = None
    """parameters -> what of them a trial's numbers depend on: trials of one seed that agree in it are run
    once; all of them unless given"""
    simulation_key: Callable[[Any], Hashable] | None = None
    """parameters -> what trials of one seed have to agree in for ``run_together``"""
    run_together: "Callable[[Sequence[Any], int], Sequence[TrialResult | Exception]] | None" = None
    """([parameters], seed) -> of each what ``run`` gives, or raises, in one simulation"""
    columns: "Tables" = field(default_factory=dict)
    """the tables that ``run`` gives and what their columns hold; nothing is checked unless given"""
    tables: "Callable[[Results], Sequence[Table]]" = _nothing
    """what ``report`` writes, prints (unless ``printed`` says otherwise) and gives as JSON"""
    printed: tuple[str, ...] = ()  # names of the main tables; all unless given
    headline: "Callable[[Results, Results | None], Headline] | None" = None
    """(results with a finished trial, those of the packaged reference if there is one) -> what a terminal
    shows instead of ``printed``, which ``--wide`` shows; ``report.html`` begins with its conclusion"""
    figures: "Callable[[Results], Mapping[str, Figure]]" = _no_figures
    """stem of its files -> a matplotlib figure"""
    sweeps_beside: bool = False  # whether scores over numeric factors are drawn beside ``figures``
    claims: "Callable[[Results], Sequence[Finding]]" = _nothing
    """what a paper states, checked against the results, for ``verify``"""
    measures: "Callable[[Results], DataFrame] | None" = None
    """the main scores of each trial, for ``compare`` and ``report --x``: a data frame with the columns
    ``seed``, ``measure`` and ``value`` beside those of the factors; ``analysis.compare.tidy`` makes one"""
    recordings: "Callable[[Results], Iterable[Recording]]" = _nothing
    """the recorded trials, for the player of ``report.html``: each is made at its first use; there
    are none without a table ``recorded``"""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """main score -> the least and the greatest value that it can have, where no column is called so"""
    lower_is_better: tuple[str, ...] = ()  # those of the main scores that are the better the lower they are
    ranked_by: tuple[str, ...] = ()  # those of them that ``leaderboard`` ranks by
    comparison_tables: "Callable[[Mapping[str, Results]], Sequence[Table]]" = _nothing
    """tables of several campaigns side by side, by the campaigns' names"""
    comparison_figures: "Callable[[Mapping[str, Results]], Mapping[str, Figure]]" = _no_figures
    """figures of several campaigns side by side"""
    power: "Callable[[Results, float, tuple[int, int], float], Table] | None" = None
    """(results, difference, team sizes, power) -> the sample sizes that show that difference"""
    trial: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager with ``frames(explain)`` for ``simulate``; else None"""
    demo: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager that gives a ``drawing.scene.Demo``, a trial for
    ``midnet-bench render``; None if there is nothing to draw"""

    def wants_less(self, measure: str) -> bool:
        """Whether less of a score is better: of a main one by ``lower_is_better``, of a metric by its name.

        A metric whose name ends in ``_s`` or ``_m`` is a time or an error; it may count what went wrong.
        """
        return measure in self.lower_is_better or measure.endswith(WANTED_LOW)

    def range_of(self, measure: str) -> tuple[float, float]:
        """The least and the greatest value of a score, by ``ranges`` or the column of that name."""
        if measure in self.ranges:
            return self.ranges[measure]
        for table in self.columns.values():
            column = table.columns.get(measure)
            if column is not None and column.kind in (int, float):
                return column.least, column.most
        return -math.inf, math.inf

    def sharing(self, parameters: Any) -> "Sharing":
        """What the trials of these parameters share with others of their seed."""
        from midnet_bench.campaign.trial import Sharing

        result_key = parameters if self.result_key is None else self.result_key(parameters)
        if self.simulation_key is None or self.run_together is None:
            return Sharing(result_key, result_key)
        return Sharing(self.simulation_key(parameters), result_key)

    @property
    def has_figures(self) -> bool:
        """Whether it draws a campaign's results in a way of its own."""
        return self.figures is not _no_figures
