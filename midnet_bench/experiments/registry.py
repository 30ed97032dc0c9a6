"""``Experiment``: all that commands need of an experiment in one record; and how a record is found.

This package has three. An experiment of your own is a Python file with such a record in it. A campaign file
names it by ``experiment: path/file.py:NAME`` or ``experiment: package.module:NAME``; a package can offer it
under a name by an entry point of the group ``midnet_bench.experiments``.
"""

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from midnet_bench.campaign.trial import VARIANT, Sharing, check_tables, shown
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments import columns
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.plugins import later, load_reference, offered

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from pandas import DataFrame

    from midnet_bench.analysis.claims import Finding
    from midnet_bench.analysis.frames import Results
    from midnet_bench.analysis.tables import Table
    from midnet_bench.campaign.definition import Definition
    from midnet_bench.campaign.trial import Tables, TrialResult, TrialSpec
    from midnet_bench.io.checked_yaml import Parameters
    from midnet_bench.page.recording import Recording

ENTRY_POINTS = "midnet_bench.experiments"  # the group under which an installed package offers experiments
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
class Trials:
    """What runs of an experiment."""

    run: "Callable[[Any, int], TrialResult]"
    """(parameters, seed) -> the tables of one trial: a pure function, no file, no clock, no global state"""
    result_key: Callable[[Any], Hashable] | None = None
    """parameters -> what of them a trial's numbers depend on: trials of one seed that agree in it are run
    once; all of them unless given"""
    simulation_key: Callable[[Any], Hashable] | None = None
    """parameters -> what trials of one seed have to agree in for ``run_together``"""
    run_together: "Callable[[Sequence[Any], int], Sequence[TrialResult | Exception]] | None" = None
    """([parameters], seed) -> of each what ``run`` gives, or raises, in one simulation"""
    frames: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager with ``frames(explain)``, for ``simulate`` and ``export``;
    None if a trial has no frames"""
    demo: Callable[..., Any] | None = None
    """(parameters, seed) -> a context manager that gives a ``drawing.scene.Demo``, a trial for
    ``midnet-bench render``; None if there is nothing to draw"""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What is reported of an experiment's results, each an ``analysis.frames.Results``."""

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
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """main score -> the least and the greatest value that it can have, where no column is called so"""
    lower_is_better: tuple[str, ...] = ()  # those of the main scores that are the better the lower they are
    ranked_by: tuple[str, ...] = ()  # those of them that ``compare --rank`` ranks by; all unless given
    recordings: "Callable[[Results], Iterable[Recording]]" = _nothing
    """the recorded trials, for the player of ``report.html``: each is made at its first use; there
    are none without a table ``recorded``"""
    comparison_tables: "Callable[[Mapping[str, Results]], Sequence[Table]]" = _nothing
    """tables of several campaigns side by side, by the campaigns' names"""
    comparison_figures: "Callable[[Mapping[str, Results]], Mapping[str, Figure]]" = _no_figures
    """figures of several campaigns side by side"""
    power: "Callable[[Results, float, tuple[int, int], float], Table] | None" = None
    """(results, difference, team sizes, power) -> the sample sizes that show that difference"""

    @property
    def has_figures(self) -> bool:
        """Whether it draws a campaign's results in a way of its own."""
        return self.figures is not _no_figures


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """An experiment: its parameters, what runs, what is stored, and what is reported.

    Importing a record should be cheap: ``plugins.later`` imports a function when it is called.
    """

    name: str
    summary: str  # one sentence for the help
    parameters: "type[Parameters]"  # the class of its parameters
    trials: Trials
    columns: "Tables" = field(default_factory=dict)
    """the tables that a trial gives and what their columns hold; nothing is checked unless given"""
    report: Report = field(default_factory=Report)

    def wants_less(self, measure: str) -> bool:
        """Whether less of a score is better: of a main one by the report, of a metric by its name.

        A metric whose name ends in ``_s`` or ``_m`` is a time or an error; it may count what went wrong.
        """
        return measure in self.report.lower_is_better or measure.endswith(WANTED_LOW)

    def range_of(self, measure: str) -> tuple[float, float]:
        """The least and the greatest value of a score, by the report or the column of that name."""
        if measure in self.report.ranges:
            return self.report.ranges[measure]
        for table in self.columns.values():
            column = table.columns.get(measure)
            if column is not None and column.kind in (int, float):
                return column.least, column.most
        return -math.inf, math.inf

    def sharing(self, parameters: Any) -> Sharing:
        """What the trials of these parameters share with others of their seed."""
        trials = self.trials
        result_key = parameters if trials.result_key is None else trials.result_key(parameters)
        if trials.simulation_key is None or trials.run_together is None:
            return Sharing(result_key, result_key)
        return Sharing(trials.simulation_key(parameters), result_key)


DETECTION = Experiment(
    name="detection",
    summary="Map 1, section V.A: which intruders are detected, frame by frame.",
    parameters=DetectionParameters,
    trials=Trials(
        run=later("midnet_bench.experiments.detection.trial:run_detection"),
        result_key=later("midnet_bench.experiments.detection.parameters:result_key"),
        simulation_key=later("midnet_bench.experiments.detection.parameters:simulation_key"),
        run_together=later("midnet_bench.experiments.detection.trial:run_together"),
        frames=later("midnet_bench.experiments.detection.trial:DetectionTrial"),
        demo=later("midnet_bench.experiments.scenes:detection_demo"),
    ),
    columns=columns.DETECTION,
    report=Report(
        tables=later("midnet_bench.experiments.detection.tables:tables"),
        printed=("detection_summary", "detection_counting", "detection_matching", "metrics_summary"),
        headline=later("midnet_bench.experiments.detection.conclusions:headline"),
        figures=later("midnet_bench.experiments.figures:detection_figures"),
        sweeps_beside=True,
        claims=later("midnet_bench.experiments.detection.conclusions:claims"),
        measures=later("midnet_bench.experiments.detection.tables:measures"),
        ranges={"f1_one_to_one": (0.0, 1.0), "gospa_per_frame_m": (0.0, math.inf)},
        lower_is_better=("gospa_per_frame_m",),
        ranked_by=("f1_one_to_one", "gospa_per_frame_m"),
        recordings=later("midnet_bench.experiments.guarded.recordings:recordings"),
    ),
)
LABYRINTH = Experiment(
    name="labyrinth",
    summary="Map 2, section V.B: which intruders are caught before they escape.",
    parameters=LabyrinthParameters,
    trials=Trials(
        run=later("midnet_bench.experiments.labyrinth.trial:run_labyrinth"),
        result_key=later("midnet_bench.experiments.labyrinth.parameters:result_key"),
        frames=later("midnet_bench.experiments.labyrinth.trial:LabyrinthTrial"),
        demo=later("midnet_bench.experiments.scenes:labyrinth_demo"),
    ),
    columns=columns.LABYRINTH,
    report=Report(
        tables=later("midnet_bench.experiments.labyrinth.tables:tables"),
        printed=("success_rate", "metrics_summary", "labyrinth_health", "labyrinth_speed"),
        headline=later("midnet_bench.experiments.labyrinth.tables:headline"),
        figures=later("midnet_bench.experiments.figures:labyrinth_figures"),
        claims=later("midnet_bench.experiments.labyrinth.tables:claims"),
        measures=later("midnet_bench.experiments.labyrinth.tables:measures"),
        ranges={"caught_percent": (0.0, 100.0), "time_to_capture_s": (0.0, math.inf)},
        lower_is_better=("duration_s", "time_to_capture_s"),
        ranked_by=("caught_percent", "time_to_capture_s"),
        recordings=later("midnet_bench.experiments.guarded.recordings:recordings"),
        comparison_tables=later("midnet_bench.experiments.labyrinth.tables:comparison_tables"),
        comparison_figures=later("midnet_bench.experiments.figures:comparison_figures"),
        power=later("midnet_bench.experiments.labyrinth.tables:power_table"),
    ),
)
MAPPING = Experiment(
    name="mapping",
    summary="Section II.A: how robots explore an unknown arena and map it.",
    parameters=MappingParameters,
    trials=Trials(
        run=later("midnet_bench.experiments.mapping.trial:run_mapping"),
    ),
    columns=columns.MAPPING,
    report=Report(
        tables=later("midnet_bench.experiments.mapping.tables:tables"),
        printed=("mapping", "mapping_walls", "mapping_speedup", "mapping_choice"),
        figures=later("midnet_bench.experiments.figures:mapping_figures"),
    ),
)
_OWN = {one.name: one for one in (DETECTION, LABYRINTH, MAPPING)}


def names() -> list[str]:
    """The names that :func:`experiment` knows, this package's first; beside them it takes references."""
    return list(dict.fromkeys([*_OWN, *(point.name for point in offered(ENTRY_POINTS))]))


def experiment(name: str) -> Experiment:
    """One of :func:`names`, or that of a reference: ``package.module:NAME`` or ``path/file.py:NAME``.

    Raises:
        InputError: an unknown name, or a reference to something that is no ``Experiment`` or has options that
            make no sense.
    """
    if name in _OWN:
        return _OWN[name]
    if ":" in name:
        return _checked(name, load_reference(name))
    for point in offered(ENTRY_POINTS):
        if point.name == name:
            return _checked(point.value, load_reference(point.value))
    raise InputError(f"experiment: unknown name '{name}'{nearest_name(name, names())}")


def experiment_of(results: "Results") -> Experiment:
    """The experiment that results are of. Raises InputError as :func:`experiment_in`."""
    return experiment_in(results.definition, results.directory)


def experiment_in(definition: "Definition", directory: "Path") -> Experiment:
    """The experiment of the campaign in a folder, also where a user's own file has it.

    Raises:
        InputError: as :func:`experiment`, such as when that file has gone; or the campaign names code that
            the user has not run, see ``campaign/provenance.py``.
    """
    from midnet_bench.campaign.provenance import refuse_untrusted

    refuse_untrusted(definition, directory)
    return experiment(definition.reference(directory))


def tables_of(definition: "Definition", directory: "Path") -> "Tables":
    """The tables that the trials of the campaign in a folder have, by its experiment.

    Raises:
        InputError: as :func:`experiment_in`, or the definition gives a parameter what it cannot be.
    """
    return columns_of(experiment_in(definition, directory), definition, directory)


def columns_of(found: Experiment, definition: "Definition", directory: "Path") -> "Tables":
    """As :func:`tables_of`, of an experiment that is known."""
    from midnet_bench.campaign.definition import SEVERAL
    from midnet_bench.settings import leaves

    known = leaves(found.parameters)
    values = [one for one in definition.parameters.items() if one[0] in known and SEVERAL not in str(one[1])]
    grid = definition.grid.items()
    for name, value in [*values, *((name, one) for name, many in grid if name != VARIANT for one in many)]:
        if name not in known:
            raise InputError(f"{directory}: the grid's '{name}' is no parameter of '{found.name}'")
        if not known[name].allows(value):
            allowed = known[name].allowed
            raise InputError(f"{directory}: {name} cannot be {shown(value)}; allowed: {allowed}")
    return found.columns


def parameters_model(name: str) -> "type[Parameters]":
    """The class of an experiment's parameters. Raises InputError as :func:`experiment`."""
    return experiment(name).parameters


def run_trials(specs: "Sequence[TrialSpec]") -> "list[TrialResult | Exception]":
    """The tables of each trial, or why it failed: a pure function of ``specs``, which are of one seed.

    Imports the simulator on first use. Those that give the same numbers are run once, those that share a
    simulation run together. One whose tables are others than its experiment says has failed by ValueError;
    ``report`` would refuse them.
    """
    found, seed = experiment(specs[0].experiment), specs[0].seed
    parameters = [found.parameters.from_flat(spec.settings) for spec in specs]
    keys = [found.sharing(each).result_key for each in parameters]
    different = dict(zip(reversed(keys), reversed(parameters), strict=True))  # the first of equal ones
    results: Sequence[TrialResult | Exception]
    if len(different) == 1 or found.trials.run_together is None:
        results = [_result_or_error(found.trials.run, each, seed) for each in different.values()]
    else:
        results = found.trials.run_together(list(different.values()), seed)
    by_key = dict(zip(different, results, strict=True))
    return [_checked_result(found, spec, by_key[key]) for spec, key in zip(specs, keys, strict=True)]


def _result_or_error(run: "Callable[..., TrialResult]", *args: Any) -> "TrialResult | Exception":
    try:
        return run(*args)
    except Exception as error:
        return error


def _checked_result(
    found: Experiment, spec: "TrialSpec", result: "TrialResult | Exception"
) -> "TrialResult | Exception":
    """The result, or the ValueError that says what its tables lack."""
    try:
        if not isinstance(result, Exception):
            check_tables(found.columns, result.tables, spec.parameters, is_new=True)
    except ValueError as error:
        return error
    return result


def _checked(reference: str, found: object) -> Experiment:
    if not isinstance(found, Experiment):
        raise InputError(f"{reference}: expected an Experiment, got {type(found).__name__}")
    from midnet_bench.io.checked_yaml import flat_model

    try:
        flat_model(found.parameters)
    except InputError:
        raise
    except Exception as error:  # whatever pydantic raises at options of a user
        what = " ".join(str(error).split())
        raise InputError(
            f"{reference}: its parameters cannot be used: {type(error).__name__}: {what}"
        ) from error
    return found
