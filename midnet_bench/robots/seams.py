"""Which robots there are, by name; imported on demand."""

from dataclasses import fields, replace
from typing import Any

from midnet_bench.errors import InputError, nearest_name
from midnet_bench.robots.model import RobotModel
from midnet_bench.seams import Choice, ExtensionPoint


class RobotExtensionPoint(ExtensionPoint):
    """Values name a :class:`RobotModel` itself. What stands in brackets replaces its numbers."""

    @property
    def wanted(self) -> str:
        """See :class:`ExtensionPoint`."""
        return "a RobotModel"

    def _class(self, choice: Choice) -> RobotModel:
        found = self._found(choice)
        if not isinstance(found, RobotModel):
            raise InputError(f"{self.option}: {choice}: expected {self.wanted}")
        numbers = [one.name for one in fields(found) if isinstance(getattr(found, one.name), float)]
        for key, value in choice.options.items():
            if key not in numbers:
                raise InputError(f"{self.option}: {choice}: no option '{key}'{nearest_name(key, numbers)}")
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise InputError(f"{self.option}: {choice}: {key}: a number is needed (got {value!r})")
        if found.urdf is not None and (choice.options or choice.place not in self.own):
            found = replace(found, urdf=None)  # the description has the old numbers, or does not travel
        numbers_given: dict[str, Any] = dict(choice.options)
        return replace(found, **numbers_given) if numbers_given else found

    def make(self, value: str, *arguments: Any) -> RobotModel:
        """The robot that ``value``, a pinned one, names."""
        return self._class(self._parsed(value))


ROBOTS = RobotExtensionPoint(
    option="robot",
    entry_points="midnet_bench.robots",
    method="rim_speeds",
    own={"burger": "midnet_bench.robots.burger:BURGER", "waffle": "midnet_bench.robots.waffle:WAFFLE"},
)
"""see ``robots/model.py``"""
