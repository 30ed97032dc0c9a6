"""References to Python objects: ``package.module:NAME`` or ``path/file.py:NAME``.

A file that a trial needs is known by a digest of its bytes, and travels to the workers with the trial: they
may run on another machine, and the file may change while they do.
"""

import hashlib
import importlib
import importlib.util
import inspect
import pickle
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

from midnet_bench.errors import InputError, nearest_name

EXECUTED = "midnet_bench_reference_"
"""what the names of modules begin with that are read from a user's file or cell"""
DIGITS = 12
"""of the digests, hexadecimal"""
FORMS = "expected package.module:NAME or path/file.py:NAME"


class Source(NamedTuple):
    """A file with code, as it was read."""

    name: str
    """without its folder"""
    content: bytes
    pickled: bytes = b""
    """of a class or function that is in no file, such as one of a notebook's cell; ``content`` is then its
    source and that of what it calls there"""


_KNOWN: dict[str, Source] = {}
"""digest -> file: those that this process has read, or was handed with a trial"""
_MADE: dict[str, Any] = {}
"""digest -> the class or function that was pickled"""


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
    if place.endswith(".py"):
        path = Path(place)
        content = _read(path, reference)
        digest = hashlib.sha256(str(path.resolve()).encode() + content).hexdigest()
        module = _executed(digest, place, content, reference)
    else:
        module = _from_package(place, reference)
    return _named(name, module, place, reference)


def read_source(path: Path, reference: str) -> str:
    """The digest of a file, whose code :func:`from_source` finds from now on.

    Raises:
        InputError: the file cannot be read; the message begins with ``reference``.
    """
    content = _read(path, reference)
    digest = hashlib.sha256(content).hexdigest()[:DIGITS]
    _KNOWN[digest] = Source(path.name, content)
    return digest


def from_source(digest: str, name: str, reference: str) -> Any:
    """The object ``name`` of the file with that digest; the file is executed once.

    Raises:
        InputError: no such file was read or handed over, it cannot be executed, or it has no such name.
    """
    if digest not in _KNOWN:
        raise InputError(f"{reference}: no file with the digest {digest} is known here; give its path")
    file, content, pickled = _KNOWN[digest]
    if pickled:
        if digest not in _MADE:
            _MADE[digest] = pickle.loads(pickled)
        return _MADE[digest]
    return _named(name, _executed(digest, file, content, reference), file, reference)


def reference_to(value: Any) -> Any:
    """The reference to a class or function, with a digest of its source; any other value as it is.

    One in a package is referred to by its module, one in another file by that file. One of a notebook's cell
    or of the program itself is pickled, and its digest is that of its source, of the functions and classes
    beside it that it uses, and of the constants: a changed cell makes other trials.

    Raises:
        InputError: it has no source, as one typed at Python's own prompt, or it cannot be pickled.
    """
    if not (inspect.isclass(value) or inspect.isfunction(value)):
        return value
    name = value.__qualname__
    try:
        if value.__module__ != "__main__" and "<" not in name and "." not in name:
            is_in_package = "." in value.__module__
            return f"{value.__module__ if is_in_package else inspect.getsourcefile(value)}:{name}"
        content = "\n".join(_sources_of(value, {})).encode()
        import cloudpickle

        pickled = cloudpickle.dumps(value)
    except (OSError, TypeError, pickle.PicklingError) as error:
        raise InputError(
            f"{name}: cannot be handed to the workers: {error}; put it into a file and give 'file.py:{name}'"
        ) from error
    digest = hashlib.sha256(content).hexdigest()[:DIGITS]
    file = f"{value.__module__.strip('_')}.py"
    _KNOWN[digest], _MADE[digest] = Source(file, content, pickled), value
    return f"{file}:{value.__name__}#{digest}"


def _sources_of(value: Any, known: dict[str, str]) -> list[str]:
    """The source of a class or function, and of what it uses of its own module, each once and in order."""
    if value.__qualname__ in known:
        return []
    known[value.__qualname__] = ""
    found = [textwrap.dedent(_source_of(value))]
    members = vars(value).values() if inspect.isclass(value) else [value]
    functions = [getattr(one, "__func__", getattr(one, "fget", one)) for one in members]
    used: list[Any] = [*value.__bases__] if inspect.isclass(value) else []
    for function in filter(inspect.isfunction, functions):
        for name in sorted(_names_in(function.__code__)):
            other = function.__globals__.get(name)
            if isinstance(other, str | int | float | tuple | bool):
                found.append(f"{name} = {other!r}")
            elif inspect.isclass(other) or inspect.isfunction(other):
                used.append(other)
    for other in used:
        if other.__module__ == value.__module__:
            found += _sources_of(other, known)
    return found


def _source_of(value: Any) -> str:
    """The source of a class or function; of a notebook's class the sources of its functions, by their lines.

    Before Python 3.13 a class does not know its lines, and a cell's module has no file to look for it in.

    Raises:
        OSError, TypeError: it has none.
    """
    try:
        return inspect.getsource(value)
    except (OSError, TypeError):
        functions = [one for one in vars(value).values() if inspect.isfunction(one)]
        if not functions:
            raise
        plain = {name: one for name, one in vars(value).items() if isinstance(one, str | int | float | tuple)}
        return f"class {value.__qualname__}: {plain!r}\n" + "".join(map(inspect.getsource, functions))


def _names_in(code: CodeType) -> set[str]:
    inner = [const for const in code.co_consts if isinstance(const, CodeType)]
    return {*code.co_names}.union(*map(_names_in, inner))


def sources(digests: set[str]) -> dict[str, Source]:
    """Those of the known files that have one of ``digests``."""
    return {digest: _KNOWN[digest] for digest in sorted(digests & _KNOWN.keys())}


def take_sources(handed: Mapping[str, Source]) -> None:
    """Know files that another process has read."""
    _KNOWN.update(handed)


def _named(name: str, module: ModuleType, place: str, reference: str) -> Any:
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


def _read(path: Path, reference: str) -> bytes:
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise InputError(f"{reference}: {path} is no file; give one with Python code")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{reference}: {path} cannot be read: {error.strerror}") from error


def _executed(digest: str, file: str, content: bytes, reference: str) -> ModuleType:
    """The module of a file, executed once."""
    name = f"{EXECUTED}{digest}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = file
    sys.modules[name] = module  # classes find their module by its name
    try:
        # what was read, and not bytecode of a file that had the same time and size
        exec(compile(content, file, "exec"), module.__dict__)
    except Exception as error:
        del sys.modules[name]
        raise _not_imported(reference, error) from error
    return module


def _not_imported(reference: str, error: Exception) -> InputError:
    what = " ".join(str(error).split())
    return InputError(f"{reference}: cannot be imported: {type(error).__name__}: {what}")
