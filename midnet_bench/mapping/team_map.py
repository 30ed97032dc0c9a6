"""``TeamMap``: what a team brings home, whether or not its robots know where they started."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.geometry import Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.mapping.merge import MergeSettings, compose, merge_by_features

_HERE = Pose2D(0.0, 0.0, 0.0)


class TeamMap(NamedTuple):
    """One map of several robots' maps."""

    grid: OccupancyGrid
    """int8, -1 unknown, 0 to 100"""
    confidence: float
    """of the features: of the worst pair accepted, of the best if all were refused; NaN without pairs"""
    refusals: list[str]
    """a line for each pair of maps that was not merged, and why"""


def largest(maps: Sequence[OccupancyGrid]) -> OccupancyGrid:
    """The map that knows most cells; the first of several."""
    return max(maps, key=lambda grid: np.count_nonzero(grid.data >= 0))


def by_known_starts(maps: Sequence[OccupancyGrid]) -> TeamMap:
    """The team's map where every robot began its own at its known start: all are in one frame."""
    return TeamMap(compose(maps, [_HERE] * len(maps)), math.nan, [])


def by_features(
    maps: Sequence[OccupancyGrid], starts: Sequence[Pose2D], settings: MergeSettings | None = None
) -> TeamMap:
    """The team's map where no robot knows another's start; the largest single map if merging is refused.

    Each map is handed to the merger in a frame that begins at its robot's start, so that nothing but the
    features can bring them together. The start of the first robot among the merged then lays the result
    into the common frame, so that it can be compared with a true map.

    Args:
        maps: one per robot; int8, in the common frame.
        starts: where each robot started, common frame.
        settings: what is trusted; the defaults if None.
    """
    own = [compose([grid], [start.inverse()]) for grid, start in zip(maps, starts, strict=True)]
    team = merge_by_features(own, settings)
    placed = [(k, placement) for k, placement in enumerate(team.placements) if placement is not None]
    root = starts[placed[0][0]]
    grid = (
        largest(maps)
        if len(placed) == 1
        else compose(
            [maps[k] for k, _ in placed],
            [root.compose(placement).compose(starts[k].inverse()) for k, placement in placed],
        )
    )
    accepted = [match.confidence for match in team.matches.values() if match.placement is not None]
    refused = {pair: match for pair, match in team.matches.items() if match.placement is None}
    best_refused = max((match.confidence for match in refused.values()), default=math.nan)
    refusals = [
        f"the maps of robots {first + 1} and {second + 1} were not merged: {match.refusal}"
        for (first, second), match in refused.items()
    ]
    return TeamMap(grid, min(accepted, default=best_refused), refusals)
