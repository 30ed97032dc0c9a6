"""References to Python objects: ``package.module:NAME`` or ``path/file.py:NAME``."""

import hashlib
import importlib
import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from midnet_bench.errors import InputError, nearest_name

FORMS = "expected package.module:NAME or path/file.py:NAME"


def load_reference(reference: str) -> Any:
    """The object that a reference names; its module is imported.

    Args:
        reference: ``package.module:NAME``, or ``path/file.py:NAME`` with a path from the working folder.

    Raises:
        InputError: the reference has another form, the module cannot be found or imported, or it has no such
            name. The message begins with the reference.
    """
    place, colon, name = reference.rpartition(":")
    if not (colon and place and name.isidentifier()):
        raise InputError(f"{reference}: {FORMS}")
    module = _from_file(Path(place), reference) if place.endswith(".py") else _from_package(place, reference)
    if not hasattr(module, name):
        names = [one for one in vars(module) if not one.startswith("_")]
        raise InputError(f"{reference}: no '{name}' in {place}{nearest_name(name, names)}")
    return getattr(module, name)


def later(reference: str) -> Callable[..., Any]:
    """A function that imports the function that ``reference`` names when it is called, and calls it."""

    def call(*arguments: Any, **named: Any) -> Any:
        return load_reference(reference)(*arguments, **named)

    return call


def _from_package(place: str, reference: str) -> ModuleType:
    if not all(part.isidentifier() for part in place.split(".")):
        raise InputError(f"{reference}: {FORMS}")
    try:
        return importlib.import_module(place)
    except Exception as error:
        raise _not_imported(reference, error) from error


def _from_file(path: Path, reference: str) -> ModuleType:
    """The module in a file, executed once for each content that the file has."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{reference}: {path} cannot be read: {error.strerror}") from error
    digest = hashlib.sha256(str(path.resolve()).encode() + content).hexdigest()[:16]
    name = f"midnet_bench_reference_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # classes find their module by its name
    try:
        # what was read, and not bytecode of a file that had the same time and size
        exec(compile(content, str(path), "exec"), module.__dict__)
    except Exception as error:
        del sys.modules[name]
        raise _not_imported(reference, error) from error
    return module


def _not_imported(reference: str, error: Exception) -> InputError:
    what = " ".join(str(error).split())
    return InputError(f"{reference}: cannot be imported: {type(error).__name__}: {what}")
