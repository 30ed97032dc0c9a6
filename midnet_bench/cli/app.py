"""The Typer application that every command file adds to, and its help."""

import inspect
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

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
START = {
    "midnet-bench detection": "the paper's detection table, in about a minute",
    "midnet-bench labyrinth": "the paper's 500 trials; stop and continue any time",
    "midnet-bench detection --detector mine.py:Mine": "your detector, same seeds",
    "midnet-bench replay drive.bag --map map.yaml": "MIDNet on your recording",
}


class Command(TyperCommand):
    """A command whose options stand under their ``rich_help_panel``, in plain text.

    An option of a parameter has the parameter's help, and is not shown where the experiment lacks it.
    """

    def __init__(self, name: str | None, **more: Any) -> None:
        """As Typer makes one."""
        super().__init__(name, **more)
        for option in self.params:
            if isinstance(option, TyperOption) and option.help is None and option.name in options.PARAMETERS:
                option.help = options.help_of(option.name, str(name))
                option.hidden = option.help is None

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the arguments, then the options by heading. Rich does so too, whose import takes longer."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            if record := parameter.get_help_record(ctx):
                heading = "Arguments" if parameter.param_type_name == "argument" else "Options"
                heading = getattr(parameter, "rich_help_panel", None) or heading
                sections.setdefault(heading, []).append(record)
        for heading, records in sections.items():
            with formatter.section(heading):
                formatter.write_dl(records)


class AllCommands(TyperGroup):
    """The whole program: its help begins with what to type first, then names the commands by heading."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """As usual; Typer would import pydantic to see that a flag, such as ``--help``, is not given."""
        for flag in self.get_params(ctx):
            flag.default = False if flag.default is None else flag.default
        return super().parse_args(ctx, args)

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
    group = typer.Typer(invoke_without_command=True, rich_markup_mode=None)
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

    The docstring is the help. A parameter that is a dataclass of options becomes one option per field.

    Args:
        name: of the command; the function's unless given.
        example: a command line that the command's help opens with.
        group: whose command it is, if not the application's own.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        text = inspect.getdoc(function) or ""  # Python drops it with -OO
        group.command(
            name or function.__name__,
            cls=Command,
            help=f"$ {example}\n\n{text}",
            short_help=text.partition("\n\n")[0],  # what a list of commands shows
        )(options.flattened(function))
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
