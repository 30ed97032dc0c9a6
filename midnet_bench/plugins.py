"""Code by reference (``package.module:NAME``, ``path/file.py:NAME``), and the options whose value names code.

A file that a trial needs is known by a digest of its bytes and of all modules that it imports from no
installed distribution. They travel to the workers with the trial: these may run on another machine, and files
may change while they do. A file finds its neighbours under their own names, whatever the working folder is.

The value of an :class:`ExtensionPoint` is ``NAME`` or a reference, followed by options of the code in
brackets: ``clusters(noise_m=0.02)``. :meth:`ExtensionPoint.pinned` adds ``#`` and a digest of the file or
module and of all that it brings, or ``@`` and the version of the installed package. So a trial's parameters
state all that it depends on, and its id changes with the code.
"""

import ast
import builtins
import contextlib
import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import logging
import os
import pickle
import re
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from importlib.abc import Loader
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import EntryPoint
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

from midnet_bench.errors import InputError, MidnetBenchError, nearest_name
from midnet_bench.settings import Scalar, checked_options

EXECUTED = "midnet_bench_reference_"  # begins the names of modules that are read from a user's file or cell
DIGITS = 12  # of the digests, hexadecimal
FORMS = "expected package.module:NAME or path/file.py:NAME"
VALUE = re.compile(r"(?P<place>[^()#@]+)(?:\((?P<options>[^()]*)\))?(?P<pin>[#@][\w.+-]+)?")
"""an extension point's value: a place, options and a pin"""


class PluginError(MidnetBenchError):
    """Code from outside failed, or gave what it must not give. The message names it."""


class Source(NamedTuple):
    """A file with code, as it was read; a package without ``__init__.py`` is empty."""

    name: str  # what tracebacks call it; of an extension point's file without its folder
    content: bytes
    is_package: bool = True  # what modules import is found inside the file's own
    pickled: bytes = b""
    """of a class or function that is in no file, such as one of a notebook's cell; ``content`` is then its
    source and that of what it calls there"""
    beside: Mapping[str, "Source"] = {}
    """by name, the modules that it imports, and those that they do, of no installed distribution"""

    @property
    def digest(self) -> str:
        """Of all its code; that of the file itself if it brings no more."""
        found = hashlib.sha256(self.content)
        for name, module in sorted(self.beside.items()):
            found.update(f"\n{name} {len(module.content)}\n".encode() + module.content)
        return found.hexdigest()[:DIGITS]


_KNOWN: dict[str, Source] = {}  # digest -> file: those that this process has read, or was handed with a trial
_MADE: dict[str, Any] = {}  # digest -> the class or function that was pickled


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
    module = place
    if place.endswith(".py"):
        source = _source(Path(place), reference)._replace(name=place)
        digest = hashlib.sha256(f"{Path(place).resolve()} {source.digest}".encode()).hexdigest()
        _KNOWN[digest] = source
        module = f"{EXECUTED}{digest}"
    elif not all(part.isidentifier() for part in place.split(".")):
        raise InputError(f"{reference}: {FORMS}")
    return _imported_object(module, name, place, reference)


def later(reference: str) -> Callable[..., Any]:
    """A function that imports the function that ``reference`` names when it is called, and calls it."""

    def call(*arguments: Any, **named: Any) -> Any:
        return load_reference(reference)(*arguments, **named)

    return call


def read_module(reference: str) -> str | None:
    """The digest of a module that a reference is into, and of what it brings; None if it is installed."""
    place = reference.rpartition(":")[0]
    found = _brought(f"import {place}".encode(), [], "", {})
    return Source(place, b"", beside=found).digest if found else None


def _source(path: Path, reference: str) -> Source:
    """A file and what it brings. Raises InputError, which begins with ``reference``: it cannot be read."""
    content = _read(path, reference)
    return Source(path.name, content, beside=_brought(content, [str(path.parent.resolve())], "", {}))


def _read(path: Path, reference: str) -> bytes:
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for
            raise InputError(f"{reference}: {path} is no file; give one with Python code")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{reference}: {path} cannot be read: {error.strerror}") from error


def _brought(content: bytes, folders: list[str], package: str, known: dict[str, Source]) -> dict[str, Source]:
    """``known`` and the modules that ``content`` of ``package`` imports from no installed distribution.

    They are looked for in ``folders`` first.
    """
    for name in _imported(content, package):
        places: list[str] | None = [*folders, *sys.path]
        parts = name.split(".")
        for module in (".".join(parts[: count + 1]) for count in range(len(parts))):
            spec = _spec(module, places)
            if spec is None or _is_installed(spec):
                break
            places = spec.submodule_search_locations
            if module in known:
                continue
            is_package = places is not None
            source = b"" if spec.origin is None else _read(Path(spec.origin), module)
            known[module] = Source(spec.origin or "", source, is_package)
            _brought(source, folders, module if is_package else module.rpartition(".")[0], known)
    return known


def _imported(content: bytes, package: str) -> Iterator[str]:
    """The names of modules that source of ``package`` imports anywhere, and of what it takes out of them."""
    try:
        nodes = [*ast.walk(ast.parse(content))]
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # said when it is executed
        return
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            start = ".".join([*filter(None, above), *filter(None, [node.module])])
            yield from (f"{start}.{one.name}".removeprefix(".") for one in node.names)


def _spec(module: str, places: list[str] | None) -> ModuleSpec | None:
    """Where a module's source is, which is neither Python's nor this package's; None if there is none."""
    if module.partition(".")[0] in {*sys.stdlib_module_names, __package__} or places is None:
        return None
    spec = PathFinder.find_spec(module, [*places])
    if spec is None and "." not in module and module not in sys.modules:
        spec = importlib.util.find_spec(module)  # an editable install may have a finder of its own
    elif spec is None and "." not in module:
        spec = sys.modules[module].__spec__
    return spec if spec is not None and (spec.origin is None or spec.origin.endswith(".py")) else None


def _is_installed(spec: ModuleSpec) -> bool:
    """Whether a distribution has it that is not editable; those lie elsewhere."""
    place = Path(spec.origin or next(iter(spec.submodule_search_locations or []), ""))
    return not {"site-packages", "dist-packages"}.isdisjoint(place.parts) and (
        bool(distributions_of(spec.name)) or "." in spec.name
    )


def distributions_of(module: str) -> list[str]:
    """The installed distributions that a module belongs to."""
    folders = tuple((path, os.stat(path).st_mtime_ns) for path in sys.path if os.path.isdir(path))
    return _distributions(folders).get(module.partition(".")[0], [])


@functools.lru_cache(maxsize=1)  # Python reads a file of every distribution for it, 0.2 s in all
def _distributions(folders: tuple[tuple[str, int], ...]) -> Mapping[str, list[str]]:
    """Of each package its distributions; ``folders``: of modules, and when each was changed last."""
    try:
        return importlib.metadata.packages_distributions()
    except Exception:  # one is damaged: code goes by its digest, whatever it belongs to
        return {}


def offered(group: str) -> list[EntryPoint]:
    """What the installed packages offer in a group; one whose list cannot be read costs itself and a line."""
    try:
        return [*importlib.metadata.entry_points(group=group)]
    except Exception:
        return [point for point in _readable_entry_points() if point.group == group]


@functools.cache
def _readable_entry_points() -> list[EntryPoint]:
    found: dict[str, list[EntryPoint]] = {}
    for one in importlib.metadata.distributions():
        name = getattr(one, "_path", one)
        try:
            found.setdefault(one.metadata["Name"], [*one.entry_points])
        except Exception as error:
            logging.getLogger("midnet_bench").warning(
                "%s: its entry points cannot be read (%s): left out", name, type(error).__name__
            )
    return [point for points in found.values() for point in points]


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
        content = "\n".join(_sources_of(value, set())).encode()
        import cloudpickle

        pickled = cloudpickle.dumps(value)
    except (OSError, TypeError, pickle.PicklingError) as error:
        raise InputError(
            f"{name}: cannot be handed to the workers: {error}; put it into a file and give 'file.py:{name}'"
        ) from error
    digest = hashlib.sha256(content).hexdigest()[:DIGITS]
    file = f"{value.__module__.strip('_')}.py"
    _KNOWN[digest], _MADE[digest] = Source(file, content, pickled=pickled), value
    return f"{file}:{value.__name__}#{digest}"


def _sources_of(value: Any, known: set[str]) -> list[str]:
    """The source of a class or function, of what it uses of its own module, and the digests of modules."""
    if value.__qualname__ in known:
        return []
    known.add(value.__qualname__)
    found = [textwrap.dedent(_source_of(value))]
    members = vars(value).values() if inspect.isclass(value) else [value]
    functions = [getattr(one, "__func__", getattr(one, "fget", one)) for one in members]
    used: list[Any] = [*value.__bases__] if inspect.isclass(value) else []
    for function in filter(inspect.isfunction, functions):
        for name in sorted(_names_in(function.__code__)):
            other = function.__globals__.get(name)
            if isinstance(other, str | int | float | tuple | bool):
                found.append(f"{name} = {other!r}")
            elif inspect.isclass(other) or inspect.isfunction(other) or inspect.ismodule(other):
                used.append(other)
    for other in used:
        module = other.__name__ if inspect.ismodule(other) else other.__module__
        if module == value.__module__:
            found += _sources_of(other, known)
        elif digest := read_module(f"{module}:"):
            found.append(f"{module} = {digest}")
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
    return {*code.co_names}.union(*(_names_in(one) for one in code.co_consts if isinstance(one, CodeType)))


def take_sources(handed: Mapping[str, Source]) -> None:
    """Know files that another process has read."""
    _KNOWN.update(handed)


def code_in(values: Iterable[Scalar]) -> dict[str, Source]:
    """The files that pinned values name, which :func:`take_sources` takes in another process."""
    texts = [VALUE.fullmatch(one) for value in values if isinstance(value, str) for one in several(value)]
    digests = {(found["pin"] or "")[1:] for found in texts if found} & _KNOWN.keys()
    return {digest: _KNOWN[digest] for digest in sorted(digests)}


def several(value: str) -> list[str]:
    """The values in a list of them, which semicolons part."""
    return [one for one in map(str.strip, value.split(";")) if one]


def _imported_object(module: str, name: str, place: str, reference: str) -> Any:
    """``name`` of a module. Raises InputError, which calls the module ``place``."""
    try:
        found = importlib.import_module(module)
    except Exception as error:
        what = " ".join(str(error).split())
        raise InputError(f"{reference}: cannot be imported: {type(error).__name__}: {what}") from error
    if not hasattr(found, name):
        names = [one for one in vars(found) if not one.startswith("_")]
        raise InputError(f"{reference}: no '{name}' in {place}{nearest_name(name, names)}")
    return getattr(found, name)


class _Importer(Loader):
    """Python's finder and loader of what was read: ``EXECUTED`` and the digest, ``.`` and what it brings.

    It runs what was read, and not bytecode of a file that had the same time and size.
    """

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        source = _source_called(name)
        return None if source is None else ModuleSpec(name, self, is_package=source.is_package)

    def exec_module(self, module: ModuleType) -> None:
        """Run the module. What it imports it finds among the modules beside its file first."""
        root = module.__name__.partition(".")[0]
        source, beside = _source_called(module.__name__), _KNOWN[root.removeprefix(EXECUTED)].beside
        assert source is not None

        def find(name: str, *more: Any, **named: Any) -> Any:
            level = named.get("level", more[3] if len(more) > 3 else 0)
            if level or name not in beside:
                return builtins.__import__(name, *more, **named)
            found = builtins.__import__(f"{root}.{name}", *more, **named)
            wants_parts = named.get("fromlist", more[2] if len(more) > 2 else ())
            return found if wants_parts else getattr(found, name.partition(".")[0])

        module.__file__ = source.name
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": find}
        exec(compile(source.content, source.name, "exec"), module.__dict__)


def _source_called(module: str) -> Source | None:
    """What a module is made of that :class:`_Importer` imports; None for any other."""
    root, _, inner = module.partition(".")
    source = _KNOWN.get(root.removeprefix(EXECUTED)) if root.startswith(EXECUTED) else None
    return source if source is None or not inner else source.beside.get(inner)


sys.meta_path.insert(0, _Importer())


class Choice(NamedTuple):
    """An extension point's value, taken apart."""

    place: str  # a name, or a reference as :func:`load_reference` takes
    options: Mapping[str, Scalar]  # of the code itself, by name
    pin: str = ""  # ``#`` and a digest, or ``@`` and a version

    @property
    def is_file(self) -> bool:
        """Whether ``place`` is a name in a file of the user's."""
        return self.place.rpartition(":")[0].endswith(".py")

    def __str__(self) -> str:
        words = {None: "null", True: "true", False: "false"}
        options = ", ".join(
            f"{key}={words[value] if value is None or isinstance(value, bool) else value}"
            for key, value in sorted(self.options.items())
        )
        return f"{self.place}{f'({options})' if options else ''}{self.pin}"


def _pinned_object(choice: Choice) -> Any:
    """What a pinned choice in a file names. Raises InputError: no such file is known, or no such name."""
    digest, (file, _, name) = choice.pin[1:], choice.place.rpartition(":")
    if digest not in _KNOWN:
        raise InputError(f"{choice}: no file with the digest {digest} is known here; give its path")
    if _KNOWN[digest].pickled:
        if digest not in _MADE:
            _MADE[digest] = pickle.loads(_KNOWN[digest].pickled)
        return _MADE[digest]
    if not name.isidentifier():
        raise InputError(f"{choice}: {name[:80]!r} is no name; expected path/file.py:NAME")
    return _imported_object(f"{EXECUTED}{digest}", name, file, str(choice))


@dataclass(frozen=True)
class ExtensionPoint:
    """An option whose value names code."""

    option: str  # its flat key, which messages begin with
    entry_points: str  # the group under which installed packages offer theirs
    method: str  # what every class here has
    own: Mapping[str, str | None]
    """this package's by name: a reference, or None for one that the caller makes"""
    needs: Mapping[str, str] = field(default_factory=dict)
    """by name in ``own``: the module of another library without which it does not run, and which the extra of
    that name installs"""

    @property
    def wanted(self) -> str:
        """What values must name, in words."""
        return f"a class with a method '{self.method}', or a function that does what the method does"

    def names(self) -> list[str]:
        """The names that can be given, this package's first; beside them it takes references."""
        return list(dict.fromkeys([*self.own, *(one.name for one in offered(self.entry_points))]))

    def choices(self, own: str = "your own", **meanings: str) -> str:
        """What can be given, for an option's help: this package's names, and what ``own`` a reference names.

        Args:
            own: what users write, with its article.
            meanings: by name, what is said in brackets behind it.

        Raises:
            ValueError: a meaning of a name that this package does not have.
        """
        if unknown := meanings.keys() - self.own.keys():
            raise ValueError(f"{self.option}: no such names: {', '.join(sorted(unknown))}")
        names = [f"{name} ({meanings[name]})" if name in meanings else name for name in self.own]
        return f"{', '.join(names)}, or {own} as package.module:NAME or file.py:NAME"

    def is_own(self, value: str) -> bool:
        """Whether ``value`` names what comes with this package; InputError as :meth:`pinned`."""
        choice = self._parsed(value)
        return choice.place in self.own and not choice.pin

    def is_made_here(self, value: str) -> bool:
        """Whether ``value`` names what the caller makes."""
        return value in self.own and self.own[value] is None

    def pinned(self, value: str) -> str:
        """``value`` in its one spelling, with a digest or version of code that is not this package's.

        Raises:
            InputError: there is no such code, it cannot be imported, a library that it needs is missing, it
                has no such option, or it is not what a pin that was given says.
        """
        choice = self._parsed(value)
        if choice.place in self.own:
            if choice.pin:
                what = f"'{choice.place}' comes with midnet-bench; leave out what follows {choice.pin[0]}"
                raise self._refusal(choice, what)
            library = self.needs.get(choice.place)
            if library and importlib.util.find_spec(library) is None:
                extra = f"midnet-bench[{choice.place}]"
                raise InputError(f"{self.option}: {choice.place} needs {library}: pip install '{extra}'")
            if choice.options:  # importing it takes a while
                if self.own[choice.place] is None:
                    raise self._refusal(
                        choice, f"'{choice.place}' goes by keys; 'midnet-bench parameters' lists them"
                    )
                self._class(choice)
            return str(choice)
        try:
            pinned = self._with_pin(choice)
        except InputError as error:
            raise InputError(f"{self.option}: {error}") from error
        if choice.pin and choice != pinned:
            raise self._refusal(value, f"what is here is {pinned}; leave out what follows {choice.pin[0]}")
        self._class(pinned)
        return str(pinned)

    def make(self, value: str, *arguments: Any) -> Any:
        """An instance of what ``value``, a pinned one, names, made of ``arguments`` and its options.

        Raises:
            InputError: as :meth:`pinned`.
            PluginError: it cannot be made.
        """
        choice = self._parsed(value)
        made = self._class(choice)
        with self.calling(value):
            return made(*arguments, **choice.options)

    @contextlib.contextmanager
    def calling(self, value: str) -> Iterator[None]:
        """Raises PluginError, by its name, if code that ``value`` names fails inside."""
        try:
            yield
        except MidnetBenchError:
            raise
        except Exception as error:
            what = " ".join(str(error).split()) or "without a word"
            if "read-only" in what:  # as NumPy calls it
                what += "; it changes what it is given: work on a copy"
            where = _line_of(value, error)
            raise PluginError(f"{self.option} {value}: {where}{type(error).__name__}: {what}") from error

    def refused(self, value: str, fault: str) -> PluginError:
        """The error for a wrong result of code that ``value`` names: file, line, and ``fault``."""
        return PluginError(f"{self.option} {value}: {self.line_of(value)}{fault}")

    def line_of(self, value: str) -> str:
        """``mine.py:12: ``, where a user's file defines the method; empty for other code."""
        choice = self._parsed(value)
        code = getattr(getattr(self._class(choice), self.method, None), "__code__", None)
        if not choice.is_file or code is None or Path(code.co_filename).name != choice.place.split(":")[0]:
            return ""
        return f"{Path(code.co_filename).name}:{code.co_firstlineno}: "

    def _refusal(self, value: object, what: str) -> InputError:
        return InputError(f"{self.option}: {value}: {what}")

    def _parsed(self, value: str) -> Choice:
        found = VALUE.fullmatch(value.strip())
        if found is None:
            raise self._refusal(
                repr(value[:80]),
                "expected NAME, package.module:NAME or path/file.py:NAME, "
                "with options as NAME(key=value, key=value)",
            )
        options: dict[str, Scalar] = {}
        for part in filter(None, map(str.strip, (found["options"] or "").split(","))):
            key, equals, text = map(str.strip, part.partition("="))
            if not (equals and key.isidentifier() and text) or key in options:
                raise self._refusal(value[:80], f"{part!r} is no key=value, or its key is there twice")
            options[key] = _scalar(text)
            if options[key] != options[key]:
                raise self._refusal(value[:80], f"{key}: a number is needed (got nan)")
        return Choice(found["place"].strip(), options, found["pin"] or "")

    def _with_pin(self, choice: Choice) -> Choice:
        """``choice`` with the pin that it has here; a file by its name alone."""
        if choice.is_file:
            if choice.pin:
                return choice
            file, _, name = choice.place.rpartition(":")
            source = _source(Path(file), choice.place)
            _KNOWN[source.digest] = source
            return choice._replace(place=f"{source.name}:{name}", pin=f"#{source.digest}")
        reference = self._reference(choice)
        if digest := read_module(reference):
            return choice._replace(pin=f"#{digest}")
        for distribution in distributions_of(reference.partition(":")[0]):
            return choice._replace(pin=f"@{importlib.metadata.version(distribution)}")
        return choice._replace(pin="")

    def _reference(self, choice: Choice) -> str:
        """Of what is in no file."""
        if ":" in choice.place:
            return choice.place
        if (own := self.own.get(choice.place)) is not None:
            return own
        for point in offered(self.entry_points):
            if point.name == choice.place:
                return point.value
        raise InputError(f"unknown name '{choice.place}'{nearest_name(choice.place, self.names())}")

    def _found(self, choice: Choice) -> Any:
        """What a choice names, as it stands there. Raises InputError."""
        try:
            if choice.is_file:
                return _pinned_object(choice)
            reference = self._reference(choice)
            found = load_reference(reference)
        except InputError as error:
            raise InputError(f"{self.option}: {error}") from error
        if choice.pin.startswith("#") and (loaded := f"#{_loaded(reference)}") != choice.pin:
            raise self._refusal(choice, f"the code that is loaded here is {loaded}; start a new process")
        return found

    def _class(self, choice: Choice) -> Any:
        """The class that a choice names, which takes the options that it gives. Raises InputError."""
        found = self._found(choice)
        # of a user's own; of any package's a name that is mistyped would be taken
        if choice.pin.startswith("#") and inspect.isfunction(found) and not hasattr(found, self.method):
            members = {"__init__": lambda self, *arguments: None, self.method: staticmethod(found)}
            found = type(found.__name__, (), members)
        if not callable(found) or not callable(getattr(found, self.method, None)):
            raise self._refusal(choice, f"expected {self.wanted}")
        if choice.options:
            # what may be given by name, behind what is given by position
            given = inspect.signature(found).parameters.values()
            known = {one.name: one.default for one in given if one.default is not one.empty}
            for key in choice.options:
                if key not in known:
                    raise self._refusal(choice, f"no option '{key}'{nearest_name(key, list(known))}")
            if isinstance(found, type) and is_dataclass(found):
                try:
                    checked_options(found, {**known, **choice.options})
                except InputError as error:
                    raise self._refusal(choice, str(error)) from error
        return found


def _line_of(value: str, error: Exception) -> str:
    """``mine.py:12 in detect: ``, the last line of a plug-in before its error; empty if none."""
    package = value.partition(":")[0].partition(".")[0]
    for frame, line in reversed([*traceback.walk_tb(error.__traceback__)]):
        module = str(frame.f_globals.get("__name__", ""))
        if module.startswith(EXECUTED) or module.partition(".")[0] == package:
            return f"{Path(frame.f_code.co_filename).name}:{line} in {frame.f_code.co_name}: "
    return ""


_loaded = functools.cache(read_module)
"""the digest of a module, about when this process imported it"""


def _scalar(text: str) -> Scalar:
    """A number, true, false, null, or the text as it stands."""
    words = {"true": True, "false": False, "null": None}
    if text in words:
        return words[text]
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


DETECTORS = ExtensionPoint(
    option="detector",
    entry_points="midnet_bench.detectors",
    method="detect",
    own={
        "midnet": None,
        "subtraction": "midnet_bench.detectors.baselines:MapSubtraction",
        "clusters": "midnet_bench.detectors.baselines:CircleClusters",
        "background": "midnet_bench.detectors.baselines:RunningMean",
    },
)
FUSIONS = ExtensionPoint(
    option="fusion",
    entry_points="midnet_bench.fusions",
    method="fuse",
    own={
        "paper": None,
        "none": "midnet_bench.detectors.fusions:NoFusion",
        "suppression": "midnet_bench.detectors.fusions:NonMaximumSuppression",
        "components": "midnet_bench.detectors.fusions:ConnectedComponents",
        "weighted": "midnet_bench.detectors.fusions:WeightedBoxes",
        "centres": "midnet_bench.detectors.fusions:CentreDistance",
        "tracks": "midnet_bench.detectors.fusions:KalmanTracks",
    },
)
