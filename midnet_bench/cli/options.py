"""Options that several commands share, what the tab key offers for them, and what their values ask for."""

import inspect
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from midnet_bench.cli import messages
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Values
    from midnet_bench.campaign.trial import Scalar

SEED, ROBOTS = 1, 5  # of a trial that is no campaign's, unless the user says otherwise
RESULTS = Path("results")  # Where results go unless ``-o`` says otherwise.
HELP = Path(__file__).with_name("parameter_help.json")
"""command -> option -> help of the parameter that it sets; ``make api`` makes it of the declarations"""
NUMBERS = ("robots", "intruders", "frames")
PARAMETERS = {name: name for name in (*NUMBERS, "arena", "preset", "engine", "detector", "fusion")}
PARAMETERS |= {"patrol": "patrol", "pursuit": "pursuit", "robot_model": "robot", "metric": "metrics"}
"""option -> the parameter that it sets; where it has no help of its own, that of ``HELP`` is shown"""
OPTIONS = {key: name.replace("_", "-") for name, key in PARAMETERS.items()}
ANY = "Set any parameter; 'midnet-bench parameters' lists them."


def flattened(function: Callable[..., None]) -> Callable[..., None]:
    """``function`` with an option for each field of its dataclasses, and with the options of Messages."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(function).parameters.values():
        if is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
        else:
            parameters.append(parameter)
    for group in (*groups.values(), Messages):
        parameters += inspect.signature(group).parameters.values()

    def run(**values: Any) -> None:
        messages.set_up(**_taken(values, Messages))
        messages.announce_compiling()
        options = {name: group(**_taken(values, group)) for name, group in groups.items()}
        function(**values, **options)

    keywords = [parameter.replace(kind=parameter.KEYWORD_ONLY) for parameter in parameters]
    run.__name__, run.__doc__ = function.__name__, function.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in keywords}
    run.__signature__ = inspect.Signature(keywords)  # type: ignore[attr-defined]
    return run


def _taken(values: dict[str, Any], group: Any) -> dict[str, Any]:
    return {field.name: values.pop(field.name) for field in fields(group)}


def help_of(name: str, command: str) -> str | None:
    """What the help of ``command`` says of a parameter's option; None: its experiment lacks the parameter."""
    return _parameter_help().get(command, {}).get(name)


@cache
def _parameter_help() -> dict[str, dict[str, str]]:
    texts: dict[str, dict[str, str]] = json.loads(HELP.read_text(encoding="utf-8"))
    return texts


def offer_experiments(incomplete: str) -> list[str]:
    """Experiments by name."""
    from midnet_bench.experiments.registry import names

    return _beginning(incomplete, names())


def offer_parameters(incomplete: str) -> list[str]:
    """Experiments, then parameters of any of them."""
    from midnet_bench.experiments.registry import names

    return _beginning(incomplete, [*names(), *_keys(names())])


def offer_campaigns(incomplete: str) -> list[str]:
    """Packaged campaigns, then campaign files whose path begins so."""
    from midnet_bench.workflows.campaigns import packaged_campaigns

    return [*_beginning(incomplete, packaged_campaigns()), *_paths(incomplete, ".yaml")]


def offer_arenas(incomplete: str) -> list[str]:
    """Packaged arenas, then YAML files whose path begins so."""
    from midnet_bench.arena.arena import arena_names

    return [*_beginning(incomplete, arena_names()), *_paths(incomplete, ".yaml")]


def offer_results(incomplete: str) -> list[str]:
    """Folders with a campaign's results: those in ``results/``, and any whose path begins so."""
    usual = [str(folder) for folder in sorted(Path("results").glob("*")) if has_results(folder)]
    return list(dict.fromkeys([*_beginning(incomplete, usual), *_paths(incomplete, "")]))


def offer_exported(incomplete: str) -> list[str]:
    """What has guards: experiments by name, then folders with results."""
    return [*_beginning(incomplete, ("detection", "labyrinth")), *offer_results(incomplete)]


def offer_settings(context: typer.Context, incomplete: str) -> list[str]:
    """Parameters of the experiment that the command runs, each with ``=`` behind it."""
    from midnet_bench.experiments.registry import names

    named = str(context.params.get("experiment") or context.info_name)
    return [f"{key}=" for key in _beginning(incomplete, _keys([named] if named in names() else names()))]


def _keys(experiments: Iterable[str]) -> list[str]:
    from midnet_bench.experiments.registry import parameters_model

    return [key for name in experiments for key in parameters_model(name).defaults()]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in dict.fromkeys(names) if name.startswith(incomplete)]


def has_results(folder: Path) -> bool:
    """Whether a campaign's results are in it."""
    return any((folder / name).is_file() for name in ("campaign.sqlite", "configuration.json"))


def _paths(incomplete: str, suffix: str) -> Iterator[str]:
    """Folders, and files that end in ``suffix``, whose path begins with ``incomplete``."""
    folder, slash, beginning = incomplete.rpartition("/")
    try:
        found = sorted(Path(folder + slash).iterdir()) if incomplete else []
    except OSError:
        return
    for path in found:
        if not path.name.startswith(beginning):
            continue
        if path.is_dir():
            yield str(path) if suffix == "" and has_results(path) else f"{path}/"
        elif suffix and path.name.endswith(suffix):
            yield str(path)


def _trust(is_given: bool) -> None:
    if is_given or "midnet_bench.campaign.provenance" in sys.modules:
        from midnet_bench.campaign import provenance

        provenance.all_code = is_given


def _is_folder(directories: "Path | list[Path]") -> "Path | list[Path]":
    """The same. Raises InputError, with a hint, if one is no folder."""
    for each in directories if isinstance(directories, list) else [directories]:
        if each.is_file():
            folder = each.parent if has_results(each.parent) else "such as results/labyrinth"
            raise InputError(f"{each}: this is a file; give a campaign's folder, {folder}")
        if not each.is_dir():
            raise InputError(f"{each}: there is no such folder; give a campaign's, such as results/labyrinth")
    return directories


def results_folder(metavar: str, help: str) -> Any:
    """An argument that names a campaign's folder."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=offer_results, callback=_is_folder)


# of a campaign, by heading
_run_option = partial(typer.Option, rich_help_panel="What runs")
_plugin_option = partial(typer.Option, metavar="NAME", rich_help_panel="What is swapped in")
_output_option = partial(typer.Option, rich_help_panel="Where it goes")
# of a campaign and of other commands
MAP: Any = {"metavar": "FILE", "help": "Prior map: the YAML file of a ROS map_server map."}
ARENA: Any = {"metavar": "ARENA", "autocompletion": offer_arenas}
SET: Any = {"metavar": "KEY=VALUE", "autocompletion": offer_settings}
JOBS: Any = {"metavar": "N", "min": 1, "help": "Worker processes (default all cores)."}
JSON: Any = {"help": "Print JSON, and nothing else, on standard output."}
WIDE: Any = {"help": "Print tables with all their columns, however long the lines."}

Seed = Annotated[int, typer.Option(metavar="N", min=0, help="Random seed.")]
Settings = Annotated[list[str] | None, typer.Option("--set", help=f"{ANY} May be repeated.", **SET)]
Map = Annotated[Path | None, typer.Option("--map", **MAP)]
Arena = Annotated[str | None, typer.Option(**ARENA)]
Plugin = Annotated[str | None, typer.Option(metavar="NAME")]
Number = Annotated[int | None, typer.Option(metavar="N")]
Numbers = Annotated[str | None, _run_option(metavar="N,N")]
CampaignPlugin = Annotated[str | None, _plugin_option()]
Jobs = Annotated[int | None, typer.Option(**JOBS)]
Json = Annotated[bool, typer.Option("--json", **JSON)]
Wide = Annotated[bool, typer.Option("--wide", **WIDE)]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust",
        callback=_trust,
        expose_value=False,
        help="Run the code that results from elsewhere name.",
    ),
]
Where = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FACTOR=VALUE",
        help="Only trials with this value of the grid, such as oracle=none; may be given again.",
    ),
]
ArenaFile = Annotated[
    str,
    typer.Argument(metavar="ARENA", help="A packaged arena or a YAML file.", autocompletion=offer_arenas),
]
ResultsFolder = Annotated[Path, results_folder("DIR", "A campaign's folder, such as results/labyrinth.")]
Given = TypeVar("Given")


@dataclass(frozen=True)
class Campaign:
    """What every command that runs a campaign takes, besides what that campaign is."""

    seeds: Annotated[
        int | None,
        _run_option(
            "--seeds",
            "--trials",
            metavar="N",
            min=1,
            help="Seeds: so many trials of each cell (default: detection 1, labyrinth 20, else the "
            "campaign's).",
        ),
    ] = None
    seed: Annotated[
        int | None,
        _run_option(
            metavar="N", min=0, help="First seed; the others count up from it (default 1, or the campaign's)."
        ),
    ] = None
    robots: Numbers = None
    intruders: Numbers = None
    frames: Numbers = None
    arena: Annotated[str | None, _run_option(**ARENA)] = None
    preset: Annotated[Literal["paper", "best"] | None, _run_option(metavar="paper|best")] = None
    engine: CampaignPlugin = None
    robot_model: CampaignPlugin = None
    detector: CampaignPlugin = None
    fusion: CampaignPlugin = None
    patrol: CampaignPlugin = None
    pursuit: CampaignPlugin = None
    metric: Annotated[list[str] | None, _plugin_option()] = None
    record: Annotated[
        bool,
        _run_option(
            "--record",
            help="Keep each frame for the player, and the cause of each error of the detection test, which "
            "does so by itself for up to four trials.",
        ),
    ] = False
    map_file: Annotated[Path | None, _run_option("--map", **MAP)] = None
    settings: Annotated[
        list[str] | None,
        _run_option("--set", help=f"{ANY} KEY=VALUE,VALUE runs each value. May be repeated.", **SET),
    ] = None
    output: Annotated[
        Path | None,
        _output_option(
            "-o", "--output", metavar="DIR", help="Folder for the results (default results/CAMPAIGN)."
        ),
    ] = None
    jobs: Annotated[int | None, _output_option(**JOBS)] = None
    backend: Annotated[
        str, _output_option(metavar="NAME", help="Where trials run: loky (this machine) or dask.")
    ] = "loky"
    scheduler: Annotated[
        str | None,
        _output_option(
            metavar="ADDRESS",
            help="Address of the Dask scheduler, such as tcp://127.0.0.1:8786 (default: on this machine).",
        ),
    ] = None
    dry_run: Annotated[bool, _output_option("--dry-run", "-n", help="Say what would run, and stop.")] = False
    fresh: Annotated[
        bool,
        _output_option("--fresh", help="Start over; the old results database is kept beside the new one."),
    ] = False
    retry_failed: Annotated[
        bool, _output_option("--retry-failed", help="Run trials that failed once more.")
    ] = False
    as_json: Annotated[bool, _output_option("--json", **JSON)] = False
    wide: Annotated[bool, _output_option("--wide", **WIDE)] = False

    def sweep(self, experiment: str) -> "dict[str, Values]":
        """The parameters of the command line by key; several values make a factor of the grid.

        Args:
            experiment: that the campaign is of; a value has to be one that it can have.

        Raises:
            InputError: a setting is no ``key=value``, is out of range, or is given in two ways.
        """
        from midnet_bench.campaign.definition import parse_settings, values_of

        given: dict[str, Values] = {}
        for name, key in PARAMETERS.items():
            if (value := getattr(self, name)) is None:
                continue
            text = "; ".join(value) if isinstance(value, list) else value
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

    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what goes wrong.")] = False
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say more: each trial as it ends.")] = False
    log_file: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Append every message with its time to this file."),
    ] = None


def whole_numbers(text: str, option: str) -> "Values":
    """One whole number, or several between commas. Raises InputError."""
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
    from midnet_bench.experiments.registry import parameters_model
    from midnet_bench.settings import leaves

    given = {key: values for key, values in given.items() if values is not None}
    # without any, resolving the campaign says what is wrong with its experiment, and in which file
    known = leaves(parameters_model(experiment)) if given else {}
    for key, values in given.items():
        named = option.format(key=OPTIONS.get(key, key))
        if key not in known and option.endswith("="):
            continue  # of an unknown setting, resolving the campaign names the nearest keys
        if key not in known:
            raise InputError(f"{named} does not go with '{experiment}', which has no such parameter")
        for value in values if isinstance(values, list) else [values]:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if is_number and known[key].range and not known[key].allows(value):
                gap = "" if option.endswith("=") else " "
                raise InputError(f"{named}{gap}{value}: must be {known[key].range}")


def joined(
    named: "Mapping[str, Scalar | None]", settings: list[str] | None, map_file: Path | None = None
) -> "dict[str, Scalar]":
    """What options that are parameters, ``--set`` and ``--map`` ask for, by key; None is not given.

    Raises:
        InputError: a setting is no ``key=value``, or another option names the same parameter.
    """
    from midnet_bench.campaign.definition import parse_settings

    given = {PARAMETERS.get(name, name): value for name, value in named.items() if value is not None}
    return {**given, **_given_once(given, parse_settings(settings or [], map_file))}


def _given_once(named: "Mapping[str, object]", parsed: "dict[str, Given]") -> "dict[str, Given]":
    for name in named:
        if name in parsed:
            raise InputError(f"--set {name}: the command line gives '{name}' without --set too; give it once")
    return parsed
