"""``TeamPursuit``: a pursuit rule, watched."""

from collections.abc import Mapping, Sequence

import numpy as np

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.pursuit import TargetState
from midnet_bench.agents.settings import PURSUITS
from midnet_bench.grid import OccupancyGrid

WITH_ORACLE = "nearest"
"""the rule that the referee's truth decides for"""


class TeamPursuit:
    """The chosen pursuit rule; what is wrong with it is said by its name."""

    def __init__(self, name: str, prior_map: OccupancyGrid, rng: np.random.Generator) -> None:
        """``name`` is a pinned value of ``PURSUITS``. Raises PluginError if it cannot be made."""
        self._name = name
        self._rule = PURSUITS.make(WITH_ORACLE if PURSUITS.is_made_here(name) else name, prior_map, rng)

    def pursue(
        self, team: Sequence[GuardState], targets: Mapping[int, TargetState], time_s: float
    ) -> dict[int, int]:
        """See :class:`~midnet_bench.agents.pursuit.PursuitRule`.

        Raises:
            PluginError: it failed, or named guards or targets that are not there.
        """
        with PURSUITS.calling(self._name):
            given = self._rule.pursue(team, dict(targets), time_s)
            said = "pursue gave"
            if not isinstance(given, Mapping):
                raise PURSUITS.refused(
                    self._name, f"{said} {type(given).__name__}; give a dict, guards to their targets"
                )
            for guard, target in given.items():
                if guard not in range(len(team)):
                    raise PURSUITS.refused(
                        self._name, f"{said} a guard {guard!r:.40}; there are 0 to {len(team) - 1}"
                    )
                if target not in targets:
                    there = ", ".join(map(str, sorted(targets)[:9]))
                    raise PURSUITS.refused(
                        self._name, f"{said} guard {guard} a target {target!r:.40}; there are {there}"
                    )
            return {int(guard): int(target) for guard, target in given.items()}
