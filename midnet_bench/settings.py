"""Settings said once: default, source, range and help of an option stand at its field, in nested dataclasses.

A settings class is a frozen dataclass of :class:`Settings` in the room of the code that obeys it, its fields
made by :func:`option`. An experiment nests such classes by :func:`group`. The leaves of that tree have flat
keys, such as ``thresh_local``: what a campaign file, ``--set`` and a trial's parameters hold.
"""

import functools
import math
import numbers
import re
import types
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self, Union, cast, get_args, get_origin, get_type_hints

from midnet_bench.errors import InputError, nearest_name

Scalar = str | int | float | bool | None
"""What a flat key or a table cell may hold; NaN stands for an undefined number."""

SOURCES = ("paper", "turtlebot3", "turtlebot3 1.0.0", "package", "ours")
"""What a source begins with, before ``: ``. A default is the first of these that there is: the paper's words;
TurtleBot3's navigation files of release 0.2.1; those of release 1.0.0 where the older value does not work; a
ROS package's default, a data sheet or the robot's Gazebo description; our choice. ``ours: off`` is a choice
that changes nothing unless another option does."""


@dataclass(frozen=True)
class Option:
    """What is said of one option, its default apart."""

    help: str
    """a sentence that stands alone, in the field's words, with the unit if the name does not have it"""
    key: str | None
    """its flat key, before a group's prefix; None: the field's name"""
    ge: float | None
    gt: float | None
    le: float | None
    multiple_of: int | None
    source: str = ""
    """where the default is from, see ``SOURCES``; empty if nothing says so"""

    def __post_init__(self) -> None:
        """Raises ValueError: a source that begins with none of ``SOURCES``."""
        kind, colon, _ = self.source.partition(": ")
        if self.source and not (colon and kind in SOURCES):
            raise ValueError(f"'{self.source}': a source begins with one of: {', '.join(SOURCES)}")

    def holds(self, value: float) -> bool:
        """Whether a number is within range; no NaN is, nor an infinite number."""
        try:
            is_above = math.isfinite(value) and (self.ge is None or value >= self.ge)
        except OverflowError:  # an int that no float can be
            return False
        is_within = (self.gt is None or value > self.gt) and (self.le is None or value <= self.le)
        return is_above and is_within and (self.multiple_of is None or value % self.multiple_of == 0)

    @property
    def allowed(self) -> str:
        """The range in words: ``1 to 100``, ``above 0 and at most 1``, ``0 or more``; empty without any."""
        low, high = self.ge, self.le
        if self.gt is not None:
            words = f"above {_plain(self.gt)}" + (f" and at most {_plain(high)}" if high is not None else "")
        elif low is not None:
            words = f"{_plain(low)} or more" if high is None else f"{_plain(low)} to {_plain(high)}"
        else:
            words = f"at most {_plain(high)}" if high is not None else ""
        multiple = f"a multiple of {self.multiple_of}" if self.multiple_of else ""
        return ", ".join(part for part in (words, multiple) if part)


_NEEDS = re.compile(r"off unless (\w+)=([\w+|]+)")
"""in a source"""


def _plain(value: float) -> str:
    """A bound without an exponent where it is a whole number below a thousand million."""
    return f"{value:.0f}" if abs(value) < 1e9 and value == math.floor(value) else f"{value:g}"


@dataclass(frozen=True)
class _Group:
    title: str
    prefix: str
    keys: Mapping[str, str | None]
    sources: Mapping[str, str]


def option(
    default: Scalar,
    help: str,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
    multiple_of: int | None = None,
    key: str | None = None,
    source: str = "",
) -> Any:
    """A dataclass field with a default, its source, a range and a sentence of help.

    Args:
        default: of the type that the field is annotated with: str, int, float, bool, a Literal, or one of
            these or None.
        help: see :class:`Option`.
        ge: the least number allowed.
        gt: every number allowed is above this one.
        le: the greatest number allowed.
        multiple_of: of an integer.
        key: the flat key if it is not the field's name.
        source: where the default is from: one of ``SOURCES``, then file and key, section, or reason.

    Raises:
        ValueError: a source of another kind.
    """
    return field(default=default, metadata={"option": Option(help, key, ge, gt, le, multiple_of, source)})


def group(
    default: "Settings",
    title: str,
    *,
    prefix: str = "",
    keys: Mapping[str, str | None] | None = None,
    sources: Mapping[str, str] | None = None,
) -> Any:
    """A dataclass field that nests the settings of one concern.

    Args:
        default: an instance, whose values are the defaults here.
        title: what a list of options calls the concern here.
        prefix: stands before the flat keys of all its options.
        keys: field name -> whole flat key for those that differ, None for one that cannot be set here.
        sources: field name -> source of the default here; in a group within this one ``group.field``.
    """
    nested = _Group(title, prefix, dict(keys or {}), dict(sources or {}))
    return field(default=default, metadata={"group": nested})


def like(owner: type["Settings"], name: str, default: Scalar, source: str = "") -> Any:
    """The option ``name`` of the class ``owner`` again, with another default and its source."""
    (found,) = (one for one in fields(cast(Any, owner)) if one.name == name)
    return field(default=default, metadata={"option": replace(found.metadata["option"], source=source)})


class Settings:
    """Base of frozen dataclasses of options: no instance holds a value that is out of its range."""

    concern: ClassVar[str] = "settings"
    """what an error message calls the class"""
    needs: ClassVar[str] = ""
    """``key=value`` without which no option here has an effect; of one option its source says it"""

    def __post_init__(self) -> None:
        """Check every option. Raises InputError: ``concern: name: value is out of range; allowed: ...``."""
        for one, said, kind in _options(cast(Any, type(self))):
            value = getattr(self, one)
            checked = _checked(value, said, kind)
            if checked is _WRONG:
                raise InputError(f"{self.concern}: {one}: {_what_is_wrong(value, said, kind)}")
            if checked is not value:
                object.__setattr__(self, one, checked)

    @classmethod
    def from_flat(cls, values: Mapping[str, Scalar]) -> Self:
        """Settings by flat keys, the defaults for the keys that are not given.

        Raises:
            InputError: an unknown key, or a value that is out of range.
        """
        known = leaves(cls)
        tree: dict[str, Any] = {}
        for key, value in values.items():
            if key not in known:
                raise InputError(f"{key}: unknown key{nearest_name(key, known)}")
            *path, name = known[key].path
            branch = tree
            for step in path:
                branch = branch.setdefault(step, {})
            branch[name] = value
        return cast(Self, _changed(cls.defaults_with(values), tree))

    @classmethod
    def defaults_with(cls, values: Mapping[str, Scalar]) -> Self:
        """The settings with all defaults; a subclass may let some of these go by ``values``, by flat keys."""
        return cls.usual()

    @classmethod
    def usual(cls) -> Self:
        """The settings with all defaults, made and checked once."""
        return cast(Self, _usual(cast(Any, cls)))

    def flat_values(self) -> dict[str, Scalar]:
        """The value of each flat key, in the order of the fields."""
        found: dict[str, Scalar] = {}
        for key, leaf in leaves(type(self)).items():
            found[key] = functools.reduce(getattr, leaf.path, cast(Any, self))
        return found


@dataclass(frozen=True)
class Leaf:
    """One option of a tree of settings."""

    key: str
    path: tuple[str, ...]
    """the attributes that lead to it"""
    option: Option
    kind: Any
    """its type annotation"""
    default: Scalar
    group: str
    """the titles of the groups it is in; empty for the root's own options"""
    needs: tuple[str, str] | None
    """key, or a field beside it, and value without which it has no effect"""

    def is_of_its_kind(self, value: Scalar) -> bool:
        """Whether an option can have this value; of a text, any."""
        base = _without_none(self.kind)
        if base in (bool, int, float) or value is None:
            return _checked(value, self.option, self.kind) is not _WRONG
        return isinstance(value, str) or value in choices_of(self.kind)

    @property
    def allowed(self) -> str:
        """What it may be, in words: the choices or the range, else its type."""
        choices, base = choices_of(self.kind), _without_none(self.kind)
        words = " | ".join(map(str, choices)) or self.option.allowed
        if base is bool:
            words = "true | false"
        if not words:
            words = {str: "text", int: "a whole number", float: "a number"}[base]
        return f"{words}, or null" if base is not self.kind else words


def leaves(settings: type[Settings]) -> Mapping[str, Leaf]:
    """Flat key -> option, of a settings class and of all that is nested in it, in the order of the fields."""
    return _all_leaves(cast(Any, settings))


def without_effect(
    settings: type[Settings], given: Iterable[str], cells: Sequence[Mapping[str, Scalar]]
) -> list[str]:
    """A line for each of the ``given`` keys that has no effect in any of the cells, all keys' values."""
    known = leaves(settings)
    keys = {leaf.path: key for key, leaf in known.items()}
    found = []
    for leaf in (known[key] for key in given if key in known):
        name, value = leaf.needs or ("", "")
        decides = keys.get((*leaf.path[:-1], name), name)
        if decides in known and not any(str(cell[decides]) in value.split("|") for cell in cells):
            found.append(f"{leaf.key} has no effect unless {decides} is {value.replace('|', ' or ')}")
    return found


@functools.cache
def _usual(settings: type[Settings]) -> Settings:
    return settings()


@functools.cache
def _all_leaves(settings: type[Settings]) -> Mapping[str, Leaf]:
    found: dict[str, Leaf] = {}
    for leaf in _leaves(settings, settings.usual(), (), _Group("", "", {}, {})):
        if leaf.key in found:
            raise ValueError(f"{settings.__name__}: two options have the flat key '{leaf.key}'")
        found[leaf.key] = leaf
    return types.MappingProxyType(found)


def choices_of(kind: Any) -> tuple[Any, ...]:
    """The values of a Literal annotation; empty for any other."""
    base = _without_none(kind)
    return get_args(base) if get_origin(base) is Literal else ()


def _leaves(
    settings: type[Settings], defaults: Settings, path: tuple[str, ...], here: _Group, needs: str = ""
) -> list[Leaf]:
    kinds, found, needs = get_type_hints(settings), [], settings.needs or needs
    for one in fields(cast(Any, settings)):
        value, at = getattr(defaults, one.name), (*path, one.name)
        if "option" in one.metadata:
            said: Option = one.metadata["option"]
            if one.name in here.sources:
                said = replace(said, source=here.sources[one.name])
            key = here.keys.get(one.name, here.prefix + (said.key or one.name))
            if key is not None:
                match = _NEEDS.search(f"{said.source} off unless {needs}")
                pair = None if match is None else (match[1], match[2])
                found.append(Leaf(key, at, said, kinds[one.name], value, here.title, pair))
        elif "group" in one.metadata:
            nested: _Group = one.metadata["group"]
            title = ", ".join(part for part in (here.title, nested.title) if part)
            start = f"{one.name}."
            within = {
                name.removeprefix(start): source
                for name, source in here.sources.items()
                if name.startswith(start)
            }
            inner = _Group(title, here.prefix + nested.prefix, nested.keys, {**nested.sources, **within})
            found += _leaves(type(value), value, at, inner, needs)
    return found


def _changed(settings: Settings, tree: Mapping[str, Any]) -> Settings:
    changes = {
        name: _changed(getattr(settings, name), value) if isinstance(value, dict) else value
        for name, value in tree.items()
    }
    return cast(Settings, replace(cast(Any, settings), **changes)) if changes else settings


@functools.cache
def _options(settings: type[Settings]) -> list[tuple[str, Option, Any]]:
    kinds = get_type_hints(settings)
    named: tuple[Field[Any], ...] = fields(cast(Any, settings))
    return [(one.name, one.metadata["option"], kinds[one.name]) for one in named if "option" in one.metadata]


_WRONG = object()


def _checked(value: Any, said: Option, kind: Any) -> Any:
    """``value`` in the type of the annotation, or ``_WRONG``."""
    base = _without_none(kind)
    if value is None and base is not kind:
        return None
    if get_origin(base) is Literal:
        return value if value in get_args(base) else _WRONG
    if base in (bool, str):
        return value if isinstance(value, base) else _WRONG
    wanted = numbers.Integral if base is int else numbers.Real
    if isinstance(value, bool) or not isinstance(value, wanted) or not said.holds(cast(float, value)):
        return _WRONG
    return value if type(value) is base else base(value)


def _what_is_wrong(value: Any, said: Option, kind: Any) -> str:
    choices = choices_of(kind)
    if choices:
        return f"no such choice '{value}'{nearest_name(str(value), choices)}"
    if isinstance(value, numbers.Real) and not isinstance(value, bool) and said.allowed:
        return f"{value} is out of range; allowed: {said.allowed}"
    base = _without_none(kind)
    wanted = {bool: "true or false", str: "a text", int: "a whole number", float: "a finite number"}[base]
    return f"{wanted} is needed (got {value!r})"


def _without_none(kind: Any) -> Any:
    """The annotation without ``| None``."""
    if get_origin(kind) in (Union, types.UnionType):
        (base,) = (one for one in get_args(kind) if one is not type(None))
        return base
    return kind
