"""Makes ``docs/api.md`` from the docstrings of the public names: ``make api``."""

import ast
import dataclasses
import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

import midnet_bench

PAGE = Path(__file__).with_name("api.md")
GROUPS = {
    "Detection on your own costmaps": (
        "MIDNet",
        "MIDNetSettings",
        "Observation",
        "prior_map",
        "load_map",
        "OccupancyGrid",
        "Pose2D",
        "Box",
    ),
    "Trials and campaigns": (
        "simulate",
        "run",
        "results",
        "compare",
        "verify",
        "error_causes",
        "Campaign",
        "load_campaign",
        "run_campaign",
        "Experiment",
    ),
    "Errors": ("MidnetBenchError", "InputError"),
}
HEAD = """# Python API

`import midnet_bench as mb` loads nothing heavy: each name is imported when it is first used. Only `simulate`,
`run` and `run_campaign` need PyBullet, and with `engine="fast"` neither do they. Paths are `str` or
`pathlib.Path`. Lengths are in metres, angles in radians, times in seconds; poses and boxes are in the map
frame unless their text says otherwise.
`docs/midnet_bench.ipynb` shows all of it at work.

This page is made from the docstrings by `make api`.
"""


def page() -> str:
    """The whole page, Markdown."""
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts.append(f"## {title}\n")
        parts += [_entry(name, getattr(midnet_bench, name)) for name in names]
    return "\n".join(parts).rstrip() + "\n"


def _entry(name: str, value: Any) -> str:
    if not inspect.isclass(value):
        return f"### `{name}{_signature(value)}`\n\n{_markdown(inspect.getdoc(value))}\n"
    lines = [f"### `class {name}{_constructor(value)}`\n", _markdown(inspect.getdoc(value)), ""]
    fields = _fields(value)
    if fields:
        lines += [*(f"- `{field}`{f': {text}' if text else ''}" for field, text in fields), ""]
    for key, member in vars(value).items():
        if key == "__init__" and member.__doc__ and "Initialize self" not in member.__doc__:
            lines += [_markdown(inspect.getdoc(member)), ""]
        if key.startswith(("_", "model_")) or not (
            callable(member) or isinstance(member, property | classmethod)
        ):
            continue
        function = member.__func__ if isinstance(member, classmethod) else member
        is_property = isinstance(member, property)
        heading = f"{name}.{key}" + ("" if is_property else _signature(function, is_method=True))
        lines += [f"#### `{heading}`\n", _markdown(inspect.getdoc(function)), ""]
    return "\n".join(lines)


def _constructor(value: Any) -> str:
    """What its instances are made from; nothing for what nobody makes by hand."""
    if issubclass(value, Exception):
        return f"({value.__bases__[0].__name__})"
    names = [field for field, _ in _fields(value)]
    if names:
        return f"({', '.join(names)})" if len(names) <= 4 else "(...)"
    return _signature(value.__init__, is_method=True)


def _signature(function: Any, is_method: bool = False) -> str:
    signature = inspect.signature(function)
    parameters = list(signature.parameters.values())[1 if is_method else 0 :]
    shown = str(signature.replace(parameters=parameters))
    # the last part of a dotted name says enough
    shown = re.sub(r"\b(?:[A-Za-z_]\w*\.)+([A-Za-z_]\w*)", r"\1", shown)
    return shown.replace("'", "").replace(" -> Self", "")


def _fields(value: Any) -> list[tuple[str, str]]:
    """Fields of a dataclass or a named tuple, each with its docstring or its help."""
    if dataclasses.is_dataclass(value):
        helps = {one.name: _help(one) for one in dataclasses.fields(value)}
    else:
        described = {name: one.description or "" for name, one in getattr(value, "model_fields", {}).items()}
        helps = dict.fromkeys(getattr(value, "_fields", ()), "") | described
    if not helps:
        return []
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(value))).body
    assert isinstance(tree, ast.ClassDef)
    for before, after in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(before, ast.AnnAssign)
            and isinstance(before.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            helps[before.target.id] = " ".join(str(after.value.value).split())
    return [(name, _inline(text)) for name, text in helps.items()]


def _help(field: dataclasses.Field[Any]) -> str:
    """What an option says of itself, with its default."""
    said = field.metadata.get("option")
    return f"{said.help} Default: {field.default}." if said else ""


def _markdown(docstring: str | None) -> str:
    """A Google docstring: its sections as lists."""
    lines: list[str] = []
    section = False
    for line in (docstring or "").splitlines():
        if re.fullmatch(r"(Args|Raises|Returns|Yields):", line):
            lines += [f"**{line.removesuffix(':')}**", ""]
            section = True
        elif section and re.match(r"    \S", line):
            text = line.strip()
            item = re.match(r"(\w+): (.*)", text)
            lines.append(f"- `{item[1]}`: {item[2]}" if item else f"{'' if lines[-1] else '- '}{text}")
            if not item and lines[-1].startswith("- ") is False:
                lines[-1] = f"  {text}"
        elif section and line.startswith("     "):
            lines.append(f"  {line.strip()}")
        else:
            section = section and not line.strip()
            lines.append(line)
    return _inline("\n".join(lines)).strip()


def _inline(text: str) -> str:
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return text.replace("``", "`")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
