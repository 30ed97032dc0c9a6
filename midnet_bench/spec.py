"""YAML files and key=value settings checked against pydantic models; one clear line when they are wrong."""

from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from midnet_bench.errors import InputError, nearest_name


class Spec(BaseModel):
    """Base of everything a user may write: frozen, and a key that does not exist is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


SpecT = TypeVar("SpecT", bound=BaseModel)


def read_yaml(path: Path) -> Any:
    """What a YAML file says. Raises InputError naming the file when it cannot be read or parsed."""
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text"
        raise InputError(f"{path}: cannot be read: {reason}") from error
    except yaml.YAMLError as error:
        raise InputError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from error


def parse(model: type[SpecT], values: Any, source: str) -> SpecT:
    """``values`` as a ``model``. Raises InputError: ``source: key.path: what is wrong`` (the first fault)."""
    try:
        return model.model_validate(values)
    except ValidationError as error:
        # a mistyped key also leaves the right one missing; the mistyped one explains both
        first = min(error.errors(), key=lambda fault: fault["type"] != "extra_forbidden")
        location = first["loc"]
        key = ".".join(str(part) for part in location) or "(top level)"
        if first["type"] == "extra_forbidden":
            valid = _fields_at(model, location[:-1])
            hint = nearest_name(str(location[-1]), valid)
            raise InputError(f"{source}: {key}: unknown key{hint}") from error
        message = first["msg"].removeprefix("Value error, ")
        got = "" if first["type"] == "missing" else f" (got {_short(first['input'])})"
        raise InputError(f"{source}: {key}: {message}{got}") from error


def _short(value: Any) -> str:
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
