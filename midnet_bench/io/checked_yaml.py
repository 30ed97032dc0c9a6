"""YAML files, and parameters by flat keys, checked by pydantic; one clear line when they are wrong."""

import functools
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self, TypeVar, cast, get_args

import yaml
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic_core import PydanticKnownError

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.io.files import read_bounded
from midnet_bench.settings import Scalar, Settings, leaves


class Spec(BaseModel):
    """Base of everything a user may write: frozen, no number is infinite, and an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _true_is_no_number(cls, value: Any, field: ValidationInfo) -> Any:
        # pydantic takes true for 1; a quoted number may stay, since YAML 1.1 takes 5e-2 for a text
        annotation = cls.model_fields[field.field_name or ""].annotation
        if _has_boolean(value) and not _mentions(annotation, bool):
            for kind, fault in ((int, "int_type"), (float, "float_type")):
                if _mentions(annotation, kind):
                    raise PydanticKnownError(fault)  # type: ignore[arg-type]
        return value


def _has_boolean(value: Any) -> bool:
    return isinstance(value, bool) or (isinstance(value, list | tuple) and any(map(_has_boolean, value)))


def _mentions(annotation: Any, kind: type) -> bool:
    return annotation is kind or any(_mentions(argument, kind) for argument in get_args(annotation))


SpecT = TypeVar("SpecT", bound=BaseModel)


LARGEST_BYTES = 4_000_000  # of a YAML file
MOST_VALUES = 200_000  # in a YAML text, where a reference (``*name``) counts as all that it stands for
MAX_DEPTH = 100  # lists and mappings inside each other that a YAML text may have


class _Loader(yaml.SafeLoader):
    """PyYAML's safe loader, whose every fault is a YAMLError, and which takes no key twice."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        # PyYAML's scanner takes seconds to reach Python's own limit
        if self._depth == MAX_DEPTH:
            raise yaml.YAMLError("nested too deeply")
        self._depth += 1
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:
        mapping = super().compose_mapping_node(anchor)
        seen = set()
        for key, _ in mapping.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise yaml.MarkedYAMLError(
                        problem=f"the key '{key.value}' is there twice; keep one", problem_mark=key.start_mark
                    )
                seen.add((key.tag, key.value))
        return mapping

    def get_single_node(self) -> yaml.Node | None:
        root = super().get_single_node()
        if root is not None and self._values_in(root, {}) > MOST_VALUES:
            raise yaml.YAMLError(f"more than {MOST_VALUES} values, references counted each time")
        return root

    def _values_in(self, node: yaml.Node, known: dict[int, int]) -> int:
        if id(node) in known:
            return known[id(node)]
        known[id(node)] = MOST_VALUES + 1  # until it is known: only what refers to itself is asked before
        count = 1
        if isinstance(node, yaml.SequenceNode):
            count += sum(self._values_in(part, known) for part in node.value)
        elif isinstance(node, yaml.MappingNode):
            count += sum(self._values_in(part, known) for pair in node.value for part in pair)
        known[id(node)] = count
        return count

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, int):
                str(value)  # no message could quote one that is too long for Python to write out
            return value
        # what looks like a number or a date and is none: 2020-13-45, 0b_, !!bool perhaps
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            kind = node.tag.rpartition(":")[2]
            raise yaml.MarkedYAMLError(
                problem=f"{short(node.value)} is not a valid {kind}; if it is a text, put it in quotes",
                problem_mark=node.start_mark,
            ) from error


def load_yaml(text: str, source: str) -> Any:
    """What a YAML text says. Raises InputError: ``source: not valid YAML: `` the line and what is wrong."""
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        what = str(error)
        if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
            what = f"line {error.problem_mark.line + 1}: {error.context or ''} {error.problem}"
        raise InputError(f"{source}: not valid YAML: {' '.join(what.split())}") from error
    except RecursionError as error:
        raise InputError(f"{source}: not valid YAML: nested too deeply") from error


def read_yaml(path: Path) -> Any:
    """What a YAML file says. Raises InputError naming the file when it cannot be read or parsed."""
    return parsed_yaml(read_text(path), str(path))


def read_text(path: Path) -> str:
    """A YAML file's text, not parsed. Raises InputError naming the file when it cannot be read."""
    try:
        return read_bounded(path, LARGEST_BYTES).decode("utf-8")
    except FileNotFoundError as error:
        where = "" if path.is_absolute() else "; the path starts from the working folder"
        raise InputError(f"{path}: cannot be read: {error.strerror}{where}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        is_image = path.suffix.lower() in (".png", ".pgm", ".jpg", ".jpeg")
        what = "an image; a YAML file is needed" if is_image else "not a UTF-8 text"
        raise InputError(f"{path}: cannot be read: {what}") from error
    except (EOFError, zlib.error) as error:
        raise InputError(f"{path}: cannot be read: a damaged gzip file") from error
    except ValueError as error:
        raise InputError(f"{str(path)!r}: cannot be read: no file can have this name") from error


def parsed_yaml(text: str, source: str) -> Any:
    """As ``load_yaml``; a text that says nothing is a fault too."""
    values = load_yaml(text, source)
    if values is None:
        raise InputError(f"{source}: (top level): the file is empty")
    return values


_SCALARS = {"str", "int", "float", "bool"}
_PLAIN_WORDS = {  # What pydantic says in terms of Python, by its fault's type.
    "dict_type": "a mapping of keys to values is needed",
    "model_type": "a mapping of keys to values is needed",
    "int_parsing_size": "the number is too large",
    "tuple_type": "Input should be a valid list",
    "too_short": "too few items; at least {min_length} needed",
    "too_long": "too many items; at most {max_length} allowed",
}


def parse(model: type[SpecT], values: Any, source: str) -> SpecT:
    """``values`` as a ``model``. Raises InputError: ``source: key.path: what is wrong`` (the first fault)."""
    try:
        return model.model_validate(values)
    except InputError as error:  # of a file that a key names
        raise InputError(f"{source}: {error}") from error
    except RecursionError as error:
        raise InputError(f"{source}: nested too deeply") from error
    except ValidationError as error:
        # a mistyped key also leaves the right one missing; the mistyped one explains both
        first = min(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
        location = first["loc"]
        message = first["msg"].removeprefix("Value error, ")
        if first["type"] in _PLAIN_WORDS:
            message = _PLAIN_WORDS[first["type"]].format(**first.get("ctx", {}))
        # pydantic names the kinds that a value may have as if they were keys of it
        if location and location[-1] in _SCALARS:
            is_number = isinstance(first["input"], float)
            wanted = "a finite number" if is_number else "one number, word or true/false"
            location, message = location[:-1], f"{wanted} is needed"
        key = ".".join(str(part) for part in location if part != "") or "(top level)"
        if first["type"] == "extra_forbidden":
            valid = _fields_at(model, location[:-1])
            hint = nearest_name(str(location[-1]), valid)
            raise InputError(f"{source}: {key}: unknown key{hint}") from error
        got = "" if first["type"] == "missing" else f" (got {short(first['input'])})"
        raise InputError(f"{source}: {key}: {message}{got}") from error


def short(value: Any) -> str:
    """A value as messages quote it."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fields_at(model: Any, location: tuple[int | str, ...]) -> list[str]:
    """The names that ``model`` knows at a key path; list indices and union tags are stepped over."""
    candidates = _models_in(model)
    for part in location:
        if not isinstance(part, str):
            continue
        inner = [
            found
            for candidate in candidates
            if part in candidate.model_fields
            for found in _models_in(candidate.model_fields[part].annotation)
        ]
        candidates = inner or candidates
    return sorted({name for candidate in candidates for name in candidate.model_fields})


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]


class Parameters(Settings):
    """Base of an experiment's parameters: a frozen dataclass of its own options and of nested settings."""

    @classmethod
    def parse(cls, values: Mapping[str, Any], source: str) -> Self:
        """What a user wrote, flat keys as read from YAML, checked; files by their contents.

        Raises:
            InputError: ``source: key: what is wrong``: an unknown key, a value of the wrong type or out of
                range, values that do not go together, or a file that cannot be used.
        """
        checked = parse(flat_model(cls), values, source)
        try:
            return cls.from_flat(checked.model_dump(exclude_unset=True)).with_files_read()
        except InputError as error:
            raise InputError(f"{source}: {error}") from error

    @classmethod
    def of(cls, **values: Any) -> Self:
        """The same by keywords: ``DetectionParameters.of(robots=5, thresh_local=90)``."""
        return cls.parse(values, "parameters")

    def with_files_read(self) -> Self:
        """These parameters with the contents of the files that they name, checked. Here: the same."""
        return self

    @property
    def effort(self) -> float:
        """About how long a trial takes, compared with the trials of other cells. Here: all the same."""
        return 1.0

    @property
    def expected_wall_s(self) -> float:
        """About how long a trial takes on one core, seconds, for an estimate before any is measured."""
        return 15.0  # a rule of thumb

    @property
    def remarks(self) -> list[str]:
        """What a user may not expect of these parameters, a line each. Here: nothing."""
        return []

    @classmethod
    def defaults(cls) -> dict[str, Scalar]:
        """The default of every flat key."""
        return {key: leaf.default for key, leaf in leaves(cls).items()}


def flat_model(parameters: type[Settings]) -> type[Spec]:
    """The pydantic model of the flat keys: what YAML and the command line are checked against."""
    return _model(cast(Any, parameters))


@functools.cache
def _model(parameters: type[Settings]) -> type[Spec]:
    named: dict[str, Any] = {}
    for key, leaf in leaves(parameters).items():
        field = Field(leaf.default, description=leaf.help, **cast(Any, leaf.limits))
        named[key] = (leaf.annotation, field)
    return cast(type[Spec], create_model(parameters.__name__, __base__=Spec, **named))
