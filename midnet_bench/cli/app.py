"""The Typer application that every command file adds to, and the standard output that they print on."""

import contextlib
import dataclasses
import errno
import inspect
import io
import json
import os
import select
import sys
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from midnet_bench import __version__
from midnet_bench.cli import messages, options
from midnet_bench.errors import InputError, MidnetBenchError

READER_GONE = 141
"""exit code of a program whose reader has closed the pipe, as a shell reports it"""
CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


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
MOVED_OPTIONS = {"--robot": "--robot-model"}
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
        records: dict[str, list[tuple[str, str]]] = {"Arguments": [], **{group: [] for group in GROUPS}}
        records["Options"] = []
        group_of = {name: group for group, names in GROUPS.items() for name in names.split()}
        is_grouped = any(one.name == "backend" for one in self.params)
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is None:
                continue
            if getattr(one, "help", None) == options.PARAMETER:
                if (text := options.help_of(one.name or "", ctx.info_name)) is None:
                    continue
                record = (record[0], text + " May be repeated." * one.multiple)
            if one.param_type_name == "argument":
                group = "Arguments"
            else:
                group = group_of.get(one.name or "", "Options") if is_grouped else "Options"
            records[group].append((record[0].replace(", --trials", ""), record[1]))
        for group, rows in records.items():
            if rows:
                with formatter.section(group):
                    formatter.write_dl(rows)


class Commands(TyperGroup):
    """Lists the commands of a group. Typer does so itself by rich, whose import takes longer."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write each command with the first sentence of its help."""
        width = max(map(len, self.commands))
        with formatter.section("Commands"):
            formatter.write_dl(
                [(f"{name:{width}}", one.short_help or "") for name, one in self.commands.items()]
            )


class AllCommands(Commands):
    """The whole program: its help begins with what to type first, then names the commands by heading."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """As usual; a command of an earlier version says where it went. Raises InputError."""
        if args and args[0] in MOVED:
            raise InputError(f"{args[0]}: now 'midnet-bench {MOVED[args[0]]}'")
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of ``midnet-bench`` alone."""
        lines = ["midnet-bench: how well does a team of LiDAR robots guard a building?", "", "Start here"]
        longest = max(map(len, START))
        for text, meaning in START.items():
            width = longest if len(text) > 30 else min(map(len, START))
            line = f"  {text:{width}}   {meaning}"
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


def print_json(document: Any) -> None:
    """Print one JSON document."""
    typer.echo(json.dumps(document, indent=1, allow_nan=False))


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

    A parameter that is a dataclass of options becomes one option per field. The docstring is the help.

    Args:
        name: of the command; the function's unless given.
        example: a command line that the command's help opens with.
        group: whose command it is, if not the application's own.
    """

    def register(function: Callable[..., None]) -> Callable[..., None]:
        paragraphs = [
            " ".join(part.split()) for part in inspect.cleandoc(function.__doc__ or "").split("\n\n")
        ]
        group.command(
            name,
            cls=Command,
            help="\n\n".join((f"$ {example}", *paragraphs)),
            short_help=paragraphs[0],  # what the list of commands shows, under the heading
        )(_with_flat_options(function))
        return function

    return register


def _with_flat_options(function: Callable[..., None]) -> Callable[..., None]:
    """``function`` as Typer can read it: every dataclass of options as options of their own, and Messages."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        if dataclasses.is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    for group in (*groups.values(), options.Messages):
        parameters += _options_of(group)

    def run(**values: Any) -> None:
        messages.set_up(**_take(values, options.Messages))
        messages.announce_compiling()
        for name, group in groups.items():
            values[name] = group(**_take(values, group))
        function(**values)

    run.__name__ = function.__name__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _options_of(group: Any) -> list[inspect.Parameter]:
    hints = get_type_hints(group, include_extras=True)
    return [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in dataclasses.fields(group)
    ]


def _take(values: dict[str, Any], group: Any) -> dict[str, Any]:
    """The fields of ``group``, out of ``values``."""
    return {field.name: values.pop(field.name) for field in dataclasses.fields(group)}


@contextlib.contextmanager
def printing() -> Iterator[None]:
    """Standard output for one command, written out to its last line.

    Raises:
        MidnetBenchError: it is closed, or cannot be written.
        SystemExit: 141; the reader of the pipe has gone.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 - for as long as the process lasts
        os.set_inheritable(sys.stderr.fileno(), True)  # as number 2: workers need one
    if sys.stdout is None:
        # the next file to be opened would take its number, and what a library in C prints would land there
        raise MidnetBenchError("standard output is closed; direct it somewhere, such as to /dev/null")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # for characters that the terminal lacks
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as error:
        # rich and typer make the one into the other; an exit for any other reason stays as it is
        if isinstance(error, SystemExit) and not isinstance(error.__context__, BrokenPipeError):
            raise
        if not _reader_has_gone():
            raise MidnetBenchError(
                "a connection to another program broke: it has ended, or was ended; run the command again"
            ) from error
        _drop_the_rest()
        raise SystemExit(READER_GONE) from None
    except OSError as error:
        if error.errno not in CANNOT_WRITE:
            raise
        _drop_the_rest()
        raise MidnetBenchError(f"the output cannot be written: {error.strerror}") from error


def _reader_has_gone() -> bool:
    """Whether standard output is a pipe without a reader."""
    if not hasattr(select, "poll"):  # Windows tells no more
        return True
    poll = select.poll()
    try:
        output = sys.stdout.fileno()
        if os.path.samestat(os.fstat(output), os.stat(os.devnull)):
            return True  # rich has put it in the place of the broken output
        poll.register(output, 0)
    except OSError:  # it is no file
        return False
    return any(event & (select.POLLERR | select.POLLHUP) for _, event in poll.poll(0))


def _drop_the_rest() -> None:
    """Send what is still buffered to /dev/null: Python would try to write it again when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


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
