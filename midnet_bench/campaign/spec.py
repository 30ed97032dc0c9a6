"""Campaign files: an experiment, a grid of its parameters, and how many trials each cell gets."""

import itertools
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Protocol

from pydantic import BaseModel, Field, Strict, field_validator

from midnet_bench.campaign.trial import Scalar, TrialResult, TrialSpec
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments import registry
from midnet_bench.io.checked_yaml import Spec, load_yaml, parse, read_yaml


class Experiments(Protocol):
    """What the engine asks of the experiments; the module ``experiments.registry`` is one."""

    def parameters_model(self, experiment: str) -> type[BaseModel]:
        """The flat model of an experiment's parameters. Raises InputError on an unknown name."""

    def run_trial(self, spec: TrialSpec) -> TrialResult:
        """One trial; a module-level function, so that other processes can import it."""


class Campaign(Spec):
    """What decides every number of a campaign. See ``campaigns/*.yaml`` for examples."""

    experiment: Annotated[str, Strict()]
    name: Annotated[str, Strict()] = Field(
        "campaign", description="the file's name unless given; names its folder"
    )
    grid: dict[str, list[Scalar]] = Field(
        default_factory=dict, description="factor -> values; a cell is one value of each"
    )
    trials: Annotated[int, Strict()] = Field(1, ge=1, le=1_000_000, description="seeds per cell")
    base_seed: Annotated[int, Strict()] = Field(
        1, ge=0, le=2**53, description="trial k of every cell has seed base_seed + k"
    )
    parameters: dict[str, Scalar] = Field(default_factory=dict, description="the same in every cell")
    trial_timeout_s: float = Field(
        3600.0, gt=0, le=1e6, description="wall time after which a trial has failed"
    )

    @field_validator("name")
    @classmethod
    def _names_one_folder(cls, name: str) -> str:
        if name in ("", ".", "..") or not name.isprintable() or "/" in name or "\\" in name:
            raise ValueError("the results' folder is named so; give one plain name, such as evening-run")
        return name

    @field_validator("grid", "parameters", mode="before")
    @classmethod
    def _empty_section_is_a_mapping(cls, value: object) -> object:
        return {} if value is None else value

    @field_validator("grid")
    @classmethod
    def _has_values(cls, grid: dict[str, list[Scalar]]) -> dict[str, list[Scalar]]:
        for factor, values in grid.items():
            if not values:
                raise ValueError(f"'{factor}' has no values; give at least one or leave it out")
        return grid


def load_campaign(path: Path, experiments: Experiments = registry) -> Campaign:
    """The campaign that a YAML file describes, every cell checked against its experiment.

    Raises:
        InputError: in one line, naming the file and the key.
    """
    values = read_yaml(path)
    if not isinstance(values, dict):
        raise InputError(f"{path}: (top level): a campaign is a mapping with at least the key 'experiment'")
    campaign = parse(Campaign, {"name": path.stem, **values}, str(path))
    check(campaign, str(path), experiments)
    return campaign


def override(
    campaign: Campaign,
    settings: Mapping[str, Scalar],
    *,
    trials: int | None = None,
    base_seed: int | None = None,
    experiments: Experiments = registry,
) -> Campaign:
    """``campaign`` with settings of the command line on top; a factor of the grid narrows to one value.

    Raises:
        InputError: a setting that the experiment does not know or that is out of range.
    """
    values = campaign.model_dump()
    for key, value in settings.items():
        if key in values["grid"]:
            values["grid"][key] = [value]
        else:
            values["parameters"][key] = value
    values["trials"] = campaign.trials if trials is None else trials
    values["base_seed"] = campaign.base_seed if base_seed is None else base_seed
    changed = parse(Campaign, values, "command line")
    check(changed, "command line", experiments)
    return changed


def parse_settings(settings: Iterable[str], map_file: Path | None = None) -> dict[str, Scalar]:
    """``["capture=contact", "frames=200"]`` as a mapping, values read as YAML scalars.

    Args:
        settings: what ``--set`` gave.
        map_file: what ``--map`` gave, which is short for ``prior_map``.

    Raises:
        InputError: no ``=``, no key, a key given twice or known as another option, or no scalar.
    """
    parsed: dict[str, Scalar] = {}
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
        value = load_yaml(text, option)
        if not isinstance(value, str | int | float | bool | None):
            raise InputError(f"{option}: the value must be one number, word or true/false")
        parsed[key] = value
    if map_file is not None:
        if "prior_map" in parsed:
            raise InputError(
                f"--map {map_file}: --set prior_map={parsed['prior_map']} too; give one of the two"
            )
        parsed["prior_map"] = str(map_file)
    return parsed


def check(campaign: Campaign, source: str, experiments: Experiments = registry) -> None:
    """Raises InputError, prefixed by ``source``, unless every cell is valid and no two are the same."""
    try:
        known = experiments.parameters_model(campaign.experiment).model_fields
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    for section in ("grid", "parameters"):
        for key in getattr(campaign, section):
            if key not in known:
                raise InputError(f"{source}: {section}.{key}: unknown key{nearest_name(key, known)}")
    twice = sorted(set(campaign.grid) & set(campaign.parameters))
    if twice:
        raise InputError(f"{source}: parameters.{twice[0]}: also a factor of the grid; keep one of the two")
    try:
        all_resolved = cells(campaign, experiments, source)
    except InputError:
        # no fault of a cell if the parameters that all cells share are wrong by themselves
        parse(experiments.parameters_model(campaign.experiment), campaign.parameters, f"{source}: parameters")
        raise
    seen: dict[str, dict[str, Scalar]] = {}
    for cell, resolved in zip(_products(campaign), all_resolved, strict=True):
        identity = TrialSpec(campaign.experiment, resolved, 0).trial_id
        if identity in seen:
            raise InputError(f"{source}: grid: the cell {_show(cell)} is there twice")
        seen[identity] = cell


def cells(
    campaign: Campaign, experiments: Experiments = registry, source: str = "campaign"
) -> list[dict[str, Scalar]]:
    """Every cell's parameters, defaults filled in, the grid's last factor changing fastest."""
    model = experiments.parameters_model(campaign.experiment)
    return [
        parse(model, {**campaign.parameters, **cell}, f"{source}: cell {_show(cell)}").model_dump(mode="json")
        for cell in _products(campaign)
    ]


def trials(campaign: Campaign, experiments: Experiments = registry) -> Iterator[TrialSpec]:
    """Every trial, seed by seed, so that an interrupted campaign has visited all cells about equally.

    Trial k of each cell has the seed ``base_seed + k``: cells are compared on the same worlds (common
    random numbers, item 71), because a trial draws its world from its seed and from named axes that
    leave team size and readings out.
    """
    resolved = cells(campaign, experiments)
    for seed in range(campaign.base_seed, campaign.base_seed + campaign.trials):
        for parameters in resolved:
            yield TrialSpec(campaign.experiment, parameters, seed)


def _products(campaign: Campaign) -> list[dict[str, Scalar]]:
    return [
        dict(zip(campaign.grid, values, strict=True)) for values in itertools.product(*campaign.grid.values())
    ]


def _show(cell: Mapping[str, Scalar]) -> str:
    return ", ".join(f"{factor}={value}" for factor, value in cell.items()) or "(the only one)"
