"""Options that mean the same for every command; a dataclass is a group of them."""

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_type_hints

import typer

from midnet_bench.cli import completion

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Values
    from midnet_bench.campaign.trial import Scalar

RESULTS = Path("results")
"""Where results go unless ``-o`` says otherwise."""


def option(metavar: str | None, help: str, *names: str, **more: Any) -> Any:
    """An option: what stands for its value in the help, its help, and its names where they are not usual."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def flag(help: str, *names: str, **more: Any) -> Any:
    """An option without a value."""
    return typer.Option(*names, help=help, **more)


def argument(metavar: str | None, help: str, complete: Any = None, **more: Any) -> Any:
    """An argument, with what the tab key offers for it."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=complete, **more)


def output_option(metavar: str, help: str) -> Any:
    """The option ``-o``."""
    return option(metavar, help, "-o", "--output")


def parameter(metavar: str = "NAME", **more: Any) -> Any:
    """An option for the parameter of its name, whose declaration the help is made of."""
    return typer.Option(metavar=metavar, help=PARAMETER, show_default=False, **more)


def settings_option(more: str = "") -> Any:
    """The option ``--set``; ``more``: a sentence of its help."""
    text = f"Set any parameter; 'midnet-bench parameters' lists them. {more}May be repeated."
    return option("KEY=VALUE", text, "--set", autocompletion=completion.settings)


Seed = Annotated[int, option("N", "Random seed.", min=0)]
Settings = Annotated[list[str] | None, settings_option()]
Sweep = Annotated[list[str] | None, settings_option("KEY=VALUE,VALUE runs each value. ")]
Map = Annotated[Path | None, option("FILE", "Prior map: the YAML file of a ROS map_server map.", "--map")]
PARAMETER = "="
"""Help of an option whose sentence, range and default are those of the parameter of its name."""
NUMBERS = ("robots", "intruders", "frames")
KEY_OF = {"robot_model": "robot", "metric": "metrics"}
"""option -> its parameter, where that is called otherwise"""
OPTION_OF = {key: name.replace("_", "-") for name, key in KEY_OF.items()}
EXPERIMENT_OF = {"detection": "detection", "labyrinth": "labyrinth", "map": "mapping"}
"""command -> the experiment that its parameters are of"""


def help_of(name: str, command: str) -> str | None:
    """What the help of ``command`` says of the option ``name``; None: its experiment does not have it."""
    from midnet_bench.campaign.definition import load_campaign
    from midnet_bench.experiments.registry import parameters_model
    from midnet_bench.settings import leaves
    from midnet_bench.workflows.campaigns import packaged_campaigns

    key, experiment = KEY_OF.get(name, name), EXPERIMENT_OF.get(command)
    known = [
        leaves(parameters_model(one)) for one in ([experiment] if experiment else EXPERIMENT_OF.values())
    ]
    leaf = next((one[key] for one in known if key in one), None)
    if leaf is None:
        return None
    default: object = leaf.default if experiment else None
    if experiment == command:
        campaign = load_campaign(packaged_campaigns()[command])
        default = campaign.grid.get(key, campaign.parameters.get(key, default))
    texts = [leaf.range] if name in NUMBERS else []
    if default is not None:
        values = default if isinstance(default, list) else [default]
        texts.append("default " + ",".join(map(str, values)))
    sentence = re.split(r"[.;] |\.$", leaf.help)[0]
    return sentence + f" ({'; '.join(texts)})" * bool(texts) + "."


Arena = Annotated[str | None, parameter("ARENA", autocompletion=completion.arenas)]
Engine = Annotated[str | None, parameter()]
RobotModel = Annotated[str | None, parameter()]
Number = Annotated[int | None, parameter("N")]
Numbers = Annotated[str | None, parameter("N,N")]
Part = Annotated[str | None, parameter()]
Jobs = Annotated[int | None, option("N", "Worker processes (default all cores).", min=1)]
Json = Annotated[bool, flag("Print JSON, and nothing else, on standard output.", "--json")]
Wide = Annotated[bool, flag("Print tables with all their columns, however long the lines.", "--wide")]
Trust = Annotated[
    bool,
    flag(
        "Run the code that results from elsewhere name.",
        "--trust",
        callback=lambda value: _trust(value),
        expose_value=False,
    ),
]


def _trust(is_given: bool) -> None:
    if is_given or "midnet_bench.campaign.trust" in sys.modules:
        from midnet_bench.campaign import trust

        trust.all_code = is_given


Given = TypeVar("Given")


@dataclass(frozen=True)
class Campaign:
    """What every command that runs a campaign takes, besides what that campaign is."""

    seeds: Annotated[
        int | None,
        option(
            "N",
            "Seeds: so many trials of each cell (default: detection 1, labyrinth 20, else the campaign's).",
            "--seeds",
            "--trials",  # its name in earlier versions; the help leaves it out
            min=1,
        ),
    ] = None
    seed: Annotated[
        int | None,
        option("N", "First seed; the others count up from it (default 1, or the campaign's).", min=0),
    ] = None
    robots: Numbers = None
    intruders: Numbers = None
    frames: Numbers = None
    arena: Arena = None
    preset: Annotated[Literal["paper", "best"] | None, parameter("paper|best")] = None
    engine: Engine = None
    robot_model: RobotModel = None
    detector: Part = None
    fusion: Part = None
    patrol: Part = None
    pursuit: Part = None
    metric: Annotated[list[str] | None, parameter()] = None
    record: Annotated[
        bool,
        flag(
            "Keep each frame for the player, and the cause of each error of the detection test, which "
            "does so by itself for up to four trials.",
            "--record",
        ),
    ] = False
    map_file: Map = None
    settings: Sweep = None
    output: Annotated[
        Path | None, output_option("DIR", "Folder for the results (default results/CAMPAIGN).")
    ] = None
    jobs: Jobs = None
    backend: Annotated[str, option("NAME", "Where trials run: loky (this machine) or dask.")] = "loky"
    scheduler: Annotated[
        str | None,
        option(
            "ADDRESS",
            "Address of the Dask scheduler, such as tcp://127.0.0.1:8786 (default: on this machine).",
        ),
    ] = None
    dry_run: Annotated[bool, flag("Say what would run, and stop.", "--dry-run", "-n")] = False
    fresh: Annotated[
        bool, flag("Start over; the old results database is kept beside the new one.", "--fresh")
    ] = False
    retry_failed: Annotated[bool, flag("Run trials that failed once more.", "--retry-failed")] = False
    as_json: Json = False
    wide: Wide = False

    def sweep(self, experiment: str) -> "dict[str, Values]":
        """The parameters of the command line by key; several values make a factor of the grid.

        Args:
            experiment: that the campaign is of; a value has to be one that it can have.

        Raises:
            InputError: a setting is no ``key=value``, is out of range, or is given in two ways.
        """
        from midnet_bench.campaign.definition import parse_settings, values_of

        given: dict[str, Values] = {}
        for name, hint in get_type_hints(type(self), include_extras=True).items():
            value = getattr(self, name)
            if hint.__metadata__[0].help != PARAMETER or value is None:
                continue
            key, text = KEY_OF.get(name, name), "; ".join(value) if isinstance(value, list) else value
            if name in NUMBERS:
                given[key] = whole_numbers(text, f"--{key}")
            else:
                given[key] = values_of(text, f"--{key}") if "," in text else text
        given |= {"record": True} if self.record else {}
        settings = _given_once(given, parse_settings(self.settings or [], self.map_file, is_sweep=True))
        check_values(experiment, given, "--{key}")
        check_values(experiment, settings, "--set {key}=")
        return given | settings


@dataclass(frozen=True)
class Messages:
    """What every command takes: how much it says while it works."""

    quiet: Annotated[bool, flag("Say only what goes wrong.", "-q", "--quiet")] = False
    verbose: Annotated[bool, flag("Say more: each trial as it ends.", "-v", "--verbose")] = False
    log_file: Annotated[
        Path | None,
        option("FILE", "Append every message with its time to this file."),
    ] = None


def whole_numbers(text: str, option: str) -> "Values":
    """One whole number, or several between commas. Raises InputError."""
    from midnet_bench.errors import InputError

    try:
        found = [int(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(f"{option} {text}: whole numbers are needed, such as 2 or 1,2,5") from error
    return found[0] if len(found) == 1 else list(found)


def check_values(experiment: str, given: "Mapping[str, Values | None]", option: str) -> None:
    """Refuse an option that the experiment lacks, or a number outside its range.

    Args:
        experiment: its name or a reference.
        given: the values by key; None of what is not given.
        option: what a message begins with, ``{key}`` being the key; ends in ``=`` where the value follows it.

    Raises:
        InputError: names the option, the value and what is allowed.
    """
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.registry import parameters_model
    from midnet_bench.io.parameters import can_be
    from midnet_bench.settings import leaves

    model = parameters_model(experiment)
    known = leaves(model)
    for key, values in given.items():
        if values is None:
            continue
        named = option.format(key=OPTION_OF.get(key, key))
        if key not in known:
            if option.endswith("="):
                continue  # resolving the campaign names the nearest keys
            raise InputError(f"{named} does not go with '{experiment}', which has no such parameter")
        for value in values if isinstance(values, list) else [values]:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if is_number and known[key].range and not can_be(model, key, value):
                gap = "" if option.endswith("=") else " "
                raise InputError(f"{named}{gap}{value}: must be {known[key].range}")


def joined(
    named: "Mapping[str, Scalar | None]", settings: list[str] | None, map_file: Path | None = None
) -> "dict[str, Scalar]":
    """What options, ``--set`` and ``--map`` ask for, by key.

    Args:
        named: values of options that are parameters, such as ``--frames``; None if not given.
        settings: what ``--set`` gave.
        map_file: what ``--map`` gave.

    Raises:
        InputError: a setting is no ``key=value``, or another option names the same parameter.
    """
    from midnet_bench.campaign.definition import parse_settings

    given = {key: value for key, value in named.items() if value is not None}
    return {**given, **_given_once(given, parse_settings(settings or [], map_file))}


def _given_once(named: "Mapping[str, object]", parsed: "dict[str, Given]") -> "dict[str, Given]":
    """``parsed``. Raises InputError if another option names one of its keys."""
    from midnet_bench.errors import InputError

    for name in named:
        if name in parsed:
            raise InputError(f"--set {name}: the command line gives '{name}' without --set too; give it once")
    return parsed
