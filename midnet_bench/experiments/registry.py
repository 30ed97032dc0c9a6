"""The experiments by name: those of this package, of installed packages, and of a user's own files."""

from typing import TYPE_CHECKING, Any

from midnet_bench.campaign.trial import VARIANT, check_tables, shown
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.detection import DETECTION
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.labyrinth import LABYRINTH
from midnet_bench.experiments.mapping import MAPPING
from midnet_bench.plugins import load_reference, offered

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from midnet_bench.analysis.frames import Results
    from midnet_bench.campaign.definition import Definition
    from midnet_bench.campaign.trial import Tables, TrialResult, TrialSpec
    from midnet_bench.io.checked_yaml import Parameters

ENTRY_POINTS = "midnet_bench.experiments"  # the group under which an installed package offers experiments

_OWN = {one.name: one for one in (DETECTION, LABYRINTH, MAPPING)}
_GONE = {
    "robustness": "it is a 'detection' campaign with variants now: 'midnet-bench run robustness'",
    "scale": "it simulates nothing: 'python -m benchmarks.scale' has its numbers",
}


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
    if name in _GONE:
        raise InputError(f"experiment: '{name}': {_GONE[name]}")
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
    if len(different) == 1 or found.run_together is None:
        results = [_result_or_error(found.run, each, seed) for each in different.values()]
    else:
        results = found.run_together(list(different.values()), seed)
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
            check_tables(found.columns, result.tables, spec.parameters)
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
