"""Makes ``docs/api.md`` from the docstrings of the public names: ``make api``."""

import dataclasses
import inspect
import re
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
        "Trials",
        "Report",
    ),
    "Errors": ("MidnetBenchError", "InputError"),
}
HEAD = """# Python API

`import midnet_bench as mb` loads nothing heavy: each name is imported when it is first used. Only `simulate`,
`run` and `run_campaign` need PyBullet, and with `engine="fast"` neither do they. Paths are `str` or
`pathlib.Path`. Lengths are in metres, angles in radians, times in seconds; poses and boxes are in the map
frame unless their text says otherwise.
`docs/midnet_bench.ipynb` shows all of it at work.

`help(mb.MIDNet)` has arguments, shapes, units and errors of a name.
This page is made from the docstrings by `make api`.
"""


def page() -> str:
    """The whole page, Markdown."""
    parts = [HEAD]
    for title, names in GROUPS.items():
        parts.append(f"## {title}\n")
        parts += [_entry(name, getattr(midnet_bench, name)) for name in names] + [""]
    return "\n".join(parts).rstrip() + "\n"


def _entry(name: str, value: Any) -> str:
    """A line for a function; for a class one more for each method and property."""
    if not inspect.isclass(value):
        return f"- `{name}{_signature(value)}`: {_first_sentence(value)}"
    lines = [f"- `class {name}{_constructor(value)}`: {_first_sentence(value)}"]
    for key, member in vars(value).items():
        if key.startswith(("_", "model_")) or not (
            callable(member) or isinstance(member, property | classmethod)
        ):
            continue
        function = member.__func__ if isinstance(member, classmethod) else member
        heading = key + ("" if isinstance(member, property) else _signature(function, is_method=True))
        lines.append(f"  - `.{heading}`: {_first_sentence(function)}")
    return "\n".join(lines)


def _first_sentence(value: Any) -> str:
    paragraph = " ".join((inspect.getdoc(value) or "").partition("\n\n")[0].split())
    return re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"`\1`", paragraph).replace("``", "`")


def _constructor(value: Any) -> str:
    """What its instances are made from; nothing for what nobody makes by hand."""
    if issubclass(value, Exception):
        return f"({value.__bases__[0].__name__})"
    names = _fields(value)
    if names:
        return f"({', '.join(names)})" if len(names) <= 4 else "(...)"
    return _signature(value.__init__, is_method=True)


def _signature(function: Any, is_method: bool = False) -> str:
    signature = inspect.signature(function)
    parameters = list(signature.parameters.values())[1 if is_method else 0 :]
    shown = str(signature.replace(parameters=parameters))
    # the last part of a dotted name says enough
    shown = re.sub(r"\b(?:[A-Za-z_]\w*\.)+([A-Za-z_]\w*)", r"\1", shown)
    shown = re.sub(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[\w+\]\]", "ndarray", shown)
    return shown.replace("'", "").replace(" -> Self", "")


def _fields(value: Any) -> list[str]:
    """Names of the fields of a dataclass, a model or a named tuple."""
    if dataclasses.is_dataclass(value):
        return [field.name for field in dataclasses.fields(value)]
    return [*getattr(value, "_fields", ()), *getattr(value, "model_fields", ())]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
