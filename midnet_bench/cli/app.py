"""The Typer application that every command file adds to, and its help."""

from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from midnet_bench import __version__
from midnet_bench.cli import options
from midnet_bench.errors import InputError

PANELS = {
    "Run": ("detection", "labyrinth", "run", "size"),
    "Look": ("report", "compare", "verify", "errors", "render"),
    "Prepare": ("arena", "map", "check", "parameters"),
    "Recordings": ("replay", "export", "node"),
}
"""heading of the help -> its commands, in the order in which people need them"""
MOVED = {
    "campaigns": "run, without a name",
    "plot": "report DIR --x FACTOR --y COLUMN --format pdf,png,svg",
    "leaderboard": "compare --rank DIR",
    "explain": "errors DIR --frame N",
    "power": "verify DIR --difference POINTS",
    "smoke": "run smoke-detection, then compare --exact results/smoke-detection; make smoke does both tests",
    "ros1-node": "node --ros 1",
}
"""command of an earlier version -> what does it now"""
MOVED_OPTIONS = {"--robot": "--robot-model", "--place": "--start found"}
GROUPS = {
    "What runs": "seeds seed robots intruders frames arena preset map_file settings record",
    "What is swapped in": "engine robot_model detector fusion patrol pursuit metric",
    "Where it goes": "output jobs backend scheduler dry_run fresh retry_failed as_json wide",
}
"""heading -> options of the commands that run campaigns; all others come last"""
START = {
    "midnet-bench detection": "the paper's detection table, in about a minute",
    "midnet-bench labyrinth": "the paper's 500 trials; stop and continue any time",
    "midnet-bench detection --detector mine.py:Mine": "your detector, same seeds",
    "midnet-bench replay drive.bag --map map.yaml": "MIDNet on your recording",
}


class Command(TyperCommand):
    """A command whose help has its options in groups where there are many."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options by group."""
        is_grouped = any(one.name == "backend" for one in self.params)
        group_of = {name: group for group, names in GROUPS.items() for name in names.split() if is_grouped}
        records: dict[str, list[tuple[str, str]]] = {name: [] for name in ("Arguments", *GROUPS, "Options")}
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is None:
                continue
            name, text = one.name or "", record[1]
            if getattr(one, "help", None) == options.PARAMETER:
                if (found := options.help_of(name, ctx.info_name)) is None:
                    continue
                text = found + " May be repeated." * one.multiple
            group = group_of.get(name, "Options") if one.param_type_name == "option" else "Arguments"
            records[group].append((record[0].replace(", --trials", ""), text))
        for group, rows in records.items():
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)


class Commands(TyperGroup):
    """Lists the commands of a group. Typer does so itself by rich, whose import takes longer."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each command with the first sentence of its help."""
        width = max(map(len, self.commands))
        rows = [(f"{name:{width}}", one.short_help or "") for name, one in self.commands.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


class AllCommands(Commands):
    """The whole program: its help begins with what to type first, then names the commands by heading."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """As usual; Typer would import pydantic to see that a flag, such as ``--help``, is not given."""
        for flag in self.get_params(ctx):
            flag.default = False if flag.default is None else flag.default
        return super().parse_args(ctx, args)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """As usual; a command of an earlier version says where it went. Raises InputError."""
        if args and args[0] in MOVED:
            raise InputError(f"{args[0]}: now 'midnet-bench {MOVED[args[0]]}'")
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of ``midnet-bench`` alone."""
        lines = ["midnet-bench: how well does a team of LiDAR robots guard a building?", "", "Start here"]
        longest, shortest = max(map(len, START)), min(map(len, START))
        for text, meaning in START.items():
            line = f"  {text:{longest if len(text) > 30 else shortest}}   {meaning}"
            # formatter.width is two less than the terminal's
            lines += [line] if len(line) <= formatter.width + 2 else [f"  {text}", f"      {meaning}"]
        width = max(map(len, PANELS))
        lines += ["", *(f"{panel:{width}}   {'  '.join(names)}" for panel, names in PANELS.items()), ""]
        lines += ["midnet-bench COMMAND -h explains a command, with an example."]
        lines += ["--version prints the version; --install-completion sets up the tab key."]
        formatter.write("\n".join(lines) + "\n")


app = typer.Typer(
    name="midnet-bench",
    cls=AllCommands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def add_group(name: str, help: str) -> typer.Typer:
    """A command that has commands."""
    group = typer.Typer(cls=Commands, invoke_without_command=True, rich_markup_mode=None)
    group.callback()(_help_without_command)
    app.add_typer(group, name=name, help=help, short_help=help)
    return group


def _help_without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help(), err=True)
        raise typer.Exit(InputError.exit_code)


def command(
    name: str | None = None, *, example: str, group: typer.Typer = app
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a command; it also takes the options of :class:`options.Messages`.

    The docstring is the help, and describes options as ``options`` says. A parameter that is a dataclass of
    options becomes one option per field.

    Args:
        name: of the command; the function's unless given.
        example: a command line that the command's help opens with.
        group: whose command it is, if not the application's own.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        text, _ = options.described(function)
        paragraphs = [" ".join(part.split()) for part in text.split("\n\n")]
        group.command(
            name,
            cls=Command,
            help="\n\n".join((f"$ {example}", *paragraphs)),
            short_help=paragraphs[0],  # what the list of commands shows, under the heading
        )(options.with_flat_options(function))
        return function

    return register


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"midnet-bench {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version."
    ),
) -> None:
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())
