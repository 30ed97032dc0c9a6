"""Extension points: options whose value names code of this package, of an installed one or of a user's file.

A value is ``NAME``, ``package.module:NAME`` or ``path/file.py:NAME``, followed by options of the code in
brackets: ``clusters(noise_m=0.02)``. :meth:`ExtensionPoint.pinned` adds ``#`` and a digest of the file or
module and of all that it brings, or ``@`` and the version of the installed package. So a trial's parameters
state all that it depends on, and its id changes with the code.
"""

import contextlib
import functools
import importlib.metadata
import inspect
import re
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from midnet_bench.errors import InputError, MidnetBenchError, nearest_name
from midnet_bench.plugins import (
    EXECUTED,
    Source,
    distributions_of,
    from_source,
    load_reference,
    offered,
    read_module,
    read_source,
    sources,
)
from midnet_bench.settings import Scalar

VALUE = re.compile(r"(?P<place>[^()#@]+)(?:\((?P<options>[^()]*)\))?(?:(?P<mark>[#@])(?P<pin>[\w.+-]+))?")
"""an extension point's value: a place, options and a pin"""
_WORDS: dict[str, Scalar] = {"true": True, "false": False, "null": None}


class PluginError(MidnetBenchError):
    """Code from outside failed, or gave what it must not give. The message names it."""


@dataclass(frozen=True)
class Choice:
    """A seam's value, taken apart."""

    place: str
    """a name, or a reference as :func:`~midnet_bench.plugins.load_reference` takes"""
    options: Mapping[str, Scalar]
    """of the code itself, by name"""
    mark: str = ""
    pin: str = ""

    @property
    def is_file(self) -> bool:
        """Whether ``place`` is a name in a file of the user's."""
        return self.place.rpartition(":")[0].endswith(".py")

    def __str__(self) -> str:
        words = {value: word for word, value in _WORDS.items()}
        said = ", ".join(
            f"{key}={words[value] if value is None or isinstance(value, bool) else value}"
            for key, value in sorted(self.options.items())
        )
        return f"{self.place}({said}){self.mark}{self.pin}" if said else f"{self.place}{self.mark}{self.pin}"


@dataclass(frozen=True)
class ExtensionPoint:
    """An option whose value names code."""

    option: str
    """its flat key, which messages begin with"""
    entry_points: str
    """the group under which installed packages offer theirs"""
    method: str
    """what every class here has"""
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

    def is_own(self, value: str) -> bool:
        """Whether ``value`` names what comes with this package; InputError as :meth:`pinned`."""
        choice = self._parsed(value)
        return choice.place in self.own and not choice.pin

    def pinned(self, value: str) -> str:
        """``value`` in its one spelling, with a digest or version of code that is not this package's.

        Raises:
            InputError: there is no such code, it cannot be imported, a library that it needs is missing, it
                has no such option, or it is not what a pin that was given says.
        """
        choice = self._parsed(value)
        if choice.place in self.own:
            return str(self._without_pin(choice))
        try:
            pinned = self._with_pin(choice)
        except InputError as error:
            raise InputError(f"{self.option}: {error}") from error
        if choice.pin and choice != pinned:
            raise InputError(
                f"{self.option}: {value}: what is here is {pinned}; leave out what follows {choice.mark}"
            )
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

    def _without_pin(self, choice: Choice) -> Choice:
        """A choice of this package's own, checked."""
        said = f"{self.option}: {choice}"
        if choice.pin:
            raise InputError(
                f"{said}: '{choice.place}' comes with midnet-bench; leave out what follows {choice.mark}"
            )
        if (library := self.needs.get(choice.place)) and find_spec(library) is None:
            raise InputError(
                f"{self.option}: {choice.place} needs {library}: pip install 'midnet-bench[{choice.place}]'"
            )
        if self.own[choice.place] is not None:
            if choice.options:  # importing it takes a while
                self._class(choice)
        elif choice.options:
            raise InputError(f"{said}: '{choice.place}' goes by keys; 'midnet-bench parameters' lists them")
        return choice

    def is_made_here(self, value: str) -> bool:
        """Whether ``value`` names what the caller makes."""
        return value in self.own and self.own[value] is None

    @contextlib.contextmanager
    def calling(self, value: str) -> Iterator[None]:
        """Raises PluginError, by its name, if code that ``value`` names fails inside."""
        try:
            yield
        except MidnetBenchError:
            raise
        except Exception as error:
            said = " ".join(str(error).split()) or "without a word"
            if "read-only" in said:  # as NumPy calls it
                said += "; it changes what it is given: work on a copy"
            where = _line_of(value, error)
            raise PluginError(f"{self.option} {value}: {where}{type(error).__name__}: {said}") from error

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

    def _parsed(self, value: str) -> Choice:
        found = VALUE.fullmatch(value.strip())
        if found is None:
            raise InputError(
                f"{self.option}: {value[:80]!r}: expected NAME, package.module:NAME or path/file.py:NAME, "
                "with options as NAME(key=value, key=value)"
            )
        options: dict[str, Scalar] = {}
        for part in filter(None, map(str.strip, (found["options"] or "").split(","))):
            key, equals, text = map(str.strip, part.partition("="))
            if not (equals and key.isidentifier() and text) or key in options:
                raise InputError(
                    f"{self.option}: {value[:80]}: {part!r} is no key=value, or its key is there twice"
                )
            options[key] = _scalar(text)
            if options[key] != options[key]:
                raise InputError(f"{self.option}: {value[:80]}: {key}: a number is needed (got nan)")
        return Choice(found["place"].strip(), options, found["mark"] or "", found["pin"] or "")

    def _with_pin(self, choice: Choice) -> Choice:
        """``choice`` with the pin that it has here; a file by its name alone."""
        if choice.is_file:
            if choice.pin:
                return choice
            file, _, name = choice.place.rpartition(":")
            pin = read_source(Path(file), choice.place)
            return replace(choice, place=f"{Path(file).name}:{name}", mark="#", pin=pin)
        reference = self._reference(choice)
        if digest := read_module(reference):
            return replace(choice, mark="#", pin=digest)
        version = _version(reference)
        return replace(choice, mark="@" if version else "", pin=version)

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
        try:
            if choice.is_file:
                return from_source(choice.pin, choice.place.rpartition(":")[2], str(choice))
            reference = self._reference(choice)
            found = load_reference(reference)
        except InputError as error:
            raise InputError(f"{self.option}: {error}") from error
        if choice.mark == "#" and (loaded := _loaded(reference)) != choice.pin:
            raise InputError(
                f"{self.option}: {choice}: the code that is loaded here is #{loaded}; start a new process"
            )
        return found

    def _class(self, choice: Choice) -> Any:
        found = self._found(choice)
        # of a user's own; of any package's a name that is mistyped would be taken
        if choice.mark == "#" and inspect.isfunction(found) and not hasattr(found, self.method):
            members = {"__init__": lambda self, *arguments: None, self.method: staticmethod(found)}
            found = type(found.__name__, (), members)
        if not callable(found) or not callable(getattr(found, self.method, None)):
            raise InputError(f"{self.option}: {choice}: expected {self.wanted}")
        known = _options_of(found) if choice.options else {}
        for key, given in choice.options.items():
            if key not in known:
                raise InputError(
                    f"{self.option}: {choice}: no option '{key}'{nearest_name(key, list(known))}"
                )
            if choice.place in self.own and isinstance(known[key], int | float) and isinstance(given, str):
                raise InputError(f"{self.option}: {choice}: {key}: a number is needed (got {given!r})")
        return found


def several(value: str) -> list[str]:
    """The values in a list of them, which semicolons part."""
    return [one for one in map(str.strip, value.split(";")) if one]


def _line_of(value: str, error: Exception) -> str:
    """``mine.py:12 in detect: ``, the last line of a plug-in before its error; empty if none."""
    package = value.partition(":")[0].partition(".")[0]
    for frame, line in reversed([*traceback.walk_tb(error.__traceback__)]):
        module = str(frame.f_globals.get("__name__", ""))
        if module.startswith(EXECUTED) or module.partition(".")[0] == package:
            return f"{Path(frame.f_code.co_filename).name}:{line} in {frame.f_code.co_name}: "
    return ""


def code_in(values: Iterable[Scalar]) -> dict[str, Source]:
    """The files that pinned values name, which ``plugins.take_sources`` takes in another process."""
    texts = [VALUE.fullmatch(one) for value in values if isinstance(value, str) for one in several(value)]
    return sources({found["pin"] for found in texts if found is not None and found["mark"] == "#"})


def _options_of(found: Any) -> dict[str, Any]:
    """What may be given by name, behind what is given by position: each parameter and its default."""
    taken = inspect.signature(found).parameters.values()
    return {one.name: one.default for one in taken if one.default is not one.empty}


def _version(reference: str) -> str:
    """Of the installed package that a reference is into; empty for a module that belongs to none."""
    for distribution in distributions_of(reference.partition(":")[0]):
        return importlib.metadata.version(distribution)
    return ""


@functools.cache
def _loaded(reference: str) -> str | None:
    """The digest of a module, about when this process imported it."""
    return read_module(reference)


def _scalar(text: str) -> Scalar:
    """A number, true, false, null, or the text as it stands."""
    if text in _WORDS:
        return _WORDS[text]
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


DETECTORS = ExtensionPoint(
    option="detector",
    entry_points="midnet_bench.detectors",
    method="detect",
    own={
        "midnet": None,
        "subtraction": "midnet_bench.detectors.map_subtraction:MapSubtraction",
        "clusters": "midnet_bench.detectors.clusters:CircleClusters",
        "background": "midnet_bench.detectors.background:RunningMean",
    },
)
"""see ``detectors/detector.py``"""

FUSIONS = ExtensionPoint(
    option="fusion",
    entry_points="midnet_bench.fusions",
    method="fuse",
    own={
        "paper": None,
        "none": "midnet_bench.detectors.alternative_fusions:NoFusion",
        "suppression": "midnet_bench.detectors.alternative_fusions:NonMaximumSuppression",
        "components": "midnet_bench.detectors.alternative_fusions:ConnectedComponents",
        "weighted": "midnet_bench.detectors.alternative_fusions:WeightedBoxes",
        "centres": "midnet_bench.detectors.alternative_fusions:CentreDistance",
        "tracks": "midnet_bench.detectors.alternative_fusions:KalmanTracks",
    },
)
"""see ``detectors/box_fusion.py``"""
