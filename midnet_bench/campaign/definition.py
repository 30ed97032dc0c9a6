"""A campaign: an experiment, a grid of its parameters, and how many trials each cell of the grid gets.

A :class:`Campaign` is what a user wrote. :func:`resolve` checks each cell against the experiment, once, and
gives a :class:`ResolvedCampaign`, which is what runs. A :class:`Definition` is what the store keeps of it.
"""

import itertools
import json
import math
import os
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Protocol

from pydantic import Field, PrivateAttr, Strict, TypeAdapter, field_validator, model_validator

from midnet_bench.campaign.trial import (
    VARIANT,
    Cell,
    RunTrials,
    Scalar,
    Sharing,
    Tables,
    TrialResult,
    TrialSpec,
    beside,
)
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.checked_yaml import Parameters, Spec, load_yaml, parse, read_yaml
from midnet_bench.plugins import Source, code_in, reference_to, take_sources
from midnet_bench.settings import without_effect

SEVERAL = " | "
"""between the values of a parameter that is not a factor of the grid and yet not the same in all cells"""
FILE_NAME = "campaign.sqlite"  # the store in a campaign's folder
LONGEST_NAME = 255  # bytes; no file system has longer ones
NOT_SET = "(not set)"  # what a message calls a parameter that a campaign leaves at its default
MAX_CELLS = 10_000  # of a grid; to check one takes some milliseconds
MAX_SHOWN_CHARACTERS = 60  # of a value in a message: an arena that was read from a file is long


Values = Scalar | list[Scalar]
"""of an option on the command line: one, or several that make a factor of the grid"""


class Experiment(Protocol):
    """What the engine uses of an experiment."""

    @property
    def parameters(self) -> type[Parameters]:
        """The class of its parameters."""

    @property
    def columns(self) -> Tables:
        """The tables of its trials; none if it does not say."""

    def sharing(self, parameters: Any) -> Sharing:
        """What the trials of these parameters share with trials of others."""


class Experiments(Protocol):
    """The experiments by name. A module with these two functions is one."""

    def experiment(self, name: str) -> Experiment:
        """The experiment of that name. Raises InputError on an unknown one."""

    def run_trials(self, specs: Sequence[TrialSpec]) -> Sequence[TrialResult | Exception]:
        """See ``RunTrials``; a module-level function, so that other processes can import it."""


@dataclass(frozen=True)
class Baseline:
    """What a report of a campaign compares seed by seed."""

    by: str = VARIANT  # a factor of the grid, or ``variant``
    baseline: Scalar = None  # the factor's value that the others are compared with; its first unless given
    measures: list[str] = field(default_factory=list)
    """the scores that are compared; the experiment's main ones unless given"""


class Campaign(Spec):
    """What decides every number of a campaign, as it was written. See ``campaigns/*.yaml`` for examples."""

    experiment: Annotated[str, Strict()]  # a name, ``package.module:NAME``, or ``file.py:NAME``
    name: Annotated[str, Strict()] = Field(
        "campaign", description="the file's name unless given; names its folder"
    )
    grid: dict[str, Annotated[list[Scalar], Field(min_length=1)]] = Field(
        default_factory=dict, description="factor -> values; a cell is one value of each"
    )
    variants: dict[str, dict[str, Scalar]] = Field(
        default_factory=dict,
        description="name -> the parameters that it changes; an axis of cells before those of the grid",
    )
    compare: Baseline | None = Field(None, description="what the report compares seed by seed")
    trials: Annotated[int, Strict()] = Field(1, ge=1, le=1_000_000, description="seeds per cell")
    base_seed: Annotated[int, Strict()] = Field(
        1, ge=0, le=2**53, description="trial k of every cell has seed base_seed + k"
    )
    parameters: dict[str, Scalar] = Field(default_factory=dict, description="the same in every cell")
    trial_timeout_s: float = Field(
        3600.0, gt=0, le=1e6, description="wall time after which a trial has failed"
    )

    _source: str = PrivateAttr("campaign")
    _before_override: "Campaign | None" = PrivateAttr(None)

    @field_validator("name")
    @classmethod
    def _names_one_folder(cls, name: str) -> str:
        if name in ("", ".", "..") or not name.isprintable() or "/" in name or "\\" in name:
            raise ValueError("the results' folder is named so; give one plain name, such as evening-run")
        if len(name.encode(errors="replace")) > LONGEST_NAME:
            raise ValueError(f"the results' folder is named so; at most {LONGEST_NAME} bytes")
        return name

    @model_validator(mode="before")
    @classmethod
    def _has_plain_values(cls, values: Any) -> Any:
        """Nothing is an empty section or variant; code is a reference; YAML reads some names as numbers."""
        given = dict(values)
        for section in ("grid", "parameters", "variants"):
            found = given.get(section)
            if found is None:
                given.pop(section, None)
            elif isinstance(found, Mapping):
                given[section] = {
                    str(key) if section == "variants" else key: _plain(value, section == "variants")
                    for key, value in found.items()
                }
        return given

    @property
    def axes(self) -> dict[str, list[Scalar]]:
        """The factors of the grid with their values, the names of the variants before them."""
        return {**({VARIANT: [*self.variants]} if self.variants else {}), **self.grid}


def _plain(value: Any, is_variant: bool) -> Any:
    if is_variant:
        return {} if value is None else value
    return list(map(reference_to, value)) if isinstance(value, list) else reference_to(value)


@dataclass(frozen=True)
class Definition:
    """A campaign with nothing left to defaults, so that its store can be read without the experiments."""

    experiment: str
    """its name; of a reference to a file, the file's name without its folder, such as ``hide.py:HIDE``"""
    base_seed: int
    trials: int
    grid: dict[str, list[Scalar]]
    parameters: dict[str, Scalar]
    """every parameter that is not a factor of the grid, defaults filled in; files by their contents"""
    experiment_file: str | None = None
    """where that file is, as seen from the store's folder; None if the experiment is in no such file"""
    variants: dict[str, dict[str, Scalar]] = field(default_factory=dict)
    """variant -> those of its parameters that differ between variants"""
    compare: Baseline | None = None

    def to_json(self) -> str:
        """The text that :meth:`from_json` reads."""
        values = asdict(self)
        for name in ("experiment_file", "variants", "compare"):
            if not values[name]:
                del values[name]
        return json.dumps(values, separators=(",", ":"))

    def parameters_of(self, cell: Mapping[str, Scalar]) -> dict[str, Scalar]:
        """The experiment's parameters in a cell, which is one value of each factor."""
        changed = self.variants.get(str(cell.get(VARIANT)), {})
        return {**self.parameters, **changed, **{key: cell[key] for key in cell if key != VARIANT}}

    @classmethod
    def from_json(cls, text: str) -> "Definition":
        """The definition that :meth:`to_json` wrote. Raises ValueError if that is not what ``text`` is."""
        return TypeAdapter(cls).validate_json(text)

    @property
    def cells(self) -> int:
        """How many cells the grid has."""
        return math.prod(len(values) for values in self.grid.values())

    def reference(self, directory: Path) -> str:
        """What finds the experiment of the store in a folder: its name, or the reference to its file."""
        if self.experiment_file is None:
            return self.experiment
        _, name = _file_and_name(self.experiment)
        return f"{(directory / self.experiment_file).resolve()}:{name}"


@dataclass(frozen=True)
class ResolvedCampaign:
    """A campaign whose cells are valid, and how to run a trial of it. Made by :func:`resolve`."""

    campaign: Campaign
    definition: Definition
    cells: list[dict[str, Scalar]]
    """every cell's parameters, defaults filled in, the grid's last factor changing fastest"""
    checked: list[Parameters]  # the same as instances of the experiment's class
    sharing: list[Sharing]  # what the trials of each cell share with those of other cells
    run_trials: RunTrials  # runs some of :meth:`trials`; other processes can import it
    experiment_file: Path | None  # where the experiment is, if it is in a file that the campaign refers to
    notes: list[str]
    """which values of the grid are there twice, or give the same trials as others; a line each"""

    @cached_property
    def numbered_cells(self) -> list[Cell]:
        """The cells with the numbers that a store knows them by."""
        return [Cell(self.definition.experiment, parameters) for parameters in self.cells]

    @property
    def seeds(self) -> range:
        """The seeds of each cell's trials."""
        first = self.definition.base_seed
        return range(first, first + self.definition.trials)

    @property
    def total(self) -> int:
        """How many trials it has."""
        return self.definition.cells * self.definition.trials

    def trials(self) -> Iterator[TrialSpec]:
        """Every trial, seed by seed, so that an interrupted campaign has visited all cells about equally.

        Trial k of each cell has the seed ``base_seed + k``: cells are compared on the same worlds (common
        random numbers, item 71), because a trial draws its world from its seed and from named axes that
        leave team size and readings out.
        """
        for seed in self.seeds:
            for parameters in self.cells:
                yield TrialSpec(self.definition.experiment, parameters, seed)

    def definition_in(self, directory: Path) -> Definition:
        """The definition for a store in ``directory``: it tells where the experiment's file is from there."""
        if self.experiment_file is None:
            return self.definition
        seen_from_there = os.path.relpath(self.experiment_file.resolve(), directory.resolve())
        return replace(self.definition, experiment_file=seen_from_there)


def load_campaign(path: str | Path) -> Campaign:
    """The campaign that a YAML file describes; :func:`resolve` checks its cells.

    Raises:
        InputError: in one line, naming the file and the key.
    """
    path = Path(path)
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: (top level): a campaign is a mapping with at least the key 'experiment'")
    campaign = parse_campaign({"name": path.stem, **values}, str(path))
    file, name = _file_and_name(campaign.experiment)
    if file is None:
        return campaign
    # a file is given as seen from the campaign's, whatever the working folder is
    return campaign.model_copy(update={"experiment": f"{(path.parent / file).resolve()}:{name}"})


def parse_campaign(values: Mapping[str, object], source: str) -> Campaign:
    """``values`` as a campaign; messages about it, also those of :func:`resolve`, begin with ``source``.

    Raises:
        InputError: in one line, naming the key.
    """
    campaign = parse(Campaign, values, source)
    campaign._source = source
    return campaign


def override(
    campaign: Campaign,
    settings: Mapping[str, Values],
    *,
    trials: int | None = None,
    base_seed: int | None = None,
) -> Campaign:
    """``campaign`` with settings of the command line on top.

    Several values make a factor of the grid, behind those that it has; one value narrows a factor to it. The
    user's own code, such as ``mine.py:Returns``, joins a factor that compares values, as one more.

    Raises:
        InputError: ``trials`` or ``base_seed`` is out of range. The settings are :func:`resolve`'s to check.
    """
    grid, parameters, variants = {**campaign.grid}, {**campaign.parameters}, campaign.variants
    for key, value in settings.items():
        if key == VARIANT and campaign.variants:
            variants = {}
            for name in map(str, value if isinstance(value, list) else [value]):
                if name not in campaign.variants:
                    hint = nearest_name(name, campaign.variants)
                    raise InputError(f"variant: '{name}' is none of the campaign's{hint}")
                variants[name] = campaign.variants[name]
        elif key in grid and isinstance(value, str) and _file_and_name(value.partition("(")[0])[0]:
            grid[key] = [*grid[key], value]
        elif isinstance(value, list) or key in grid:
            grid[key] = value if isinstance(value, list) else [value]
            parameters.pop(key, None)
        else:
            parameters[key] = value
    given = {"trials": trials, "base_seed": base_seed}
    changes = {"grid": grid, "parameters": parameters, "variants": variants}
    changes |= {key: number for key, number in given.items() if number is not None}
    changed = parse_campaign({**campaign.model_dump(), **changes}, "command line")
    changed._before_override = campaign
    return changed


def parse_settings(
    settings: Iterable[str], map_file: Path | None = None, is_sweep: bool = False
) -> dict[str, Any]:
    """``["capture=contact", "frames=200"]`` of ``--set`` as a mapping, values read as YAML scalars.

    ``map_file``, of ``--map``, stands for ``prior_map``. ``is_sweep``: commas part several values, as
    :func:`values_of` reads them.

    Raises:
        InputError: no ``=``, no key, a key given twice or known as another option, or no scalar.
    """
    parsed: dict[str, Any] = {}
    for setting in settings:
        key, equals, text = setting.partition("=")
        key = key.strip()
        option = f"--set {setting}" if len(setting) <= 60 else f"--set {setting[:57]}..."
        if not equals or not key:
            raise InputError(f"{option}: expected key=value")
        if key in parsed:
            raise InputError(f"{option}: '{key}' is set twice")
        if key == "seed":
            raise InputError(f"{option}: the seed is no parameter; give it by --seed")
        parsed[key] = (values_of if is_sweep else _scalar)(text, option)
    if map_file is not None:
        if "prior_map" in parsed:
            raise InputError(
                f"--map {map_file}: --set prior_map={parsed['prior_map']} too; give one of the two"
            )
        parsed["prior_map"] = str(map_file)
    return parsed


def values_of(text: str, option: str) -> Values:
    """The value of an option, or all of ``60,80`` or ``midnet,clusters(noise_m=0.02, min_returns=3)``.

    Commas inside brackets or quotes part none. Raises InputError, which begins with ``option``, if a value is
    missing or no scalar.
    """
    parts: list[str] = []
    for piece in text.split(","):
        if parts and _is_open(parts[-1]):
            parts[-1] += f",{piece}"
        else:
            parts.append(piece)
    if len(parts) == 1:
        return _scalar(text, option)
    if not all(part.strip() for part in parts):
        raise InputError(f"{option}: a value is missing beside a comma; commas part the values of a sweep")
    return [_scalar(part.strip(), option) for part in parts]


def _is_open(text: str) -> bool:
    """Whether a bracket or a quotation is not closed; an apostrophe behind a letter opens none."""
    bare = re.sub(r"""(?<!\w)('[^']*'|"[^"]*")""", "", text)
    brackets = any(bare.count(pair[0]) > bare.count(pair[1]) for pair in ("()", "[]", "{}"))
    return brackets or bare.lstrip()[:1] in ("'", '"')


def _scalar(text: str, option: str) -> Scalar:
    value = load_yaml(text, option)
    if not isinstance(value, str | int | float | bool | None):
        raise InputError(f"{option}: the value must be one number, word or true/false")
    return value


def resolve(campaign: Campaign, experiments: Experiments) -> ResolvedCampaign:
    """What ``campaign`` runs: every cell checked by its experiment, each of them once.

    Raises:
        InputError: in one line, naming where the campaign comes from and the key: the experiment or one of
            its parameters is unknown, or a cell is not valid.
    """
    try:
        return _resolve(campaign, experiments)
    except InputError as error:
        if campaign._before_override is not None:  # a fault that was there before is the file's
            resolve(campaign._before_override, experiments)
        raise InputError(f"{campaign._source}: {error}") from error


def _resolve(campaign: Campaign, experiments: Experiments) -> ResolvedCampaign:
    experiment = experiments.experiment(campaign.experiment)
    model, axes = experiment.parameters, campaign.axes
    _check_keys(campaign, experiment)
    count = math.prod(map(len, axes.values()))
    if count > MAX_CELLS:
        raise InputError(
            f"grid: {count} cells, and each is checked before the first trial;"
            f" give at most {MAX_CELLS}, in several campaigns if need be"
        )
    cells: list[dict[str, Scalar]] = []
    checked: list[Parameters] = []
    known: set[tuple[tuple[str, Scalar], ...]] = set()
    try:
        for values in itertools.product(*axes.values()):
            product = dict(zip(axes, values, strict=True))
            changes = campaign.variants.get(str(product.get(VARIANT)), {})
            flat = {**campaign.parameters, **changes, **product}
            flat.pop(VARIANT, None)
            parameters = model.parse(flat, f"cell {shown_cell(product)}")
            cell = {**parameters.flat_values(), **{key: product[key] for key in product if key == VARIANT}}
            if (identity := tuple(cell.items())) not in known:
                known.add(identity)
                cells.append(cell)
                checked.append(parameters)
    except InputError:
        # no fault of a cell if the parameters that all cells share are wrong by themselves
        model.parse(campaign.parameters, "parameters")
        raise
    grid = {factor: list(dict.fromkeys(cell[factor] for cell in cells)) for factor in axes}
    notes = [
        f"{factor}={_shown(value)} is there {times} times; it is run once"
        for factor, values in campaign.grid.items()
        for value, times in Counter(values).items()
        if times > 1
    ]
    given = itertools.chain(campaign.parameters, campaign.grid, *campaign.variants.values())
    notes += without_effect(model, dict.fromkeys(given), cells)
    notes += dict.fromkeys(line for parameters in checked for line in parameters.remarks)
    sharing = [Sharing(None, None)]  # a lone cell shares nothing, and what others do takes a compiler
    if len(cells) > 1:
        sharing = [experiment.sharing(parameters) for parameters in checked]
    file, name = _file_and_name(campaign.experiment)
    run_trials: RunTrials = experiments.run_trials
    code = code_in(value for cell in cells for value in cell.values())
    if file or code:
        run_trials = partial(_run_with_files, run_trials, campaign.experiment if file else None, code)
    return ResolvedCampaign(
        campaign=campaign,
        definition=Definition(
            experiment=f"{file.name}:{name}" if file else campaign.experiment,
            base_seed=campaign.base_seed,
            trials=campaign.trials,
            grid=grid,
            parameters={name: _in_all_cells(name, cells) for name in cells[0] if name not in grid},
            variants=_resolved_variants(cells, grid),
            compare=_baseline(campaign.compare, grid),
        ),
        cells=cells,
        checked=checked,
        sharing=sharing,
        run_trials=run_trials,
        experiment_file=file,
        notes=[*notes, *same_trials(grid, cells, [shared.result_key for shared in sharing])],
    )


def _check_keys(campaign: Campaign, experiment: Experiment) -> None:
    """Raises InputError unless every key is a parameter of the experiment, and given in one place."""
    known = experiment.parameters.defaults()
    if VARIANT in known:
        raise InputError(f"'{VARIANT}' is a campaign's own axis; rename that parameter")
    sections: dict[str, Mapping[str, object]] = {"grid": campaign.grid, "parameters": campaign.parameters}
    sections |= {f"variants.{name}": changes for name, changes in campaign.variants.items()}
    for section, keys in sections.items():
        for key in keys:
            if key in campaign.grid and section.startswith("variants"):
                raise InputError(f"{section}.{key}: also a factor of the grid")
            if key not in known:
                where = f"; 'midnet-bench parameters {campaign.experiment}' lists them"
                raise InputError(f"{section}.{key}: unknown key{nearest_name(key, known, where)}")
    if twice := sorted(set(campaign.grid) & set(campaign.parameters)):
        raise InputError(f"parameters.{twice[0]}: also a factor of the grid; keep one of the two")
    for factor, (name, table) in itertools.product(campaign.axes, experiment.columns.items()):
        if factor in table.columns and beside(factor) in table.columns:
            raise InputError(
                f"grid.{factor}: the table '{name}' has a column of that name and one called "
                f"'{beside(factor)}'; rename one of the two"
            )


def _resolved_variants(
    cells: Sequence[Mapping[str, Scalar]], grid: Mapping[str, Sequence[Scalar]]
) -> dict[str, dict[str, Scalar]]:
    """Variant -> those of its parameters that are not the same in all variants."""
    if VARIANT not in grid:
        return {}
    first = {str(cell[VARIANT]): cell for cell in reversed(cells)}
    names = [name for name in cells[0] if name not in grid]
    differ = [name for name in names if len({cell[name] for cell in first.values()}) > 1]
    return {name: {key: first[name][key] for key in differ} for name in map(str, grid[VARIANT])}


def _baseline(compare: Baseline | None, grid: Mapping[str, Sequence[Scalar]]) -> Baseline | None:
    """With the baseline filled in. Raises InputError if there is no such factor, or no such value of it."""
    if compare is None:
        return None
    if compare.by not in grid:
        raise InputError(f"compare.by: '{compare.by}' is no factor{nearest_name(compare.by, grid)}")
    baseline = grid[compare.by][0] if compare.baseline is None else compare.baseline
    if baseline not in grid[compare.by]:
        known = map(str, grid[compare.by])
        raise InputError(
            f"compare.baseline: '{baseline}' is no value of {compare.by}{nearest_name(str(baseline), known)}"
        )
    return replace(compare, baseline=baseline)


def same_trials(
    grid: Iterable[str], cells: Sequence[Mapping[str, Scalar]], same: Sequence[Hashable]
) -> list[str]:
    """Which cells give the trials of others, those of an equal value in ``same``, in a line."""
    first: dict[Hashable, Mapping[str, Scalar]] = {}
    pairs = [(cell, first.setdefault(key, cell)) for cell, key in zip(cells, same, strict=True)]
    twins = [(own, other) for own, other in pairs if own is not other]
    if not twins:
        return []
    own, other = (shown_cell({factor: cell[factor] for factor in grid}) for cell in twins[0])
    more = f", and {len(twins) - 1} more likewise" if len(twins) > 1 else ""
    return [f"{own} gives the same trials as {other}{more}; they are run once, results stand under each"]


def _run_with_files(
    run_trials: RunTrials, reference: str | None, code: Mapping[str, Source], specs: Sequence[TrialSpec]
) -> Sequence[TrialResult | Exception]:
    """``run_trials`` in a process that has none of the user's files: the ``code`` of parts of a trial.

    Specs have the name alone of the file of the experiment's ``reference``, the same on any machine.
    """
    take_sources(code)
    return run_trials(specs if reference is None else [replace(one, experiment=reference) for one in specs])


def _file_and_name(experiment: str) -> tuple[Path | None, str]:
    """The file and the name inside it that a reference such as ``hide.py:HIDE`` gives; else no file."""
    file, colon, name = experiment.rpartition(":")
    return (Path(file), name) if colon and file.endswith(".py") else (None, experiment)


def _in_all_cells(name: str, cells: list[dict[str, Scalar]]) -> Scalar:
    """The value that a parameter has in every cell; if they differ, all that there are.

    They may where one parameter names what goes with another: each arena has an explored map of its own.
    """
    values = list(dict.fromkeys(cell[name] for cell in cells))
    return values[0] if len(values) == 1 else SEVERAL.join(map(str, values))


def differences(old: Definition, new: Definition) -> list[str]:
    """What forbids ``new`` to go on where ``old`` stopped; empty if it only adds trials or grid values."""
    found: dict[str, None] = {}
    for variant in old.variants or [""]:
        before, after = _flat(old, variant), _flat(new, variant)
        for name in {**before, **after}:
            was, is_now = before.get(name, NOT_SET), after.get(name, NOT_SET)
            if name == "trials":
                extends = new.trials >= old.trials
            elif isinstance(was, list) and isinstance(is_now, list):
                extends = all(value in is_now for value in was)
            else:
                extends = was == is_now
            if not extends:
                found[f"{name} {_shown(was)} -> {_shown(is_now)}"] = None
    return list(found)


def _flat(definition: Definition, variant: str) -> dict[str, Scalar | list[Scalar]]:
    return {
        "experiment": definition.experiment,
        "base_seed": definition.base_seed,
        "trials": definition.trials,
        **{f"grid.{factor}": values for factor, values in definition.grid.items()},
        **definition.parameters,
        **definition.variants.get(variant, {}),
    }


def _shown(value: Scalar | list[Scalar]) -> str:
    text = f"[{', '.join(map(str, value))}]" if isinstance(value, list) else str(value)
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}..."


def shown_cell(cell: Mapping[str, Scalar]) -> str:
    """``robots=1, capture=within``: what messages call a cell."""
    return ", ".join(f"{factor}={_shown(value)}" for factor, value in cell.items()) or "(the only one)"
