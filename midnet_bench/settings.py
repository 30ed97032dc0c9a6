"""Settings stated once: default, range, sentence and source of an option stand at its field, on pydantic.

A settings class is a frozen dataclass of :class:`Settings` in the room of the code that obeys it.
:func:`option` makes a field that users set, :func:`fixed` one that they do not, :func:`inner` one that code
sets. An experiment nests such classes by :func:`group`. The options of that tree have flat keys, such as
``thresh_local``: what a campaign file, ``--set`` and a trial's parameters hold.
"""

import functools
import re
import types
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Self, cast, get_args, get_origin, get_type_hints

from midnet_bench.errors import InputError, nearest_name

if TYPE_CHECKING:
    from pydantic import BaseModel

Scalar = str | int | float | bool | None
"""What a flat key or a table cell may hold; NaN stands for an undefined number."""

SOURCES = ("paper", "turtlebot3", "turtlebot3 1.0.0", "package", "ours")
"""What a source begins with, before ``: ``. A default is the first of these that there is: the paper's words;
TurtleBot3's navigation files of release 0.2.1; those of release 1.0.0 where the older value does not work; a
ROS package's default, a data sheet or the robot's Gazebo description; our choice. ``ours: off`` is a choice
that changes nothing unless another option does."""

_NEEDS = re.compile(r"off unless (\w+)=([\w+|]+)")  # in a source


def option(default: Scalar, help: str, *, source: str = "", key: str | None = None, **limits: float) -> Any:
    """A field that users set.

    Args:
        default: of the type that the field is annotated with: str, int, float, bool, a Literal, or one of
            these or None.
        help: a sentence that stands alone, in the field's words, with the unit if the name does not have it.
        source: where the default is from: one of ``SOURCES``, then file and key, section, or reason.
        key: the flat key, before a group's prefix, if it is not the field's name.
        limits: of a number, as pydantic names them: ``ge``, ``gt``, ``le``, ``multiple_of``.

    Raises:
        ValueError: a source of another kind.
    """
    said = {"help": help, "limits": limits, "key": key, "source": _known(source)}
    return field(default=default, metadata=said)


def fixed(default: Scalar, source: str) -> Any:
    """A field without a flat key: a value that no user turns, with its source. ValueError as for option."""
    return field(default=default, metadata={"source": _known(source)})


def inner(default: Scalar, **limits: float) -> Any:
    """A field without a flat key, which code works out; ``limits`` as of :func:`option`."""
    return field(default=default, metadata={"limits": limits})


def _known(source: str) -> str:
    kind, colon, _ = source.partition(": ")
    if source and not (colon and kind in SOURCES):
        raise ValueError(f"'{source}': a source begins with one of: {', '.join(SOURCES)}")
    return source


class Group(NamedTuple):
    """Settings of one concern inside others."""

    title: str = ""  # what a list of options calls the concern here
    prefix: str = ""  # stands before the flat keys of all its options
    only: tuple[str, ...] | None = None  # the names of the fields that can be set here; None: all options
    sources: Mapping[str, str] = {}
    """field name -> source of the default here; in a group within this one ``group.field``"""


def group(default: "Settings", title: str, **place: Any) -> Any:
    """A field that nests settings with ``default`` values; the rest are the fields of its :class:`Group`."""
    return field(default=default, metadata={"group": Group(title, **place)})


def like(owner: type["Settings"], name: str, default: Scalar, source: str = "") -> Any:
    """The option ``name`` of the class ``owner`` again, with another default and its source."""
    (found,) = (one for one in fields(cast(Any, owner)) if one.name == name)
    return field(default=default, metadata={**found.metadata, "source": _known(source)})


class Settings:
    """Base of frozen dataclasses of options: pydantic checks each value when one is made."""

    def __post_init__(self) -> None:
        """Check every option. Raises InputError: ``class: field: what is wrong``."""
        kind: Any = type(self)
        values = {name: getattr(self, name) for name in _model(kind).model_fields}
        try:
            checked = checked_options(kind, values)
        except InputError as error:
            raise InputError(f"{kind.__name__}: {error}") from error
        for name, value in values.items():
            if (taken := getattr(checked, name)) is not value:
                object.__setattr__(self, name, taken)

    @classmethod
    def from_flat(cls, values: Mapping[str, Scalar]) -> Self:
        """Settings by flat keys, the defaults for the keys that are not given.

        Raises:
            InputError: ``key: what is wrong``; it is unknown, or its value is out of range.
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
        try:
            return cast(Self, _changed(cls.defaults_with(values), tree))
        except InputError as error:  # of a class within, which does not know the flat key
            owner, _, said = str(error).partition(": ")
            name, _, what = said.partition(": ")
            for key in values:
                if (known[key].owner.__name__, known[key].path[-1]) == (owner, name):
                    raise InputError(f"{key}: {what}") from error
            raise

    @classmethod
    def defaults_with(cls, values: Mapping[str, Scalar]) -> Self:
        """The settings with all defaults; a subclass may let some of these go by ``values``, by flat keys."""
        return cls.usual()

    @classmethod
    @functools.cache
    def usual(cls) -> Self:
        """The settings with all defaults, made and checked once."""
        return cls()

    def but(self, **changes: Any) -> Self:
        """The settings with these fields changed, checked; themselves if that changes nothing."""
        return cast(Self, _changed(self, changes))

    def flat_values(self) -> dict[str, Scalar]:
        """The value of each flat key, in the order of the fields."""
        known = leaves(type(self)).items()
        return {key: functools.reduce(getattr, leaf.path, cast(Any, self)) for key, leaf in known}


@dataclass(frozen=True)
class Leaf:
    """One value of a tree of settings."""

    owner: type["Settings"]  # the class that has it
    key: str | None  # None: it cannot be set
    path: tuple[str, ...]  # the attributes that lead to it
    help: str  # what it does, a sentence; empty of one that cannot be set
    limits: Mapping[str, float]  # its range, as pydantic names it
    annotation: Any
    default: Scalar
    source: str  # where the default is from, see ``SOURCES``; empty if nothing says so
    group: str  # the titles of the groups it is in; empty for the root's own options

    @property
    def kind(self) -> Any:
        """Its type annotation without ``| None``; float where whole numbers may stay whole."""
        kind = get_args(self.annotation)[0] if self.takes_none else self.annotation
        return float if kind == int | float else kind

    @property
    def takes_none(self) -> bool:
        """Whether it may be None."""
        return type(None) in get_args(self.annotation)

    @property
    def choices(self) -> tuple[Any, ...]:
        """The values of a Literal annotation; empty for any other."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    @property
    def needs(self) -> tuple[str, str] | None:
        """Key, or a field beside it, and value without which it has no effect, as its source says."""
        found = _NEEDS.search(self.source)
        return None if found is None else (found[1], found[2])

    @property
    def range(self) -> str:
        """The range in words: ``1 to 100``, ``above 0 and at most 1``, ``0 or more``; empty without any."""
        low, above, high, multiple = map(self.limits.get, ("ge", "gt", "le", "multiple_of"))
        if above is not None:
            words = f"above {_plain(above)}" + (f" and at most {_plain(high)}" if high is not None else "")
        elif low is not None:
            words = f"{_plain(low)} or more" if high is None else f"{_plain(low)} to {_plain(high)}"
        else:
            words = f"at most {_plain(high)}" if high is not None else ""
        return ", ".join(filter(None, (words, f"a multiple of {multiple}" if multiple else "")))

    @property
    def allowed(self) -> str:
        """What it may be, in words: the choices or the range, else its type."""
        kinds = {bool: "true | false", str: "text", int: "a whole number", float: "a number"}
        words = " | ".join(map(str, self.choices)) or self.range or kinds[self.kind]
        return f"{words}, or null" if self.takes_none else words

    def allows(self, value: Scalar) -> bool:
        """Whether it may have this value, in its declared type; a text is looked at where it is used."""
        if isinstance(value, str):
            return self.kind not in (bool, int, float)
        if isinstance(value, bool):  # pydantic takes it for the 1 of a Literal
            return self.kind is bool
        model = _model(cast(Any, self.owner))
        try:
            model.__pydantic_validator__.validate_assignment(model.model_construct(), self.path[-1], value)
        except ValueError:
            return False
        return True


def leaves(settings: type[Settings]) -> Mapping[str, Leaf]:
    """Flat key -> option, of a settings class and of all that is nested in it, in the order of the fields."""
    return _leaves(cast(Any, settings))


@functools.cache
def _leaves(settings: type[Settings]) -> Mapping[str, Leaf]:
    found: dict[str, Leaf] = {}
    for leaf in all_values(settings):
        if leaf.key in found:
            raise ValueError(f"{settings.__name__}: two options have the flat key '{leaf.key}'")
        if leaf.key is not None:
            found[leaf.key] = leaf
    return types.MappingProxyType(found)


def all_values(settings: type[Settings]) -> Iterator[Leaf]:
    """The options of a tree of settings, and the values that cannot be set."""
    yield from _walk(settings.usual(), (), Group())


def without_effect(
    settings: type[Settings], given: Iterable[str], cells: Sequence[Mapping[str, Scalar]]
) -> list[str]:
    """A line for each of the ``given`` keys that has no effect in any of the cells, all keys' values."""
    known = leaves(settings)
    keys = {leaf.path: key for key, leaf in known.items()}
    found = []
    for key in given:
        name, value = (known[key].needs if key in known else None) or ("", "")
        decides = keys.get((*known[key].path[:-1], name), name) if name else ""
        if decides in known and not any(str(cell[decides]) in value.split("|") for cell in cells):
            found.append(f"{key} has no effect unless {decides} is {value.replace('|', ' or ')}")
    return found


def checked_options(kind: type, values: Mapping[str, Any]) -> Any:
    """Values as the fields that :func:`option` makes in any dataclass want them, as attributes.

    Raises:
        InputError: ``field: what is wrong``.
    """
    try:
        return _model(kind).model_validate(values)
    except ValueError as error:  # pydantic's, which takes long to import
        first = cast(Any, error).errors()[0]
        raise InputError(f"{first['loc'][0]}: {first['msg']} (got {first['input']!r})") from error


def _plain(value: float) -> str:
    """A bound without an exponent where it is a whole number below a thousand million."""
    return f"{value:.0f}" if abs(value) < 1e9 and value == int(value) else f"{value:g}"


@functools.cache
def _model(settings: type) -> "type[BaseModel]":
    """What checks the options of a class itself, in the types that are declared."""
    from pydantic import ConfigDict, Field, create_model

    kinds = get_type_hints(settings)
    named: Any = {
        one.name: (kinds[one.name], Field(**one.metadata["limits"]))
        for one in fields(cast(Any, settings))
        if "limits" in one.metadata
    }
    checks = ConfigDict(strict=True, allow_inf_nan=False)
    return create_model(settings.__name__, __config__=checks, **named)


def _walk(defaults: Settings, path: tuple[str, ...], here: Group) -> Iterator[Leaf]:
    kinds = get_type_hints(type(defaults))
    for one in fields(cast(Any, defaults)):
        name, said, value = one.name, one.metadata, getattr(defaults, one.name)
        if "source" in said:
            is_open = "limits" in said and (here.only is None or name in here.only)
            key = here.prefix + (said["key"] or name) if is_open else None
            source, help = here.sources.get(name, said["source"]), said.get("help", "")
            limits = said.get("limits", {})
            place = (*path, name)
            yield Leaf(type(defaults), key, place, help, limits, kinds[name], value, source, here.title)
        elif "group" in said:
            inner: Group = said["group"]
            start = f"{name}."
            within = {
                key.removeprefix(start): source
                for key, source in here.sources.items()
                if key.startswith(start)
            }
            title = ", ".join(filter(None, (here.title, inner.title)))
            nested = Group(title, here.prefix + inner.prefix, inner.only, {**inner.sources, **within})
            yield from _walk(value, (*path, name), nested)


def _changed(settings: Settings, tree: Mapping[str, Any]) -> Settings:
    """Settings of which nothing changes stay the same object, which was checked when it was made."""
    changes = {}
    for name, value in tree.items():
        before = getattr(settings, name)
        after = _changed(before, value) if isinstance(value, dict) else value
        if after is not before and not (type(after) is type(before) and after == before):
            changes[name] = after
    return cast(Settings, replace(cast(Any, settings), **changes)) if changes else settings
