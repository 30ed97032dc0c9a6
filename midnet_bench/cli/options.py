"""Options that mean the same for every command; a dataclass is a group of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from midnet_bench.cli import completion

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Values
    from midnet_bench.campaign.trial import Scalar

RESULTS = Path("results")
"""Where results go unless ``-o`` says otherwise."""

Seed = Annotated[int, typer.Option(min=0, metavar="N", help="Random seed.")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Set any parameter; 'midnet-bench parameters' lists them. May be repeated.",
        autocompletion=completion.settings,
    ),
]
Sweep = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Set any parameter; 'midnet-bench parameters' lists them. KEY=VALUE,VALUE runs each value. "
        "May be repeated.",
        autocompletion=completion.settings,
    ),
]
Map = Annotated[
    Path | None,
    typer.Option("--map", metavar="FILE", help="Prior map: the YAML file of a ROS map_server map."),
]
Arena = Annotated[
    str | None,
    typer.Option(
        metavar="ARENA",
        help="Packaged arena (map1, map2, empty, office, people, people-pausing) or a YAML file.",
        show_default=False,
        autocompletion=completion.arenas,
    ),
]
Engine = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What simulates: bullet (PyBullet), fast (our own, several times as fast), another by name, "
        "package.module:NAME or file.py:NAME.",
        show_default=False,
    ),
]
RobotModel = Annotated[
    str | None,
    typer.Option(
        "--robot-model",
        metavar="NAME",
        help="What the robots are: burger, waffle, another by name, package.module:NAME or file.py:NAME.",
        show_default=False,
    ),
]
Preset = Annotated[
    Literal["paper", "best"] | None,
    typer.Option(
        help="Parameters to begin with: the paper's (default), or those that detect best.", show_default=False
    ),
]
Jobs = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Worker processes (default all cores).",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on standard output.")]
Wide = Annotated[
    bool, typer.Option("--wide", help="Print tables with all their columns, however long the lines.")
]

OPTION_OF = {"robot": "robot-model", "metrics": "metric"}
"""key -> its option, where that is called otherwise"""
_MESSAGES = "Messages"
Given = TypeVar("Given")


def _part(help: str) -> Any:
    """An option that names code; ``help`` ends with what comes with the package."""
    more = "another by name, package.module:NAME or file.py:NAME."
    return typer.Option(metavar="NAME", help=f"{help}, {more}", show_default=False)


Pursuit = Annotated[str | None, _part("Which guard pursues which intruder: nearest")]


@dataclass(frozen=True)
class Campaign:
    """What every command that runs a campaign takes, besides what that campaign is."""

    seeds: Annotated[
        int | None,
        typer.Option(
            "--seeds",
            "--trials",  # its name in earlier versions; the help leaves it out
            min=1,
            metavar="N",
            help="Seeds: so many trials of each cell (default: detection 1, labyrinth 20, else the "
            "campaign's).",
        ),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option(
            min=0, metavar="N", help="First seed; the others count up from it (default 1, or the campaign's)."
        ),
    ] = None
    robots: Annotated[
        str | None,
        typer.Option(
            metavar="N,N", help="Team sizes, such as 2,3,4 (default: detection 1,5, labyrinth 1,2,3,4,5)."
        ),
    ] = None
    intruders: Annotated[
        str | None,
        typer.Option(
            metavar="N,N",
            help="Numbers of robots that intrude, such as 1,2 (default: detection as in the arena, "
            "labyrinth 1,2,3,4,5).",
        ),
    ] = None
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="N", help="Frames of a trial, 5 a second (default: detection 1999; not in the labyrinth)."
        ),
    ] = None
    arena: Arena = None
    preset: Preset = None
    engine: Engine = None
    robot_model: RobotModel = None
    detector: Annotated[str | None, _part("Detector: midnet")] = None
    fusion: Annotated[str | None, _part("Fusion of the robots' boxes: paper")] = None
    patrol: Annotated[str | None, _part("Where idle guards go: paper")] = None
    pursuit: Pursuit = None
    metric: Annotated[
        list[str] | None,
        _part("Further metrics, may be repeated: ospa, first_detection, idleness, mot"),
    ] = None
    record: Annotated[
        bool,
        typer.Option(
            "--record",
            help="Keep each frame for the player, and the cause of each error of the detection test, which "
            "does so by itself for up to four trials.",
        ),
    ] = False
    map_file: Map = None
    settings: Sweep = None
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Folder for the results (default results/CAMPAIGN).",
        ),
    ] = None
    jobs: Jobs = None
    backend: Annotated[
        str, typer.Option(metavar="NAME", help="Where trials run: loky (this machine) or dask.")
    ] = "loky"
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Address of the Dask scheduler, such as tcp://127.0.0.1:8786."),
    ] = None
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="Say what would run, and stop.")] = False
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start over; the old results database is kept beside the new one.")
    ] = False
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Run trials that failed once more.")
    ] = False
    as_json: Json = False
    wide: Wide = False

    def sweep(self, experiment: str) -> "dict[str, Values]":
        """What the command line asks for by key; several values make a factor of the grid.

        Args:
            experiment: that the campaign is of; a value has to be one that it can have.

        Raises:
            InputError: a setting is no ``key=value``, is out of range, or is given in two ways.
        """
        from midnet_bench.campaign.definition import parse_sweep, values_of

        given: dict[str, Values] = {}
        numbers = {"robots": self.robots, "intruders": self.intruders, "frames": self.frames}
        for key, text in numbers.items():
            if text is not None:
                given[key] = whole_numbers(text, f"--{key}")
        for key, value in {**self._parts, "record": self.record or None}.items():
            if isinstance(value, str) and "," in value:
                given[key] = values_of(value, f"--{key}")
            elif value is not None:
                given[key] = value
        settings = _given_once(given, parse_sweep(self.settings or [], self.map_file))
        check_values(experiment, given, "--{key}")
        check_values(experiment, settings, "--set {key}=")
        return given | settings

    @property
    def _parts(self) -> dict[str, str | None]:
        """What stands behind the seams, by option; None if not given."""
        return {
            "arena": self.arena,
            "preset": self.preset,
            "engine": self.engine,
            "robot": self.robot_model,
            "detector": self.detector,
            "fusion": self.fusion,
            "patrol": self.patrol,
            "pursuit": self.pursuit,
            "metrics": "; ".join(self.metric) if self.metric else None,
        }


@dataclass(frozen=True)
class Messages:
    """What every command takes: how much it says while it works."""

    quiet: Annotated[
        bool,
        typer.Option("-q", "--quiet", help="Say only what goes wrong.", rich_help_panel=_MESSAGES),
    ] = False
    verbose: Annotated[
        bool,
        typer.Option("-v", "--verbose", help="Say more: each trial as it ends.", rich_help_panel=_MESSAGES),
    ] = False
    log_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Append every message with its time to this file.", rich_help_panel=_MESSAGES
        ),
    ] = None


def whole_numbers(text: str, option: str) -> "Values":
    """One whole number, or several between commas. Raises InputError."""
    from midnet_bench.errors import InputError

    try:
        found = [int(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(f"{option} {text}: whole numbers are needed, such as 2 or 1,2,5") from error
    return found[0] if len(found) == 1 else list(found)


def check_values(experiment: str, given: "Mapping[str, Values]", option: str) -> None:
    """Refuse an option that the experiment lacks, or a number outside its range.

    Args:
        experiment: its name or a reference.
        given: the values by key.
        option: what a message begins with, ``{key}`` being the key; ends in ``=`` where the value follows it.

    Raises:
        InputError: names the option, the value and what is allowed.
    """
    from midnet_bench.errors import InputError
    from midnet_bench.experiments.registry import parameters_model
    from midnet_bench.settings import leaves

    known = leaves(parameters_model(experiment))
    for key, values in given.items():
        named = option.format(key=OPTION_OF.get(key, key))
        if key not in known:
            if option.endswith("="):
                continue  # whoever resolves the campaign says which keys are near
            raise InputError(f"{named} does not go with '{experiment}', which has no such parameter")
        for value in values if isinstance(values, list) else [values]:
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if is_number and not known[key].is_of_its_kind(value) and known[key].option.allowed:
                gap = "" if option.endswith("=") else " "
                raise InputError(f"{named}{gap}{value}: must be {known[key].option.allowed}")


def settings_with(
    named: "Mapping[str, object]", settings: list[str] | None, map_file: Path | None = None
) -> "dict[str, Scalar]":
    """What ``--set`` and ``--map`` ask for.

    Args:
        named: what options of their own gave for parameters, such as ``--frames``; None if not given.
        settings: what ``--set`` gave.
        map_file: what ``--map`` gave.

    Raises:
        InputError: a setting is no ``key=value``, or an option of its own names the same parameter.
    """
    from midnet_bench.campaign.definition import parse_settings

    return _given_once(named, parse_settings(settings or [], map_file))


def _given_once(named: "Mapping[str, object]", parsed: "dict[str, Given]") -> "dict[str, Given]":
    """``parsed``. Raises InputError if an option of its own names one of its keys."""
    from midnet_bench.errors import InputError

    for name, value in named.items():
        if name in parsed and value is not None:
            raise InputError(f"--set {name}: the command line gives '{name}' without --set too; give it once")
    return parsed
