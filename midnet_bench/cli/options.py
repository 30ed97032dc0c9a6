"""Options that mean the same for every command; a dataclass is a group of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

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
Robot = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What the robots are: burger, waffle, another by name, package.module:NAME or file.py:NAME.",
        show_default=False,
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

_MESSAGES = "Messages"
Given = TypeVar("Given")


def _part(help: str) -> Any:
    """An option that names code; ``help`` ends with what comes with the package."""
    more = "another by name, package.module:NAME or file.py:NAME."
    return typer.Option(metavar="NAME", help=f"{help}, {more}", show_default=False)


Pursuit = Annotated[str | None, _part("Which guards pursue whom: nearest")]


@dataclass(frozen=True)
class Campaign:
    """What every command that runs a campaign takes, besides what that campaign is."""

    engine: Engine = None
    robot: Robot = None
    detector: Annotated[str | None, _part("Who detects: midnet")] = None
    fusion: Annotated[str | None, _part("Who fuses the robots' boxes: paper")] = None
    patrol: Annotated[str | None, _part("Where idle guards go: paper")] = None
    metric: Annotated[
        list[str] | None,
        _part("What else is measured: ospa, first_detection, idleness, mot; may be repeated"),
    ] = None
    record: Annotated[
        bool,
        typer.Option("--record", help="Keep each frame, and the cause of each error of the detection test."),
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

    def sweep(self, named: "Mapping[str, Values]") -> "dict[str, Values]":
        """What the command line asks for by key; several values make a factor of the grid.

        Args:
            named: what the command's own options gave; None if not given.

        Raises:
            InputError: a setting is no ``key=value``, or is given in two ways.
        """
        from midnet_bench.campaign.definition import parse_sweep, values_of

        given: dict[str, Values] = {}
        for key, value in {**named, **self._parts, "record": self.record or None}.items():
            if isinstance(value, str) and "," in value:
                given[key] = values_of(value, f"--{key}")
            elif value is not None:
                given[key] = value
        return given | _given_once(given, parse_sweep(self.settings or [], self.map_file))

    @property
    def _parts(self) -> dict[str, str | None]:
        """What stands behind the seams, by option; None if not given."""
        return {
            "engine": self.engine,
            "robot": self.robot,
            "detector": self.detector,
            "fusion": self.fusion,
            "patrol": self.patrol,
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
