"""Options of commands: what a docstring says of them, what the tab key offers, and those of every command.

A function or a dataclass declares an option by a parameter with a type; its docstring has a section
``Options`` with a line ``name --names METAVAR>=least: help`` for each, where all but name and help may be
left out.
"""

import ast
import inspect
import json
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_type_hints

import typer

from midnet_bench.cli import messages
from midnet_bench.errors import InputError

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Values
    from midnet_bench.campaign.trial import Scalar

SEED, ROBOTS = 1, 5  # of a trial that is no campaign's, unless the user says otherwise
RESULTS = Path("results")  # Where results go unless ``-o`` says otherwise.
HELP = Path(__file__).with_name("parameter_help.json")
"""command -> option -> what its help says of a parameter; ``make api`` makes it of the declarations"""
PARAMETER = "="  # Help of an option whose sentence, range and default are those of the parameter of its name.
NUMBERS = ("robots", "intruders", "frames")
KEY_OF = {"robot_model": "robot", "metric": "metrics"}
"""option -> its parameter, where that is called otherwise"""
OPTION_OF = {key: name.replace("_", "-") for name, key in KEY_OF.items()}
EXPERIMENT_OF = {"detection": "detection", "labyrinth": "labyrinth", "map": "mapping"}
"""command -> the experiment that its parameters are of"""
USUAL_NAMES = {
    "as_json": ("--json",),
    "map_file": ("--map",),
    "output": ("-o", "--output"),
    "settings": ("--set",),
}
_LINE = re.compile(
    r"(?P<name>\w+)(?P<names>(?: -\S+)*)(?: (?P<metavar>[^:>]\S*?)(?:>=(?P<least>\d+))?)?: (?P<help>.*)"
)


def option(metavar: str | None, help: str, *names: str, **more: Any) -> Any:
    """An option: what stands for its value in the help (None of a flag), its help, its names if not usual."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def argument(metavar: str | None, help: str, complete: Any = None, **more: Any) -> Any:
    """An argument, with what the tab key offers for it."""
    return typer.Argument(metavar=metavar, help=help, autocompletion=complete, **more)


def parameter(metavar: str = "NAME", **more: Any) -> Any:
    """An option for the parameter of its name, whose declaration the help is made of."""
    return typer.Option(metavar=metavar, help=PARAMETER, show_default=False, **more)


def described(function: Any) -> tuple[str, dict[str, re.Match[str]]]:
    """A docstring without its section ``Options``, and by name the parts of that section's lines."""
    docstring = function.__doc__ or ""
    if sys.flags.optimize > 1:  # Python has dropped it
        (node,) = ast.parse(textwrap.dedent(inspect.getsource(function))).body
        docstring = ast.get_docstring(node) or ""  # type: ignore[arg-type]
    text, _, section = inspect.cleandoc(docstring).partition("\n\nOptions:\n")
    lines = [line.strip() for line in re.sub(r"\n {5,}", " ", section).splitlines()]
    found = [_LINE.fullmatch(line) for line in lines]
    assert all(found), f"an option needs 'name: help': {lines}"
    return text, {said["name"]: said for said in found if said}


def declared(function: Any) -> list[inspect.Parameter]:
    """The parameters of a function or a dataclass, those that its docstring describes as Typer's options."""
    _, found = described(function)
    hints = get_type_hints(function, include_extras=True)
    made = []
    for name, one in inspect.signature(function).parameters.items():
        kind = hints[name]
        if said := found.get(name):
            # Typer makes a --no-... for a flag whose name is not given
            usual = USUAL_NAMES.get(name, (f"--{name.replace('_', '-')}",) if kind is bool else ())
            names, limits = (
                said["names"].split() or usual,
                {"min": int(said["least"])} if said["least"] else {},
            )
            kind = Annotated[kind, option(said["metavar"], said["help"], *names, **limits)]
        made.append(one.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=kind))
    return made


def with_flat_options(function: Callable[..., None]) -> Callable[..., None]:
    """``function`` as Typer can read it: every dataclass of options as options of their own, and Messages."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for one in declared(function):
        if is_dataclass(one.annotation):
            groups[one.name] = one.annotation
        else:
            parameters.append(one)
    for group in (*groups.values(), Messages):
        parameters += declared(group)

    def run(**values: Any) -> None:
        messages.set_up(**_take(values, Messages))
        messages.announce_compiling()
        for name, group in groups.items():
            values[name] = group(**_take(values, group))
        function(**values)

    run.__name__ = function.__name__
    run.__annotations__ = {one.name: one.annotation for one in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _take(values: dict[str, Any], group: Any) -> dict[str, Any]:
    return {field.name: values.pop(field.name) for field in fields(group)}


def help_of(name: str, command: str) -> str | None:
    """What the help of ``command`` says of the option ``name``; None: its experiment does not have it."""
    text: str | None = _parameter_help()[command].get(name)
    return text


@cache
def _parameter_help() -> Any:
    return json.loads(HELP.read_text(encoding="utf-8"))


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


def _settings(more: str = "") -> Any:
    text = f"Set any parameter; 'midnet-bench parameters' lists them. {more}May be repeated."
    return option("KEY=VALUE", text, "--set", autocompletion=offer_settings)


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
    return argument(metavar, help, offer_results, callback=_is_folder)


Seed = Annotated[int, option("N", "Random seed.", min=0)]
Settings = Annotated[list[str] | None, _settings()]
Sweep = Annotated[list[str] | None, _settings("KEY=VALUE,VALUE runs each value. ")]
Map = Annotated[Path | None, option("FILE", "Prior map: the YAML file of a ROS map_server map.", "--map")]
Arena = Annotated[str | None, parameter("ARENA", autocompletion=offer_arenas)]
Part = Annotated[str | None, parameter()]
Number = Annotated[int | None, parameter("N")]
Numbers = Annotated[str | None, parameter("N,N")]
Jobs = Annotated[int | None, option("N", "Worker processes (default all cores).", min=1)]
Json = Annotated[bool, option(None, "Print JSON, and nothing else, on standard output.", "--json")]
Wide = Annotated[bool, option(None, "Print tables with all their columns, however long the lines.", "--wide")]
Trust = Annotated[
    bool,
    option(
        None, "Run the code that results from elsewhere name.", "--trust", callback=_trust, expose_value=False
    ),
]
Where = Annotated[
    list[str] | None,
    option(
        "FACTOR=VALUE", "Only trials with this value of the grid, such as oracle=none; may be given again."
    ),
]
ArenaFile = Annotated[str, argument("ARENA", "A packaged arena or a YAML file.", offer_arenas)]
ResultsFolder = Annotated[Path, results_folder("DIR", "A campaign's folder, such as results/labyrinth.")]
Given = TypeVar("Given")


@dataclass(frozen=True)
class Campaign:
    """What every command that runs a campaign takes, besides what that campaign is.

    Options:
        seeds --seeds --trials N>=1: Seeds: so many trials of each cell (default: detection 1, labyrinth 20,
            else the campaign's).
        seed N>=0: First seed; the others count up from it (default 1, or the campaign's).
        record: Keep each frame for the player, and the cause of each error of the detection test, which does
            so by itself for up to four trials.
        output DIR: Folder for the results (default results/CAMPAIGN).
        backend NAME: Where trials run: loky (this machine) or dask.
        scheduler ADDRESS: Address of the Dask scheduler, such as tcp://127.0.0.1:8786 (default: on this
            machine).
        dry_run --dry-run -n: Say what would run, and stop.
        fresh: Start over; the old results database is kept beside the new one.
        retry_failed: Run trials that failed once more.
    """

    seeds: int | None = None
    seed: int | None = None
    robots: Numbers = None
    intruders: Numbers = None
    frames: Numbers = None
    arena: Arena = None
    preset: Annotated[Literal["paper", "best"] | None, parameter("paper|best")] = None
    engine: Part = None
    robot_model: Part = None
    detector: Part = None
    fusion: Part = None
    patrol: Part = None
    pursuit: Part = None
    metric: Annotated[list[str] | None, parameter()] = None
    record: bool = False
    map_file: Map = None
    settings: Sweep = None
    output: Path | None = None
    jobs: Jobs = None
    backend: str = "loky"
    scheduler: str | None = None
    dry_run: bool = False
    fresh: bool = False
    retry_failed: bool = False
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
            value, (said, *_) = getattr(self, name), getattr(hint, "__metadata__", (None,))
            if value is None or getattr(said, "help", None) != PARAMETER:
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
    """What every command takes: how much it says while it works.

    Options:
        quiet -q --quiet: Say only what goes wrong.
        verbose -v --verbose: Say more: each trial as it ends.
        log_file FILE: Append every message with its time to this file.
    """

    quiet: bool = False
    verbose: bool = False
    log_file: Path | None = None


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
        named = option.format(key=OPTION_OF.get(key, key))
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

    given = {KEY_OF.get(name, name): value for name, value in named.items() if value is not None}
    return {**given, **_given_once(given, parse_settings(settings or [], map_file))}


def _given_once(named: "Mapping[str, object]", parsed: "dict[str, Given]") -> "dict[str, Given]":
    for name in named:
        if name in parsed:
            raise InputError(f"--set {name}: the command line gives '{name}' without --set too; give it once")
    return parsed
