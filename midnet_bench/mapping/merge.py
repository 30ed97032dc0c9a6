"""One map of a team's maps, whether or not the robots know where they started."""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D, mean_point, wrap_angle
from midnet_bench.grid import UNKNOWN, OccupancyGrid, cell_centers, values_at
from midnet_bench.mapping.map_alignment import WallMap, coarse_placements, fit, propose, refine
from midnet_bench.mapping.mapping_settings import MergeSettings

_HERE = Pose2D(0.0, 0.0, 0.0)


class MapMatch(NamedTuple):
    """What came of matching a map against another: a placement, or why there is none."""

    placement: Pose2D | None
    """the second map's frame in the first map's frame; None when refused"""
    refusal: str
    """why not; empty when there is a placement"""
    confidence: float
    """inliers / (8 + 0.3 * matches) of the features; 0 without features"""
    evidence_m: float = 0.0
    """shared wall less weighted contradictions, metres"""


Matches = dict[tuple[int, int], MapMatch]
"""of each pair of a team's maps by their places in the team, the lower one first"""


def match_maps(first: OccupancyGrid, second: OccupancyGrid, settings: MergeSettings) -> MapMatch:
    """Where ``second`` lies in ``first``: a rigid placement, or a refusal with its reason.

    Features propose a placement; the grids improve it and judge it: how much wall they share, how
    much of one's wall stands in the other's open space, and whether the maps would fit elsewhere too.
    A square room fits in four ways, and then none is drawn.

    Not as in multirobot_map_merge: the package accepts a pair whose features agree (confidence >= 1),
    keeps the features' scale in its transform and looks neither at the grids nor for a second solution.

    Args:
        first: int8, -1 unknown, 0 to 100, occupied from 65 on.
        second: the same.
        settings: what is trusted.
    """
    proposal = propose(first, second)
    if proposal is None:
        return MapMatch(None, "too few features match", 0.0)
    if abs(proposal.scale - 1.0) > settings.max_scale_error:
        refusal = f"features want a scale of {proposal.scale:.3f}, not 1"
        return MapMatch(None, refusal, proposal.confidence)

    a, b = WallMap.of(first), WallMap.of(second)
    poses = [refine(a, b, proposal.pose)]
    poses += [refine(a, b, pose) for pose in coarse_placements(a, b, poses[0].yaw)]
    fits = [fit(a, b, pose) for pose in poses]
    evidence = [found.evidence_m(settings.min_agreement) for found in fits]
    best = int(np.argmax(evidence))
    middle = mean_point(b.walls)
    elsewhere = [
        value
        for pose, value in zip(poses, evidence, strict=True)
        if not _same_place(pose, poses[best], Pose2D(float(middle[0]), float(middle[1]), 0.0))
    ]
    rival = max(elsewhere, default=0.0) / evidence[best] if evidence[best] > 0.0 else 0.0
    overlap = evidence[best] / min(a.wall_m, b.wall_m)
    refusal = _refusal(proposal.confidence, fits[best].agreement, overlap, rival, settings)
    placement = None if refusal else poses[best]
    return MapMatch(placement, refusal, proposal.confidence, evidence[best])


def compose(maps: Sequence[OccupancyGrid], placements: Sequence[Pose2D]) -> OccupancyGrid:
    """All maps in one grid that holds them all: the largest value known of each cell, -1 where none is.

    Nearest neighbour and signed maximum, as in multirobot_map_merge: known beats unknown, occupied beats
    free, the order does not matter. Not so the transform: the package puts metres into one of pixels,
    applies the inverse, ignores origins and moves (0, 0) to the middle of the result. Cells have the first
    map's resolution, and lie on its lattice if its placement is not turned, so that a map alone at the
    identity comes back as it is.

    Args:
        maps: at least one; int8, -1 unknown, 0 to 100.
        placements: each map's frame in the result's frame.
    """
    resolution = maps[0].resolution
    corners = np.concatenate(
        [pose.transform(_corners(grid)) for grid, pose in zip(maps, placements, strict=True)]
    )
    anchor = placements[0].transform(np.array([maps[0].origin]))[0]
    low = np.floor((corners.min(axis=0) - anchor) / resolution + 1e-6).astype(int)
    high = np.ceil((corners.max(axis=0) - anchor) / resolution - 1e-6).astype(int)
    origin_x, origin_y = (anchor + low * resolution).tolist()
    width, height = (high - low).tolist()
    merged = OccupancyGrid(np.full((height, width), UNKNOWN, dtype=np.int8), resolution, (origin_x, origin_y))
    for grid, pose in zip(maps, placements, strict=True):
        _draw(grid, pose, merged)
    return merged


def _draw(grid: OccupancyGrid, pose: Pose2D, onto: OccupancyGrid) -> None:
    """Raise the cells of ``onto`` to what ``grid`` says, nearest neighbour."""
    corner = (pose.transform(np.array([grid.origin]))[0] - onto.origin) / onto.resolution
    column, row = np.rint(corner).astype(int).tolist()
    if pose.yaw == 0.0 and grid.resolution == onto.resolution and np.abs(corner - (column, row)).max() < 1e-6:
        cells = onto.data[row : row + grid.height, column : column + grid.width]
        np.maximum(cells, grid.data, out=cells)
        return
    centres = cell_centers(onto, np.ones(onto.data.shape, dtype=np.bool_))
    values = values_at(grid.data, grid, pose.inverse().transform(centres), outside=UNKNOWN)
    np.maximum(onto.data, values.reshape(onto.data.shape), out=onto.data)


def _refusal(
    confidence: float, agreement: float, overlap: float, rival: float, settings: MergeSettings
) -> str:
    """Why a match is not to be trusted; empty if it is."""
    if confidence < settings.min_confidence:
        return f"confidence {confidence:.2f} of the features is below {settings.min_confidence}"
    if agreement < settings.min_agreement:
        return f"agreement {agreement:.2f} of the grids is below {settings.min_agreement}"
    if overlap < settings.min_overlap:
        return f"only {overlap:.0%} of the smaller map's wall is shared, less than {settings.min_overlap:.0%}"
    if rival > settings.max_rival:
        return f"ambiguous: another placement has {rival:.0%} of the best one's evidence"
    return ""


def _same_place(a: Pose2D, b: Pose2D, middle: Pose2D) -> bool:
    """Whether two placements of a map with this middle are one and the same, to 0.3 m and 0.1 rad."""
    apart_m = a.compose(middle).distance_to(b.compose(middle))
    return apart_m < 0.3 and abs(wrap_angle(a.yaw - b.yaw)) < 0.1


def _grow(root: int, links: Sequence[tuple[int, int, Pose2D]]) -> dict[int, Pose2D]:
    """Placements in the root's frame of all maps that links connect to it, strongest links first."""
    placed = {root: Pose2D(0.0, 0.0, 0.0)}
    while True:
        link = next((link for link in links if (link[0] in placed) != (link[1] in placed)), None)
        if link is None:
            return placed
        first, second, step = link
        if first in placed:
            placed[second] = placed[first].compose(step)
        else:
            placed[first] = placed[second].compose(step.inverse())


def _corners(grid: OccupancyGrid) -> npt.NDArray[np.float64]:
    """(4, 2) the outer corners of a grid, metres."""
    x_min, y_min, x_max, y_max = grid.extent
    return np.array([(x_min, y_min), (x_max, y_min), (x_min, y_max), (x_max, y_max)])


def largest(maps: Sequence[OccupancyGrid]) -> OccupancyGrid:
    """The map that knows most cells; the first of several."""
    return max(maps, key=lambda grid: np.count_nonzero(grid.data >= 0))


def by_known_starts(maps: Sequence[OccupancyGrid]) -> OccupancyGrid:
    """The team's map where every robot began its own at its known start: all are in one frame."""
    return compose(maps, [_HERE] * len(maps))


def by_features(
    maps: Sequence[OccupancyGrid], starts: Sequence[Pose2D], settings: MergeSettings
) -> tuple[OccupancyGrid, Matches]:
    """The team's map where no robot knows another's start, and what came of matching every pair.

    Each map is matched in a frame that begins at its robot's start, so that nothing but the features can
    bring them together. The largest group that accepted pairs connect is drawn, each map placed over the
    pairs with the most evidence. Maps outside the group are left out; where every pair is refused, the
    largest single map comes back. The start of the first robot among the merged lays the result into the
    common frame, so that it can be compared with a true map.

    Args:
        maps: one per robot; int8, -1 unknown, 0 to 100, in the common frame.
        starts: where each robot started, common frame.
        settings: what is trusted.
    """
    own = [compose([grid], [start.inverse()]) for grid, start in zip(maps, starts, strict=True)]
    matches = {(i, j): match_maps(own[i], own[j], settings) for i, j in combinations(range(len(maps)), 2)}
    by_evidence = sorted(matches.items(), key=lambda item: (-item[1].evidence_m, item[0]))
    links = [(*pair, match.placement) for pair, match in by_evidence if match.placement is not None]
    placed = max((_grow(root, links) for root in range(len(maps))), key=len)
    if len(placed) == 1:
        return largest(maps), matches
    merged = sorted(placed)
    root = starts[merged[0]]
    placements = [root.compose(placed[k]).compose(starts[k].inverse()) for k in merged]
    return compose([maps[k] for k in merged], placements), matches


def confidence(matches: Matches) -> float:
    """Of the features: of the worst pair accepted, of the best if all were refused; NaN without pairs."""
    accepted = [match.confidence for match in matches.values() if not match.refusal]
    return min(accepted, default=max((match.confidence for match in matches.values()), default=math.nan))


def refusals(matches: Matches) -> list[str]:
    """A line for each pair of maps that was not merged, and why."""
    return [
        f"the maps of robots {first + 1} and {second + 1} were not merged: {match.refusal}"
        for (first, second), match in matches.items()
        if match.refusal
    ]
