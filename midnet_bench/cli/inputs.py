"""The commands that say what can be given: ``parameters``, and ``check`` of code for a seam."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from midnet_bench.cli import completion, options
from midnet_bench.cli.app import command
from midnet_bench.cli.messages import filled, print_json, width
from midnet_bench.errors import InputError, nearest_name

if TYPE_CHECKING:
    from midnet_bench.settings import Leaf


BROKEN = 1  # exit code where something is wrong
LISTED = "; 'midnet-bench parameters EXPERIMENT' lists an experiment's"


@command(example="midnet-bench parameters localization")
def parameters(
    name: Annotated[
        str, options.argument(None, "An experiment, or a parameter of any experiment.", completion.parameters)
    ] = "detection",
    as_json: options.Json = False,
) -> None:
    """List an experiment's parameters: default, range, meaning, source. Of one parameter, say more."""
    from midnet_bench.experiments.registry import names, parameters_model
    from midnet_bench.settings import leaves

    of_all = {one: leaves(parameters_model(one)) for one in names()}
    if name in of_all or ":" in name:
        _list(name, list(leaves(parameters_model(name)).values()), as_json)
        return
    users = {one: known[name] for one, known in of_all.items() if name in known}
    if not users:
        known_names = {*of_all, *(key for known in of_all.values() for key in known)}
        raise InputError(
            f"parameters: no experiment or parameter '{name}'{nearest_name(name, known_names, LISTED)}"
        )
    _explain(name, users, as_json)


def _list(experiment: str, options: "list[Leaf]", as_json: bool) -> None:
    if as_json:
        rows = [_described(one) for one in options]
        print_json({"schema": 1, "experiment": experiment, "parameters": rows})
        return
    lines, group = [experiment], ""
    for one in options:
        if one.group != group:
            lines += ["", one.group]
            group = one.group
        allowed = f" ({one.allowed})" if one.allowed else ""
        texts = [(2, f"{one.key} = {_written(one.default)}{allowed}"), (6, one.help)]
        texts += [(6, f"source: {one.source}")] * bool(one.source)
        for indent, text in texts:
            first, *more = filled(text, width() - indent) or [""]
            lines += [" " * indent + first, *(" " * 6 + line for line in more)]
    typer.echo("\n".join(lines))


def _explain(name: str, users: "dict[str, Leaf]", as_json: bool) -> None:
    from midnet_bench.workflows.readings import readings_of

    readings = readings_of(name)
    if as_json:
        rows = [{"experiment": experiment, **_described(leaf)} for experiment, leaf in users.items()]
        print_json({"schema": 1, "parameter": name, "experiments": rows, "readings": [*map(vars, readings)]})
        return
    typer.echo(name)
    users_of: dict[tuple[str, ...], list[str]] = {}
    for experiment, leaf in users.items():
        said = (leaf.help, _written(leaf.default), leaf.allowed, leaf.source)
        users_of.setdefault(said, []).append(experiment)
    for (help, default, allowed, source), experiments in users_of.items():
        _print_paragraph(help)
        typer.echo(f"  default: {default}\n  allowed: {allowed}\n  experiments: {', '.join(experiments)}")
        if source:
            typer.echo(f"  source: {source}")
    for one in readings:
        source = f" Source: {one.source}." if one.source else ""
        _print_paragraph(f"The paper leaves open (item {one.item}): {one.open}. Here: {one.reading}.{source}")


def _print_paragraph(text: str) -> None:
    """A paragraph, indented, as wide as the terminal."""
    typer.echo("\n" + "\n".join(f"  {line}" for line in filled(text, max(40, width()) - 2)))


def _described(leaf: "Leaf") -> dict[str, Any]:
    limits = leaf.limits
    return {
        "key": leaf.key,
        "default": leaf.default,
        "choices": list(leaf.choices) or None,
        "minimum": limits.get("ge"),
        "above": limits.get("gt"),
        "maximum": limits.get("le"),
        "multiple_of": limits.get("multiple_of"),
        "group": leaf.group or None,
        "help": leaf.help,
        "source": leaf.source or None,
    }


def _written(value: object) -> str:
    """A default as YAML writes it."""
    return str(value).lower() if isinstance(value, bool) else "null" if value is None else str(value)


@command(example="midnet-bench check my_detector.py:Mine")
def check(
    thing: Annotated[
        str,
        options.argument(
            "THING",
            "A detector, fusion, patrol, pursuit, metric, engine or robot: NAME, package.module:NAME or"
            " file.py:NAME.",
        ),
    ],
    as_json: options.Json = False,
) -> None:
    """Check that your plug-in follows the interface: a line for each fault, or 'ok'.

    Runs your code with 0, 1 and 20 robots, in two processes, and checks units, shapes, unchanged inputs and
    repeatable results. The exit code is 1 if anything is wrong.
    """
    from midnet_bench.workflows.check import check as checked_thing

    found = checked_thing(thing)
    if as_json:
        frame_ms = None if found.frame_ms is None else round(found.frame_ms, 3)
        said = {"seam": found.seam, "name": found.name, "faults": found.faults, "frame_ms": frame_ms}
        print_json(said)
    elif found.faults:
        typer.echo("\n".join(found.faults))
    elif found.frame_ms is None:
        typer.echo(f"ok ({found.seam} {found.name})")
    else:
        typer.echo(f"ok, {found.frame_ms:.1f} ms a frame ({found.seam} {found.name}, four robots)")
    if found.faults:
        raise typer.Exit(BROKEN)
